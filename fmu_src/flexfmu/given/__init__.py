"""Bodies that other programs reduced."""
