"""Choices in words."""

import math

from ..candidates import GIVEN
from ..config import BasisChoice
from ..measure import Errors
from .trial import Joints, Plan

BASES = {
    BasisChoice.NORMAL: "normal",
    BasisChoice.RESIDUAL: "normal with residual flexibility",
    BasisChoice.CRAIG_BAMPTON: "Craig-Bampton",
}


def basis_words(plan: Plan) -> str:
    """A basis, with the loads whose residual flexibility it has if not all of them."""
    return BASES[plan.basis] + (f" of {', '.join(plan.residual)}" if plan.residual else "")


def frames_words(division: int | Joints) -> str:
    """A division."""
    if not isinstance(division, int):
        return "joints at " + "; ".join(
            f"{', '.join(f'{place:g}' for place in places)} m toward {toward}" for toward, places in division
        )
    return "the body's own frames" if division == GIVEN else f"{division} frame" + ("" if division == 1 else "s")


def short(share: float) -> str:
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
