"""Coupling FMUs from a file or from Python: set up, run, keep what came out also where a run stops early."""

import math
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from ..files.errors import INTERRUPTED, SimulationError
from ..files.progress import Reporter, Tell, ends_on_interrupt
from ..files.targets import check_target
from ..fmu.runtime import own_log
from ..fmu.simulation import MOST_VALUES
from .config import CouplingFile, Scheme, read_coupling_file
from .doubts import FED, Words
from .foreign import ForeignProcess
from .layout import Wiring
from .loop import GROWS, Loop
from .participants import Participant
from .results import CREATED_ENERGY, ITERATIONS, SUFFIXES, Result, write_result
from .wiring import wire

# s that the loop runs without a word: so soon Ctrl-C ends it.
_PATIENCE = 0.02


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
        loop = Loop(wiring, participants, settings, coupling.output.every)
        stack.callback(loop.close)
        try:
            return _march(coupling, wiring, loop, Words(wiring, settings, report), tell, pressed)
        finally:
            for participant in participants:
                for text in participant.ended():
                    report.warning(f"{participant.name}: {text}")


def _check_size(coupling: CouplingFile, columns: int) -> None:
    """Refuse a run whose results are more than can be kept, before it begins."""
    rows, most = coupling.experiment.steps / coupling.output.every, MOST_VALUES / columns
    if rows > most:
        raise SimulationError(
            f"the results are {rows:.3g} rows of {columns} values each, expected at most {most:.3g} rows: take "
            f"output.every = {coupling.output.every * math.ceil(rows / most)}, fewer output.variables, or an earlier "
            "experiment.stop"
        )
    settings = coupling.experiment
    if settings.scheme is Scheme.ITERATED and (settings.reuse + 1) * settings.max_iterations * columns > MOST_VALUES:
        raise SimulationError(
            f"experiment.max_iterations = {settings.max_iterations} with reuse = {settings.reuse} are more differences "
            "than can be kept: take less of one"
        )


def _march(
    coupling: CouplingFile, wiring: Wiring, loop: Loop, words: Words, tell: Tell, pressed: Callable[[], bool]
) -> Result:
    """Go on to the end, or until Ctrl-C was pressed, in runs of steps so short that a person does not wait for them."""
    settings = coupling.experiment

    def result() -> Result:
        names = (*(variable.name for variable in wiring.recorded), ITERATIONS, CREATED_ENERGY)
        units = (*(variable.unit for variable in wiring.recorded), None, "J")
        return Result(names, units, loop.times, loop.rows)

    loop.begin()
    done, count = loop.outcome, 1
    try:
        while done.steps < settings.steps:
            begun = time.perf_counter()
            try:
                loop.run(min(done.steps + count, settings.steps))
            finally:
                words.notices(loop)
            if done.ending == GROWS:
                raise SimulationError(words.runaway(done))
            if count == done.steps == 1 and settings.scheme is not Scheme.ITERATED:
                words.stiff_springs(loop.slope())
            tell(done.steps * settings.step)
            if pressed() and done.steps < settings.steps:
                loop.record()
                at = f"stopped at {done.steps * settings.step:.9g} s of {settings.stop:g} s: ended by Ctrl-C"
                raise CouplingStoppedError(at, result(), interrupted=True)
            spent = time.perf_counter() - begun
            count = 2 * count if spent < 0.5 * _PATIENCE else max(count // 2, 1) if spent > _PATIENCE else count
    except CouplingStoppedError:
        raise
    except SimulationError as error:
        told = FED in str(error) or done.feeds <= 0
        at = f"stopped at {done.steps * settings.step:.9g} s: {error}" + ("" if told else f"\n{FED}")
        raise CouplingStoppedError(at, result()) from error
    words.end(done)
    return result()


def run(path: Path, output: Path, report: Reporter) -> Result:
    """Run the coupling of a file and write its results; of a run that stops early, as NAME.partial.SUFFIX beside it.

    Parameters
    ----------
    path : Path
        Coupling file (TOML).
    output : Path
        CSV or HDF5, by its ending.
    report : Reporter

    Returns
    -------
    Result

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
    return result
