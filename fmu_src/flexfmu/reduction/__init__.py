"""Modes, interfaces and frames: from finite elements to a few numbers."""
