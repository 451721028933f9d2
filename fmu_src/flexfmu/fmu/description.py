"""The FMU's modelDescription.xml of FMI 2.0 and 3.0, made from one table of variables."""

import math
from collections.abc import Sequence
from dataclasses import replace
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from ..core.building import sources
from ..core.interface import lines
from ..files.basics import own_version
from ..model.reduced_body import ReducedBody
from ..program.variable_table import AXES, Variable, variable_table
from .runtime import Runtime

LOG_CATEGORIES = {
    "logStatusWarning": "something that the user should look at",
    "logStatusDiscard": "a step that was refused; the state is as it was before",
    "logStatusError": "a call that cannot be honoured",
    "logStatusFatal": "the instance cannot go on",
}

# SI exponents of each unit, FMI 2.0's BaseUnit.
_UNITS: dict[str, dict[str, int]] = {
    "N": {"kg": 1, "m": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "m": {"m": 1},
    "rad": {"rad": 1},
    "m/s": {"m": 1, "s": -1},
    "rad/s": {"rad": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "m/N": {"kg": -1, "s": 2},
    "m/(N.m)": {"kg": -1, "m": -1, "s": 2},
    "rad/N": {"kg": -1, "m": -1, "s": 2, "rad": 1},
    "rad/(N.m)": {"kg": -1, "m": -2, "s": 2, "rad": 1},
    "s": {"s": 1},
}
_DEGREE = {"rad": "deg", "rad/s": "deg/s"}


def model_description(body: ReducedBody, guid: str, runtime: Runtime = Runtime.NATIVE) -> bytes:
    """The model description of a body's FMU; the same body gives the same bytes.

    Parameters
    ----------
    body : ReducedBody
    guid : str
    runtime : Runtime

    Returns
    -------
    bytes
        UTF-8 XML.
    """
    table = variable_table(body)
    native = runtime is Runtime.NATIVE
    root = Element("fmiModelDescription", fmiVersion="2.0", modelName=body.name, guid=guid, numberOfEventIndicators="0")
    root.attrib.update(body_words(body))
    simulation = SubElement(
        root,
        "CoSimulation",
        modelIdentifier=body.name,
        needsExecutionTool="false",
        canHandleVariableCommunicationStepSize="true",
        canInterpolateInputs="true" if native else "false",
        canBeInstantiatedOnlyOncePerProcess="false",
        canNotUseMemoryManagementFunctions="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
    )
    if native:
        simulation.set("providesDirectionalDerivative", "true")
        files = SubElement(simulation, "SourceFiles")
        for path in sources():
            SubElement(files, "File", name=path.name)
    describe_run(root, body, table)
    variables = SubElement(root, "ModelVariables")
    variables.extend(_scalar_variable(reference, variable) for reference, variable in enumerate(table))
    _structure(SubElement(root, "ModelStructure"), table)
    return as_file(root)


def body_words(body: ReducedBody) -> dict[str, str]:
    """Attributes of a model description that are the same in every version of FMI."""
    return {
        "description": f"Flexible body {body.name}: {body.mode_count} modes, {body.frame_count} corotated frames. All "
        "vectors have components along the fixed global axes of its "
        "finite element model; rotations are rotation vectors.",
        "generationTool": f"flexfmu {own_version()}",
        "variableNamingConvention": "structured",
    }


def describe_run(root: Element, body: ReducedBody, table: Sequence[Variable]) -> None:
    """Units, categories of the log, and the default experiment: the same in every version of FMI."""
    _units(SubElement(root, "UnitDefinitions"), {variable.unit for variable in table})
    categories = SubElement(root, "LogCategories")
    for name, words in LOG_CATEGORIES.items():
        SubElement(categories, "Category", name=name, description=words)
    SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize=repr(body.suggested_step))


def as_file(root: Element) -> bytes:
    """A document's bytes, UTF-8."""
    indent(root)
    text: bytes = tostring(root, "utf-8")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + text + b"\n"


def _units(units: Element, used: set[str | None]) -> None:
    """Units in SI exponents."""
    for name, exponents in _UNITS.items():
        if name not in used:
            continue
        unit = SubElement(units, "Unit", name=name)
        SubElement(unit, "BaseUnit", {base: str(exponent) for base, exponent in exponents.items()})
        if name in _DEGREE:
            SubElement(unit, "DisplayUnit", name=_DEGREE[name], factor=repr(180.0 / math.pi))


def _declared(tag: str, reference: int, variable: Variable) -> Element:
    """What both versions of FMI say of a variable."""
    told = {key: getattr(variable, key) for key in ("description", "causality", "variability")}
    element = Element(tag, name=variable.name, valueReference=str(reference), **told)
    if variable.initial is not None:
        element.set("initial", variable.initial)
    return element


def _scalar_variable(reference: int, variable: Variable) -> Element:
    element = _declared("ScalarVariable", reference, variable)
    value = SubElement(element, variable.type, quantity(variable))
    if variable.start is not None:
        value.set("start", start_text(variable))
    return element


def quantity(variable: Variable) -> dict[str, str]:
    """Attributes of a variable as a quantity."""
    found: dict[str, object] = {"unit": variable.unit, "displayUnit": _DEGREE.get(variable.unit or "")}
    found |= {"min": variable.minimum, "nominal": variable.nominal}
    return {name: str(value) for name, value in found.items() if value is not None}


def start_text(variable: Variable) -> str:
    """Its start value, as XML writes it."""
    return str(variable.start).lower() if isinstance(variable.start, bool) else str(variable.start)


def _structure(structure: Element, table: tuple[Variable, ...]) -> None:
    """Outputs follow from the state alone: no direct feedthrough, and masters see no algebraic loop."""
    # At the start they may depend on every load and parameter: that is what leaving the dependencies out says.
    known: dict[str, dict[str, str]] = {"Outputs": {"dependencies": ""}, "InitialUnknowns": {}}
    for title, dependencies in known.items():
        unknowns = SubElement(structure, title)
        for index, variable in enumerate(table, start=1):
            if variable.causality == "output":
                SubElement(unknowns, "Unknown", {"index": str(index), **dependencies})


_TYPES = {"Real": "Float64", "Integer": "Int32"}
_CAN = (
    "canGetAndSetFMUState",
    "canSerializeFMUState",
    "providesDirectionalDerivatives",
    "providesAdjointDerivatives",
    "canHandleVariableCommunicationStepSize",
    "mightReturnEarlyFromDoStep",
)


def arrays(table: Sequence[Variable]) -> dict[int, tuple[Variable, int]]:
    """Variables of FMI 3.0 by value reference, which is that of the first number; and how many numbers each has."""
    axes = {role: int(count) for role, _, count, *_ in lines("ROLE")}
    result = {}
    for reference, variable in enumerate(table):
        count = axes[variable.role]
        if variable.number % count:
            continue
        if count > 1:
            words = variable.description.replace("x axis, which turns", "axes, which turn").replace("x axis", "axes")
            variable = replace(variable, name=variable.name.removesuffix(f".{AXES[0]}"), description=words)
        result[reference] = variable, count
    return result


def files_3(body: ReducedBody, token: str) -> dict[str, bytes]:
    """The model description, terminals, and how sources are built, by their names in the archive.

    Parameters
    ----------
    body : ReducedBody
    token : str
        Instantiation token.

    Returns
    -------
    dict of str to bytes
        UTF-8 XML; the same body gives the same bytes.
    """
    table = variable_table(body)
    built = Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = SubElement(built, "BuildConfiguration", modelIdentifier=body.name)
    files = SubElement(configuration, "SourceFileSet", language="C99")
    for path in sources():
        SubElement(files, "SourceFile", name=path.name)
    return {
        "modelDescription.xml": _description(body, token, table),
        "terminalsAndIcons/terminalsAndIcons.xml": _terminals(body, table),
        "sources/buildDescription.xml": as_file(built),
    }


def _description(body: ReducedBody, token: str, table: Sequence[Variable]) -> bytes:
    root = Element("fmiModelDescription", fmiVersion="3.0", modelName=body.name, instantiationToken=token)
    root.attrib.update(body_words(body))
    SubElement(root, "CoSimulation", dict.fromkeys(_CAN, "true"), modelIdentifier=body.name)
    describe_run(root, body, table)
    variables, structure = SubElement(root, "ModelVariables"), Element("ModelStructure")
    time = {"name": "time", "description": "time", "causality": "independent", "variability": "continuous"}
    SubElement(variables, "Float64", time, valueReference=str(len(table)))
    variables.extend(_variable(reference, *one) for reference, one in arrays(table).items())
    outputs = [reference for reference, (one, _) in arrays(table).items() if one.causality == "output"]
    # As in FMI 2.0: outputs follow from the state alone, at the start from every load and parameter.
    for reference in outputs:
        SubElement(structure, "Output", valueReference=str(reference), dependencies="")
    for reference in outputs:
        SubElement(structure, "InitialUnknown", valueReference=str(reference))
    root.append(structure)
    return as_file(root)


def _variable(reference: int, variable: Variable, count: int) -> Element:
    element = _declared(_TYPES.get(variable.type, variable.type), reference, variable)
    element.attrib.update(quantity(variable))
    if count > 1:
        SubElement(element, "Dimension", start=str(count))
    if variable.type == "String":
        SubElement(element, "Start", value=start_text(variable))
    elif variable.start is not None:
        element.set("start", " ".join(count * [start_text(variable)]))
    return element


def _terminals(body: ReducedBody, table: Sequence[Variable]) -> bytes:
    """Loads and motion of an interface as one connector."""
    root = Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    terminals = SubElement(root, "Terminals")
    vectors = [one.name for one, count in arrays(table).values() if count > 1]
    for interface in body.interface_names:
        terminal = SubElement(terminals, "Terminal", name=interface, matchingRule="plug")
        for name in vectors:
            owner, _, member = name.rpartition(".")
            if owner == interface:
                words = {"variableName": name, "memberName": member, "variableKind": "signal"}
                SubElement(terminal, "TerminalMemberVariable", words)
    return as_file(root)
