"""All maps of a body: run what is not recorded yet, record it, draw."""

import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from ...files.progress import Reporter, Tell
from ...files.store import Store
from ...files.targets import PICTURE_SUFFIXES, check_target
from ..jobs import Crew
from ..pictures import draw_maps
from ..records import RUNS, RecordFile, Run, Verdict
from ..scene.config import Map
from . import coupling
from .equilibria import BUCKLING, ROTATION
from .subject import Subject, read_subject

_MAPS: dict[Map, Any] = {Map.BUCKLING: BUCKLING, Map.ROTATION: ROTATION, Map.COUPLING: coupling}
_WORDS = {Verdict.SILENT: "wrong in silence"}


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
    kept = RecordFile(RUNS, records, subject.digest)
    lines = []
    wanted = [kind for kind in Map if kind in subject.table.maps]
    for place, kind in enumerate(wanted, start=1):
        obstacle = _MAPS[kind].obstacle(subject)
        if obstacle is not None:
            lines.append(f"{kind.value}: left out, {obstacle}")
            continue
        left = sum(run.key not in kept for run in _MAPS[kind].planned(subject))
        with report.counted(f"Map of {kind.value}, {place} of {len(wanted)}", left, "runs") as tell:
            if left:
                _run(subject, kind, kept, crew or Crew(), tell)
        counts = Counter(Verdict(run.verdict) for run in kept.rows if run.map == kind.value)
        found = [f"{counts[v]} {_WORDS.get(v, v.value)}" for v in Verdict if counts[v] or v is Verdict.SILENT]
        lines.append(f"{kind.value}: {', '.join(found)}")
    if picture is not None:
        lines += [str(path) for path in draw_maps(records, picture)]
    return lines


def _run(subject: Subject, kind: Map, kept: RecordFile[Run], crew: Crew, tell: Tell) -> None:
    """Make and record the runs of a map that are not recorded yet."""
    done = 0
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as folder:
        for runs, warnings in crew.each(_MAPS[kind].tasks(subject, kept, Path(folder))):
            for text in warnings:
                subject.quiet.warning(text)
            for run in runs:
                kept.append(run)
                done += 1
                tell(done)
