"""Map of a load that presses against the critical one, per method: deflection under a small side load."""

from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...body.flexible_body import FlexibleBody
from ...files.array_types import FloatArray
from ...model.methods import Method
from ...model.reduced_body import ReducedBody
from ...program.compile import compile_draft
from ..scenes.map_config import Map
from .records import Run, StabilityError
from .statics import Rows, StaticMap
from .subject import Subject, Task, linear_response, unit

# Deflection by the side load alone, as part of the interface's distance from the farthest point of the body.
_SIDE = 1e-3
# With more frames the second order has little to add.
_FEW = 2


@dataclass(frozen=True, slots=True)
class _Press:
    """What presses.

    Attributes
    ----------
    critical : float
        Least critical load along the direction, N, of the undeformed body by geometric stiffness.
    along, aside : (3,) float
        Directions of the load and of the side load.
    side : float
        N.
    """

    critical: float
    along: FloatArray
    aside: FloatArray
    side: float


def reason_against(subject: Subject) -> str | None:
    """Why the map has no meaning for a body."""
    if subject.config.cut:
        return "a cut body has no geometric stiffness by load to judge by, and its stability is not watched by default"
    if subject.config.free:
        return "nothing holds a free body against a load that presses"
    return None


def static_map(subject: Subject) -> StaticMap:
    """Rows and places of the map."""
    counts = subject.table.frames
    rows = [
        Rows(
            tuple(_methods(frames, max(counts))),
            {
                "frames": frames or None,
                "geometric_stiffness": ["by_load"],
                "second_order": bool(frames),
                "method": Method.FRAMES if frames else Method.LINEAR,
            },
        )
        for frames in (0, *counts)
    ]
    # As in an FMU that was built for the method alone.
    return StaticMap(
        Map.BUCKLING, "methods", "diagnostics.stability", tuple(subject.table.shares), tuple(rows), alone=True
    )


def planned(subject: Subject) -> list[Run]:
    """Runs of the whole map, of which nothing is known yet."""
    return static_map(subject).planned(subject)


def tasks(subject: Subject, done: Container[object], _folder: Path) -> list[Task]:
    """What is not done.

    Parameters
    ----------
    subject : Subject
    done : container of keys
    _folder : Path

    Returns
    -------
    list of Task
    """

    def loads(finest: FlexibleBody, reader: int) -> dict[float, FloatArray]:
        body = finest.model
        press = _press(subject, body, reader)
        subject.report.note(
            f"presses along {_words(press.along)} at {body.interface_names[reader]}: critical {press.critical:.4g} N"
        )
        heavy = body.masses is not None
        return {share: _inputs(press, share, body.interface_count, heavy, reader) for share in subject.table.shares}

    return static_map(subject).tasks(subject, done, loads)


def _methods(frames: int, most: int) -> list[tuple[str, Method]]:
    """Rows that a body with so many frames serves."""
    if not frames:
        return [(method.label, method) for method in (Method.LINEAR, Method.STIFFNESS_BY_LOAD)]
    methods = [Method.FRAMES]
    if frames <= _FEW:
        methods.append(Method.SECOND_ORDER)
    if frames == most:
        methods = [Method.MODAL_ROTATION, Method.HALF_ROTATION, *methods, Method.FRAMES_STIFFNESS]
    return [(f"{frames} × {method.label}", method) for method in methods]


def _press(subject: Subject, body: ReducedBody, reader: int) -> _Press:
    """Direction in which the body buckles first, or the one given, and a side load that finds the shape."""
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
            first = body.rigid_count
            omega = body.angular_frequency[first : first + len(vectors)]
            q[first : first + len(vectors)] = vectors[:, -1] / omega
            found.append((1.0 / float(values[-1]), along, body.interface_displacement[reader] @ q))
    if not found:
        raise StabilityError(
            "no force on the interface makes the body buckle; give [stability] axial, or leave the map out by maps"
        )
    critical, along, shape = min(found, key=lambda item: item[0])
    aside = unit(shape - (shape @ along) * along)
    inputs = np.zeros(6 * body.interface_count)
    inputs[6 * reader : 6 * reader + 3] = aside
    points = np.concatenate([body.interface_point, body.joint_point])
    length = float(np.max(np.linalg.norm(points - body.interface_point[reader], axis=1)))
    give = float(linear_response(body, inputs)[reader, 0] @ aside)
    return _Press(critical, along, aside, _SIDE * length / give)


def _inputs(press: _Press, share: float, interfaces: int, heavy: bool, reader: int) -> FloatArray:
    inputs = np.zeros(6 * interfaces + (3 if heavy else 0))
    inputs[6 * reader : 6 * reader + 3] = share * press.critical * press.along + press.side * press.aside
    return inputs


def _words(direction: FloatArray) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in direction) + ")"
