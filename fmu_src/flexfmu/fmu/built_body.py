"""A reduced body at hand: driven from a script, simulated through its FMU, written."""

import html
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..body.flexible_body import FlexibleBody
from ..body.loads import load_names
from ..files.basics import FloatArray, SimulationError
from ..files.outputs import SCRIPT, Reporter, check_target, picture_html, rows_html
from ..files.tables import unit_of, write_table
from ..model.methods import Mass, Method
from ..model.modal_file import write_modal_file
from ..model.reduced_body import ReducedBody
from ..model.summary import first_frequency, summary
from ..view.motions import MODES, body_view, live_view, mode_cases, static_case
from ..view.shown import Shown
from .package import package_fmu
from .reading import read_packaged_body
from .runtime import Runtime
from .simulation import simulate


class BuiltBody(FlexibleBody):
    """A reduced body that can be driven, simulated, and written as an FMU.

    Parameters
    ----------
    reduced : ReducedBody
    method : Method or str, optional
        Default: the one that the body was built with.
    mass : Mass or str, optional
        Default: the body's own, where the method knows it.

    Attributes
    ----------
    reduced : ReducedBody
        As built, to start with the method chosen.
    """

    def __init__(self, reduced: ReducedBody, method: Method | str | None = None, mass: Mass | str | None = None):
        super().__init__(reduced, method, mass)
        self.reduced = replace(reduced, method=self.method, mass=self.variant.mass)

    def _repr_html_(self) -> str:
        """What it is made of, as a table."""
        facts = [] if self.reduced.properties is None else summary(self.reduced.properties)
        rows = [*facts, ("first frequency", first_frequency(self.model.angular_frequency))]
        picture = "" if self.model.surface is None else picture_html(Shown(body_view(self)).plot(), "png")
        return f"<p>{html.escape(repr(self))}</p>{rows_html(rows)}{picture}"

    def view(
        self,
        loads: Mapping[str, Sequence[float]] | None = None,
        *,
        modes: int = 0,
        live: bool = False,
        report: Reporter = SCRIPT,
    ) -> Shown:
        """Show the body under loads that hold still, its modes, or alive: a page in notebooks.

        Parameters
        ----------
        loads : mapping of str to 3 or 6 float, optional
            N and N m by interface.
        modes : int
            How many mode shapes; without loads some are shown.
        live : bool
            Whether the body answers to the pointer; then without loads and modes.
        report : Reporter, optional

        Returns
        -------
        Shown
            Its `save(path)` writes page or picture, `plot()` is a figure.

        Raises
        ------
        FlexfmuError
            The body was built without its surface, or has no equilibrium.

        Examples
        --------
        >>> flexfmu.load("arm.fmu").view({"tip": [0.0, 5e3, 0.0]}).save("bent.html")
        PosixPath('bent.html')
        """
        if live:
            return Shown(live_view(self, not (loads or modes)))
        cases = []
        if loads:
            held = self.loads(loads)
            values = zip(load_names(self.model.interface_names, False), held.packed(False), strict=True)
            words = ", ".join(f"{name} = {value:g} {unit_of(name)}" for name, value in values if value)
            cases.append(static_case(self, held, words, report))
        if modes or not cases:
            cases += mode_cases(self, modes or MODES)
        return Shown(body_view(self, cases))

    def plot(self, loads: Mapping[str, Sequence[float]] | None = None) -> Any:
        """A matplotlib figure of the body, under loads that hold still."""
        return (self.view(loads) if loads else Shown(body_view(self))).plot()

    def fmu(
        self,
        path: str | Path,
        runtime: Runtime | str = Runtime.NATIVE,
        platforms: Sequence[str] = (),
        report: Reporter | None = None,
        fmi: int = 2,
    ) -> Path:
        """Write the body as an FMU.

        Parameters
        ----------
        path : path
            Ends in ".fmu".
        runtime : Runtime or str
        platforms : sequence of str
            Default: those that this installation has the core for.
        report : Reporter, optional
        fmi : int
            Version of FMI, 2 or 3.

        Returns
        -------
        Path
        """
        package_fmu(self.reduced, Path(path), Runtime(runtime), platforms, report, fmi)
        return Path(path)

    def save(self, path: str | Path) -> Path:
        """Write the modal file (HDF5), which `flexfmu.load` reads.

        Parameters
        ----------
        path : path
            Ends in ".h5".

        Returns
        -------
        Path
        """
        check_target(Path(path), (".h5",))
        write_modal_file(self.reduced, Path(path))
        return Path(path)

    def simulate(
        self,
        loads: Mapping[str, Any],
        *,
        step: float | None = None,
        stop: float | None = None,
        parameters: Mapping[str, object] | None = None,
        report: Reporter = SCRIPT,
    ) -> "SimulationResult":
        """Drive the body's FMU by loads over time; see `fmu.simulation.simulate`.

        Parameters
        ----------
        loads : mapping of str to array, or pandas.DataFrame
            Over time: a column "time" (s) and columns by the FMU's inputs, such as "tip.force.y" (N). Or constant:
            {interface: 3 forces, or 3 forces and 3 moments}, with `stop`.
        step : float, optional
            Communication step, s; default: the FMU's own.
        stop : float, optional
            s; default: the last time of the loads.
        parameters : mapping of str to float or str, optional
            Start values of the FMU's parameters.
        report : Reporter, optional

        Returns
        -------
        SimulationResult

        Raises
        ------
        SimulationError
            An unknown input, or a step that the FMU refuses.

        Examples
        --------
        >>> arm = flexfmu.load("arm.fmu")
        >>> result = arm.simulate({"time": [0.0, 0.02], "tip.force.y": [0.0, 500.0]}, step=1e-3)
        >>> result["tip.displacement.y"].shape
        (21,)
        """
        names, table = self._table(loads, stop)
        with tempfile.TemporaryDirectory(prefix="flexfmu-") as folder:
            fmu = self.fmu(Path(folder) / f"{self.model.name}.fmu")
            outputs, result = simulate(fmu, names, table, step=step, stop=stop, parameters=parameters, report=report)
        return SimulationResult(self.model.name, tuple(outputs), result[:, 0], result[:, 1:])

    def _table(self, loads: Mapping[str, Any], stop: float | None) -> tuple[list[str], FloatArray]:
        """Names of inputs, and rows of time and their values."""
        columns = {str(key): np.asarray(loads[key], dtype=np.float64) for key in loads}
        if "time" not in columns and hasattr(loads, "index"):
            columns["time"] = np.asarray(loads.index, dtype=np.float64)
        if "time" not in columns:
            if stop is None:
                raise SimulationError('loads have no column "time": give one, or constant loads and stop = … (s)')
            values = self.loads(loads).packed(with_acceleration=False)
            return load_names(self.model.interface_names, False), np.array([[time, *values] for time in (0.0, stop)])
        time = columns.pop("time")
        for name, values in columns.items():
            if values.shape != time.shape or time.ndim != 1:
                raise SimulationError(f"loads {name!r} have shape {values.shape}, expected that of time, {time.shape}")
        table = np.column_stack([time, *columns.values()])
        if not np.isfinite(table).all() or np.any(np.diff(time) < 0.0):
            raise SimulationError("loads hold values that are not finite, or a time that goes back")
        return list(columns), table


@dataclass(frozen=True, slots=True, repr=False)
class SimulationResult:
    """Motion over time.

    Attributes
    ----------
    name : str
        Of the body.
    outputs : tuple of str
        Names of the FMU's outputs (docs/fmu-variables.md).
    time : (n,) float
        s.
    values : (n, len(outputs)) float
    """

    name: str
    outputs: tuple[str, ...]
    time: FloatArray
    values: FloatArray

    def __repr__(self) -> str:
        """Name, size and span."""
        span = f"{len(self.time)} times from {self.time[0]:g} s to {self.time[-1]:g} s"
        return f"<SimulationResult of {self.name!r}: {span}, {len(self.outputs)} outputs such as {self.outputs[0]}>"

    def __getitem__(self, output: str) -> FloatArray:
        """Values (n,) of an output by its name."""
        if output == "time":
            return self.time
        if output not in self.outputs:
            raise KeyError(f"{output!r}: the outputs are {', '.join(self.outputs)}")
        return self.values[:, self.outputs.index(output)]

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame of the outputs, with time as its index."""
        import pandas

        return pandas.DataFrame(self.values, index=pandas.Index(self.time, name="time"), columns=list(self.outputs))

    def plot(self) -> Any:
        """A matplotlib figure of the motion over time."""
        from .curves import result_figure

        return result_figure(self.outputs, self.time, self.values)

    def _repr_html_(self) -> str:
        return f"<p>{html.escape(repr(self))}</p>{picture_html(self.plot())}"

    def to_csv(self, path: str | Path) -> None:
        """Write the table that `flexfmu simulate` writes."""
        write_table(Path(path), self.outputs, np.column_stack([self.time, self.values]))


def load(path: str | Path, method: Method | str | None = None, mass: Mass | str | None = None) -> BuiltBody:
    """Read a body from an FMU or a modal file, to use it without FMI.

    Parameters
    ----------
    path : path
        FMU made by flexfmu, or modal file (HDF5).
    method : Method or str, optional
        Default: the one that the body was built with.
    mass : Mass or str, optional
        Default: the body's own, where the method knows it.

    Returns
    -------
    BuiltBody

    Raises
    ------
    PackagingError
        An archive that is no FMU of flexfmu.
    OptionError
        No such method or mass, or data that the body was built without.
    ModalFileError
        The file is missing, damaged, altered or of an unknown version.

    Examples
    --------
    >>> arm = flexfmu.load("arm.fmu", method="linear")
    >>> bent = arm.response(arm.static({"tip": [0.0, 1000.0, 0.0]}))
    >>> float(bent.displacement[0, 1].round(4))  # F L³ / 3 E I = 1000 / (3 · 2e11 · 5.208e-7) m
    0.0032
    """
    return BuiltBody(read_packaged_body(Path(path)), method, mass)
