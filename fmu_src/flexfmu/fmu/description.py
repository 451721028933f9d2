"""The FMU's modelDescription.xml, made from the table of variables."""

import math
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from ..core.building import sources
from ..files.version import __version__
from ..model.reduced_body import ReducedBody
from ..program.variable_table import variable_table
from ..program.variables import Variable
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
    root = Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=body.name,
        guid=guid,
        description=f"Flexible body {body.name}: {body.mode_count} modes, {body.frame_count} corotated frames. All "
        "vectors have components along the fixed global axes of its "
        "finite element model; rotations are rotation vectors.",
        generationTool=f"flexfmu {__version__}",
        variableNamingConvention="structured",
        numberOfEventIndicators="0",
    )
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
    _units(SubElement(root, "UnitDefinitions"), {variable.unit for variable in table})
    categories = SubElement(root, "LogCategories")
    for name, words in LOG_CATEGORIES.items():
        SubElement(categories, "Category", name=name, description=words)
    SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize=repr(body.suggested_step))

    variables = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(table):
        variables.append(_scalar_variable(reference, variable))
    _structure(SubElement(root, "ModelStructure"), table)
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


def _scalar_variable(reference: int, variable: Variable) -> Element:
    element = Element(
        "ScalarVariable",
        name=variable.name,
        valueReference=str(reference),
        description=variable.description,
        causality=variable.causality,
        variability=variable.variability,
    )
    if variable.initial is not None:
        element.set("initial", variable.initial)
    value = SubElement(element, variable.type)
    if variable.unit is not None:
        value.set("unit", variable.unit)
        if variable.unit in _DEGREE:
            value.set("displayUnit", _DEGREE[variable.unit])
    if variable.minimum is not None:
        value.set("min", repr(variable.minimum))
    if variable.nominal is not None:
        value.set("nominal", repr(variable.nominal))
    if variable.start is not None:
        start = variable.start
        value.set("start", str(start).lower() if isinstance(start, bool) else str(start))
    return element


def _structure(structure: Element, table: tuple[Variable, ...]) -> None:
    """Outputs follow from the state alone: no direct feedthrough, and masters see no algebraic loop."""
    outputs = SubElement(structure, "Outputs")
    for index, variable in enumerate(table, start=1):
        if variable.causality == "output":
            SubElement(outputs, "Unknown", index=str(index), dependencies="")
    # At the start they may depend on every load and parameter: that is what leaving the dependencies out says.
    initial = SubElement(structure, "InitialUnknowns")
    for index, variable in enumerate(table, start=1):
        if variable.causality == "output":
            SubElement(initial, "Unknown", index=str(index))
