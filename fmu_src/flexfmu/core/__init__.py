"""The core in C, and the one place where Python calls it."""
