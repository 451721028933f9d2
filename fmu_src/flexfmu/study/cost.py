"""What a step of each method costs, measured on the body itself."""

from dataclasses import dataclass

import numpy as np

from ..body.flexible_body import FlexibleBody
from ..body.loads import Loads
from ..files.progress import Reporter
from ..model.errors import RuntimeBodyError
from ..model.methods import Method, Variant, offered_variants
from ..model.reduced_body import ReducedBody
from .scenes.pace import time_steps

# Tip motion, relative to the body's size, that the measuring load brings about: bent enough to need its iterations.
_BENT = 0.02


@dataclass(frozen=True, slots=True)
class Cost:
    """Time of a step.

    Attributes
    ----------
    variant : Variant
    median, fastest : float
        s, of blocks of steps.
    iterations : float
        Rounds of the implicit iteration per step.
    """

    variant: Variant
    median: float
    fastest: float
    iterations: float


def step_costs(body: ReducedBody, report: Reporter) -> list[Cost]:
    """Time a step of every method whose data the body holds, at the suggested communication step.

    Parameters
    ----------
    body : ReducedBody
    report : Reporter

    Returns
    -------
    list of Cost
    """
    costs = []
    step = body.suggested_step
    with report.stage(f"Time steps of {step:g} s"):
        loads = _measuring_loads(body)
        for variant in offered_variants(body):
            try:
                model = FlexibleBody(body, variant.method, variant.mass)
                cost = time_steps(model, [loads.packed(body.masses is not None)], step)
            except RuntimeBodyError:
                # Not stable under this load: nothing to time.
                continue
            costs.append(Cost(variant, cost.median, cost.fastest, cost.iterations))
    return costs


def _measuring_loads(body: ReducedBody) -> Loads:
    """Equal forces on all interfaces that move the farthest of them by a small share of the body's size."""
    points = np.concatenate([body.interface_point, body.joint_point])
    size = float(np.max(np.ptp(points, axis=0))) or 1.0
    force = np.ones((body.interface_count, 3))
    linear = FlexibleBody(body, Method.LINEAR)
    unit = Loads(force, np.zeros_like(force))
    moved = float(np.max(np.linalg.norm(linear.response(linear.static(unit)).displacement, axis=1)))
    return unit.scaled(_BENT * size / moved) if moved > 0.0 else unit
