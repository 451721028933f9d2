"""Bodies in a script, without files: a mesh in memory, a reduced body, an FMU, a simulation."""

import hashlib
import logging
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any, Literal

import numpy as np

from .body.flexible_body import FlexibleBody
from .build.choices import (
    Interface,
    NodeChoices,
    Nodes,
    Support,
    checked_spec,
    interface_table,
    material_table,
    plain,
    support_table,
    unit_system,
)
from .build.config import read_body_file
from .build.reduce import reduce_mesh
from .files.array_types import FloatArray
from .files.errors import SimulationError
from .files.progress import Reporter
from .files.store import Store
from .files.tables import write_table
from .files.targets import check_target
from .files.units import UnitSystem
from .fmu.package import package_fmu, read_packaged_body
from .fmu.runtime import Runtime
from .fmu.simulation import simulate
from .mesh.formats import file_origin, read_mesh
from .mesh.in_memory import as_mesh
from .mesh.model import Mesh
from .model.methods import Mass, Method
from .model.modal_file import write_modal_file
from .model.reduced_body import ReducedBody


class ScriptReporter(Reporter):
    """Warnings as Python's, notes to the log "flexfmu"."""

    def note(self, text: str) -> None:
        """Log what was found or chosen."""
        logging.getLogger("flexfmu").info(text)

    def warning(self, text: str) -> None:
        """Warn of what the user should look at."""
        warnings.warn(text, stacklevel=2)


class Body:
    """A finite element body: a mesh, what it is made of, where it is held and loaded. Constant.

    Parameters
    ----------
    mesh : Mesh, meshio.Mesh, skfem.Mesh, or pair of points (n, 3) and cells
        See `mesh.in_memory.as_mesh`; `flexfmu.read_mesh` reads files.
    material : tuple of 3 float, or mapping, optional
        Young's modulus, Poisson's ratio and density in `units`, or a mapping with the keys of `[material]`; of elements
        that have none yet.
    supports : sequence of Support or Nodes
        Nodes alone are held in all directions.
    interfaces : mapping of str to Interface or Nodes
    name : str
        Of the body and its FMU.
    units : UnitSystem or str
        Of the mesh's coordinates and of `material`.
    free : bool
        Whether the body may move rigidly.
    damping : float or sequence of float
        Modal damping ratio, one for all modes or one each.
    stress : mapping of str to str, optional
        Element sets whose largest von Mises stress goes out, by the output's name.
    cuts : sequence of Nodes, or "auto"
        Sections at which the body is cut into parts; "auto" finds those that open loops between supports.
    tables : mapping, optional
        Further keys of a body file (docs/file-formats.md), as `tomllib` would read them.

    Attributes
    ----------
    mesh : Mesh
    spec : BodySpec

    Raises
    ------
    MeshError, BodyFileError
        With what was found, what was expected and what to do.

    Examples
    --------
    >>> mesh = flexfmu.read_mesh("arm.inp")
    >>> body = flexfmu.Body(mesh, supports=["ROOT"], interfaces={"tip": "TIP"}, name="arm")
    >>> arm = body.build(frames=2, modes=4)
    >>> arm
    <BuiltBody 'arm': second_order, 4 modes, 2 frames, interfaces tip>
    """

    def __init__(
        self,
        mesh: object,
        material: Sequence[float] | Mapping[str, float] | None = None,
        supports: Sequence[Support | Nodes] = (),
        interfaces: Mapping[str, Interface | Nodes] | None = None,
        *,
        name: str = "body",
        units: UnitSystem | str = UnitSystem.SI,
        free: bool = False,
        damping: float | Sequence[float] = 0.0,
        stress: Mapping[str, str] | None = None,
        cuts: Sequence[Nodes] | Literal["auto"] = (),
        tables: Mapping[str, Any] | None = None,
    ):
        system = unit_system(units)
        choices = NodeChoices(as_mesh(mesh, system), system)
        data: dict[str, Any] = {
            "name": name,
            "mesh": {"units": system},
            "support": [support_table(choices, each, f"support {k}") for k, each in enumerate(supports, start=1)],
            "interface": [interface_table(choices, key, each) for key, each in (interfaces or {}).items()],
            "damping": {"ratio": plain(damping)},
            **({"free": True} if free else {}),
            **({"cut": _cut_tables(choices, cuts)} if cuts else {}),
            **({"stress": [{"name": key, "elements": value} for key, value in stress.items()]} if stress else {}),
            **(plain(tables) if tables else {}),
        }
        if material is not None:
            data["material"] = material_table(material)
        self.spec = checked_spec(data)
        self.mesh = choices.mesh
        self._origin = {"mesh_file": "in memory", "mesh_sha256": _digest(self.mesh)}

    @classmethod
    def read(cls, path: str | Path, report: Reporter | None = None) -> "Body":
        """Body of a body file (TOML) and the mesh that it names.

        Parameters
        ----------
        path : path
        report : Reporter, optional

        Returns
        -------
        Body

        Examples
        --------
        >>> flexfmu.Body.read("body.toml").build(modes=6).fmu("lean.fmu")
        PosixPath('lean.fmu')
        """
        config = read_body_file(Path(path))
        file = config.mesh.file
        body = cls.__new__(cls)
        with (report or ScriptReporter()).stage(f"Read {file.name}"):
            body.mesh = read_mesh(file, config.mesh.units)
        body.spec = config
        body._origin = file_origin(file)
        return body

    def __repr__(self) -> str:
        """Name, size, sets in use."""
        held = ", ".join(str(table.nodes) for table in self.spec.support) or "nothing"
        taken = ", ".join(f"{table.name} ({table.nodes})" for table in self.spec.interface)
        return f"<Body {self.spec.name!r}: {self.mesh!r}, held at {held}; interfaces {taken}>"

    def build(
        self,
        method: Method | str | None = None,
        *,
        mass: Mass | str | None = None,
        modes: int | Sequence[int] | None = None,
        frames: int | Sequence[Mapping[str, Any]] | None = None,
        branches: Mapping[str, Sequence[float]] | None = None,
        basis: Enum | str | None = None,
        residual_flexibility: bool | Sequence[str] | None = None,
        acceleration: bool | None = None,
        velocities: bool | None = None,
        surface: bool | None = None,
        stress: bool | None = None,
        report: Reporter | None = None,
        store: Store | None = None,
    ) -> "BuiltBody":
        """Reduce the body. Whatever is not given is as the body file says, or as its default.

        Parameters
        ----------
        method : Method or str, optional
        mass : Mass or str, optional
        modes : int or sequence of int, optional
            How many, or their numbers.
        frames : int or sequence of mapping, optional
            How many, or tables as of `[[frame]]`.
        branches : mapping of str to sequence of float, optional
            Distances of joints by what they lead toward, m.
        basis : Basis or str, optional
        residual_flexibility : bool or sequence of str, optional
        acceleration, velocities, surface, stress : bool, optional
            Keys of `[input]` and `[output]`.
        report : Reporter, optional
            Default: warnings are Python's, notes go to the log "flexfmu".
        store : Store, optional
            Where modes and the like are kept from build to build; default: nowhere.

        Returns
        -------
        BuiltBody

        Raises
        ------
        FlexfmuError
            With what was found, what was expected and what to do.
        """
        data = self.spec.model_dump(exclude_unset=True) | {"mesh": {"units": self.spec.mesh.units}}
        if frames is not None or branches is not None:
            for key in ("frames", "frame", "branch"):
                data.pop(key, None)
            if branches is not None:
                data["branch"] = [{"toward": key, "joints": plain(value)} for key, value in branches.items()]
            if frames is not None:
                data["frames" if isinstance(frames, int) else "frame"] = plain(frames)
        chosen: dict[str, dict[str, Any]] = {
            "formulation": {"method": method, "mass": mass},
            "reduction": {"basis": basis, "modes": modes, "residual_flexibility": residual_flexibility},
            "input": {"acceleration": acceleration},
            "output": {"velocities": velocities, "surface": surface, "stress": stress},
        }
        for table, values in chosen.items():
            given = {key: plain(value) for key, value in values.items() if value is not None}
            data[table] = {**data.get(table, {}), **given}
        spec = checked_spec(data)
        return BuiltBody(reduce_mesh(self.mesh, spec, self._origin, report or ScriptReporter(), store))


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

    def fmu(
        self,
        path: str | Path,
        runtime: Runtime | str = Runtime.NATIVE,
        platforms: Sequence[str] = (),
        report: Reporter | None = None,
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

        Returns
        -------
        Path
        """
        package_fmu(self.reduced, Path(path), Runtime(runtime), platforms, report)
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
        report: Reporter | None = None,
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
            outputs, result = simulate(
                fmu, names, table, step=step, stop=stop, parameters=parameters, report=report or ScriptReporter()
            )
        return SimulationResult(self.model.name, tuple(outputs), result[:, 0], result[:, 1:])

    def _table(self, loads: Mapping[str, Any], stop: float | None) -> tuple[list[str], FloatArray]:
        """Names of inputs, and rows of time and their values."""
        columns = {str(key): np.asarray(loads[key], dtype=np.float64) for key in loads}
        if "time" not in columns and hasattr(loads, "index"):
            columns["time"] = np.asarray(loads.index, dtype=np.float64)
        if "time" not in columns:
            if stop is None:
                raise SimulationError('loads have no column "time": give one, or constant loads and stop = … (s)')
            packed = self.loads(loads)
            given = {
                f"{name}.{kind}.{axis}": value
                for kind, rows in (("force", packed.force), ("moment", packed.moment))
                for name, row in zip(self.model.interface_names, rows, strict=True)
                for axis, value in zip("xyz", row, strict=True)
            }
            return list(given), np.array([[time, *given.values()] for time in (0.0, stop)])
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
        return (
            f"<SimulationResult of {self.name!r}: {len(self.time)} times from {self.time[0]:g} s to "
            f"{self.time[-1]:g} s, {len(self.outputs)} outputs such as {self.outputs[0]}>"
        )

    def __getitem__(self, output: str) -> FloatArray:
        """Values (n,) of an output by its name."""
        if output == "time":
            return self.time
        if output not in self.outputs:
            raise KeyError(f"{output!r}: the outputs are {', '.join(self.outputs)}")
        column: FloatArray = self.values[:, self.outputs.index(output)]
        return column

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame of the outputs, with time as its index."""
        import pandas

        return pandas.DataFrame(self.values, index=pandas.Index(self.time, name="time"), columns=list(self.outputs))

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


def _cut_tables(choices: NodeChoices, cuts: Sequence[Nodes] | Literal["auto"]) -> list[dict[str, str]] | str:
    """The key `cut` of a body file."""
    if cuts == "auto":
        return "auto"
    return [{"nodes": choices.name(each, f"cut {k}")} for k, each in enumerate(cuts, 1)]


def _digest(mesh: Mesh) -> str:
    """Hash of a mesh's points, elements and sets."""
    digest = hashlib.sha256(mesh.points.tobytes())
    for block in mesh.blocks:
        digest.update(block.type.name.encode() + block.connectivity.tobytes())
    for name, rows in mesh.node_sets.items():
        digest.update(name.encode() + rows.tobytes())
    return digest.hexdigest()
