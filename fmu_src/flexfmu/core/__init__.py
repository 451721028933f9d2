"""The core in C, and the one place where Python calls it."""

from .library import Core, StepAnswer, StepLimits

__all__ = ["Core", "StepAnswer", "StepLimits"]
