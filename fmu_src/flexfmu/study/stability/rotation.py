"""Map of rotation against the number of frames: static displacement under a moment, or under the scene's loads."""

from collections.abc import Container
from pathlib import Path

import numpy as np

from ...body.flexible_body import FlexibleBody
from ...files.array_types import FloatArray
from ...model.methods import Method
from ...model.reduced_body import ReducedBody
from ..scenes.map_config import Map
from .records import Run
from .statics import Rows, StaticMap
from .subject import Subject, Task, linear_response, unit

# A cut body is turned by the scene's loads up to this angle (°): its supports let it go no further.
_CUT = 30.0


def reason_against(subject: Subject) -> str | None:
    """Why the map has no meaning for a body."""
    if subject.config.free:
        return "nothing holds a free body against a load that turns it"
    return None


def static_map(subject: Subject) -> StaticMap:
    """Rows and places of the map."""
    least = 1 if subject.config.cut else 0
    rows = []
    for frames in (least, *(n for n in subject.table.frames if n > least)):
        methods = [("linear", Method.LINEAR)] if frames == least else []
        if frames:
            methods += [(f"{frames} × {m.label}", m) for m in (Method.FRAMES, Method.SECOND_ORDER)]
        changes: dict[str, object] = {"frames": frames or None, "second_order": bool(frames), "method": methods[-1][1]}
        rows.append(Rows(tuple(methods), changes))
    places = tuple(a for a in subject.table.angles if not subject.config.cut or a <= _CUT)
    return StaticMap(Map.ROTATION, "frames", "diagnostics.rotation_within_frame", places, tuple(rows), alone=False)


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
    found = static_map(subject)

    def loads(finest: FlexibleBody, reader: int) -> dict[float, FloatArray]:
        pattern = _pattern(subject, finest.model, reader)
        return {angle: np.radians(angle) * pattern for angle in found.places}

    return found.tasks(subject, done, loads)


def _pattern(subject: Subject, body: ReducedBody, reader: int) -> FloatArray:
    """Loads (L,) that turn the interface by one radian in linear theory."""
    peak = subject.peak(body)
    turn = linear_response(body, peak)[reader, 1]
    if subject.config.cut:
        pattern: FloatArray = peak / float(np.linalg.norm(turn))
        return pattern
    given = subject.table.axis
    axis = unit(np.array(given) if given is not None else turn)
    moment = np.zeros_like(peak)
    moment[6 * reader + 3 : 6 * reader + 6] = axis
    return moment / float(linear_response(body, moment)[reader, 1] @ axis)
