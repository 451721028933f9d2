"""From the coupling file and what the FMUs say of themselves to a layout, all names, units and types checked."""

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ..files.basics import QUANTITIES, FloatArray, IntArray, SimulationError, nearest
from ..files.tables import read_table
from ..files.toml_files import orthonormal
from . import layout
from .config import ConnectionTable, CouplingFile, FmuTable, Scheme, SpringTable, StartValue
from .layout import Description

Described = Mapping[str, Description]
Places = Mapping[tuple[str, str], int]
"""Of variables, by FMU and name."""

AXES = ("x", "y", "z")
ROWS = ("ux", "uy", "uz", "rx", "ry", "rz")
COLUMNS = ("fx", "fy", "fz", "mx", "my", "mz")
_MOTION, _RATES, _LOADS = ("displacement", "rotation"), ("velocity", "angular_velocity"), ("force", "moment")
# "N.m", "N m", "N*m" and "Nm" are all in use.
_JOINTS = str.maketrans("", "", ". *·")


Asked = dict[tuple[str, str], None]
"""Variables that are asked for, by FMU and name; once is enough."""


def end_names(springs: list[SpringTable], descriptions: Described, inputs: Asked, signals: Asked) -> tuple[str, ...]:
    """Interfaces that springs hold, in the order found; their variables are asked for.

    Parameters
    ----------
    springs : list of SpringTable
    descriptions : mapping of str to Description
    inputs, signals : dict
        Get what is asked for.

    Returns
    -------
    tuple of str
        "fmu.interface".

    Raises
    ------
    SimulationError
        An end that is not there, or lacks what the spring needs.
    """
    ends: dict[str, None] = {}
    for number, spring in enumerate(springs, start=1):
        for side, text in (("a", spring.a), ("b", spring.b)):
            if text is None:
                continue
            key = f"spring {number}, {side}"
            description, interface = layout.split(text, descriptions, key)
            _check_vectors(description, interface, ("displacement", "force"), key)
            turns = _group(description, f"{interface}.rotation") and _group(description, f"{interface}.moment")
            if turns:
                _check_vectors(description, interface, ("rotation", "moment"), key)
            elif any(spring.stiffness[3:] + spring.damping[3:]):
                found = f"{key}: {text} has no rotation and moment ({interface}.rotation.x …, {interface}.moment.x …)"
                raise SimulationError(f"{found}: set the last three numbers of stiffness and damping to zero")
            ends[text] = None
    for text in ends:
        fmu, _, interface = text.partition(".")
        for quantity in (*_MOTION, *_RATES, *_LOADS):
            if _group(descriptions[fmu], f"{interface}.{quantity}"):
                asked = inputs if quantity in _LOADS else signals
                asked |= dict.fromkeys((fmu, f"{interface}.{quantity}.{axis}") for axis in AXES)
    return tuple(ends)


def _check_vectors(description: Description, interface: str, quantities: Sequence[str], key: str) -> None:
    """Whether the three components of vectors of an interface are there, and are what a spring needs."""
    for quantity, axis in product(quantities, AXES):
        wanted, expected = "input" if quantity in _LOADS else "output", QUANTITIES[quantity]
        name = f"{interface}.{quantity}.{axis}"
        variable = description.variable(name, key)
        if variable.causality != wanted or variable.type != "Real":
            found = f"{key}: {description.name}.{name} is of causality {variable.causality} and type {variable.type}"
            raise SimulationError(f"{found}, expected a Real {wanted}")
        unit = description.unit(name)
        if unit is not None and unit.translate(_JOINTS) != expected.translate(_JOINTS):
            raise SimulationError(f"{key}: {description.name}.{name} is in {unit}, expected {expected}")


def _group(description: Description, name: str) -> bool:
    """Whether all three components of a vector are there."""
    return all(f"{name}.{axis}" in description.variables for axis in AXES)


def lay_ends(ends: tuple[str, ...], descriptions: Described, input_place: Places, signal_place: Places) -> layout.Ends:
    """Places of the ends' variables.

    Parameters
    ----------
    ends : tuple of str
        "fmu.interface".
    descriptions : mapping of str to Description
    input_place, signal_place : mapping of (str, str) to int
        Places of FMUs' variables.

    Returns
    -------
    Ends
    """
    order = list(descriptions)

    def places(place: Places, quantities: Sequence[str]) -> IntArray:
        return np.array([_places(place, text, quantities) for text in ends], dtype=np.int64).reshape(len(ends), 6)

    roles = np.array([order.index(text.partition(".")[0]) for text in ends], dtype=np.int64)
    signals = places(signal_place, _MOTION), places(signal_place, _RATES)
    return layout.Ends(ends, roles, *signals, places(input_place, _LOADS))


def lay_responses(
    ends: tuple[str, ...], descriptions: Described, fed_place: Places, signal_place: Places
) -> tuple[layout.EndResponse, ...]:
    """Compliance that FMUs offer of interfaces whose motion the coupling reads to those that it loads.

    Parameters
    ----------
    ends : tuple of str
        Interfaces that springs hold.
    descriptions : mapping of str to Description
    fed_place, signal_place : mapping of (str, str) to int
        Places of FMUs' variables: inputs that connections or springs feed, and signals.

    Returns
    -------
    tuple of EndResponse
    """
    order, found = list(descriptions), []
    for a in _interfaces(signal_place, (*_MOTION, *_RATES)):
        for b in _interfaces(fed_place, _LOADS):
            fmu, _, interface = a.partition(".")
            other_fmu, _, other = b.partition(".")
            middle = "" if other == interface else f"{other}."
            names = [f"{interface}.compliance.{middle}{row}.{column}" for row in ROWS for column in COLUMNS]
            there = descriptions[fmu].variables
            if fmu == other_fmu and all(name in there and there[name].type == "Real" for name in names):
                references = tuple(int(there[name].valueReference) for name in names)
                places = _places(signal_place, a, (*_MOTION, *_RATES)), _places(fed_place, b, _LOADS)
                end = ends.index(a) if a == b and a in ends else -1
                found.append(layout.EndResponse(end, order.index(fmu), references, np.concatenate(places)))
    return tuple(found)


def _places(place: Places, text: str, quantities: Sequence[str]) -> IntArray:
    """Places of the components of vectors of an interface."""
    fmu, _, interface = text.partition(".")
    names = [f"{interface}.{quantity}.{axis}" for quantity in quantities for axis in AXES]
    return np.array([place.get((fmu, name), -1) for name in names], dtype=np.int64)


def _interfaces(place: Places, quantities: Sequence[str]) -> list[str]:
    """Interfaces of which components of some vectors are among the variables."""
    found: dict[str, None] = {}
    for fmu, name in place:
        interface, _, rest = name.partition(".")
        quantity, _, axis = rest.partition(".")
        if quantity in quantities and axis in AXES:
            found[f"{fmu}.{interface}"] = None
    return list(found)


def lay_springs(springs: list[SpringTable], ends: tuple[str, ...]) -> layout.Springs:
    """Springs between the ends.

    Parameters
    ----------
    springs : list of SpringTable
    ends : tuple of str
        "fmu.interface".

    Returns
    -------
    Springs
    """
    return layout.Springs(
        np.array([ends.index(spring.a) for spring in springs], dtype=np.int64),
        np.array([len(ends) if spring.b is None else ends.index(spring.b) for spring in springs], dtype=np.int64),
        np.array([spring.stiffness for spring in springs], dtype=np.float64).reshape(-1, 6),
        np.array([spring.damping for spring in springs], dtype=np.float64).reshape(-1, 6),
        np.array([orthonormal(spring.axes) for spring in springs]).reshape(-1, 3, 3),
    )


_SETTABLE = ("input", "parameter")
_VALUES: dict[str, Any] = {"Real": (int, float), "Integer": int, "Enumeration": int, "Boolean": bool, "String": str}


def wire(coupling: CouplingFile) -> layout.Wiring:
    """Check a coupling against the FMUs' descriptions and lay it out.

    Parameters
    ----------
    coupling : CouplingFile

    Returns
    -------
    Wiring

    Raises
    ------
    SimulationError
        A name, type or unit that does not fit, an input fed twice, or an FMU that cannot do what the scheme needs.
    """
    descriptions = {fmu.name: layout.read_description(fmu.name, fmu.file) for fmu in coupling.fmu}
    inputs, signals = Asked(), Asked()
    starts = {fmu.name: _start_values(descriptions[fmu.name], fmu.start) for fmu in coupling.fmu}
    tables = {fmu.name: _table(descriptions[fmu.name], fmu, inputs) for fmu in coupling.fmu if fmu.input is not None}
    links = [_link(number, link, descriptions) for number, link in enumerate(coupling.connection, start=1)]
    tabled = {(fmu.name, name): fmu.input for fmu in coupling.fmu if fmu.name in tables for name in tables[fmu.name][0]}
    linked = [(target.name, name) for _, _, target, name in links]
    _check_fed_once(linked, tabled)
    for source, output, target, name in links:
        signals[source.name, output] = inputs[target.name, name] = None
    ends = end_names(coupling.spring, descriptions, inputs, signals)
    input_place, signal_place = _placed(inputs, descriptions), _placed(signals, descriptions)
    if coupling.experiment.scheme is Scheme.ITERATED:
        _check_states(descriptions, {fmu for fmu, _ in linked} | {end.partition(".")[0] for end in ends})
    matrix = np.zeros((len(input_place), len(signal_place)))
    for link, (source, output, target, name) in zip(coupling.connection, links, strict=True):
        factor = 1.0 if link.factor is None else link.factor
        matrix[input_place[target.name, name], signal_place[source.name, output]] += factor
    laid_ends = lay_ends(ends, descriptions, input_place, signal_place)
    # What an input has on its own: the start value given, or the FMU's.
    alone = [starts[fmu].get(name, descriptions[fmu].variables[name].start) for fmu, name in input_place]
    base = np.array([float(value or 0.0) for value in alone])
    base[[input_place[pair] for pair in (*linked, *tabled)]] = 0.0
    coupled = np.any(matrix != 0.0, axis=1)
    coupled[laid_ends.loads[laid_ends.loads >= 0]] = True
    fed_place = {pair: place for pair, place in input_place.items() if coupled[place]}
    return layout.Wiring(
        roles=tuple(_roles(descriptions, starts, input_place, signal_place)),
        input_names=tuple(f"{fmu}.{name}" for fmu, name in input_place),
        kind=_kinds(descriptions, input_place, laid_ends),
        base=base,
        coupled=coupled,
        matrix=matrix,
        tables=tuple((np.array([input_place[fmu, n] for n in own]), rows) for fmu, (own, rows) in tables.items()),
        springs=lay_springs(coupling.spring, ends),
        ends=laid_ends,
        responses=lay_responses(ends, descriptions, fed_place, signal_place),
        recorded=_recorded(coupling.output.variables, descriptions),
        nominal=np.array([descriptions[fmu].nominal(name) for fmu, name in signal_place]),
    )


def _placed(asked: Asked, descriptions: Described) -> Places:
    """Places of variables: in the order of the FMUs, then in that of asking."""
    order = list(descriptions).index
    return {pair: place for place, pair in enumerate(sorted(asked, key=lambda pair: order(pair[0])))}


def _roles(descriptions: Described, starts: Mapping[str, Mapping[str, StartValue]], *both: Places) -> list[layout.Role]:
    roles: list[layout.Role] = []
    first_input = first_signal = 0
    for name, description in descriptions.items():
        references = [
            tuple(int(description.variables[variable].valueReference) for fmu, variable in places if fmu == name)
            for places in both
        ]
        roles.append(layout.Role(description, starts[name], references[0], references[1], first_input, first_signal))
        first_input += len(references[0])
        first_signal += len(references[1])
    return roles


def _start_values(description: Description, start: Mapping[str, StartValue]) -> dict[str, StartValue]:
    """Start values of the variables' own types."""
    result: dict[str, StartValue] = {}
    for name, value in start.items():
        key = f"fmu {description.name!r}, start"
        variable = description.variable(name, key)
        fixed = variable.initial == "calculated" or variable.variability == "constant"
        if fixed or (variable.causality not in _SETTABLE and variable.initial not in ("exact", "approx")):
            raise SimulationError(f"{key}: {name!r} is of causality {variable.causality} and cannot be set")
        # To Python every Boolean is a whole number, too.
        if isinstance(value, bool) != (variable.type == "Boolean") or not isinstance(value, _VALUES[variable.type]):
            raise SimulationError(f"{key}: {name!r} is {value!r}, expected a value of type {variable.type}")
        result[name] = float(value) if variable.type == "Real" else value
    return result


def _table(description: Description, fmu: FmuTable, inputs: Asked) -> tuple[list[str], FloatArray]:
    """Names and rows of an FMU's table of inputs."""
    assert fmu.input is not None
    names, rows = read_table(Path(fmu.input))
    offered = [v.name for v in description.variables.values() if v.causality == "input" and v.type == "Real"]
    for name in names:
        if name not in offered:
            found = f"{fmu.input}: {name!r} is no Real input of fmu {fmu.name!r}"
            raise SimulationError(f"{found}; {nearest(name, offered)}")
        inputs[fmu.name, name] = None
    return names, rows


def _link(number: int, link: ConnectionTable, descriptions: Described) -> tuple[Description, str, Description, str]:
    """A connection's ends, checked."""
    key = f"connection {number}"
    source, output = layout.split(link.source, descriptions, f"{key}, from")
    target, name = layout.split(link.target, descriptions, f"{key}, to")
    giver, taker = source.variable(output, f"{key}, from"), target.variable(name, f"{key}, to")
    if giver.causality not in ("output", "local"):
        raise SimulationError(f"{key}: {link.source} is of causality {giver.causality}, expected an output")
    if taker.causality != "input":
        raise SimulationError(f"{key}: {link.target} is of causality {taker.causality}, expected an input")
    for text, variable in ((link.source, giver), (link.target, taker)):
        if variable.type != "Real":
            raise SimulationError(f"{key}: {text} is of type {variable.type}; only Real variables can be connected")
    if link.factor is None and layout.units_differ(source, output, target, name):
        found = f"{key}: {link.source} is in {source.unit(output)}, {link.target} in {target.unit(name)}"
        advice = "connect variables of one unit, or give the factor that turns the one into the other"
        raise SimulationError(f"{found}; {advice}")
    return source, output, target, name


def _check_fed_once(linked: list[tuple[str, str]], tabled: Mapping[tuple[str, str], Path | None]) -> None:
    """An input takes a table or connections, not both."""
    for number, pair in enumerate(linked, start=1):
        if pair in tabled:
            found = f"connection {number}: {'.'.join(pair)} is also a column of {tabled[pair]}"
            raise SimulationError(f"{found}; an input takes a table or connections: remove one of them")


def _check_states(descriptions: Described, coupled: set[str]) -> None:
    """Iterations repeat a step: every coupled FMU must save its state."""
    for name, description in descriptions.items():
        if name in coupled and not description.saves_state:
            raise SimulationError(
                f'experiment.scheme is "iterated", but fmu {name!r} ({description.file.name}) cannot save '
                'its state (canGetAndSetFMUstate is false): take "jacobi" or "gauss_seidel", or export it anew'
            )


def _kinds(descriptions: Described, input_place: Places, ends: layout.Ends) -> IntArray:
    """Number of each input's kind: those of one unit, and all loads of springs, N and N m alike."""
    kinds: dict[str, int] = {"load": 0}
    result = [kinds.setdefault(descriptions[fmu].unit(name) or "", len(kinds)) for fmu, name in input_place]
    found = np.array(result, dtype=np.int64)
    found[ends.loads[ends.loads >= 0]] = 0
    return found


def _recorded(variables: list[str] | None, descriptions: Described) -> tuple[layout.Recorded, ...]:
    """Variables of the results; without a choice all Real outputs."""
    order = list(descriptions)
    if variables is None:
        variables = [
            f"{fmu}.{v.name}"
            for fmu, description in descriptions.items()
            for v in description.variables.values()
            if v.causality == "output" and v.type == "Real"
        ]
    result: dict[str, layout.Recorded] = {}
    for text in variables:
        description, name = layout.split(text, descriptions, "output.variables")
        variable = description.variable(name, "output.variables")
        if variable.type not in ("Real", "Integer", "Boolean"):
            raise SimulationError(f"output.variables: {text} is of type {variable.type}, expected a number")
        reference, role = int(variable.valueReference), order.index(description.name)
        result[text] = layout.Recorded(text, description.unit(name), role, reference, variable.type)
    return tuple(result.values())
