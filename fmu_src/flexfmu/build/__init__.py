"""From a body file to a body."""
