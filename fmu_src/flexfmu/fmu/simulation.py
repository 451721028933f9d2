"""Driving an FMU through fmpy by a table of loads, and what came of it in one line."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import fmpy
import numpy as np
from fmpy.model_description import ModelDescription, ScalarVariable
from numpy.typing import NDArray

from ..files import basics
from ..files.basics import FloatArray, SimulationError, plural
from ..files.outputs import SILENT, Reporter, check_target, ends_on_interrupt
from ..files.tables import Kind, check_input, number, read_table, write_table
from ..program.variable_table import STEP_TOLERANCE
from .runtime import own_log

# FMI 2.0 statuses from here on mean that a call was not honoured.
_FMI_DISCARD = 2
# Share of a load's area over time that communication points may pass over in silence.
_PASSED_OVER = 0.1


def parse_parameters(settings: Sequence[str]) -> dict[str, object]:
    """Turn NAME=VALUE texts into start values; numbers become numbers.

    Parameters
    ----------
    settings : sequence of str

    Returns
    -------
    dict of str to float or str

    Raises
    ------
    SimulationError
        A text without a name, without a value, or two of one name.
    """
    result: dict[str, object] = {}
    for text in settings:
        name, _, value = (part.strip() for part in text.partition("="))
        if not name or not value:
            lacks = "the parameter's name" if not name or number(text) is not None else "a value"
            raise SimulationError(f"--set {text}: lacks {lacks}, expected NAME=VALUE, such as --set damping.scale=2")
        if name in result:
            raise SimulationError(f"--set {text}: {name} is set twice, expected each parameter once")
        found = number(value)
        result[name] = value if found is None else found
    return result


def simulate(
    fmu: Path,
    names: Sequence[str],
    loads: FloatArray,
    *,
    step: float | None = None,
    stop: float | None = None,
    parameters: Mapping[str, object] | None = None,
    report: Reporter = SILENT,
) -> tuple[list[str], FloatArray]:
    """Drive an FMU by loads that are linear between the rows of a table, held constant over each step.

    Parameters
    ----------
    fmu : Path
    names : sequence of str
        Inputs that the table gives; others stay zero.
    loads : (rows, 1 + len(names)) float
        Time (s), then the inputs.
    step : float, optional
        Communication step, s; default: the FMU's DefaultExperiment.
    stop : float, optional
        s; default: the table's last time.
    parameters : mapping of str to float or str, optional
        Start values of parameters.
    report : Reporter, optional

    Returns
    -------
    outputs : list of str
    result : (steps + 1, 1 + len(outputs)) float
        Time, then all real outputs.

    Raises
    ------
    SimulationError
        An unknown input or parameter, more steps than can be kept, an FMU that fails its start, or a file that is none.
    StoppedError
        A step that the FMU refuses, or Ctrl-C; with what came out until then.
    """
    description = description_of(fmu)
    inputs = [v.name for v in _known(description, "input", names, fmu)]
    settings = _typed(_known(description, "parameter", parameters or {}, fmu), parameters or {})
    outputs = [v.name for v in description.modelVariables if v.causality == "output" and v.type == "Real"]
    start, end, interval = _span(description, loads, step, stop)
    _doubt(names, loads, end, settings, report)
    _check_size(start, end, interval, 1 + len(outputs))
    _tell_passed_over(names, loads, np.arange(start, end + 0.5 * interval, interval), report)
    run = _Run(fmu, outputs, end)
    span = {"start_time": start, "stop_time": end, "output_interval": interval}
    result = run.driven(span, report, input=_signals(inputs, names, loads), start_values=settings)
    report.tell(warnings=run.messages)
    return outputs, _columns(result, outputs)


def description_of(fmu: Path) -> ModelDescription:
    """The model description of an FMU of FMI 2.0 for co-simulation; a SimulationError for others."""
    check_input(fmu, SimulationError, Kind.FMU)
    try:
        found = fmpy.read_model_description(str(fmu))
    except Exception as error:  # fmpy raises bare exceptions
        raise SimulationError(f"{fmu}: not a readable FMU ({error})") from error
    if found.fmiVersion != "2.0" or found.coSimulation is None:
        kind = "co-simulation" if found.coSimulation is not None else "model exchange only"
        expected = "expected FMI 2.0 for co-simulation: export it so (flexfmu build without --fmi 3)"
        raise SimulationError(f"{fmu} is FMI {found.fmiVersion}, {kind}; {expected}")
    return found


class _Run:
    """What an FMU says in a run, and the rows so far."""

    def __init__(self, fmu: Path, outputs: list[str], end: float):
        self._fmu, self._outputs, self._end = fmu, outputs, end
        self.messages: list[str] = []
        self.refusals: list[str] = []
        self.recorder: fmpy.simulation.Recorder | None = None

    def log(self, _environment: object, _instance: object, status: int, category: bytes | None, text: bytes) -> None:
        """The FMU's logger."""
        # Lines without a category are the library's own, and say only which call failed.
        if category:
            (self.refusals if status >= _FMI_DISCARD else self.messages).append(text.decode(errors="replace"))

    def driven(self, span: Mapping[str, float], report: Reporter, **given: object) -> NDArray[np.void]:
        """What fmpy makes of a run over a span of time."""
        start, interval = span["start_time"], span["output_interval"]
        title = f"Simulate {self._fmu.name} from {start:g} s to {self._end:g} s in steps of {interval:g} s"
        with report.counted(title, self._end - start, "s") as tell, ends_on_interrupt(report) as pressed, own_log():

            def step_finished(time: float, recorder: fmpy.simulation.Recorder) -> bool:
                self.recorder = recorder
                tell(time - start)
                # Of FMUs that would try a refused step again and again.
                return not (pressed() or self.refusals)

            heard = {"step_finished": step_finished, "logger": self.log, "debug_logging": True}
            options = {"output": self._outputs, **heard}
            try:
                result: NDArray[np.void] = fmpy.simulate_fmu(str(self._fmu), **span, **options, **given)
            except Exception as error:  # fmpy's FMICallException and what its loader raises
                raise self.stopped("; ".join(self.refusals) or str(error)) from error
            # fmpy ends a run quietly where the FMU discards a step.
            if self.refusals:
                raise self.stopped("; ".join(self.refusals))
            if pressed() and result["time"][-1] < self._end - 0.5 * interval:
                raise self.stopped("ended by Ctrl-C", interrupted=True)
        return result

    def stopped(self, why: str, interrupted: bool = False) -> SimulationError:
        """What is raised in mid-run, with the rows so far if there are any."""
        if self.recorder is None or not self.recorder.rows:
            return SimulationError(f"{self._fmu.name} stopped: {why}")
        result = _columns(self.recorder.result(), self._outputs)
        # fmpy records the state before a refused step once more.
        result = result[np.append(True, np.diff(result[:, 0]) > 0.0)]
        words = f"{self._fmu.name} stopped at {result[-1, 0]:.9g} s of {self._end:g} s: {why}"
        return basics.StoppedError(words, (self._outputs, result), interrupted)


def _span(
    description: ModelDescription, loads: FloatArray, step: float | None, stop: float | None
) -> tuple[float, float, float]:
    """Start, end and communication step of a run, s, by the table, the FMU's own step and what was asked for."""
    start = float(loads[0, 0])
    end = float(loads[-1, 0]) if stop is None else stop
    interval = float(description.defaultExperiment.stepSize) if step is None else step
    if stop is None and end == start:
        raise SimulationError(f"the table has rows at one time only, {start:g} s: add a later row, or give --stop")
    if not (math.isfinite(interval) and interval > 0.0 and math.isfinite(end) and end > start):
        found = f"from {start} s to {end} s in steps of {interval} s: expected a later end and a step > 0"
        raise SimulationError(f"{found} (--stop, --step; without them the table's last time and the FMU's own step)")
    if step is not None and interval > end - start:
        found = f"--step is {step:g} s, longer than the run from {start:g} s to {end:g} s: expected a shorter step"
        raise SimulationError(f"{found}; the FMU's own is {float(description.defaultExperiment.stepSize):g} s")
    return start, end, interval


def _doubt(names: Sequence[str], loads: FloatArray, end: float, given: Mapping[str, object], report: Reporter) -> None:
    """Warn of what is allowed, and hardly meant."""
    tolerance = given.get(STEP_TOLERANCE, 0.0)
    if isinstance(tolerance, int | float) and tolerance >= 1.0:
        report.warning(f"{STEP_TOLERANCE} = {tolerance:g} accepts any error; expected a share below 1, such as 1e-4")
    last = float(loads[-1, 0])
    if end > last and len(loads) > 1:
        report.warning(f"the run ends at {end:g} s, its table at {last:g} s: the last loads are held from there on")
    if not names:
        report.warning("the table has no column but time: nothing acts on the body; add inputs by name")
    elif not np.any(loads[:, 1:]):
        report.warning("all values of the table are zero: nothing acts on the body")


def _tell_passed_over(names: Sequence[str], loads: FloatArray, points: FloatArray, report: Reporter) -> None:
    """Warn of loads that communication points (s) pass over, by their areas over time."""
    times, gap = loads[:, 0], np.diff(loads[:, 0])
    # Jumps have points of their own.
    points = np.union1d(points, times[1:][gap == 0.0])
    fine = np.union1d(times, points)
    for name, column in zip(names, loads[:, 1:].T, strict=True):
        there = np.interp(fine, times, column)
        missed = np.abs(there - np.interp(fine, points, np.interp(points, times, column)))
        share = np.trapezoid(missed, fine) / max(float(np.trapezoid(np.abs(there), fine)), np.finfo(float).tiny)
        if share > _PASSED_OVER:
            report.warning(
                f"communication points pass over {100.0 * share:.0f} % of {name} (area over time), most of it at "
                f"{fine[np.argmax(missed)]:g} s: take a shorter step (--step; the table's closest rows are "
                f"{np.min(gap[gap > 0.0]):g} s apart)"
            )


def _columns(result: NDArray[np.void], outputs: Sequence[str]) -> FloatArray:
    """Time and outputs of fmpy's structured array."""
    return np.column_stack([result[name] for name in ("time", *outputs)])


def _check_size(start: float, end: float, interval: float, columns: int) -> None:
    """Refuse a run whose results are more than can be kept, before it begins."""
    steps, most = (end - start) / interval, basics.MOST_VALUES / columns
    if steps > most:
        raise SimulationError(
            f"from {start:g} s to {end:g} s in steps of {interval:g} s are {steps:.3g} steps of {columns} values each, "
            f"expected at most {most:.3g} steps, whose results can be kept; take an earlier stop or a longer step, or "
            "run it in pieces"
        )


def _known(description: ModelDescription, causality: str, names: Iterable[str], fmu: Path) -> list[ScalarVariable]:
    """Variables of a causality, after making sure that all names asked for are among them."""
    every = {v.name: v for v in description.modelVariables}
    there = [v for v in every.values() if v.causality == causality]
    for name in names:
        if name in every and every[name].causality == causality:
            continue
        if name in every and every[name].causality == "input":
            help_ = "it is an input: give it a column of the table of loads"
        elif name in every:
            help_ = f"it is of causality {every[name].causality}; {basics.nearest('', [v.name for v in there])}"
        else:
            help_ = basics.nearest(name, [v.name for v in there])
        raise SimulationError(f"{name!r} is no {causality} of {fmu.name}; {help_}")
    return there


def _typed(variables: Sequence[ScalarVariable], settings: Mapping[str, object]) -> dict[str, object]:
    """Start values of their variables' types and within their limits."""
    known, result = {v.name: v for v in variables}, dict(settings)
    for name, value in settings.items():
        variable = known[name]
        if variable.type == "String" and isinstance(value, float):
            result[name] = f"{value:g}"
        if variable.type != "Real":
            continue
        low = -math.inf if variable.min is None else float(variable.min)
        if not isinstance(value, int | float) or not low <= value < math.inf:
            least = "" if variable.min is None else f" ≥ {low:g}"
            raise SimulationError(f"--set {name}={value}: expected a finite number{least}")
    return result


def _signals(inputs: Sequence[str], names: Sequence[str], loads: FloatArray) -> NDArray[np.void]:
    """Input table for fmpy."""
    # Of several rows at the first time only the last counts: fmpy would begin with the first and jump a step later.
    loads = loads[int(np.searchsorted(loads[:, 0], loads[0, 0], side="right")) - 1 :]
    # Every input is given, so that fmpy does not warn about those that stay zero.
    signals = np.zeros(len(loads), dtype=[("time", float), *((name, float) for name in inputs)])
    for column, name in enumerate(("time", *names)):
        signals[name] = loads[:, column]
    return signals


def simulate_csv(
    fmu: Path,
    loads: Path,
    output: Path,
    step: float | None,
    stop: float | None,
    parameters: Mapping[str, object],
    report: Reporter,
) -> tuple[list[str], FloatArray]:
    """Drive an FMU by a CSV of loads and write a CSV of its motion, of a run that stops early as NAME.partial.csv.

    Parameters
    ----------
    fmu, loads, output : Path
    step, stop : float or None
        s.
    parameters : mapping of str to float or str
    report : Reporter

    Returns
    -------
    outputs, result
        As of `simulate`.

    Raises
    ------
    SimulationError
        See `simulate`.
    """
    check_target(output, (".csv",), inputs=(fmu, loads))
    names, values = read_table(loads)
    with basics.keeping_partial(output, lambda path, came: write_table(path, *came)):
        outputs, result = simulate(fmu, names, values, step=step, stop=stop, parameters=parameters, report=report)
    write_table(output, outputs, result)
    return outputs, result


def outcome(names: Sequence[str], result: FloatArray, warnings: int) -> str:
    """Largest displacement and rotation of any interface, when, and how many warnings there were.

    Parameters
    ----------
    names : sequence of str
        Outputs.
    result : (rows, 1 + len(names)) float
        Time (s), then the outputs.
    warnings : int

    Returns
    -------
    str
    """
    found = []
    for quantity, words in (("displacement", basics.metres), ("rotation", lambda value: f"{np.degrees(value):.4g}°")):
        lengths: list[tuple[float, str, float]] = []
        for interface in dict.fromkeys(name.split(".")[0] for name in names if f".{quantity}." in name):
            columns = [1 + names.index(f"{interface}.{quantity}.{axis}") for axis in "xyz"]
            length = np.linalg.norm(result[:, columns], axis=1)
            row = int(np.argmax(length))
            lengths.append((float(length[row]), interface, float(result[row, 0])))
        if lengths:
            size, interface, time = max(lengths, key=lambda one: one[0])
            found.append(f"largest {quantity} {words(size)} of {interface} at {time:.4g} s")
    return "; ".join([*found, plural(warnings, "warning")])
