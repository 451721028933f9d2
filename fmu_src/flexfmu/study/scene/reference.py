"""What the motion of a scene is, and how far a model is off it.

It is from the whole finite element model, a tight reduced one, or the user.
"""

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...body.flexible_body import FlexibleBody, State, StepLimits
from ...body.loads import Loads
from ...build.config import BodyFile
from ...build.reduce import reduce_body
from ...build.tables import FormulationTable, ReductionTable
from ...files.basics import MOST_FRAMES, EquilibriumError, FloatArray, RuntimeBodyError, StepError
from ...files.outputs import Reporter, Stages, Tell, tell_nobody
from ...files.store import Store, content_key
from ...model.methods import Mass, Method
from .config import AcceptedTable, SceneError
from .scene import Scene, StaticCase, TransientCase, read_results
from .whole_model import Equilibria, WholeModel

# A factor in a table of results counts as one of the scene's within this.
_SAME = 1e-9
# Error of a reference in statics over what is accepted over time that is worth a warning.
_DOUBTFUL = 0.33
# Frames of the model that static cases are compared with, at least; for each frame of the largest that is tried.
_FINE, _FINER = 16, 2


@dataclass(frozen=True, slots=True)
class Reference:
    """Motion of the interfaces that count.

    Attributes
    ----------
    motion : (rows, interfaces, 6) float
        Displacement (m) and rotation vector (rad) at each factor or communication point; not a number where nothing
        is known.
    origin : str
        Where it comes from, in words.
    whole : Equilibria or None
        Of the finite element model: what it took.
    equilibria : int
        Of results that were brought: rows that are loaded.
    doubt : float
        Of a reduced model: its own relative error in the scene's static cases, where the finite element model tells.
    """

    motion: FloatArray
    origin: str
    whole: Equilibria | None = None
    equilibria: int = 0
    doubt: float = math.nan


def references(
    scene: Scene, report: Reporter, store: Store | None = None, whole: WholeModel | None = None, solve: bool = True
) -> dict[str, Reference]:
    """Find the motion of every case.

    Parameters
    ----------
    scene : Scene
    report : Reporter
    store : Store, optional
        Where results are kept from run to run, by content.
    whole : WholeModel, optional
        The finite element model, where others need it too.
    solve : bool
        Whether it is solved for static cases without results; else a fine reduced model is.

    Returns
    -------
    dict of str to Reference
        By the name of the case.

    Raises
    ------
    SceneError
        A case that the finite element model cannot follow, and for which the user brings no results.
    """
    store = store or Store()
    whole = whole or WholeModel(scene, report, store)
    found = {} if solve else _by_fine_model(scene, report, store)
    for case in scene.static:
        if case.results is None and solve:
            solved = whole.equilibria(case)
            words = f"finite element model, {len(whole.model.mesh.points)} nodes, geometric nonlinearity"
            found[case.name] = Reference(solved.motion, words, solved)
        elif case.results is not None:
            found[case.name] = _brought_static(scene, case, case.results)
    for motion in scene.transient:
        if motion.results is None:
            found[motion.name] = _tight_model(scene, motion, found, report, store)
        else:
            found[motion.name] = _brought_transient(scene, motion, motion.results)
    return found


def _brought_static(scene: Scene, case: StaticCase, path: Path) -> Reference:
    factors, motion = read_results(path, "factor", scene.read)
    rows = []
    for factor in case.factors:
        near = np.flatnonzero(np.abs(factors - factor) <= _SAME * max(1.0, factor))
        if not near.size:
            raise SceneError(f"{path}: no row for the factor {factor} of {case.name}; it has {factors.tolist()}")
        rows.append(near[-1])
    return Reference(_complete(motion[rows], path), path.name, equilibria=int(np.sum(factors > 0.0)))


def _brought_transient(scene: Scene, case: TransientCase, path: Path) -> Reference:
    times, motion = read_results(path, "time", scene.read)
    if np.any(np.diff(times) <= 0.0) or times[0] > _SAME or times[-1] < case.time[-1] * (1.0 - _SAME):
        found = f"{path}: times go from {times[0]} s to {times[-1]} s"
        raise SceneError(f"{found}, expected them to ascend from 0 to at least {case.time[-1]:g} s")
    at = np.column_stack([np.interp(case.time, times, column) for column in motion.reshape(len(times), -1).T])
    return Reference(_complete(at.reshape(len(at), *motion.shape[1:]), path), path.name)


def _complete(motion: FloatArray, path: Path) -> FloatArray:
    if np.all(np.isnan(motion)):
        raise SceneError(f"{path}: no column is an output of an interface that the scene reads")
    return motion


def by_default(config: BodyFile, mass: Mass | None = None, modes: int | None = None, error: bool = True) -> BodyFile:
    """A body file that says nothing of basis, frames and method, without pictures; `error`: with its error."""
    method = FormulationTable(method=None if mass is None else Method.SECOND_ORDER, mass=mass)
    reduction = ReductionTable() if modes is None else ReductionTable(modes=modes)
    usual: dict[str, object] = {"frames": None, "frame": [], "branch": [], "reduction": reduction}
    plain = config.certified if error else config.without_pictures
    return plain.model_copy(update=usual | {"formulation": method})


def _by_fine_model(scene: Scene, report: Reporter, store: Store) -> dict[str, Reference]:
    """Static cases without results by a model with more shapes and frames than any that will be delivered."""
    cases = [case for case in scene.static if case.results is None]
    if not cases:
        return {}
    levels = min(max(_FINER * max(scene.file.sweep.frames), _FINE), MOST_FRAMES)
    fine = by_default(scene.config, Mass.CONSTANT)

    def run() -> dict[str, FloatArray]:
        with report.stage(f"Reduce the body with {levels} frames and all static shapes, to compare with"):
            model = FlexibleBody(reduce_body(fine, Stages(report), store, levels))
        found: dict[str, FloatArray] = {}
        doubt = 0.0
        for number, case in enumerate(cases):
            rows = []
            for factor in case.factors:
                loads = case.peak.scaled(factor)
                try:
                    state = model.static(loads)
                except EquilibriumError as error:
                    fault = f"{case.name} × {factor:g}: the reduced model to compare with has no equilibrium: {error}"
                    raise SceneError(f"{fault}; lower the load, or bring results") from error
                rows.append(model.motion(state).reshape(-1, 6))
                doubt = max(doubt, model.error(state, loads).relative)
            found[str(number)] = np.array(rows)
        return found | {"doubt": np.array(doubt)}

    loads = [part for case in cases for part in (case.peak.packed(True), np.array(case.factors))]
    kept = store.arrays(_key(fine, "scene static", levels, *loads), "reference equilibria", report, run)
    doubt, accepted = float(kept["doubt"]), scene.file.tolerance.static
    _tell_doubt("the model to compare with", doubt, accepted, "take --verify, or bring results", report)
    words = f"reduced model, frames = {levels}, second order, all static shapes"
    return {
        case.name: Reference(kept[str(number)][:, scene.read_index], words, doubt=doubt)
        for number, case in enumerate(cases)
    }


def _tell_doubt(who: str, doubt: float, accepted: AcceptedTable, advice: str, report: Reporter) -> None:
    """Say how far a model that others are compared with is off, and whether that is much beside what is accepted."""
    found = f"{who} is off by {100.0 * doubt:.2g} % in the static cases"
    if not math.isnan(doubt):
        report.note(found)
    if doubt > _DOUBTFUL * accepted.displacement:
        report.warning(f"{found}, where {100.0 * accepted.displacement:g} % are accepted: {advice}")


def _key(config: BodyFile, kind: str, *values: object) -> str:
    """Key of what a body under some loads is found to do."""
    mesh = hashlib.sha256(Path(config.mesh.file).read_bytes()).hexdigest()
    return content_key(__name__, kind, mesh, config.model_dump_json(exclude={"mesh": {"file"}}), *values)


def _tight_model(
    scene: Scene, case: TransientCase, known: Mapping[str, Reference], report: Reporter, store: Store
) -> Reference:
    """Motion of a model with more modes and frames than any that will be delivered."""
    settings = scene.file.reference
    mass = Mass.CONSTANT if scene.config.cut else settings.mass
    tight = by_default(scene.config, mass, settings.modes, error=False)

    def run() -> dict[str, FloatArray]:
        with report.stage(f"Reduce the body with {settings.frames} frames, to follow {case.name} with"):
            body = reduce_body(tight, Stages(report), store, settings.frames)
        model = FlexibleBody(body, limits=StepLimits(tolerance=settings.tolerance))
        steps = len(case.start_loads)
        title = f"Follow {case.name} with {body.mode_count} modes and {body.frame_count} frames, {steps} steps"
        with report.counted(title, steps, "steps") as tell:
            try:
                still = errors(replace(scene, transient=()), known, model)
                doubt = math.inf if still.failure else still.static_displacement
                return {"motion": follow(model, case, tell), "doubt": np.array(doubt)}
            except StepError as error:
                found = f"{case.name}: the reference model refuses a step: {error}"
                raise SceneError(f"{found}; take other numbers in [reference], or bring results") from error

    start = np.array([loads.packed(True) for loads in case.start_loads])
    end = np.array([loads.packed(True) for loads in case.end_loads])
    statics = [part for one in scene.static for part in (one.peak.packed(True), known[one.name].motion)]
    key = _key(tight, "scene transient", settings.frames, settings.tolerance, case.step, start, end, *statics)
    kept = store.arrays(key, f"reference motion under {case.name}", report, run)
    doubt, advice = float(kept["doubt"]), "give [reference] more modes or frames, or bring results"
    _tell_doubt(f"the reference model of {case.name}", doubt, scene.file.tolerance.transient, advice, report)
    words = f"reduced model, {settings.modes} modes and static shapes, frames = {settings.frames}, mass {mass.value}"
    return Reference(kept["motion"][:, scene.read_index], words, doubt=doubt)


def follow(model: FlexibleBody, case: TransientCase, tell: Tell = tell_nobody) -> FloatArray:
    """Motion (steps + 1, I, 6) of all interfaces from rest through a transient.

    Parameters
    ----------
    model : FlexibleBody
    case : TransientCase
    tell : callable, optional
        Takes the number of steps done.

    Raises
    ------
    StepError
    """
    rows = []
    for done, state in enumerate(states_through(model, case)):
        rows.append(model.motion(state))
        tell(done)
    return np.array(rows).reshape(len(rows), -1, 6)


def states_through(model: FlexibleBody, case: TransientCase) -> Iterator[State]:
    """States of a model from rest through a transient, one a communication point; it may raise a StepError."""
    heavy = model.model.masses is not None
    state = model.rest()
    yield state
    for start, end in zip(case.start_loads, case.end_loads, strict=True):
        first, last = start.packed(heavy), end.packed(heavy)
        state, _ = model.step_packed(state, first, case.step, None if np.array_equal(first, last) else last)
        yield state


# An interface that moves less than this share of the one that moves farthest is judged by that share.
_FLOOR = 1e-3
_FILTER_ORDER = 4
# Their places among the six components of a motion.
_KINDS = {"displacement": slice(0, 3), "rotation": slice(3, 6)}


@dataclass(frozen=True, slots=True)
class SceneErrors:
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

    @property
    def columns(self) -> dict[str, Any]:
        """All but the failure, by the names of a record's columns."""
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name != "failure"}


class _Worst:
    """The largest of several errors, and where."""

    def __init__(self) -> None:
        self.relative = dict.fromkeys(_KINDS, math.nan)
        self.absolute = dict.fromkeys(_KINDS, math.nan)
        self.at = dict.fromkeys(_KINDS, "")
        self.share = 0.0
        self.share_at = ""

    @property
    def told(self) -> tuple[float, float, float, str]:
        """Displacement and rotation, relative, rotation in rad, and where the displacement is worst."""
        relative = self.relative
        return relative["displacement"], relative["rotation"], self.absolute["rotation"], self.at["displacement"]

    def look(self, kind: str, error: FloatArray, size: FloatArray, accepted: AcceptedTable, where: list[str]) -> None:
        """Take in errors (I,) of motions of sizes (I,)."""
        limit, absolute = getattr(accepted, kind) or 0.0, getattr(accepted, f"{kind}_absolute")
        known = np.flatnonzero(np.isfinite(size))
        if not size[known].any():
            return
        of = np.maximum(size, _FLOOR * size[known].max())
        for k in known.tolist():
            # Not `max`, which a value that is not a number confuses.
            if not error[k] / of[k] <= self.relative[kind]:
                self.relative[kind], self.at[kind] = float(error[k] / of[k]), where[k]
            if not error[k] <= self.absolute[kind]:
                self.absolute[kind] = float(error[k])
            # Without either nothing is asked of this kind.
            share = float(error[k] / max(limit * of[k], absolute)) if limit or absolute else 0.0
            if share > self.share:
                self.share, self.share_at = share, f"{kind}, {where[k]}"


def errors(scene: Scene, known: Mapping[str, Reference], model: FlexibleBody) -> SceneErrors:
    """Compare a model with the references of a scene.

    Parameters
    ----------
    scene : Scene
    known : mapping of str to Reference
    model : FlexibleBody
        With the interfaces of `scene.config`, or more.

    Returns
    -------
    SceneErrors
    """
    places = [model.model.interface_names.index(name) for name in scene.read]
    fit = partial(on_interfaces, scene, model)
    static, moving = _Worst(), _Worst()
    try:
        for case in scene.static:
            for factor, expected in zip(case.factors, known[case.name].motion, strict=True):
                found = model.motion(model.static(fit(case.peak.scaled(factor)))).reshape(-1, 6)[places]
                _look_at_rest(static, scene, case, factor, found, expected)
        for transient in scene.transient:
            start, end = tuple(map(fit, transient.start_loads)), tuple(map(fit, transient.end_loads))
            motion = follow(model, transient.model_copy(update={"start_loads": start, "end_loads": end}))[:, places]
            _look_over_time(moving, scene, transient, motion, known[transient.name].motion)
    except RuntimeBodyError as error:
        return SceneErrors(failure=str(error))
    worst = max(static, moving, key=lambda one: one.share)
    return SceneErrors(*static.told, *moving.told, worst.share, worst.share_at)


def equilibria_errors(scene: Scene, case: StaticCase, motion: FloatArray, known: Reference) -> SceneErrors:
    """Compare equilibria that were found otherwise with the reference of a static case.

    Parameters
    ----------
    scene : Scene
    case : StaticCase
    motion : (factors, interfaces, 6) float
        Of the interfaces that count: displacement (m), rotation vector (rad).
    known : Reference

    Returns
    -------
    SceneErrors
    """
    worst = _Worst()
    for factor, found, expected in zip(case.factors, motion, known.motion, strict=True):
        _look_at_rest(worst, scene, case, factor, found, expected)
    return SceneErrors(*worst.told, share=worst.share, limited_by=worst.share_at)


def on_interfaces(scene: Scene, model: FlexibleBody, loads: Loads) -> Loads:
    """Loads of the scene's interfaces on those of a model that may have more of them; other interfaces bear none."""
    names = model.model.interface_names
    if names == scene.names:
        return loads
    force, moment = np.zeros((len(names), 3)), np.zeros((len(names), 3))
    for k, name in enumerate(scene.names):
        force[names.index(name)], moment[names.index(name)] = loads.force[k], loads.moment[k]
    return Loads(force, moment, loads.acceleration)


def _look_at_rest(
    worst: _Worst, scene: Scene, case: StaticCase, factor: float, found: FloatArray, expected: FloatArray
) -> None:
    where = [f"{case.name} × {factor:g}, {name}" for name in scene.read]
    for kind, part in _KINDS.items():
        error = np.linalg.norm(found[:, part] - expected[:, part], axis=1)
        worst.look(kind, error, np.linalg.norm(expected[:, part], axis=1), scene.file.tolerance.static, where)


def _look_over_time(worst: _Worst, scene: Scene, case: TransientCase, found: FloatArray, expected: FloatArray) -> None:
    error, size = found - expected, expected
    if case.frequencies is not None:
        error, size = (within(signal, case.frequencies, case.step) for signal in (error, size))
    where = [f"{case.name}, {name}" for name in scene.read]
    for kind, part in _KINDS.items():
        rms = [np.sqrt(np.mean(np.sum(signal[:, :, part] ** 2, axis=2), axis=0)) for signal in (error, size)]
        worst.look(kind, rms[0], rms[1], scene.file.tolerance.transient, where)


def within(signal: FloatArray, band: Sequence[float], step: float) -> FloatArray:
    """What a signal (T, ...) holds within a range of frequencies (Hz), without shifting it in time."""
    # Imported where needed: it takes 0.7 s.
    from scipy.signal import butter, sosfiltfilt

    low, high = band
    edges, kind = (high, "lowpass") if low == 0.0 else ((low, high), "bandpass")
    sections = butter(_FILTER_ORDER, edges, kind, fs=1.0 / step, output="sos")
    return sosfiltfilt(sections, signal, axis=0, padlen=min(len(signal) - 1, 3 * (2 * len(sections) + 1)))
