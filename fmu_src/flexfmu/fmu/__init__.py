"""FMU packaging and driving (build and master side)."""
