"""A body that runs: the Python face of the core."""
