"""Finite element models of flexible bodies as FMI 2.0 co-simulation FMUs."""
