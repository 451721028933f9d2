"""The core in C, and the one place where Python calls it."""

from .library import Core, StepWork

__all__ = ["Core", "StepWork"]
