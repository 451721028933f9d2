"""Coupling FMUs from a file or from Python: set up, run, keep what came out also where a run stops early."""

import math
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from ..files.array_types import FloatArray
from ..files.errors import INTERRUPTED, SimulationError
from ..files.progress import Reporter, Tell, ends_on_interrupt
from ..files.targets import check_target
from ..fmu.runtime import own_log
from ..fmu.simulation import MOST_VALUES
from .config import CouplingFile, Scheme, read_coupling_file
from .exchange import EnergyCount, counted
from .foreign import ForeignProcess
from .growth import FED, GrowthWatch, fed
from .layout import Wiring
from .participants import Participant
from .resolution import ResolutionWatch
from .results import CREATED_ENERGY, ITERATIONS, SUFFIXES, Result, write_result
from .schemes import Point, Stage, scheme
from .wiring import wire

# Answer of springs to their own loads beyond which explicit schemes are warned of.
_STIFF = 0.1


class CouplingStoppedError(SimulationError):
    """A run that ended before its time.

    Parameters
    ----------
    message : str
    result : Result
        What came out until then.
    interrupted : bool
        Whether the user ended it.
    """

    def __init__(self, message: str, result: Result, interrupted: bool = False):
        super().__init__(message)
        self.result = result
        if interrupted:
            self.exit_code = INTERRUPTED


class _Recorder:
    """Rows of results as they come."""

    def __init__(self, wiring: Wiring, participants: list[Participant]):
        self._recorded = wiring.recorded
        self._of = [
            (participant, [k for k, variable in enumerate(wiring.recorded) if variable.role == role])
            for role, participant in enumerate(participants)
        ]
        self._times: list[float] = []
        self._rows: list[FloatArray] = []

    def record(self, time: float, iterations: float, created: float) -> None:
        row = np.empty(len(self._recorded) + 2)
        for participant, places in self._of:
            row[places] = participant.recorded([self._recorded[k] for k in places])
        row[-2:] = iterations, created
        self._times.append(time)
        self._rows.append(row)

    def result(self) -> Result:
        names = (*(variable.name for variable in self._recorded), ITERATIONS, CREATED_ENERGY)
        units = (*(variable.unit for variable in self._recorded), None, "J")
        return Result(names, units, np.array(self._times), np.array(self._rows).reshape(-1, len(names)))


def couple(coupling: CouplingFile, report: Reporter | None = None) -> Result:
    """Run coupled FMUs.

    Parameters
    ----------
    coupling : CouplingFile
    report : Reporter, optional

    Returns
    -------
    Result

    Raises
    ------
    SimulationError
        The coupling cannot be, or an FMU fails its start; nothing has run.
    CouplingStoppedError
        An FMU refused or failed a step, the coupled inputs did not settle, or Ctrl-C; with what came out until then.
    """
    report = report or Reporter()
    settings = coupling.experiment
    wiring = wire(coupling)
    _check_size(coupling, len(wiring.recorded) + 3)
    names = ", ".join(role.description.name for role in wiring.roles)
    title = f"Couple {names} to {settings.stop:g} s in steps of {settings.step:g} s, {settings.scheme.value}"
    with report.counted(title, settings.stop, "s") as tell, ends_on_interrupt(report) as pressed, ExitStack() as stack:
        stack.enter_context(own_log())
        foreign = ForeignProcess(settings.timeout)
        stack.callback(foreign.close)
        participants = []
        for role in wiring.roles:
            participants.append(Participant(role, foreign))
            stack.callback(participants[-1].close)
        for participant in participants:
            participant.initialize(settings.stop)
        # What grows without bound is told of in words.
        with np.errstate(all="ignore"):
            result = _march(coupling, Stage(wiring, participants, settings.step), report, tell, pressed)
        for participant in participants:
            for text in participant.warnings():
                report.warning(f"{participant.name}: {text}")
    return result


def _check_size(coupling: CouplingFile, columns: int) -> None:
    """Refuse a run whose results are more than can be kept, before it begins."""
    rows, most = coupling.experiment.steps / coupling.output.every, MOST_VALUES / columns
    if rows > most:
        raise SimulationError(
            f"the results are {rows:.3g} rows of {columns} values each, expected at most {most:.3g} rows: take "
            f"output.every = {coupling.output.every * math.ceil(rows / most)}, fewer output.variables, or an earlier "
            "experiment.stop"
        )


def _march(coupling: CouplingFile, stage: Stage, report: Reporter, tell: Tell, pressed: Callable[[], bool]) -> Result:
    """Step by step to the end, or until Ctrl-C was pressed."""
    settings, recorder = coupling.experiment, _Recorder(stage.wiring, list(stage.participants))
    point = stage.initial()
    recorder.record(0.0, 0.0, 0.0)
    advance, rounds = scheme(stage, settings), 0
    energies, odd = EnergyCount(0.0, 0.0, 0.0), set[str]()
    growth = GrowthWatch(report.warning, settings.scheme is Scheme.ITERATED)
    resolution = ResolutionWatch(stage.wiring, report.warning)
    try:
        while point.number < settings.steps:
            point = advance(point)
            rounds += point.iterations
            _watch(stage, point, odd, report)
            energies = counted(energies, stage.wiring, point.signals, point.before, point.held, settings.step)
            if point.number == 1 and settings.scheme is not Scheme.ITERATED:
                _warn_of_stiff_springs(stage, point, report)
            ended = pressed() and point.number < settings.steps
            if ended or point.number % coupling.output.every == 0 or point.number == settings.steps:
                recorder.record(point.number * settings.step, point.iterations, energies.created)
            resolution.look(point.signals, point.number * settings.step)
            if (runaway := growth.look(energies, point.number * settings.step)) is not None:
                raise SimulationError(runaway)
            tell(point.number * settings.step)
            if ended:
                words = f"stopped at {point.number * settings.step:.9g} s of {settings.stop:g} s: ended by Ctrl-C"
                raise CouplingStoppedError(words, recorder.result(), interrupted=True)
    except CouplingStoppedError:
        raise
    except SimulationError as error:
        at = point.number * settings.step
        told = FED in str(error) or not fed(energies)
        words = f"stopped at {at:.9g} s: {error}" + ("" if told else f"\n{FED}")
        raise CouplingStoppedError(words, recorder.result()) from error
    growth.end(energies)
    if settings.scheme is Scheme.ITERATED:
        report.note(f"{rounds / settings.steps:.2f} iterations a step")
    return recorder.result()


def _watch(stage: Stage, point: Point, odd: set[str], report: Reporter) -> None:
    """Say once of each FMU that its status is no longer sound."""
    for participant in stage.participants:
        if participant.status() and participant.name not in odd:
            odd.add(participant.name)
            at = point.number * stage.step
            report.warning(f"{participant.name}: status.code is {participant.status()} from {at:.6g} s on")


def _warn_of_stiff_springs(stage: Stage, point: Point, report: Reporter) -> None:
    """Say so where the interfaces' compliance tells that an explicit scheme will grow."""
    model = stage.response(point.signals, point.before)
    if model is None:
        return
    size = float(np.max(np.abs(np.linalg.eigvals(model.slope))))
    if size > _STIFF:
        report.warning(
            f"springs answer their own loads {size:.2g}-fold within a step; explicit coupling grows where that is not "
            'small against 1: take scheme = "iterated", or a shorter step'
        )


def run(path: Path, output: Path, report: Reporter) -> None:
    """Run the coupling of a file and write its results; of a run that stops early, as NAME.partial.SUFFIX beside it.

    Parameters
    ----------
    path : Path
        Coupling file (TOML).
    output : Path
        CSV or HDF5, by its ending.
    report : Reporter

    Raises
    ------
    SimulationError
        The coupling cannot be, or stopped early.
    OutputError
        The results cannot be written.
    """
    coupling = read_coupling_file(path)
    tables = [fmu.input for fmu in coupling.fmu if fmu.input is not None]
    check_target(output, SUFFIXES, inputs=(path, *(fmu.file for fmu in coupling.fmu), *tables))
    try:
        result = couple(coupling, report)
    except CouplingStoppedError as stopped:
        partial = output.with_suffix(f".partial{output.suffix}")
        write_result(partial, stopped.result)
        words = f"{stopped}\nWhat came out until then is in {partial}"
        raise CouplingStoppedError(words, stopped.result, stopped.exit_code == INTERRUPTED) from stopped
    write_result(output, result)
