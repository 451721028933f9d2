"""Maps, made by running, of where each method stops working on a body."""
