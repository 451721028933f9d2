"""Benchmarks of the field: published problems, our error and what it costs."""
