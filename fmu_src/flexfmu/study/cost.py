"""What a step of a model costs, without FMI; of each method, on the body itself."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.flexible_body import FlexibleBody
from ..body.loads import Loads
from ..files.basics import FloatArray, RuntimeBodyError
from ..files.outputs import Reporter
from ..model.methods import Method, Variant
from ..model.reduced_body import ReducedBody
from ..model.variants import offered_variants
from .pace import Clock, calm_blocks, timed_piece

# Tip motion, relative to the body's size, that the measuring load brings about: bent enough to need its iterations.
_BENT = 0.02


@dataclass(frozen=True, slots=True)
class StepCost:
    """Time of a step of the model without FMI, outputs included.

    Attributes
    ----------
    fastest, median : float
        s, of blocks of steps.
    iterations : float
        Rounds of the implicit iteration a step.
    busy : float
        Time that passed over that of the steps themselves: 1 when the machine was calm.
    """

    fastest: float
    median: float
    iterations: float
    busy: float


def time_steps(model: FlexibleBody, rows: Sequence[FloatArray], step: float) -> StepCost:
    """Time steps of a model from rest, outputs included.

    Parameters
    ----------
    model : FlexibleBody
    rows : sequence of (L,) float
        Loads of each step; a single one holds.
    step : float
        s.

    Returns
    -------
    StepCost

    Raises
    ------
    RuntimeBodyError
        The model has no answer.
    """
    # Two steps, so that whatever is prepared once is there.
    state = model.rest()
    for _ in range(2):
        state, _ = model.step_packed(state, rows[0], step)
    clock = Clock()
    model.step_packed(state, rows[0], step)
    # Every block is the same piece of the scene, from its start.
    piece = timed_piece(rows, clock.elapsed())

    def block() -> tuple[float, float]:
        state, iterations, clock = model.rest(), 0, Clock()
        for inputs in piece:
            state, work = model.step_packed(state, inputs, step)
            model.motion(state)
            iterations += work.iterations
        return clock.elapsed() / len(piece), iterations / len(piece)

    done = calm_blocks(block)
    times = [took for _, (took, _) in done]
    rounds = statistics.mean(iterations for _, (_, iterations) in done)
    return StepCost(min(times), statistics.median(times), rounds, statistics.median(busy for busy, _ in done))


def step_costs(body: ReducedBody, report: Reporter) -> dict[Variant, StepCost]:
    """Time a step of every method whose data the body holds, at the suggested communication step.

    Parameters
    ----------
    body : ReducedBody
    report : Reporter

    Returns
    -------
    dict of Variant to StepCost
    """
    costs = {}
    step = body.suggested_step
    with report.stage(f"Time steps of {step:g} s"):
        loads = _measuring_loads(body).packed(body.masses is not None)
        for variant in offered_variants(body):
            try:
                costs[variant] = time_steps(FlexibleBody(body, variant.method, variant.mass), [loads], step)
            except RuntimeBodyError:
                # Not stable under this load: nothing to time.
                continue
    return costs


def _measuring_loads(body: ReducedBody) -> Loads:
    """Equal forces on all interfaces that move the farthest of them by a small share of the body's size."""
    force = np.ones((body.interface_count, 3))
    linear = FlexibleBody(body, Method.LINEAR)
    unit = Loads(force, np.zeros_like(force))
    moved = float(np.max(np.linalg.norm(linear.response(linear.static(unit)).displacement, axis=1)))
    return unit.scaled(_BENT * body.extent / moved) if moved > 0.0 else unit
