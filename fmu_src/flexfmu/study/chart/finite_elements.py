"""The whole finite element model among the records: how long it takes for what a reduced model gives at each step."""

import math
import statistics
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from ...files.progress import Reporter
from ..candidates import REDUCED
from ..records import Record, RecordFile
from ..scene.config import SceneError
from ..scene.measure import equilibria_errors
from ..scene.reference import Reference
from ..scene.scene import Scene
from ..scene.whole_model import WholeModel

BROUGHT, OWN = "results", "flexfmu"
"""The solver of what the user brings, and the package's own."""


def finite_element_records(
    scene: Scene, known: Mapping[str, Reference], whole: WholeModel, kept: RecordFile[Record], report: Reporter
) -> Iterator[Record]:
    """Records of the finite element model, where they are not kept already.

    Static: one equilibrium, reached from the one before, stands against one step. Transient: what a simulated second
    takes, where the user tells.

    Parameters
    ----------
    scene : Scene
    known : mapping of str to Reference
    whole : WholeModel
    kept : RecordFile
        Of the reduced models, whose step and empty FMU are those that times are taken against.
    report : Reporter

    Yields
    ------
    Record
    """
    rows = [row for row in kept.rows if row.solver == REDUCED and row.status == "ok"]
    done = {(row.solver, row.case) for row in kept.rows}
    if not rows:
        return
    empty = [row.empty_us for row in rows if math.isfinite(row.empty_us)]
    empty_us = statistics.median(empty) if empty else math.nan
    plain = Record(scene.digest, scene.config.name, step=rows[0].step, empty_us=empty_us)
    for case in scene.static:
        if case.results_seconds is not None and (BROUGHT, case.name) not in done:
            count, seconds = known[case.name].equilibria, case.results_seconds
            note, spent = f"{count} equilibria in {seconds:.3g} s", 1e3 * seconds
            own = _timed(plain, BROUGHT, case.name, seconds / count, note=note, equilibrium_ms=spent)
            yield replace(own, static_displacement=0.0, share=0.0)
    for motion in scene.transient:
        if motion.seconds_per_second is not None and (BROUGHT, motion.name) not in done:
            note = f"{motion.seconds_per_second:.3g} s per simulated second"
            own = _timed(plain, BROUGHT, motion.name, motion.seconds_per_second * plain.step, note=note)
            yield replace(own, transient_displacement=0.0, share=0.0)
    if scene.static and scene.file.sweep.finite_elements and (OWN, scene.static[0].name) not in done:
        yield from _own(plain, scene, known, whole, report)


def _own(
    plain: Record, scene: Scene, known: Mapping[str, Reference], whole: WholeModel, report: Reporter
) -> Iterator[Record]:
    """Record of the package's own finite element model in the first static case; a word why where there is none."""
    case = scene.static[0]
    if refusal := whole.refusal(case):
        report.note(f"no time of the finite element model: {refusal}")
        return
    try:
        found = known[case.name].whole or whole.equilibria(case)
    except SceneError as error:
        report.warning(str(error))
        return
    yield _timed(
        plain,
        OWN,
        case.name,
        found.seconds / found.increments,
        equilibrium_ms=1e3 * found.seconds,
        iterations=found.iterations / found.increments,
        mode_count=whole.size,
        note=f"{len(case.factors)} equilibria in {found.seconds:.3g} s: {found.increments} increments, "
        f"{found.iterations} iterations",
        **equilibria_errors(scene, case, found.motion, known[case.name]).columns,
    )


def _timed(plain: Record, solver: str, case: str, seconds: float, **others: Any) -> Record:
    """Record of what takes so many seconds where a reduced model takes a step."""
    us = 1e6 * seconds
    others |= dict.fromkeys(("step_us", "step_us_median", "fmu_us"), us)
    others |= dict.fromkeys(("bare_ms_per_s", "fmu_ms_per_s"), 1e3 * seconds / plain.step)
    return replace(plain, solver=solver, case=case, fmu_ratio=us / plain.empty_us, **others)
