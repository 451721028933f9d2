"""Thin bodies bent far, through the FMU, beside CalculiX."""
