"""Where methods stop working: models of a body under growing parts of a scene's static loads, by the FMU's core.

All have the modes of `[reference]` and residual flexibility, so that they differ by method and frames alone, and tell
their error. They are compared with the default model of `[reference]` modes and frames.
"""

import math
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from ..body.flexible_body import FlexibleBody
from ..build.reduce import reduce_body
from ..core.library import library_path
from ..files.basics import FloatArray, RuntimeBodyError
from ..files.outputs import Reporter, check_target
from ..files.store import Store
from ..fmu.python_slave import BodySlave, SlaveError, core_file
from ..model.methods import Mass, Variant, has_frames
from ..model.reduced_body import ReducedBody
from ..model.variants import lean
from ..program.compile import programs, with_guid
from ..program.variable_table import ERROR, STATUS_CODE, variable_table
from .candidates import Candidate, Reduction, has_meaning, linear_frames, reduction_config
from .records import RUNS, VERDICTS, RecordFile, Run, verdict
from .scene.config import BasisChoice, SceneError
from .scene.reference import by_default
from .scene.scene import Scene
from .workshop import Crew, Workshop, build


class BodyPrograms(AbstractContextManager["BodyPrograms"]):
    """A body's programs in a folder, from which slaves start.

    Parameters
    ----------
    body : ReducedBody
    """

    def __init__(self, body: ReducedBody):
        self.body = body
        self._folder = tempfile.TemporaryDirectory(prefix="flexfmu-")
        folder = Path(self._folder.name)
        for name, image in with_guid(programs(body), "").items():
            (folder / name).write_bytes(image)
        core = core_file(folder)
        core.parent.mkdir()
        core.write_bytes(library_path().read_bytes())
        self.variables = {v.name: (number, v) for number, v in enumerate(variable_table(body))}

    def start(self, **parameters: float | str) -> BodySlave:
        """Instance with some parameters, before its initialisation ends."""
        slave = BodySlave(instance_name=self.body.name, resources=self._folder.name)
        for name, value in parameters.items():
            number, variable = self.variables[name]
            if variable.type == "String":
                slave.set_string([number], [str(value)])
            else:
                slave.set_real([number], [float(value)])
        return slave

    def __exit__(self, *_: object) -> None:
        self._folder.cleanup()


class DrivenSlave:
    """An instance after its initialisation.

    Parameters
    ----------
    programs : BodyPrograms
    parameters : mapping of str to float or str
    inputs : (L,) float
    """

    def __init__(self, programs: BodyPrograms, parameters: Mapping[str, float | str], inputs: FloatArray):
        self._variables = programs.variables
        self._count = 6 * programs.body.interface_count
        self._slave, self.refused = programs.start(**parameters), False
        self._slave.set_real(list(range(inputs.size)), inputs.tolist())
        try:
            self._slave.setup_experiment(0.0, None, None)
            self._slave.enter_initialization_mode()
            self._slave.exit_initialization_mode()
        except SlaveError:
            self.refused = True

    def motion(self) -> FloatArray:
        """Displacement and rotation vector of each interface, (I, 2, 3)."""
        first = next(number for number, v in self._variables.values() if v.name.endswith("displacement.x"))
        return np.array(self._slave.get_real(list(range(first, first + self._count)))).reshape(-1, 2, 3)

    def real(self, name: str) -> float:
        """Value of a Real variable."""
        return self._slave.get_real([self._variables[name][0]])[0]

    @property
    def warned(self) -> bool:
        """Whether status.code tells of a limit that was passed."""
        return self._slave.get_integer([self._variables[STATUS_CODE][0]])[0] != 0

    @property
    def words(self) -> str:
        """First line of the log."""
        log = self._slave._get_log_queue()
        return log[0].msg.replace("%%", "%") if log else ""


ESTIMATE = "its own estimate"
"""Row of the map that has what the default model says its error is."""
Truth = Mapping[tuple[str, str], FloatArray]
"""Displacements (I, 3) of the interfaces that count, m, by case and factor of each equilibrium."""


def map_stability(scene: Scene, records: Path, report: Reporter, store: Store, crew: Crew | None = None) -> str:
    """Run what is not recorded yet of a map, and record it.

    Parameters
    ----------
    scene : Scene
    records : Path
        CSV.
    report : Reporter
    store : Store
    crew : Crew, optional
        Processes that make the runs. Default: this one.

    Returns
    -------
    str
        How many runs came to which verdict.

    Raises
    ------
    FlexfmuError
        A scene without loads that hold still, a free body, or records of another scene.
    """
    check_target(records, (".csv",), inputs=(scene.body,))
    if not scene.static or scene.config.free:
        raise SceneError("a map of stability takes [[static]] cases of a body that is held: add one to the scene")
    workshop = Workshop(scene, report, store, crew)
    kept = RecordFile(RUNS, records, _owner(scene))
    left = [one for one in mapped_models(scene) if any(run.key not in kept for run in planned(scene, one))]
    with report.counted("Map of stability", len(left), "models") as tell:
        truth = _truth(workshop) if left else {}
        for done, runs in enumerate(workshop.each(_run, [(one, truth) for one in left]), start=1):
            for run in runs:
                if run.key not in kept:
                    kept.append(run)
            tell(done)
    counts = Counter(run.verdict for run in kept.rows)
    return ", ".join(f"{counts[one]} {words}" for one, words in VERDICTS.items())


def mapped_models(scene: Scene) -> list[Candidate | None]:
    """Models of the map: every method of `[sweep]` that the body allows, with each number of frames; None: the default.

    The default model is the one that tells its error.
    """
    sweep, flat = scene.file.sweep, [linear_frames(scene.config)]
    every = [
        Candidate(Reduction(BasisChoice.RESIDUAL, scene.file.reference.modes, frames), Variant(method))
        for method in sweep.methods
        for frames in (sweep.frames if has_frames(method) else flat)
    ]
    return [*(one for one in every if has_meaning(scene.config, one)), None]


def planned(scene: Scene, model: Candidate | None) -> list[Run]:
    """Runs of a model, of which nothing is known yet; of the default once more, for its own estimate."""
    labels = ["default", ESTIMATE]
    if model is not None:
        method = model.variant.method
        labels = [f"{model.reduction.frames} × {method.label}" if has_frames(method) else method.label]
    places = [(case.name, f"{factor:g}") for case in scene.static for factor in scene.file.stability.factors]
    own = _owner(scene), scene.config.name
    return [Run(*own, case, factor, label, "") for label in labels for case, factor in places]


def _owner(scene: Scene) -> str:
    return f"{scene.digest}, {scene.file.stability.tolerance:g}"


def _truth(workshop: Workshop) -> Truth:
    """What the finest model does, where it has an equilibrium."""
    scene, settings = workshop.scene, workshop.scene.file.reference
    # Parts of a cut body are divided as the body file says, or not at all.
    asked = {"frames": max(settings.frames, 1) if scene.config.cut else None}
    fine = by_default(scene.config, Mass.CONSTANT, settings.modes, error=False).model_copy(update=asked)
    model = FlexibleBody(reduce_body(fine, Reporter(), workshop.store, settings.frames))
    found: dict[tuple[str, str], FloatArray] = {}
    for case, factor in product(scene.static, scene.file.stability.factors):
        with suppress(RuntimeBodyError):
            moved = model.response(model.static(case.peak.scaled(factor))).displacement
            found[case.name, f"{factor:g}"] = moved[scene.read_index]
    return found


def _run(workshop: Workshop, mapped: Candidate | None, truth: Truth) -> list[Run]:
    """Run a model: an FMU that holds one method, initialised in each equilibrium."""
    scene = workshop.scene
    if mapped is None:
        body = build(by_default(scene.config), workshop.store).body
    else:
        config = reduction_config(scene.config, mapped.reduction, [mapped.variant]).certified
        body = lean(build(config, workshop.store).body, mapped.variant)
    peaks = {case.name: case.peak for case in scene.static}
    found = []
    with BodyPrograms(body) as programs:
        for blank in planned(scene, mapped):
            start, error = time.perf_counter(), math.nan
            loads = peaks[blank.case].scaled(float(blank.factor)).packed(body.masses is not None)
            slave = DrivenSlave(programs, {"initialization": "static"}, loads)
            expected = truth.get((blank.case, blank.factor))
            if not slave.refused and expected is not None:
                moved = slave.motion()[scene.read_index, 0]
                error = float(np.linalg.norm(moved - expected) / np.linalg.norm(expected))
            name = verdict(error, slave.warned, slave.refused, scene.file.stability.tolerance)
            if blank.model == ESTIMATE and not slave.refused:
                error = slave.real(ERROR)
            run = replace(blank, verdict=name, error=error, words=slave.words)
            found.append(replace(run, seconds=time.perf_counter() - start))
    return found
