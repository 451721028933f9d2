"""Bodies that are cut into parts: where, whether, and how the parts are joined."""
