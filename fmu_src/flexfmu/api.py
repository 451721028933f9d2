"""Bodies in a script, without files: a mesh in memory, a reduced body, an FMU, a simulation."""

import hashlib
from collections.abc import Mapping, Sequence
from enum import Enum
from html import escape
from pathlib import Path
from typing import Any, Literal

from .build.choices import Interface, NodeChoices, Nodes, Support, checked_spec, material_table, plain
from .build.config import read_body_file
from .build.kept import built_body
from .files.basics import BodyFileError, UnitSystem, unit_system
from .files.outputs import SCRIPT, Reporter, picture_html, rows_html
from .files.store import Store, default_folder
from .fmu.built_body import BuiltBody
from .mesh.formats import file_origin
from .mesh.in_memory import as_mesh
from .mesh.model import Mesh
from .model.methods import Mass, Method
from .view.shown import Shown


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
        Further keys of a body file (docs/reference/body-file.md), as `tomllib` would read them.

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
    >>> arm = body.build(frames=2, modes=4, residual_flexibility=False)
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
        if isinstance(supports, str) or not isinstance(interfaces or {}, Mapping):
            found = f"supports are {supports!r} and interfaces {interfaces!r}"
            raise BodyFileError(f'{found}, expected a list such as ["CLAMP"] and a mapping such as {{"tip": "FLANGE"}}')
        system = unit_system(units)
        choices = NodeChoices(as_mesh(mesh, system), system)
        data: dict[str, Any] = {
            "name": name,
            "mesh": {"units": system},
            **choices.tables(supports, interfaces or {}),
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
    def read(cls, path: str | Path, report: Reporter = SCRIPT) -> "Body":
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
        body = cls.__new__(cls)
        body.spec = config = read_body_file(Path(path))
        body.mesh = config.read_mesh(report)
        body._origin = file_origin(config.mesh.file)
        return body

    def __repr__(self) -> str:
        """Name, size, sets in use."""
        held = ", ".join(str(table.nodes) for table in self.spec.support) or "nothing"
        taken = ", ".join(f"{table.name} ({table.nodes})" for table in self.spec.interface)
        return f"<Body {self.spec.name!r}: {self.mesh!r}, held at {held}; interfaces {taken}>"

    def _repr_html_(self) -> str:
        """What it is, as a table."""
        rows = [("mesh", repr(self.mesh)), *(("held at", str(table.nodes)) for table in self.spec.support)]
        rows += [(f"interface {table.name}", str(table.nodes)) for table in self.spec.interface]
        return f"<p>{escape(self.spec.name)}</p>{rows_html(rows)}{picture_html(self.plot(), 'png')}"

    def view(self, report: Reporter = SCRIPT) -> Shown:
        """Show supports, interfaces, frames and cuts on the mesh, before the build: a page in notebooks."""
        from .build.reduce import body_model
        from .view.mesh import model_view

        read = body_model(self.mesh, self.spec)
        return Shown(model_view(read.options, read.model, report))

    def plot(self) -> Any:
        """A matplotlib figure of `view()`."""
        return self.view().plot()

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
        tolerance: float | None = None,
        report: Reporter = SCRIPT,
        store: Store | None = None,
    ) -> BuiltBody:
        """Reduce the body. Whatever is not given is as the body file says, or as its default.

        Parameters
        ----------
        method, mass : Method and Mass, or str, optional
        modes : int or sequence of int, optional
            How many, or their numbers.
        frames : int or sequence of mapping, optional
            How many, or tables as of `[[frame]]`.
        branches : mapping of str to sequence of float, optional
            Distances of joints by what they lead toward, m.
        basis : Basis or str, optional
        residual_flexibility : bool or sequence of str, optional
        acceleration, velocities, surface, stress, tolerance : bool, or float, optional
            Keys of `[input]` and `[output]`.
        report : Reporter, optional
            Default: warnings are Python's, notes go to the log "flexfmu".
        store : Store, optional
            Where modes and the like are kept from build to build; default: where commands keep them.

        Returns
        -------
        BuiltBody

        Raises
        ------
        FlexfmuError
            With what was found, what was expected and what to do.
        """
        data = self.spec.model_dump(exclude_unset=True, exclude={"shell"}) | {"mesh": {"units": self.spec.mesh.units}}
        _choose_frames(data, frames, branches)
        chosen: dict[str, dict[str, Any]] = {
            "formulation": {"method": method, "mass": mass},
            "reduction": {"basis": basis, "modes": modes, "residual_flexibility": residual_flexibility},
            "input": {"acceleration": acceleration},
            "output": {"velocities": velocities, "surface": surface, "stress": stress, "tolerance": tolerance},
        }
        for table, values in chosen.items():
            given = {key: plain(value) for key, value in values.items() if value is not None}
            data[table] = {**data.get(table, {}), **given}
        store = store or Store(default_folder())
        return BuiltBody(built_body(self.mesh, checked_spec(data), self._origin, report, store))


def _choose_frames(
    data: dict[str, Any],
    frames: int | Sequence[Mapping[str, Any]] | None,
    branches: Mapping[str, Sequence[float]] | None,
) -> None:
    """Put frames and branches, where any are given, in place of all those of a body file."""
    if frames is not None or branches is not None:
        for key in ("frames", "frame", "branch"):
            data.pop(key, None)
    if branches is not None:
        data["branch"] = [{"toward": key, "joints": plain(value)} for key, value in branches.items()]
    if frames is not None:
        data["frames" if isinstance(frames, int) else "frame"] = plain(frames)


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
