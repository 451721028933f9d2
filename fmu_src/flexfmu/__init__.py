"""Finite element models of flexible bodies as FMI 2.0 co-simulation FMUs that stay right when the body bends far."""

from importlib.metadata import version

__version__ = version("flexfmu")
