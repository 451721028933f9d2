"""Coupling FMUs from a file or from Python: set up, run, keep what came out where a run stops early; or as SSP 1.0.

An SSP archive has FMUs, connections, start values and the span of time, for other masters.
"""

import math
import time
import zipfile
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from ..files.basics import MOST_VALUES, FloatArray, SimulationError, StoppedError, keeping_partial, own_version
from ..files.outputs import SILENT, Reporter, Tell, check_target, ends_on_interrupt, picture_html, whole_file
from ..files.tables import write_table
from ..fmu.description import as_file
from ..fmu.runtime import own_log
from .config import CouplingFile, ExperimentTable, Scheme, read_coupling_file
from .layout import Description, Wiring, read_description
from .loop import GROWS, Loop
from .participants import Participant
from .wiring import wire

FED = 'the coupling itself fed the motion: take scheme = "iterated", or a shorter step'
TAKEN = "the coupling itself damped the motion: take a shorter step{}"
# `NoticeKind` of core/doubts.h.
_ODD_STATUS, _FED, _TAKEN, _COARSE = range(4)
# Answer of springs to their own loads beyond which explicit schemes are warned of.
_STIFF = 0.1


class Words:
    """Tells a user what the loop noticed.

    Parameters
    ----------
    wiring : Wiring
    settings : ExperimentTable
    report : Reporter
    """

    def __init__(self, wiring: Wiring, settings: ExperimentTable, report: Reporter):
        self._wiring, self._settings, self._report = wiring, settings, report
        self._iterated = settings.scheme is Scheme.ITERATED
        self._told, self._fed = 0, False

    def notices(self, loop: Loop) -> None:
        """Tell what was noticed since the last time.

        Parameters
        ----------
        loop : Loop
        """
        for notice in loop.notices[self._told : loop.outcome.notices]:
            self._report.warning(self._words(notice, notice.step * self._settings.step))
            self._fed |= notice.kind == _FED
        self._told = loop.outcome.notices

    def _words(self, notice: Any, time: float) -> str:
        figure, other = notice.figures
        if notice.kind == _ODD_STATUS:
            name = self._wiring.roles[notice.who].description.name
            return f"{name}: status.code is {figure:.0f} from {time:.6g} s on"
        if notice.kind == _COARSE:
            return (
                f"the step does not resolve the motion of {self._wiring.ends.names[notice.who]}: with {figure:.3g} "
                f"steps a period it lags by some {other:.2g} rad at {time:.6g} s: take a shorter step"
            )
        if notice.kind == _FED:
            return _energies(FED, "created", figure, other, f" from {time:.6g} s on")
        remedy = ', or held = "mean"' if self._iterated else ', or scheme = "iterated" with held = "mean"'
        return _energies(TAKEN.format(remedy), "took", figure, other, f" from {time:.6g} s on")

    def stiff_springs(self, slope: FloatArray | None) -> None:
        """Say so where the interfaces' compliance tells that an explicit scheme will grow.

        Parameters
        ----------
        slope : (n, n) float or None
            Of the coupled inputs by themselves.
        """
        size = 0.0 if slope is None else float(np.max(np.abs(np.linalg.eigvals(slope)), initial=0.0))
        if size > _STIFF:
            self._report.warning(
                f"springs answer their own loads {size:.2g}-fold within a step; explicit coupling grows where that is "
                'not small against 1: take scheme = "iterated", or a shorter step'
            )

    def end(self, outcome: Any) -> None:
        """Say what was not said on the way, and how many iterations there were."""
        if outcome.feeds > 0 and not self._fed:
            self._report.warning(_energies(FED, "created", outcome.energies.created, outcome.energies.stored, ""))
        if self._iterated:
            self._report.note(f"{outcome.rounds / outcome.steps:.2f} iterations a step")


def _energies(words: str, verb: str, created: float, stored: float, since: str) -> str:
    return f"{words} (it {verb} {abs(created):.3g} J{since}, the springs held {stored:.3g} J at most)"


SUFFIXES = (".csv", ".h5", ".hdf5")
ITERATIONS = "master.iterations"
CREATED_ENERGY = "master.created_energy"


@dataclass(frozen=True, slots=True)
class Result:
    """What the coupled FMUs did.

    Attributes
    ----------
    names : tuple of str
        "fmu.variable", C of them; the last ones are the master's own.
    units : tuple of str or None
    time : (T,) float
        s.
    values : (T, C) float
    """

    names: tuple[str, ...]
    units: tuple[str | None, ...]
    time: FloatArray
    values: FloatArray

    def __post_init__(self) -> None:
        for array in (self.time, self.values):
            array.flags.writeable = False

    def __getitem__(self, name: str) -> FloatArray:
        """Values (T,) of a column by its name."""
        return self.values[:, self.names.index(name)]

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame of the columns, with time as its index."""
        import pandas

        return pandas.DataFrame(self.values, index=pandas.Index(self.time, name="time"), columns=list(self.names))

    def plot(self) -> Any:
        """A matplotlib figure of the motions among the columns."""
        from ..fmu.curves import result_figure

        return result_figure(self.names, self.time, self.values)

    def _repr_html_(self) -> str:
        return picture_html(self.plot())


def write_result(path: Path, result: Result) -> None:
    """Write results, by the file name's ending as CSV or HDF5; the file appears whole or not at all.

    CSV: as `write_table`. HDF5: datasets "time" and one a column, with the attribute "unit".

    Parameters
    ----------
    path : Path
    result : Result

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    if path.suffix.lower() == ".csv":
        write_table(path, result.names, np.column_stack([result.time, result.values]), result.units)
        return
    import h5py

    columns = zip(("time", *result.names), ("s", *result.units), (result.time, *result.values.T), strict=True)
    with whole_file(path) as part, h5py.File(part, "w") as file:
        for name, unit, values in columns:
            # HDF5 takes a slash for a group.
            dataset = file.create_dataset(name.replace("/", "_"), data=values, track_times=False)
            dataset.attrs["unit"] = unit or ""


# s that the loop runs without a word: so soon Ctrl-C ends it.
_PATIENCE = 0.02


def couple(coupling: CouplingFile, report: Reporter = SILENT) -> Result:
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
    StoppedError
        An FMU refused or failed a step, the coupled inputs did not settle, or Ctrl-C; with what came out until then.
    """
    settings = coupling.experiment
    wiring = wire(coupling)
    _check_size(coupling, len(wiring.recorded) + 3)
    names = ", ".join(role.description.name for role in wiring.roles)
    title = f"Couple {names} to {settings.stop:g} s in steps of {settings.step:g} s, {settings.scheme.value}"
    with report.counted(title, settings.stop, "s") as tell, ends_on_interrupt(report) as pressed, ExitStack() as stack:
        stack.enter_context(own_log())
        participants = []
        for role in wiring.roles:
            participants.append(Participant(role, settings.timeout))
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
        return Result(names, (*(variable.unit for variable in wiring.recorded), None, "J"), loop.times, loop.rows)

    loop.ask("begin")
    done, count = loop.outcome, 1
    try:
        while done.steps < settings.steps:
            begun = time.perf_counter()
            try:
                loop.run(min(done.steps + count, settings.steps))
            finally:
                words.notices(loop)
            if done.ending == GROWS:
                created = done.energies.created
                raise SimulationError(f"the motion grows without bound. {FED} (it created {created:.3g} J)")
            if count == done.steps == 1 and settings.scheme is not Scheme.ITERATED:
                words.stiff_springs(loop.slope())
            tell(done.steps * settings.step)
            if pressed() and done.steps < settings.steps:
                loop.ask("record")
                at = f"stopped at {done.steps * settings.step:.9g} s of {settings.stop:g} s: ended by Ctrl-C"
                raise StoppedError(at, result(), interrupted=True)
            spent = time.perf_counter() - begun
            count = 2 * count if spent < 0.5 * _PATIENCE else max(count // 2, 1) if spent > _PATIENCE else count
    except StoppedError:
        raise
    except SimulationError as error:
        told = FED in str(error) or done.feeds <= 0
        at = f"stopped at {done.steps * settings.step:.9g} s: {error}" + ("" if told else f"\n{FED}")
        raise StoppedError(at, result()) from error
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
    check_target(output, SUFFIXES, inputs=(path, *(file for fmu in coupling.fmu for file in (fmu.file, fmu.input))))
    with keeping_partial(output, write_result):
        result = couple(coupling, report)
    write_result(output, result)
    return result


_SPACE = "http://ssp-standard.org/SSP1/SystemStructure"
_SPACES = {"ssd": "Description", "ssc": "Common", "ssv": "ParameterValues"}
# OMSimulator reads the communication step there.
_OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
_FMU = "application/x-fmu-sharedlibrary"
# Names of the system's inputs begin with it.
_TABLE = "table."


def write_ssp(file: Path, path: Path, report: Reporter) -> None:
    """Write the system of a coupling file as an SSP; the same FMUs and file give the same bytes.

    Columns of tables become inputs "table.FMU.VARIABLE" of the system; the tables lie in its folder extra. Start
    values are one parameter set, resources/start.ssv, of names "FMU.VARIABLE". Masters take schemes of their own.

    Parameters
    ----------
    file : Path
        Coupling file (TOML).
    path : Path
        Ends in ".ssp"; the system has its name.
    report : Reporter

    Raises
    ------
    SimulationError
        The coupling cannot be, or SSP cannot hold it.
    OutputError
        The file cannot be written.
    """
    coupling = read_coupling_file(file)
    check_target(path, (".ssp",), inputs=[fmu.file for fmu in coupling.fmu])
    wiring = wire(coupling)
    described = {fmu.name: read_description(fmu.name, fmu.file) for fmu in coupling.fmu}
    _check(coupling, described)
    fed = [place for places, _ in wiring.tables for place in places]
    inputs = [wiring.input_names[place] for place in fed]
    outputs = [
        recorded.name
        for recorded in wiring.recorded
        if described[recorded.name.partition(".")[0]].variables[recorded.name.partition(".")[2]].causality == "output"
    ]
    # The same file under several names lies there once.
    sources: dict[Path, str] = {}
    for fmu in coupling.fmu:
        sources.setdefault(fmu.file.resolve(), f"resources/{fmu.name}.fmu")
    files = {
        "SystemStructure.ssd": as_file(_structure(path.stem, coupling, sources, described, inputs, outputs)),
        "resources/start.ssv": as_file(_start(coupling, described)),
        **{source: file.read_bytes() for file, source in sources.items()},
        **{f"extra/{fmu.name}.csv": fmu.input.read_bytes() for fmu in coupling.fmu if fmu.input is not None},
    }
    with whole_file(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, data in files.items():
            # Of the earliest date that the format knows: archives of the same contents are the same.
            archive.writestr(zipfile.ZipInfo(entry), data, zipfile.ZIP_DEFLATED)
    if inputs:
        named = ", ".join(_TABLE + text for text in inputs)
        report.warning(f"SSP has no tables: the master must feed the system's inputs {named}")
    if coupling.experiment.scheme is not Scheme.JACOBI:
        report.warning(f"SSP has no schemes: masters take their own, not {coupling.experiment.scheme.value!r}")


def _check(coupling: CouplingFile, described: dict[str, Description]) -> None:
    """Refuse what SSP 1.0 has no element for, all at once."""
    wrong = [
        f"spring {number} ({spring.a} to {spring.b or 'the ground'}): SSP joins signals, not interfaces; "
        "put the spring into an FMU of its own, with connections"
        for number, spring in enumerate(coupling.spring, start=1)
    ]
    targets = [link.target for link in coupling.connection]
    for number, link in enumerate(coupling.connection, start=1):
        fmu, _, variable = link.source.partition(".")
        if link.target in targets[: number - 1]:
            wrong.append(f"connection {number}: {link.target} has another connection, and SSP's inputs take one")
        if described[fmu].variables[variable].causality != "output":
            wrong.append(f"connection {number}: {link.source} is a local variable, and SSP connects outputs")
    if wrong:
        raise SimulationError("as SSP:\n  " + "\n  ".join(wrong))


def _root(tag: str, **attributes: str) -> Element:
    names = {f"xmlns:{short}": _SPACE + rest for short, rest in _SPACES.items()}
    return Element(tag, {**names, "version": "1.0", **attributes, "generationTool": f"flexfmu {own_version()}"})


def _structure(
    name: str,
    coupling: CouplingFile,
    sources: dict[Path, str],
    described: dict[str, Description],
    inputs: list[str],
    outputs: list[str],
) -> Element:
    """SystemStructure.ssd; `inputs` of the system, and `outputs` that become connectors, are "FMU.VARIABLE"."""
    root = _root("ssd:SystemStructureDescription", name=name)
    system = SubElement(root, "ssd:System", name=name)
    links = coupling.connection
    _connectors(system, dict.fromkeys((_TABLE + text for text in inputs), ("input", "Real")))
    SubElement(SubElement(system, "ssd:ParameterBindings"), "ssd:ParameterBinding", source="resources/start.ssv")
    elements = SubElement(system, "ssd:Elements")
    kinds = dict.fromkeys((*inputs, *(link.target for link in links)), "input")
    kinds |= dict.fromkeys((*(link.source for link in links), *outputs), "output")
    for fmu in coupling.fmu:
        part = SubElement(elements, "ssd:Component", name=fmu.name, type=_FMU, source=sources[fmu.file.resolve()])
        part.set("implementation", "CoSimulation")
        mine = {text.partition(".")[2]: kind for text, kind in kinds.items() if text.partition(".")[0] == fmu.name}
        variables = described[fmu.name].variables
        _connectors(part, {variable: (kind, variables[variable].type) for variable, kind in mine.items()})
    joints = Element("ssd:Connections")
    for text in inputs:
        end = dict(zip(("endElement", "endConnector"), text.split(".", 1), strict=True))
        SubElement(joints, "ssd:Connection", {"startConnector": _TABLE + text, **end})
    for link in links:
        start = dict(zip(("startElement", "startConnector"), link.source.split(".", 1), strict=True))
        end = dict(zip(("endElement", "endConnector"), link.target.split(".", 1), strict=True))
        joint = SubElement(joints, "ssd:Connection", start | end)
        if link.factor is not None:
            # The factor is all of the conversion.
            joint.set("suppressUnitConversion", "true")
            SubElement(joint, "ssc:LinearTransformation", factor=repr(link.factor))
    if len(joints):
        system.append(joints)
    note = SubElement(SubElement(system, "ssd:Annotations"), "ssc:Annotation", type="org.openmodelica")
    note = SubElement(SubElement(note, "oms:Annotations", {"xmlns:oms": _OMS}), "oms:SimulationInformation")
    SubElement(note, "oms:FixedStepMaster", description="oms-ma", stepSize=repr(coupling.experiment.step))
    SubElement(root, "ssd:DefaultExperiment", startTime="0.0", stopTime=repr(coupling.experiment.stop))
    return root


def _connectors(parent: Element, wanted: dict[str, tuple[str, str]]) -> None:
    """The connectors of an element, by name: kind and type."""
    if wanted:
        table = SubElement(parent, "ssd:Connectors")
        for name, (kind, type_name) in wanted.items():
            SubElement(SubElement(table, "ssd:Connector", name=name, kind=kind), f"ssc:{type_name}")


def _start(coupling: CouplingFile, described: dict[str, Description]) -> Element:
    """resources/start.ssv: the start values of all FMUs."""
    root = _root("ssv:ParameterSet", name="start")
    table = SubElement(root, "ssv:Parameters")
    for fmu in coupling.fmu:
        for name, value in fmu.start.items():
            kind = described[fmu.name].variables[name].type
            text = str(value).lower() if isinstance(value, bool) else repr(float(value)) if kind == "Real" else value
            # FMI 2.0 sets enumerations by number.
            entry = "Integer" if kind == "Enumeration" else kind
            SubElement(SubElement(table, "ssv:Parameter", name=f"{fmu.name}.{name}"), f"ssv:{entry}", value=str(text))
    return root
