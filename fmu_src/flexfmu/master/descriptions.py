"""What FMUs say about themselves: variables, units and abilities, with words for what cannot be used."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import fmpy
from fmpy.model_description import BaseUnit, ModelVariable

from ..files.errors import SimulationError
from ..files.inputs import Kind, check_input
from ..files.names import nearest

# What `generationTool` begins with in FMUs of this package.
_OWN = "flexfmu "
_BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad", "factor", "offset")


@dataclass(frozen=True, slots=True)
class Description:
    """An FMU as its model description tells, under the name that it has in the coupling.

    Attributes
    ----------
    name : str
        Of the instance.
    file : Path
    guid, model_identifier : str
    saves_state : bool
        `canGetAndSetFMUstate`.
    own : bool
        Made by this package.
    variables : mapping of str to ModelVariable
        By name.
    units : mapping of str to BaseUnit or None
        Declared units; None: without base units.
    """

    name: str
    file: Path
    guid: str
    model_identifier: str
    saves_state: bool
    own: bool
    variables: Mapping[str, ModelVariable]
    units: Mapping[str, BaseUnit | None]

    def variable(self, name: str, wanted: str) -> ModelVariable:
        """A variable by name.

        Parameters
        ----------
        name : str
        wanted : str
            Who asks for it, to begin the message.

        Returns
        -------
        ModelVariable

        Raises
        ------
        SimulationError
            There is none; with the nearest names.
        """
        if name not in self.variables:
            near = nearest(name, self.variables)
            raise SimulationError(f"{wanted}: {self.name!r} ({self.file.name}) has no variable {name!r}; {near}")
        return self.variables[name]

    def nominal(self, name: str) -> float:
        """Nominal value of a variable, its own or its type's; one where there is none, as FMI has it.

        Parameters
        ----------
        name : str

        Returns
        -------
        float
        """
        variable = self.variables[name]
        own = variable.nominal or (variable.declaredType.nominal if variable.declaredType is not None else None)
        return 1.0 if own is None else abs(float(own))

    def unit(self, name: str) -> str | None:
        """Unit of a variable, its own or its type's.

        Parameters
        ----------
        name : str

        Returns
        -------
        str or None
        """
        variable = self.variables[name]
        own = variable.unit or (variable.declaredType.unit if variable.declaredType is not None else None)
        return None if own is None else str(own)


def read_description(name: str, file: Path) -> Description:
    """Read an FMU's model description.

    Parameters
    ----------
    name : str
        Of the instance.
    file : Path

    Returns
    -------
    Description

    Raises
    ------
    SimulationError
        No readable FMU, or not one of FMI 2.0 for co-simulation.
    """
    try:
        check_input(file, SimulationError, Kind.FMU)
    except SimulationError as error:
        raise SimulationError(f"fmu {name!r}: {error}") from error
    try:
        model = fmpy.read_model_description(str(file))
    except Exception as error:  # fmpy raises bare exceptions
        raise SimulationError(f"fmu {name!r}: {file}: not a readable FMU ({error})") from error
    if not str(model.fmiVersion).startswith("2.") or model.coSimulation is None:
        kind = "co-simulation" if model.coSimulation is not None else "model exchange only"
        raise SimulationError(
            f"fmu {name!r}: {file} is FMI {model.fmiVersion}, {kind}; expected FMI 2.0 for co-simulation: export it so"
        )
    return Description(
        name,
        file,
        str(model.guid),
        str(model.coSimulation.modelIdentifier),
        bool(model.coSimulation.canGetAndSetFMUstate),
        str(model.generationTool or "").startswith(_OWN),
        {variable.name: variable for variable in model.modelVariables},
        {unit.name: unit.baseUnit for unit in model.unitDefinitions},
    )


def split(text: str, descriptions: Mapping[str, Description], wanted: str) -> tuple[Description, str]:
    """Take "fmu.rest" apart.

    Parameters
    ----------
    text : str
    descriptions : mapping of str to Description
    wanted : str
        Who asks for it, to begin the message.

    Returns
    -------
    description : Description
    rest : str

    Raises
    ------
    SimulationError
        No dot, or no FMU of that name.
    """
    fmu, dot, rest = text.partition(".")
    if not dot or not rest:
        raise SimulationError(f'{wanted}: found {text!r}, expected "FMU.NAME" with one of {", ".join(descriptions)}')
    if fmu not in descriptions:
        raise SimulationError(f"{wanted}: {text!r} names no [[fmu]]; {nearest(fmu, descriptions)}")
    return descriptions[fmu], rest


def units_differ(one: Description, name: str, other: Description, other_name: str) -> bool:
    """Whether two variables have units, and these are not the same.

    Units of the same name are the same; of different names, if their base units are.

    Parameters
    ----------
    one, other : Description
    name, other_name : str
        Variables.

    Returns
    -------
    bool
    """
    first, second = one.unit(name), other.unit(other_name)
    if first is None or second is None or first == second:
        return False
    base, other_base = one.units.get(first), other.units.get(second)
    if base is None or other_base is None:
        return True
    return any(float(getattr(base, key)) != float(getattr(other_base, key)) for key in _BASES)
