"""Map of load against communication step, for explicit and implicit evaluation of loads on the moving body."""

import time
from collections.abc import Container, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from ..mesh.model import FloatArray
from ..runtime.body import FlexibleBody
from ..runtime.errors import RuntimeBodyError
from ..runtime.loads import Loads
from ..runtime.reduced_body import Evaluation, Formulation, Kinematics, LoadPlacement, ReducedBody
from ..runtime.stepping import StepLimits
from .config import Map
from .records import Key, Run, Verdict, verdict
from .slave import Aboard, Told
from .subject import Subject, period

# Beyond this error nothing more can come of a run.
_LOST = 3.0
_PLACEMENTS = (LoadPlacement.CORRECTIVE_MOMENT, LoadPlacement.DEFORMED)
_VARIANTS = (
    ("explicit, undamped", Evaluation.EXPLICIT, 0.0),
    ("explicit", Evaluation.EXPLICIT, 1.0),
    ("implicit", Evaluation.IMPLICIT, 1.0),
)
# The reference's internal error, against 1e-4 of what it judges.
_TOLERANCE = 1e-6


def reason_against(subject: Subject) -> str | None:
    """Why the map has no meaning for a body."""
    if subject.config.cut:
        return "the springs that join a cut body's parts are too stiff for explicit evaluation, which is refused"
    if subject.config.free:
        return "a free body under a load that is held flies away: the map is of vibrations"
    return None


@dataclass(frozen=True, slots=True)
class _Cell:
    """A point of the map.

    Attributes
    ----------
    run : Run
        Of which nothing is known yet.
    placement : LoadPlacement
    factor : float
        Of the scene's peak load.
    evaluation : Evaluation
    damping : float
        Scale of the body's.
    count : int
        Steps a period.
    """

    run: Run
    placement: LoadPlacement
    factor: float
    evaluation: Evaluation
    damping: float
    count: int


def _cells(subject: Subject) -> Iterator[_Cell]:
    table = subject.table
    for placement, factor, variant in product(_PLACEMENTS, table.factors, _VARIANTS):
        name, evaluation, damping = variant
        panel = f"{placement.value.replace('_', ' ')}: {name}"
        for count in table.steps_per_period:
            run = subject.blank(Map.EVALUATION, panel, str(count), f"{factor:g}")
            yield _Cell(run, placement, factor, evaluation, damping, count)


def planned(subject: Subject) -> list[Run]:
    """Runs of the whole map, of which nothing is known yet."""
    return [cell.run for cell in _cells(subject)]


def runs(subject: Subject, done: Container[Key]) -> Iterator[Run]:
    """Run what is not `done`, with the body's own frames.

    Parameters
    ----------
    subject : Subject
    done : container of keys

    Yields
    ------
    Run
    """
    body = subject.reduced(formulation=Formulation())
    peak, reader = subject.peak(body), subject.interface(body)
    truth: dict[tuple[LoadPlacement, float, float], FloatArray | None] = {}
    with Aboard(body) as aboard:
        for cell in _cells(subject):
            if cell.run.key in done:
                continue
            inputs, key = cell.factor * peak, (cell.placement, cell.factor, cell.damping)
            if key not in truth:
                truth[key] = _truth(subject, body, cell.placement, cell.damping, inputs, reader)
            parameters = {
                "formulation.loads": cell.placement.value,
                "formulation.evaluation": cell.evaluation.value,
                "damping.scale": cell.damping,
            }
            yield _one(subject, aboard, cell.run, parameters, inputs, cell.count, truth[key], reader)


def _truth(
    subject: Subject, body: ReducedBody, placement: LoadPlacement, damping: float, inputs: FloatArray, reader: int
) -> FloatArray | None:
    """Displacement (n, 3) of an interface at as many points a period as all numbers of steps divide."""
    finest = subject.table.finest
    formulation = Formulation(Kinematics.COROTATED, placement)
    model = FlexibleBody(body, formulation, damping, StepLimits(tolerance=_TOLERANCE))
    state, points = model.rest(), []
    loads = Loads.unpacked(inputs, body.interface_count)
    try:
        for _ in range(round(subject.table.periods * finest)):
            state = model.step(state, loads, period(body) / finest)
            points.append(model.response(state).displacement[reader])
    except RuntimeBodyError:
        return None
    return np.array(points)


def _one(
    subject: Subject,
    aboard: Aboard,
    run: Run,
    parameters: dict[str, float | str],
    inputs: FloatArray,
    count: int,
    truth: FloatArray | None,
    reader: int,
) -> Run:
    start, step = time.perf_counter(), period(aboard.body) / count
    told = Told(aboard, parameters, inputs)
    steps = round(subject.table.periods * count)
    right = None if truth is None else truth[len(truth) // steps - 1 :: len(truth) // steps]
    size = 1.0 if right is None else float(np.sum(right**2))
    off, taken = 0.0, 0
    with np.errstate(all="ignore"):
        while taken < steps and told.step(step):
            taken += 1
            if right is not None:
                off += float(np.sum((told.motion()[reader, 0] - right[taken - 1]) ** 2))
                if not off < _LOST**2 * size and told.warned:
                    break
    error = float("nan") if right is None or not taken else float(np.sqrt(off / size))
    found = verdict(error, told.warned, told.refused, subject.table.tolerance)
    if right is None and found is Verdict.SILENT:
        # With nothing to compare with an answer is at least not known to be wrong.
        found = Verdict.WARNED
    measure = told.real("diagnostics.feed")
    seconds = time.perf_counter() - start
    return Run(*run.key_and_owner, found.value, error, measure, taken, seconds, told.words)
