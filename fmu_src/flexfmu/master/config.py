"""The coupling file (TOML): its keys, checked, with errors that name the key."""

from enum import Enum
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from ..files.basics import MOST_COUPLED_STEPS, SimulationError
from ..files.tables import Kind
from ..files.toml_files import Axes, Name, NotNegative, Table, different, read_toml, validated

# FMU instances; a dot parts them from their variables.
Six = Annotated[list[NotNegative], Field(min_length=6, max_length=6)]
StartValue = float | int | bool | str

# The number of steps must be whole to this much of a step.
_WHOLE = 1e-6


class Scheme(Enum):
    """How the FMUs exchange values within a communication step."""

    JACOBI = "jacobi"
    """All step with the values of the last communication point."""
    GAUSS_SEIDEL = "gauss_seidel"
    """One after the other in the order listed; the later ones get the fresh values."""
    ITERATED = "iterated"
    """Steps are taken back and repeated until the coupled inputs settle."""


class Held(Enum):
    """Which coupled inputs the iterated scheme holds over a step."""

    END = "end"
    """Those of the step's end: first order, damps what the step does not resolve."""
    MEAN = "mean"
    """The mean of those at its two ends: second order, without numerical damping."""


class ExperimentTable(Table):
    """`[experiment]`: span of time, communication step and scheme.

    Attributes
    ----------
    stop
        End of the run, s: a whole number of steps from 0.
    step
        Communication step, s.
    scheme
        `"jacobi"`, `"gauss_seidel"` or `"iterated"` ([schemes](../master.md#schemes)).
    tolerance
        `"iterated"`: accepted change of coupled inputs, relative to the largest of their unit so far.
        Loads of springs count together, 1 N as 1 N m.
    max_iterations
        `"iterated"`: the run stops after so many iterations of a step.
    relaxation
        `"iterated"`: fraction of the first difference that is added.
    reuse
        `"iterated"`: number of earlier steps whose differences are used.
    held
        `"iterated"`: inputs held over a step are those of its `"end"`, or the `"mean"` of its ends.
    timeout
        s that a call to an FMU of another program may take. These run in a process of their own.
    """

    stop: float = Field(gt=0.0)
    step: float = Field(gt=0.0)
    scheme: Scheme = Field(default=Scheme.JACOBI, strict=False)
    tolerance: float = Field(default=1e-6, gt=0.0, lt=1.0)
    max_iterations: int = Field(default=20, ge=1)
    relaxation: float = Field(default=0.1, gt=0.0, le=1.0)
    reuse: int = Field(default=4, ge=0)
    held: Held = Field(default=Held.END, strict=False)
    timeout: float = Field(default=60.0, gt=0.0)

    @property
    def steps(self) -> int:
        """Number of communication steps."""
        return round(self.stop / self.step)

    @model_validator(mode="after")
    def _whole_number_of_steps(self) -> "ExperimentTable":
        count = self.stop / self.step
        if count > MOST_COUPLED_STEPS:
            raise ValueError(
                f"stop = {self.stop:g} s are {count:.3g} steps of {self.step:g} s, expected at most "
                f"{MOST_COUPLED_STEPS:.3g}: take stop = {MOST_COUPLED_STEPS * self.step:.6g} s, or a longer step"
            )
        if round(count) < 1 or abs(count - round(count)) > _WHOLE:
            near = max(round(count), 1)
            found = f"stop = {self.stop:g} s is {count:.6g} steps of {self.step:g} s, expected a whole number"
            raise ValueError(f"{found}: take stop = {near * self.step:.12g} or step = {self.stop / near:.12g}")
        return self


class FmuTable(Table):
    """`[[fmu]]`: an FMU, its start values and its table of inputs.

    Attributes
    ----------
    name
        Name in this file: letters, digits, `_`.
    file
        The FMU. The same file may serve several names.
    start
        Parameters and start values.
    input
        CSV of inputs, linear between rows. A step takes the values of its beginning (`"mean"`: the mean of its ends).
        The first and last rows hold outside. Of rows at the same time the last counts.
    """

    name: Name
    file: Path = Field(strict=False)
    start: dict[str, StartValue] = {}
    input: Path | None = Field(default=None, strict=False)


class ConnectionTable(Table):
    """`[[connection]]`: an output that sets an input.

    Attributes
    ----------
    from, to
        `FMU.VARIABLE`: a Real output and a Real input. Connections to one input add up and replace its start value.
    factor
        Multiplier. Only with it may units differ. Default: 1
    """

    source: str = Field(alias="from")
    target: str = Field(alias="to")
    factor: float | None = None


class SpringTable(Table):
    """`[[spring]]`: spring and damper between two interfaces, or one and the ground.

    Attributes
    ----------
    a, b
        `FMU.INTERFACE` at each end. Without `b`: the ground.
    stiffness
        Six numbers: three in N/m, three in N m/rad.
    damping
        Six numbers: three in N s/m, three in N m s/rad.
    axes
        x of the spring, and a vector in the plane of its x and y; they turn with `b`. Default: global
    """

    a: str
    b: str | None = None
    stiffness: Six = Field(examples=[[1e6, 1e6, 1e6, 0.0, 0.0, 0.0]])
    damping: Six = [0.0] * 6
    axes: Axes | None = Field(default=None, examples=[[[0, 1, 0], [0, 0, 1]]])

    @model_validator(mode="after")
    def _two_ends(self) -> "SpringTable":
        if self.a == self.b:
            raise ValueError(f"both ends are {self.a!r}, expected two different interfaces, or no b for the ground")
        return self


class CouplingOutputTable(Table):
    """`[output]`: what goes into the results.

    Attributes
    ----------
    variables
        `FMU.VARIABLE`, also inputs and locals. Default: all Real outputs
    every
        Communication points per row. The last point is always written.
    """

    variables: list[str] | None = None
    every: int = Field(default=1, ge=1)


class CouplingFile(Table):
    """A whole coupling file."""

    experiment: ExperimentTable
    fmu: list[FmuTable] = Field(min_length=1)
    connection: list[ConnectionTable] = []
    spring: list[SpringTable] = []
    output: CouplingOutputTable = CouplingOutputTable()

    @model_validator(mode="after")
    def _different_names(self) -> "CouplingFile":
        different([fmu.name for fmu in self.fmu], "[[fmu]] tables have the name")
        return self


def read_coupling_file(path: Path) -> CouplingFile:
    """Read and check a coupling file; paths in it come out relative to the working directory.

    Parameters
    ----------
    path : Path

    Returns
    -------
    CouplingFile

    Raises
    ------
    SimulationError
        Every wrong key at once, with what was found and what would do.
    """
    data = read_toml(path, SimulationError, Kind.COUPLING)
    try:
        return parse_coupling(data, path.parent)
    except SimulationError as error:
        raise SimulationError(f"{path}:\n  {error}") from error


def parse_coupling(data: dict[str, Any], folder: Path) -> CouplingFile:
    """Check the contents of a coupling file.

    Parameters
    ----------
    data : dict
        As `tomllib` reads it.
    folder : Path
        What paths of FMUs and tables are relative to.

    Returns
    -------
    CouplingFile

    Raises
    ------
    SimulationError
        Every wrong key at once, with what was found and what would do.
    """
    coupling = validated(CouplingFile, data, SimulationError, "docs/reference/coupling-file.md")
    fmus = [
        fmu.model_copy(update={"file": folder / fmu.file, "input": None if fmu.input is None else folder / fmu.input})
        for fmu in coupling.fmu
    ]
    return coupling.model_copy(update={"fmu": fmus})
