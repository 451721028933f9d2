"""Maps of equilibria under loads of growing size, method by method: an axial load, and rotation.

Buckling: a load that presses, over the critical one, with a small side load. Rotation: a moment, or the scene's loads,
against the number of frames.
"""

import time
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ...body.flexible_body import FlexibleBody
from ...body.loads import Loads
from ...files.array_types import FloatArray
from ...model.errors import RuntimeBodyError
from ...model.methods import Method, Variant
from ...model.reduced_body import ReducedBody
from ...model.variants import lean
from ...program.compile import compile_draft
from ...program.variables import METHOD
from ..records import Run, StabilityError, verdict
from ..scene.config import Map
from .slave import BodyPrograms, DrivenSlave
from .subject import Subject, Task, linear_response, unit

# Deflection by the side load alone, as part of the interface's distance from the farthest point of the body.
_SIDE = 1e-3
# With more frames the second order has little to add.
_FEW = 2
# A cut body is turned by the scene's loads up to this angle (°): its supports let it go no further.
_CUT = 30.0

Inputs = Mapping[float, FloatArray]
"""Loads (L,) by place on the axis."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of a map that one reduction of the body serves.

    Attributes
    ----------
    methods : tuple of (str, Method)
        Label and method of each.
    changes : dict of str to object
        What the reduction changes; see `Subject.reduced`.
    """

    methods: tuple[tuple[str, Method], ...]
    changes: dict[str, object]


@dataclass(frozen=True, slots=True)
class StaticMap:
    """A map of equilibria.

    Attributes
    ----------
    kind : Map
    panel : str
    measure : str
        Variable of the FMU that is recorded.
    alone : bool
        Whether each method runs in an FMU that holds no other.
    places : callable
        Places along the axis.
    rows : callable
        Takes a subject.
    loads : callable
        Takes a subject, the finest body and the place of the interface that is read.
    obstacle : callable
        Why the map has no meaning for a subject, or None.
    """

    kind: Map
    panel: str
    measure: str
    alone: bool
    places: Callable[[Subject], Sequence[float]]
    rows: Callable[[Subject], list[Rows]]
    loads: Callable[[Subject, FlexibleBody, int], Inputs]
    obstacle: Callable[[Subject], str | None]

    def blank(self, subject: Subject, rows: Rows) -> list[Run]:
        """Runs of some rows, of which nothing is known yet."""
        places = [f"{place:g}" for place in self.places(subject)]
        return [subject.blank(self.kind, self.panel, place, label) for label, _ in rows.methods for place in places]

    def planned(self, subject: Subject) -> list[Run]:
        """Runs of the whole map, of which nothing is known yet."""
        return [run for rows in self.rows(subject) for run in self.blank(subject, rows)]

    def tasks(self, subject: Subject, done: Container[object], _folder: Path) -> list[Task]:
        """What is not done, a task for each reduction.

        Parameters
        ----------
        subject : Subject
        done : container of keys
        _folder : Path

        Returns
        -------
        list of Task
        """
        finest = subject.reference()
        reader = subject.interface(finest.model)
        inputs = self.loads(subject, finest, reader)
        truth = {place: _equilibrium(finest, load, reader) for place, load in inputs.items()}
        found: list[Task] = []
        for rows in self.rows(subject):
            left = [run for run in self.blank(subject, rows) if run.key not in done]
            if left:
                shared = subject.silent(), rows, left, self.alone, self.measure
                found.append(partial(_run, *shared, inputs, truth, reader))
        return found


def _equilibrium(model: FlexibleBody, inputs: FloatArray, reader: int) -> FloatArray | None:
    """Displacement (3,) of an interface, m; None where there is no equilibrium."""
    try:
        state = model.static(Loads.unpacked(inputs, model.model.interface_count))
    except RuntimeBodyError:
        return None
    displacement: FloatArray = model.response(state).displacement[reader]
    return displacement


def _run(
    subject: Subject,
    rows: Rows,
    runs: Sequence[Run],
    alone: bool,
    measured: str,
    inputs: Inputs,
    truth: Mapping[float, FloatArray | None],
    reader: int,
) -> tuple[list[Run], list[str]]:
    body = subject.reduced(**rows.changes)
    found = []
    for label, method in rows.methods:
        parameters = {"initialization": "static"} | ({} if alone else {METHOD: method.value})
        with BodyPrograms(lean(body, Variant(method)) if alone else body) as programs:
            for blank in (run for run in runs if run.y == label):
                start, place = time.perf_counter(), float(blank.x)
                slave = DrivenSlave(programs, parameters, inputs[place])
                error = measure = float("nan")
                expected = truth[place]
                if not slave.refused:
                    measure = slave.real(measured)
                    if expected is not None:
                        error = float(np.linalg.norm(slave.motion()[reader, 0] - expected) / np.linalg.norm(expected))
                name = verdict(error, slave.warned, slave.refused, subject.table.tolerance).value
                run = replace(blank, verdict=name, error=error, measure=measure, taken=1, words=slave.words)
                found.append(replace(run, seconds=time.perf_counter() - start))
    return found, subject.quiet.warnings


# --- buckling


def _unpressed(subject: Subject) -> str | None:
    if subject.config.cut:
        return "a cut body has no geometric stiffness by load to judge by, and its stability is not watched by default"
    return "nothing holds a free body against a load that presses" if subject.config.free else None


def _pressed_rows(subject: Subject) -> list[Rows]:
    counts = subject.table.frames
    found = []
    for frames in (0, *counts):
        methods = [Method.FRAMES, Method.SECOND_ORDER] if frames <= _FEW else [Method.FRAMES]
        if frames == max(counts):
            methods = [Method.MODAL_ROTATION, Method.HALF_ROTATION, *methods, Method.FRAMES_STIFFNESS]
        labels = [(f"{frames} × {method.label}", method) for method in methods]
        if not frames:
            labels = [(method.label, method) for method in (Method.LINEAR, Method.STIFFNESS_BY_LOAD)]
        changes: dict[str, object] = {"frames": frames or None, "geometric_stiffness": ["by_load"]}
        changes |= {"second_order": bool(frames), "method": Method.FRAMES if frames else Method.LINEAR}
        found.append(Rows(tuple(labels), changes))
    return found


def _pressing(subject: Subject, finest: FlexibleBody, reader: int) -> Inputs:
    """Loads along the direction in which the body buckles first, or the one given, with one aside."""
    body = finest.model
    critical, along, shape = _first_buckling(subject, body, reader)
    aside = unit(shape - (shape @ along) * along)
    inputs = np.zeros(6 * body.interface_count + (0 if body.masses is None else 3))
    force = inputs[6 * reader : 6 * reader + 3]
    force[:] = aside
    points = np.concatenate([body.interface_point, body.joint_point])
    length = float(np.max(np.linalg.norm(points - body.interface_point[reader], axis=1)))
    side = _SIDE * length / float(linear_response(body, inputs)[reader, 0] @ aside)
    words = "(" + ", ".join(f"{x:.3g}" for x in along) + ")"
    subject.report.note(f"presses along {words} at {body.interface_names[reader]}: critical {critical:.4g} N")
    found = {}
    for share in subject.table.shares:
        force[:] = share * critical * along + side * aside
        found[share] = inputs.copy()
    return found


def _first_buckling(subject: Subject, body: ReducedBody, reader: int) -> tuple[float, FloatArray, FloatArray]:
    """Least critical load, N, of the undeformed body by geometric stiffness, its direction, and how it buckles."""
    draft = compile_draft(body, Method.LINEAR)
    count = draft.sizes["elastic_count"]
    # What each unit load does to the tangent stiffness, over the unloaded one.
    changes = np.asarray(draft.arrays["judge_change"]).reshape(-1, count, count)
    given = subject.table.axial
    choices = [unit(np.array(given))] if given is not None else [s * axis for axis in np.eye(3) for s in (1.0, -1.0)]
    found = []
    for along in choices:
        load = np.zeros(len(changes))
        load[6 * reader : 6 * reader + 3] = along
        values, vectors = np.linalg.eigh(-np.tensordot(load, changes, axes=1))
        if values[-1] > 0.0:
            q = np.zeros(body.mode_count)
            elastic = slice(body.rigid_count, body.rigid_count + len(vectors))
            q[elastic] = vectors[:, -1] / body.angular_frequency[elastic]
            found.append((1.0 / float(values[-1]), along, body.interface_displacement[reader] @ q))
    if not found:
        raise StabilityError(
            "no force on the interface makes the body buckle; give [stability] axial, or leave the map out by maps"
        )
    return min(found, key=lambda item: item[0])


# --- rotation


def _unturned(subject: Subject) -> str | None:
    return "nothing holds a free body against a load that turns it" if subject.config.free else None


def _angles(subject: Subject) -> list[float]:
    return [angle for angle in subject.table.angles if not subject.config.cut or angle <= _CUT]


def _turned_rows(subject: Subject) -> list[Rows]:
    least = 1 if subject.config.cut else 0
    found = []
    for frames in (least, *(n for n in subject.table.frames if n > least)):
        methods = [("linear", Method.LINEAR)] if frames == least else []
        if frames:
            methods += [(f"{frames} × {m.label}", m) for m in (Method.FRAMES, Method.SECOND_ORDER)]
        changes: dict[str, object] = {"frames": frames or None, "second_order": bool(frames), "method": methods[-1][1]}
        found.append(Rows(tuple(methods), changes))
    return found


def _turning(subject: Subject, finest: FlexibleBody, reader: int) -> Inputs:
    """Loads that turn the interface by each angle in linear theory."""
    body = finest.model
    pattern = subject.peak(body)
    turn = linear_response(body, pattern)[reader, 1]
    if subject.config.cut:
        pattern = pattern / float(np.linalg.norm(turn))
    else:
        given = subject.table.axis
        axis = unit(np.array(given) if given is not None else turn)
        pattern[:] = 0.0
        pattern[6 * reader + 3 : 6 * reader + 6] = axis
        pattern = pattern / float(linear_response(body, pattern)[reader, 1] @ axis)
    return {angle: np.radians(angle) * pattern for angle in _angles(subject)}


# As in an FMU that was built for the method alone.
BUCKLING = StaticMap(
    Map.BUCKLING,
    "methods",
    "diagnostics.stability",
    alone=True,
    places=lambda subject: subject.table.shares,
    rows=_pressed_rows,
    loads=_pressing,
    obstacle=_unpressed,
)
ROTATION = StaticMap(
    Map.ROTATION,
    "frames",
    "diagnostics.rotation_within_frame",
    alone=False,
    places=_angles,
    rows=_turned_rows,
    loads=_turning,
    obstacle=_unturned,
)
