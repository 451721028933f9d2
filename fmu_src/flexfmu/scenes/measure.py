"""How far a model is off in a scene, and what its steps cost."""

import math
import statistics
import time
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.signal import butter, sosfiltfilt

from ..mesh.model import FloatArray
from ..runtime.body import FlexibleBody
from ..runtime.errors import RuntimeBodyError
from ..runtime.loads import Loads
from .config import AcceptedTable
from .reference import Reference, follow
from .scene import Scene, TransientCase

# An interface that moves less than this share of the one that moves farthest is judged by that share.
_FLOOR = 1e-3
_BLOCKS, _SHORTEST_STEPS, _LONGEST_STEPS = 7, 10, 300
# Time that a block of steps may take, s, if that is enough for a few steps.
_BLOCK_TIME = 0.05
_FILTER_ORDER = 4
# A fixed piece of work is done so many times to see how busy the machine is; up to such a slowdown it counts as calm.
_WORK, _CALM = 150, 1.25
# Where it is not, blocks are repeated up to so many, with pauses (s).
_MOST_BLOCKS, _PAUSE = 40, 0.02


@dataclass(frozen=True, slots=True)
class Errors:
    """Error of a model in a scene; infinite where it has no answer, not a number where nothing was compared.

    Attributes
    ----------
    static_displacement, static_rotation : float
        Of the worst interface, case and factor; relative.
    static_rotation_rad : float
        The largest error of a rotation, rad.
    static_at : str
        Where the displacement is worst: case, factor, interface.
    transient_displacement, transient_rotation : float
        rms over time, of the worst interface and case; relative.
    transient_rotation_rad : float
        The largest rms error of a rotation, rad.
    transient_at : str
    share : float
        The largest error over what is accepted there: the scene's tolerance is met up to 1.
    limited_by : str
        Where that is.
    failure : str
        Why there is no answer.
    """

    static_displacement: float = math.nan
    static_rotation: float = math.nan
    static_rotation_rad: float = math.nan
    static_at: str = ""
    transient_displacement: float = math.nan
    transient_rotation: float = math.nan
    transient_rotation_rad: float = math.nan
    transient_at: str = ""
    share: float = math.inf
    limited_by: str = ""
    failure: str = ""


class _Worst:
    """The largest of several errors, and where."""

    def __init__(self) -> None:
        self.relative = {"displacement": math.nan, "rotation": math.nan}
        self.absolute = {"displacement": math.nan, "rotation": math.nan}
        self.at = {"displacement": "", "rotation": ""}
        self.share = 0.0
        self.share_at = ""

    def look(self, kind: str, error: FloatArray, size: FloatArray, accepted: AcceptedTable, where: list[str]) -> None:
        """Take in errors (I,) of motions of sizes (I,)."""
        limit = getattr(accepted, kind)
        absolute = getattr(accepted, f"{kind}_absolute")
        known = np.isfinite(size)
        if not np.any(known) or np.max(size[known]) == 0.0:
            return
        floor = _FLOOR * float(np.max(size[known]))
        for k in np.flatnonzero(known):
            of = max(float(size[k]), floor)
            relative = float(error[k]) / of
            # Not `max`, which a value that is not a number confuses.
            if not relative <= self.relative[kind]:
                self.relative[kind], self.at[kind] = relative, where[k]
            if not error[k] <= self.absolute[kind]:
                self.absolute[kind] = float(error[k])
            if limit is None and absolute == 0.0:
                continue
            share = float(error[k]) / max((limit or 0.0) * of, absolute)
            if share > self.share:
                self.share, self.share_at = share, f"{kind}, {where[k]}"


def errors(scene: Scene, known: dict[str, Reference], model: FlexibleBody) -> Errors:
    """Compare a model with the references of a scene.

    Parameters
    ----------
    scene : Scene
    known : dict of str to Reference
    model : FlexibleBody
        With the interfaces of `scene.config`, or more.

    Returns
    -------
    Errors
    """
    places = [model.model.interface_names.index(name) for name in scene.read]
    fit = partial(_on_interfaces, scene, model)
    static, moving = _Worst(), _Worst()
    try:
        for case in scene.static:
            for factor, expected in zip(case.factors, known[case.name].motion, strict=True):
                found = model.motion(model.static(fit(case.peak.scaled(factor)))).reshape(-1, 6)[places]
                where = [f"{case.name} × {factor:g}, {name}" for name in scene.read]
                for kind, part in (("displacement", slice(0, 3)), ("rotation", slice(3, 6))):
                    error = np.linalg.norm(found[:, part] - expected[:, part], axis=1)
                    size = np.linalg.norm(expected[:, part], axis=1)
                    static.look(kind, error, size, scene.file.tolerance.static, where)
        for transient in scene.transient:
            adapted = TransientCase(
                transient.name,
                transient.step,
                tuple(fit(loads) for loads in transient.start_loads),
                tuple(fit(loads) for loads in transient.end_loads),
                transient.frequencies,
                None,
            )
            motion = follow(model, adapted)[:, places]
            _look_over_time(moving, scene, transient, motion, known[transient.name].motion)
    except RuntimeBodyError as error:
        return Errors(failure=str(error))
    worst = max(static, moving, key=lambda one: one.share)
    return Errors(
        static.relative["displacement"],
        static.relative["rotation"],
        static.absolute["rotation"],
        static.at["displacement"],
        moving.relative["displacement"],
        moving.relative["rotation"],
        moving.absolute["rotation"],
        moving.at["displacement"],
        worst.share,
        worst.share_at,
    )


def _on_interfaces(scene: Scene, model: FlexibleBody, loads: Loads) -> Loads:
    """Loads of the scene's interfaces on those of a model that may have more of them."""
    names = model.model.interface_names
    if names == scene.names:
        return loads
    force, moment = np.zeros((len(names), 3)), np.zeros((len(names), 3))
    for k, name in enumerate(scene.names):
        force[names.index(name)], moment[names.index(name)] = loads.force[k], loads.moment[k]
    return Loads(force, moment, loads.acceleration)


def _look_over_time(worst: _Worst, scene: Scene, case: TransientCase, found: FloatArray, expected: FloatArray) -> None:
    error, size = found - expected, expected
    if case.frequencies is not None:
        error, size = (_within(signal, case.frequencies, case.step) for signal in (error, size))
    where = [f"{case.name}, {name}" for name in scene.read]
    for kind, part in (("displacement", slice(0, 3)), ("rotation", slice(3, 6))):
        rms = [np.sqrt(np.mean(np.sum(signal[:, :, part] ** 2, axis=2), axis=0)) for signal in (error, size)]
        worst.look(kind, rms[0], rms[1], scene.file.tolerance.transient, where)


def _within(signal: FloatArray, band: tuple[float, float], step: float) -> FloatArray:
    """What a signal (T, ...) holds within a range of frequencies (Hz), without shifting it in time."""
    low, high = band
    edges, kind = (high, "lowpass") if low == 0.0 else ((low, high), "bandpass")
    sections = butter(_FILTER_ORDER, edges, kind, fs=1.0 / step, output="sos")
    padding = min(len(signal) - 1, 3 * (2 * len(sections) + 1))
    result: FloatArray = sosfiltfilt(sections, signal, axis=0, padlen=padding)
    return result


@dataclass(frozen=True, slots=True)
class StepCost:
    """Time of a step of the bare model, outputs included.

    Attributes
    ----------
    fastest, median : float
        s, of blocks of steps.
    iterations : float
        Rounds of the implicit iteration a step.
    busy : float
        How much slower than at its best the machine did a fixed piece of work meanwhile: 1 when it was calm.
    """

    fastest: float
    median: float
    iterations: float
    busy: float


class _Pace:
    """How fast the machine does a fixed piece of work, against the fastest that it was seen to do it."""

    def __init__(self) -> None:
        self._best = math.inf
        self._matrix = np.full((8, 8), 0.1)

    def slowdown(self) -> float:
        """Do the work; 1 where it took as long as the fastest time."""
        start = time.perf_counter()
        for _ in range(_WORK):
            self._matrix @ self._matrix
        took = time.perf_counter() - start
        self._best = min(self._best, took)
        return took / self._best


_PACE = _Pace()


def communication_step(scene: Scene, model: FlexibleBody) -> float:
    """Step (s) at which models are timed: that of the scene's first transient, else what the body suggests."""
    return scene.transient[0].step if scene.transient else model.model.suggested_step


def step_cost(scene: Scene, model: FlexibleBody, step: float) -> StepCost:
    """Time steps of a model under the scene's first transient, or half its first static load, suddenly put on.

    Parameters
    ----------
    scene : Scene
    model : FlexibleBody
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
    heavy = model.model.masses is not None
    fit = partial(_on_interfaces, scene, model)
    if scene.transient:
        rows = [fit(loads).packed(heavy) for loads in scene.transient[0].start_loads]
    else:
        rows = [fit(scene.static[0].peak.scaled(0.5)).packed(heavy)]
    # Two steps, so that whatever is prepared once is there.
    state = model.rest()
    for _ in range(2):
        state, _ = model.step_packed(state, rows[0], step)
    start = time.perf_counter()
    state, _ = model.step_packed(state, rows[0], step)
    affordable = math.ceil(_BLOCK_TIME / (time.perf_counter() - start))
    # Every block is the same piece of the scene, from its start.
    piece = rows[:_LONGEST_STEPS] if len(rows) > 1 else rows * _LONGEST_STEPS
    piece = piece[: max(_SHORTEST_STEPS, affordable)]
    count, iterations, steps = len(piece), 0, 0
    times: list[tuple[float, float]] = []
    for _ in range(_MOST_BLOCKS):
        before = _PACE.slowdown()
        state = model.rest()
        start = time.perf_counter()
        for inputs in piece:
            state, work = model.step_packed(state, inputs, step)
            model.motion(state)
            iterations += work.iterations
        took = (time.perf_counter() - start) / count
        steps += count
        times.append((max(before, _PACE.slowdown()), took))
        if times[-1][0] > _CALM:
            # Someone else is at work: wait a little.
            time.sleep(_PAUSE)
        elif sum(busy <= _CALM for busy, _ in times) == _BLOCKS:
            break
    # The calmest blocks count.
    times = sorted(times)[:_BLOCKS]
    took_all = [took for _, took in times]
    return StepCost(
        min(took_all), statistics.median(took_all), iterations / steps, statistics.median(b for b, _ in times)
    )
