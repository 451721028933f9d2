"""A coupled system as an SSP 1.0 archive: FMUs, connections, start values and span of time, for other masters."""

import zipfile
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from ..files.basics import SimulationError, __version__
from ..files.outputs import check_target, whole_file
from ..files.progress import Reporter
from .config import CouplingFile, Scheme, read_coupling_file
from .layout import Description, read_description
from .wiring import wire

_SPACE = "http://ssp-standard.org/SSP1/SystemStructure"
_SPACES = {"ssd": "Description", "ssc": "Common", "ssv": "ParameterValues"}
# OMSimulator reads the communication step there.
_OMS = "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
_FMU = "application/x-fmu-sharedlibrary"
# Names of the system's inputs begin with it.
_TABLE = "table."
# The earliest date that the format knows: archives of the same contents are the same.
_DATE = (1980, 1, 1, 0, 0, 0)


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
    fed = [place for table in wiring.tables for place in table.inputs]
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
        "SystemStructure.ssd": _xml(_structure(path.stem, coupling, sources, described, inputs, outputs)),
        "resources/start.ssv": _xml(_start(coupling, described)),
        **{source: file.read_bytes() for file, source in sources.items()},
        **{f"extra/{fmu.name}.csv": fmu.input.read_bytes() for fmu in coupling.fmu if fmu.input is not None},
    }
    with whole_file(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, data in files.items():
            archive.writestr(zipfile.ZipInfo(entry, _DATE), data, zipfile.ZIP_DEFLATED)
    if inputs:
        report.warning(
            f"SSP has no tables: the master must feed the system's inputs {', '.join(_TABLE + text for text in inputs)}"
        )
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
    return Element(tag, {**names, "version": "1.0", **attributes, "generationTool": f"flexfmu {__version__}"})


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
    bindings = SubElement(system, "ssd:ParameterBindings")
    SubElement(bindings, "ssd:ParameterBinding", source="resources/start.ssv")
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


def _xml(root: Element) -> bytes:
    indent(root)
    return bytes(tostring(root, encoding="UTF-8", xml_declaration=True)) + b"\n"
