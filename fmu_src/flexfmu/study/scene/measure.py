"""How far a model is off in a scene."""

import math
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.signal import butter, sosfiltfilt

from ...body.flexible_body import FlexibleBody
from ...body.loads import Loads
from ...files.array_types import FloatArray
from ...model.errors import RuntimeBodyError
from .config import AcceptedTable
from .reference import Reference, follow
from .scene import Scene, StaticCase, TransientCase

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


def errors(scene: Scene, known: dict[str, Reference], model: FlexibleBody) -> SceneErrors:
    """Compare a model with the references of a scene.

    Parameters
    ----------
    scene : Scene
    known : dict of str to Reference
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
            motion = follow(model, replace(transient, start_loads=start, end_loads=end))[:, places]
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
        size = np.linalg.norm(expected[:, part], axis=1)
        worst.look(kind, error, size, scene.file.tolerance.static, where)


def _look_over_time(worst: _Worst, scene: Scene, case: TransientCase, found: FloatArray, expected: FloatArray) -> None:
    error, size = found - expected, expected
    if case.frequencies is not None:
        error, size = (within(signal, case.frequencies, case.step) for signal in (error, size))
    where = [f"{case.name}, {name}" for name in scene.read]
    for kind, part in _KINDS.items():
        rms = [np.sqrt(np.mean(np.sum(signal[:, :, part] ** 2, axis=2), axis=0)) for signal in (error, size)]
        worst.look(kind, rms[0], rms[1], scene.file.tolerance.transient, where)


def within(signal: FloatArray, band: tuple[float, float], step: float) -> FloatArray:
    """What a signal (T, ...) holds within a range of frequencies (Hz), without shifting it in time."""
    low, high = band
    edges, kind = (high, "lowpass") if low == 0.0 else ((low, high), "bandpass")
    sections = butter(_FILTER_ORDER, edges, kind, fs=1.0 / step, output="sos")
    padding = min(len(signal) - 1, 3 * (2 * len(sections) + 1))
    return sosfiltfilt(sections, signal, axis=0, padlen=padding)
