"""The XML files of an FMI 3.0 FMU, made from the same table of variables: vectors are arrays, interfaces terminals."""

from collections.abc import Sequence
from dataclasses import replace
from xml.etree.ElementTree import Element, SubElement

from ..core.building import sources
from ..core.interface import lines
from ..model.reduced_body import ReducedBody
from ..program.variable_table import variable_table
from ..program.variables import AXES, Variable
from .description import as_file, body_words, describe_run, quantity, start_text

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
    for reference, (variable, count) in arrays(table).items():
        variables.append(_variable(reference, variable, count))
    outputs = [reference for reference, (one, _) in arrays(table).items() if one.causality == "output"]
    # As in FMI 2.0: outputs follow from the state alone, at the start from every load and parameter.
    for reference in outputs:
        SubElement(structure, "Output", valueReference=str(reference), dependencies="")
    for reference in outputs:
        SubElement(structure, "InitialUnknown", valueReference=str(reference))
    root.append(structure)
    return as_file(root)


def _variable(reference: int, variable: Variable, count: int) -> Element:
    element = Element(
        _TYPES.get(variable.type, variable.type),
        name=variable.name,
        valueReference=str(reference),
        description=variable.description,
        causality=variable.causality,
        variability=variable.variability,
    )
    if variable.initial is not None:
        element.set("initial", variable.initial)
    for name, value in quantity(variable).items():
        element.set(name, value)
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
