"""Readers of Ansys archives, Exodus and meshes of other programs."""
