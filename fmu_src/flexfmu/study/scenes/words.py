"""Models, errors and counts in words, for charts, comments and the terminal."""

import math

from ...files.counts import plural
from .candidates import GIVEN, Joints, Reduction
from .measure import Errors

BASES = {"normal": "normal", "residual": "normal + residual", "craig_bampton": "Craig-Bampton"}
"""Bases by the word of a scene file."""
_MODES = {"normal": "normal mode", "residual": "normal mode", "craig_bampton": "mode"}
_STATIC_SHAPES = {"residual": " + residual", "craig_bampton": ", Craig-Bampton"}


def basis_words(reduction: Reduction) -> str:
    """A basis, with the loads whose residual flexibility it has if not all of them."""
    return BASES[reduction.basis.value] + (f" of {', '.join(reduction.residual)}" if reduction.residual else "")


def modes_words(basis: str, modes: int) -> str:
    """A number of modes of a basis."""
    return plural(modes, _MODES.get(basis, "mode")) + _STATIC_SHAPES.get(basis, "")


def frames_words(division: int | Joints) -> str:
    """A division."""
    if not isinstance(division, int):
        return "joints at " + "; ".join(
            f"{', '.join(f'{place:g}' for place in places)} m toward {toward}" for toward, places in division
        )
    return "the body's own frames" if division == GIVEN else plural(division, "frame")


def short(value: float) -> str:
    """A number in three digits at most."""
    if not math.isfinite(value):
        return "no answer"
    return f"{value:.3g}" if abs(value) < 1e4 else f"{value:.2g}"


def times(share: float) -> str:
    """An error over what is accepted."""
    return f"{share:.2g}" if share < 100.0 else f"{share:.0f}" if math.isfinite(share) else "no answer"


def in_percent(found: Errors) -> str:
    """Errors of a model."""
    parts = []
    if not math.isnan(found.static_displacement):
        parts.append(f"static displacement {100.0 * found.static_displacement:.2g} %")
    if not math.isnan(found.transient_displacement):
        parts.append(f"displacement over time {100.0 * found.transient_displacement:.2g} % rms")
    return ", ".join(parts)
