"""Finite element matrices and sparse factorisation."""
