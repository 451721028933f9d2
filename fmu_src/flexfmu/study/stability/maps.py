"""All maps of a body: run what is not recorded yet, record it, draw."""

import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from ...files.progress import Reporter, Tell
from ...files.store import Store
from ...files.targets import PICTURE_SUFFIXES, check_target
from ..scenes.jobs import Crew
from ..scenes.map_config import Map
from ..scenes.record_file import RecordFile
from . import buckling, coupling, rotation
from .picture import pictures
from .records import LAYOUT, Run, Verdict
from .subject import Subject, read_subject

_MAPS = {Map.BUCKLING: buckling, Map.ROTATION: rotation, Map.COUPLING: coupling}


def chart_stability(
    body: Path,
    scene: Path,
    records: Path,
    picture: Path | None,
    report: Reporter,
    store: Store,
    crew: Crew | None = None,
) -> list[str]:
    """Make the maps that a scene asks for.

    Parameters
    ----------
    body, scene : Path
        Body file and scene file.
    records : Path
        CSV; what is in it is not run again.
    picture : Path or None
        Each map is drawn as NAME_MAP beside this name.
    report : Reporter
    store : Store
    crew : Crew, optional
        Processes that make the runs. Default: this one.

    Returns
    -------
    list of str
        A line for each map, and the pictures.

    Raises
    ------
    FlexfmuError
        A wrong file, or records of another body or scene.
    """
    check_target(records, (".csv",), inputs=(body, scene))
    if picture is not None:
        check_target(picture, PICTURE_SUFFIXES, inputs=(body, scene, records))
    subject = read_subject(body, scene, report, store)
    kept = RecordFile(LAYOUT, records, subject.digest)
    lines = []
    wanted = [kind for kind in Map if kind in subject.table.maps]
    for place, kind in enumerate(wanted, start=1):
        reason = _MAPS[kind].reason_against(subject)
        if reason is not None:
            lines.append(f"{kind.value}: left out, {reason}")
            continue
        left = sum(run.key not in kept for run in _MAPS[kind].planned(subject))
        title = f"Map of {kind.value}, {place} of {len(wanted)}"
        with report.counted(title, left, "runs") as tell:
            _run(subject, kind, kept, crew or Crew(), tell)
        lines.append(f"{kind.value}: {_summary([run for run in kept.rows if run.map == kind.value])}")
    if picture is not None:
        lines += [str(path) for path in pictures(records, picture)]
    return lines


def _run(subject: Subject, kind: Map, kept: RecordFile[Run], crew: Crew, tell: Tell) -> None:
    """Make and record the runs of a map that are not recorded yet."""
    if all(run.key in kept for run in _MAPS[kind].planned(subject)):
        return
    done = 0
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as folder:
        for runs, warnings in crew.each(_MAPS[kind].tasks(subject, kept, Path(folder))):
            for text in warnings:
                subject.quiet.warning(text)
            for run in runs:
                kept.append(run)
                done += 1
                tell(done)


def _summary(runs: Sequence[Run]) -> str:
    counts = Counter(run.verdict for run in runs)
    words = {Verdict.SILENT: "wrong in silence"}
    return ", ".join(
        f"{counts[v.value]} {words.get(v, v.value)}" for v in Verdict if counts[v.value] or v is Verdict.SILENT
    )
