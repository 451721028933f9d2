"""Map of rotation against the number of frames: static displacement under a moment, or under the scene's loads."""

import time
from collections.abc import Container, Iterator

import numpy as np

from ..body import FlexibleBody
from ..fmu.variables import METHOD
from ..loads import Loads
from ..mesh.model import FloatArray
from ..methods import Method
from ..model.errors import RuntimeBodyError
from ..model.reduced_body import ReducedBody
from .config import Map
from .records import Key, Run, verdict
from .slave import Aboard, Told
from .subject import Subject, linear_response, unit

# A cut body is turned by the scene's loads up to this angle (°): its supports let it go no further.
_CUT = 30.0


def reason_against(subject: Subject) -> str | None:
    """Why the map has no meaning for a body."""
    if subject.config.free:
        return "nothing holds a free body against a load that turns it"
    return None


def _rows(subject: Subject) -> Iterator[tuple[int, list[tuple[str, Method]], list[Run]]]:
    """Numbers of frames, the methods that each serves, and their runs, of which nothing is known yet."""
    least = 1 if subject.config.cut else 0
    for frames in (least, *(n for n in subject.table.frames if n > least)):
        rows = [("linear", Method.LINEAR)] if frames == least else []
        if frames:
            rows += [(f"{frames} × {m.label}", m) for m in (Method.FRAMES, Method.SECOND_ORDER)]
        angles = _angles(subject)
        yield (
            frames,
            rows,
            [subject.blank(Map.ROTATION, "frames", f"{a:g}", label) for label, _ in rows for a in angles],
        )


def _angles(subject: Subject) -> list[float]:
    return [a for a in subject.table.angles if not subject.config.cut or a <= _CUT]


def planned(subject: Subject) -> list[Run]:
    """Runs of the whole map, of which nothing is known yet."""
    return [run for _, _, runs in _rows(subject) for run in runs]


def runs(subject: Subject, done: Container[Key]) -> Iterator[Run]:
    """Run what is not `done`.

    Parameters
    ----------
    subject : Subject
    done : container of keys

    Yields
    ------
    Run
    """
    finest = subject.reference()
    reader = subject.interface(finest.model)
    pattern = _pattern(subject, finest.model, reader)
    truth = {a: _static(finest, np.radians(a) * pattern, reader) for a in _angles(subject)}
    for frames, rows, keys in _rows(subject):
        if all(run.key in done for run in keys):
            continue
        body = subject.reduced(frames=frames or None, second_order=bool(frames), method=rows[-1][1])
        with Aboard(body) as aboard:
            for label, method in rows:
                for run in keys:
                    if run.y == label and run.key not in done:
                        inputs = np.radians(float(run.x)) * pattern
                        yield _one(subject, aboard, run, method, inputs, truth[float(run.x)], reader)


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


def _static(model: FlexibleBody, inputs: FloatArray, reader: int) -> FloatArray | None:
    try:
        state = model.static(Loads.unpacked(inputs, model.model.interface_count))
    except RuntimeBodyError:
        return None
    displacement: FloatArray = model.response(state).displacement[reader]
    return displacement


def _one(
    subject: Subject,
    aboard: Aboard,
    run: Run,
    method: Method,
    inputs: FloatArray,
    truth: FloatArray | None,
    reader: int,
) -> Run:
    start = time.perf_counter()
    told = Told(aboard, {"initialization": "static", METHOD: method.value}, inputs)
    error = turned = float("nan")
    if not told.refused:
        turned = told.real("diagnostics.rotation_within_frame")
        if truth is not None:
            error = float(np.linalg.norm(told.motion()[reader, 0] - truth) / np.linalg.norm(truth))
    found = verdict(error, told.warned, told.refused, subject.table.tolerance)
    seconds = time.perf_counter() - start
    return Run(*run.key_and_owner, found.value, error, turned, 1, seconds, told.words)
