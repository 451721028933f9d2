"""A scene: a body and what happens to it, resolved and checked against each other."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import InstanceOf

from ...body.loads import Loads, load_names
from ...build.config import BodyFile, read_body_file
from ...files.basics import FloatArray
from ...files.tables import Kind, check_input, read_table
from ...program.variable_table import ACCELERATION
from .config import SceneError, SceneFile, StaticTable, TransientTable, check_steps, read_scene_file

AXES = ("x", "y", "z")
MOTION = ("displacement", "rotation")
# Relative change of a step that brings the end of a transient onto a communication point.
_ROUNDING = 1e-9


class StaticCase(StaticTable):
    """Loads that hold still: what the scene file says of them, and their peak as the body takes it."""

    peak: InstanceOf[Loads]


class TransientCase(TransientTable):
    """Motion from rest: what the scene file says of it, and the loads at the start and at the end of each step.

    Within a step loads are linear.
    """

    start_loads: tuple[InstanceOf[Loads], ...]
    end_loads: tuple[InstanceOf[Loads], ...]

    @property
    def time(self) -> FloatArray:
        """Communication points, s."""
        return np.linspace(0.0, self.step * len(self.start_loads), len(self.start_loads) + 1)


@dataclass(frozen=True, slots=True)
class Scene:
    """A scene.

    Attributes
    ----------
    file : SceneFile
    body : Path
        Body file.
    given : BodyFile
        The body as the user has it.
    config : BodyFile
        The same with no more interfaces than the scene loads or reads.
    read : tuple of str
        Interfaces whose motion counts.
    static : tuple of StaticCase
    transient : tuple of TransientCase
    digest : str
        Hash of all that errors depend on beside the model.
    """

    file: SceneFile
    body: Path
    given: BodyFile
    config: BodyFile
    read: tuple[str, ...]
    static: tuple[StaticCase, ...]
    transient: tuple[TransientCase, ...]
    digest: str

    @property
    def names(self) -> tuple[str, ...]:
        """Interfaces of `config`, in its order."""
        return tuple(table.name for table in self.config.interface)

    @property
    def timing_loads(self) -> tuple[Loads, ...]:
        """Loads of steps that are timed: the first transient's, or half the first static load, suddenly put on."""
        return self.transient[0].start_loads if self.transient else (self.static[0].peak.scaled(0.5),)

    @property
    def read_index(self) -> list[int]:
        """Places of the interfaces that count among `names`."""
        return [self.names.index(name) for name in self.read]


def read_scene(path: Path, body: Path) -> Scene:
    """Read a scene file and a body file, and check one against the other.

    Parameters
    ----------
    path : Path
        Scene file.
    body : Path
        Body file.

    Returns
    -------
    Scene

    Raises
    ------
    SceneError, BodyFileError
        With what was found, what was expected and what to do.
    """
    return made_scene(read_scene_file(path), path, body)


def made_scene(file: SceneFile, path: Path, body: Path) -> Scene:
    """A scene of what a scene file of some path says; see `read_scene`."""
    given = read_body_file(body)
    if isinstance(given.damping.ratio, list):
        found = f"{body}: damping.ratio lists one value per mode, which has no meaning for other numbers of modes"
        raise SceneError(f"{found}; give one number")
    known = tuple(table.name for table in given.interface)
    tables = {case.name: _table(case, path) for case in file.transient}
    columns = {case.name: list(case.loads) for case in file.static} | {name: table[0] for name, table in tables.items()}
    every = [(name, f"{path}: {case}.loads") for case, inputs in columns.items() for name in inputs]
    loaded = {_loaded(name, known, where) for name, where in every} - {ACCELERATION}
    for key, listed in (("loaded", file.loaded), ("read", file.read)):
        for name in listed or ():
            if name not in known:
                raise SceneError(f"{path}: {key} names {name!r}, and the body has {', '.join(known)}")
    if left := sorted(loaded - set(loaded if file.loaded is None else file.loaded)):
        raise SceneError(f"{path}: loads act on {', '.join(left)}, which loaded leaves out")
    read = tuple(file.read or known)
    kept = {*read, *loaded, *(file.loaded or ()), *([given.root or known[0]] if given.free else ())}
    config = given.model_copy(update={"interface": [table for table in given.interface if table.name in kept]})
    names = tuple(table.name for table in config.interface)
    static = tuple(StaticCase(**dict(c), peak=_loads(c.loads, names, given, f"{path}: {c.name}")) for c in file.static)
    transient = tuple(_transient(c, tables[c.name], names, given, path) for c in file.transient)
    return Scene(file, body, given, config, read, static, transient, _digest(file, config, read, static, transient))


def _digest(
    file: SceneFile, body: BodyFile, read: Sequence[str], static: Sequence[StaticCase], moving: Sequence[TransientCase]
) -> str:
    digest = hashlib.sha256()
    varied = {"mesh": {"file"}, "frames": True, "frame": True, "reduction": True, "formulation": True}
    # Keys that the file does not use, and that later versions may add, change nothing.
    said = body.model_dump_json(exclude=varied, exclude_defaults=True)  # type: ignore[arg-type]
    digest.update(said.encode())
    digest.update(Path(body.mesh.file).read_bytes())
    digest.update(repr((tuple(read), file.tolerance, file.reference)).encode())
    for rest in static:
        digest.update(repr((rest.name, tuple(rest.factors))).encode() + rest.peak.packed(True).tobytes())
    for motion in moving:
        digest.update(repr((motion.name, motion.step, motion.frequencies and tuple(motion.frequencies))).encode())
        for loads in (*motion.start_loads, *motion.end_loads):
            digest.update(loads.packed(True).tobytes())
    for results in (*(case.results for case in static), *(case.results for case in moving)):
        if results is not None:
            check_input(results, SceneError, Kind.TABLE)
            digest.update(results.read_bytes())
    return digest.hexdigest()[:12]


def _loaded(name: str, known: Sequence[str], where: str) -> str:
    """Interface that an FMU input acts on; `ACCELERATION` of that of the supports."""
    if name in [f"{ACCELERATION}.{axis}" for axis in AXES]:
        return ACCELERATION
    if name not in load_names(known, False):
        found = f"{where}: {name!r} is no input of the body; expected INTERFACE.force.AXIS or INTERFACE.moment.AXIS"
        raise SceneError(f'{found}, as "{known[0]}.force.y", or "{ACCELERATION}.z"; its interfaces: {", ".join(known)}')
    return name.partition(".")[0]


def _loads(values: Mapping[str, float], names: Sequence[str], body: BodyFile, where: str) -> Loads:
    inputs = load_names(names, True)
    packed = np.zeros(len(inputs))
    for name, value in values.items():
        if _loaded(name, names, where) == ACCELERATION and not body.input.acceleration:
            raise SceneError(f"{where}: {name!r} needs acceleration = true in [input] of the body file")
        packed[inputs.index(name)] = value
    return Loads.unpacked(packed, len(names))


def _table(case: TransientTable, path: Path) -> tuple[list[str], FloatArray]:
    """Names and rows (time, values) of a transient's loads; a sudden load has one row."""
    if isinstance(case.loads, dict):
        return list(case.loads), np.array([[0.0, *case.loads.values()]])
    names, rows = read_table(Path(case.loads))
    if rows[0, 0] != 0.0:
        raise SceneError(f"{case.loads}: the first time is {rows[0, 0]} s, expected 0: the body starts at rest there")
    if case.duration is None and rows[-1, 0] < 2.0 * case.step:
        raise SceneError(f"{path}: {case.name}: {case.loads} ends at {rows[-1, 0]} s, in less than two steps")
    return names, rows


def _transient(
    case: TransientTable, table: tuple[list[str], FloatArray], names: Sequence[str], body: BodyFile, path: Path
) -> TransientCase:
    columns, rows = table
    duration = case.duration if case.duration is not None else float(rows[-1, 0])
    where = f"{path}: {case.name}"
    try:
        check_steps(duration, case.step)
    except ValueError as error:
        raise SceneError(f"{where}: {case.loads}: {error}") from error
    times = case.step * np.arange(int(np.ceil(duration / case.step * (1.0 - _ROUNDING))) + 1)

    def at(time: float, side: str) -> Loads:
        values = [_value(rows[:, 0], rows[:, 1 + k], time, side) for k in range(len(columns))]
        return _loads(dict(zip(columns, values, strict=True)), names, body, where)

    start = tuple(at(t, "right") for t in times[:-1])
    # Where nothing jumps the end of a step is the start of the next one.
    end = tuple(at(t, "left") for t in times[1:])
    return TransientCase(**dict(case), start_loads=start, end_loads=end)


def _value(times: FloatArray, values: FloatArray, time: float, side: str) -> float:
    """A column at a time, linear between rows; at a jump the value before it ("left") or after it ("right")."""
    same = np.flatnonzero(np.abs(times - time) <= _ROUNDING * max(abs(time), float(times[-1]), 1e-300))
    if same.size:
        return float(values[same[0] if side == "left" else same[-1]])
    return float(np.interp(time, times, values))


def read_results(path: Path, first: str, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Read results that the user brings.

    Parameters
    ----------
    path : Path
        CSV: a header with `first` ("factor" or "time") and outputs of the FMU by name (INTERFACE.displacement.x,
        INTERFACE.rotation.x, …); lines that begin with # are passed over.
    first : str
    names : sequence of str
        Interfaces.

    Returns
    -------
    key : (rows,) float
        First column.
    motion : (rows, interfaces, 6) float
        Displacement, rotation vector; not a number where the table tells none.

    Raises
    ------
    SimulationError
    """
    header, table = read_table(path, first)
    motion = np.full((len(table), 6 * len(names)), np.nan)
    allowed = [f"{name}.{kind}.{axis}" for name in names for kind in MOTION for axis in AXES]
    for column, name in enumerate(header, start=1):
        if name in allowed:
            motion[:, allowed.index(name)] = table[:, column]
    return table[:, 0], motion.reshape(len(table), len(names), 6)
