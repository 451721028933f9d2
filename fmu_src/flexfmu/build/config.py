"""The body file (TOML): all its tables together, checked, with errors that name the key."""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from ..files.basics import MOST_FRAMES, BodyFileError
from ..files.outputs import Reporter
from ..files.tables import Kind
from ..files.toml_files import Name, Table, different, read_toml, validated
from ..mesh.formats import read_mesh
from ..mesh.model import Mesh
from ..model.methods import Data, Mass, Method, Variant, conflict, has_frames, needs
from ..reduction import options as plain
from . import tables
from .tables import OF_MESH, PlaceTable

C_KEYWORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
"""
"""Names that no body may have."""


class BodySpec(Table):
    """What to make of a mesh: everything that a body file says, but for where the mesh is.

    Attributes
    ----------
    name
        Name of the body and the FMU.
    frames
        Number of frames along the body, counted from the supports (at most one per element layer). 0: linear.
        Default: 4, shared by parts if cut, 2 or more each; 8 with lumps; 1 if stretch stops a loop or all supports roll
    free
        Nothing holds the body, or only a hinge.
    root
        Free body: interface from which frames are counted, and which a master may hold. Default: the first interface
    cut
        `"auto"`: cut loops at slender sections; `[]`: never; or `[[cut]]` tables.
        Default: where parts turn far against each other, if no key divides the body
    """

    name: Name = Field(examples=["arm"])
    mesh: tables.MeshUnits = tables.MeshUnits()
    material: tables.MaterialTable | list[tables.MaterialTable] | None = None
    free: bool = False
    root: Name | None = None
    support: list[tables.SupportTable] = []
    interface: list[tables.InterfaceTable] = Field(min_length=1)
    frames: int | None = Field(default=None, ge=0, le=MOST_FRAMES, examples=[4])
    frame: list[tables.FrameTable] = []
    branch: list[tables.BranchTable] = []
    cut: list[tables.CutTable] | Literal["auto"] | None = None
    stress: list[tables.StressTable] = []
    reduction: tables.ReductionTable = tables.ReductionTable()
    damping: tables.DampingTable = tables.DampingTable()
    formulation: tables.FormulationTable = tables.FormulationTable()
    input: tables.InputTable = tables.InputTable()
    output: tables.OutputTable = tables.OutputTable()

    @field_validator("name")
    @classmethod
    def _identifier(cls, value: str) -> str:
        if value in C_KEYWORDS.split():
            raise ValueError(f"{value!r} is a word of the C language, which an FMU's model identifier may not be")
        return value

    @model_validator(mode="after")
    def _consistent(self) -> "BodySpec":
        if sum((self.frames is not None, bool(self.frame), bool(self.branch))) > 1:
            raise ValueError(
                "give either frames = n (automatic division), [[branch]] tables (joints at distances) or [[frame]] "
                "tables (node sets)"
            )
        self._check_branches()
        self.residual_columns()
        for kind, given in (("interface", self.interface), ("frame", self.frame), ("stress", self.stress)):
            different([one.name for one in given], f"[[{kind}]] tables have the name")
        named = [None if table.name is None else table.name.upper() for table in self.materials]
        if len(set(named)) < len(named):
            raise ValueError("two [[material]] tables have the same name, or none, expected different names")
        if self.root is not None and self.root not in [i.name for i in self.interface]:
            raise ValueError(f"root is {self.root!r}, which is no [[interface]]")
        if self.root is not None and not self.free:
            raise ValueError("root names the interface from which a free body is divided: it needs free = true")
        if self.free and "by_load" in (self.reduction.geometric_stiffness or ()):
            found = 'geometric_stiffness "by_load" needs the stress of each load by itself, and a free body has none'
            raise ValueError(f"{found}: what balances the load is not known before; take it out")
        if reason := conflict(self.variant, self.free, bool(self.cut)):
            raise ValueError(reason)
        if self.cut:
            self._check_cut()
        known = {f.name for f in self.frame}
        for f in self.frame:
            if f.parent is not None and f.parent not in known:
                raise ValueError(f"frame {f.name!r} has the parent {f.parent!r}, which is no [[frame]]")
        self._check_data()
        ratio = self.damping.ratio
        count = len(self._modes.numbers)
        if self._plain and isinstance(ratio, list) and len(ratio) != count:
            raise ValueError(f"damping.ratio lists {len(ratio)} values for {count} modes")
        return self

    @property
    def cuts(self) -> list[tables.CutTable]:
        """The `[[cut]]` tables; none where the build finds the sections."""
        return self.cut if isinstance(self.cut, list) else []

    @property
    def open_to_cuts(self) -> bool:
        """Whether the build decides if loops are cut: nothing is said of cuts or frames, or goes without cuts."""
        divided = self.frames is not None or self.frame or self.branch
        heavy = self.formulation.mass not in (None, Mass.CONSTANT)
        if self.cut is not None or divided or self._listed or heavy or self.variant.method is not Method.SECOND_ORDER:
            return False
        try:
            self._check_cut()
        except ValueError:
            return False
        return True

    @property
    def residual(self) -> bool | list[str]:
        """Loads whose static shapes complete the normal modes: as listed, or all.

        Without the key all of them, unless modes or their damping ratios are listed one by one.
        """
        said = self.reduction.residual_flexibility
        return self.reduction.basis is plain.Basis.NORMAL and not self._listed if said is None else said

    @property
    def _listed(self) -> bool:
        return isinstance(self.reduction.modes, list) or isinstance(self.damping.ratio, list)

    @property
    def _plain(self) -> bool:
        """Whether the basis is normal modes alone."""
        return self.reduction.basis is plain.Basis.NORMAL and not self.residual

    @property
    def _modes(self) -> tables.ReductionTable:
        """`[reduction]` with its number of modes: where it does not say, as many as damping ratios are listed."""
        table, ratio = self.reduction, self.damping.ratio
        if not isinstance(ratio, list) or not self._plain or table.counted:
            return table
        return table.model_copy(update={"modes": len(ratio)})

    @property
    def without_pictures(self) -> Self:
        """The same body without what its motion does not need."""
        return self._output(surface=False, stress=False, error=False)

    @property
    def certified(self) -> Self:
        """The same body without pictures, with what tells its error."""
        return self._output(surface=False, stress=False, error=True)

    def accepting(self, tolerance: float) -> Self:
        """The same body; its FMU warns above this relative error."""
        return self._output(tolerance=tolerance)

    def _output(self, **changed: Any) -> Self:
        return self.model_copy(update={"output": self.output.model_copy(update=changed)})

    @property
    def use(self) -> plain.BodyUse:
        """How the body will be used."""
        damping = np.array(self.damping.measured) if self.damping.measured else self.damping.ratio
        soft = tuple(one.name for one in self.interface if one.compliance)
        following, output = tuple(one.name for one in self.interface if one.follows), self.output
        return plain.BodyUse(self.name, damping, self.variant, output.velocities, soft, following, output.tolerance)

    @property
    def options(self) -> plain.BodyOptions:
        """The same as plain data."""
        residual = self.residual
        return plain.BodyOptions(
            name=self.name,
            interfaces=plain_tables(plain.InterfaceNodes, self.interface, self.mesh.units.length),
            supports=plain_tables(plain.SupportNodes, self.support, self.mesh.units.length),
            materials=plain_tables(plain.MaterialConstants, self.materials),
            units=self.mesh.units,
            boundary=self.mesh.boundary,
            free=self.free,
            root=self.root,
            levels=plain.DEFAULT_FRAMES if self.frames is None else self.frames,
            levels_asked=self.frames is not None,
            frames=plain_tables(plain.FrameNodes, self.frame, self.mesh.units.length),
            branches=tuple((b.toward, tuple(one * self.mesh.units.length for one in b.joints)) for b in self.branch),
            cuts=tuple(one.nodes for one in self.cuts),
            find_cuts=self.cut == "auto",
            may_cut=self.open_to_cuts,
            stress=tuple((one.name, one.elements) for one in self.stress),
            basis=plain.BasisOptions(
                self.reduction.basis,
                self._modes.numbers,
                self._modes.counted,
                tuple(self.residual_columns()) if isinstance(residual, list) else residual,
                by_need=residual is True and self.reduction.residual_flexibility is None,
            ),
            membrane=self.reduction.membrane,
            variant=self.variant,
            stored=self.stored,
            acceleration=self.input.acceleration,
            surface=self.output.surface,
            surface_stress=self.output.stress,
            certificate=self.output.error,
        )

    @property
    def materials(self) -> list[tables.MaterialTable]:
        """The tables `[material]` or `[[material]]`."""
        return self.material if isinstance(self.material, list) else [] if self.material is None else [self.material]

    @property
    def variant(self) -> Variant:
        """Method and mass that the FMU starts with.

        Where no method is given, second order; linear for a body without frames; frames where
        `reduction.second_order` is false.
        """
        table = self.formulation
        possible = self.frames != 0 and self.reduction.second_order is not False
        if table.method is None and self.frames == 0 and not self.free:
            return Variant(Method.LINEAR)
        if table.method is not Method.SECOND_ORDER and (table.method is not None or not possible):
            return table.variant
        return Variant(Method.SECOND_ORDER, table.mass or (Mass.CONSTANT if self.cut else Mass.POLYNOMIAL))

    @property
    def stored(self) -> frozenset[Data]:
        """Data of methods that the modal file holds: as `[reduction]` asks, or as the method needs."""
        table, needed = self.reduction, needs(self.variant.method, self.variant.mass)
        listed = table.geometric_stiffness
        asked = {
            Data.BY_LOAD: None if listed is None else "by_load" in listed,
            Data.BY_MODE: None if listed is None else "by_mode" in listed,
            Data.INERTIA: table.inertia,
            Data.SECOND_ORDER: table.second_order,
        }
        return frozenset(data for data, wish in asked.items() if (data in needed if wish is None else wish))

    def _check_data(self) -> None:
        """Refuse a method whose data `[reduction]` leaves out, and frames that are not there."""
        variant = self.variant
        for data in sorted(needs(variant.method, variant.mass) - self.stored, key=lambda one: one.value):
            words = variant.words if data is Data.INERTIA else variant.method.value
            found = f'method "{words}" needs {data.key}, and [reduction] says otherwise'
            raise ValueError(f"{found}: take that key out")
        if has_frames(variant.method) and self.frames == 0 and not self.free:
            found = f'method "{variant.method.value}" needs frames, and frames is 0'
            raise ValueError(f'{found}: take frames = 1 or more, or method "linear"')

    def residual_columns(self) -> list[int]:
        """Places of the loads whose residual flexibility is listed, among forces of all interfaces, then moments."""
        names = [i.name for i in self.interface]
        listed = self.residual
        known = [f"{name}.{kind}.{axis}" for kind in ("force", "moment") for name in names for axis in "xyz"]
        if not isinstance(listed, list):
            return list(range(len(known))) if listed else []
        for name in listed:
            if name not in known or listed.count(name) > 1:
                raise ValueError(
                    f"reduction.residual_flexibility lists {name!r}, expected loads of interfaces, each once, such as "
                    f'"{known[0]}", or true for all of them; interfaces: {", ".join(names)}'
                )
        return sorted(known.index(name) for name in listed)

    def _check_branches(self) -> None:
        """Refuse branches that lead nowhere, or the same way twice."""
        ends = [*(i.name for i in self.interface), *(c.nodes for c in self.cuts)]
        names = [b.toward for b in self.branch]
        for name in names:
            if name not in ends:
                found = f"[[branch]] leads toward {name!r}"
                expected = f"an interface{' or the nodes of a [[cut]]' if self.cut else ''}: {', '.join(ends)}"
                raise ValueError(f"{found}, expected {expected}")
            if names.count(name) > 1:
                raise ValueError(f"two [[branch]] tables lead toward {name!r}: put the joints into one")

    def _check_cut(self) -> None:
        """Refuse what is made for bodies in one piece."""
        different([c.nodes for c in self.cuts], "[[cut]] tables have the nodes", "different sections")
        if isinstance(self.residual, list):
            raise ValueError("[[cut]] needs residual_flexibility of all loads: the list does not go with it")
        if self.frames == 0:
            raise ValueError("[[cut]] is for the frames' sake: it does not go with frames = 0")
        if self.free:
            raise ValueError("[[cut]] needs supports from which the frames of each part hang: it goes without free")
        if self.reduction.geometric_stiffness:
            raise ValueError("[[cut]] goes without geometric_stiffness, which knows bodies in one piece")
        if self.reduction.inertia:
            raise ValueError('[[cut]] goes with mass "constant" only, without reduction.inertia')


class BodyFile(BodySpec):
    """A whole body file."""

    mesh: tables.MeshTable
    shell: list[tables.ShellTable] = []

    @field_validator("shell")
    @classmethod
    def _of_different_sets(cls, value: list[tables.ShellTable]) -> list[tables.ShellTable]:
        different([one.elements for one in value], "[[shell]] tables have the elements", "different sets")
        return value

    @property
    def shells(self) -> dict[str, tuple[float, float]]:
        """Thickness and offset of the shells of the mesh file, by their set."""
        return {one.elements: (one.thickness, one.offset) for one in self.shell}

    def read_mesh(self, report: Reporter) -> Mesh:
        """Read the mesh that it names."""
        with report.stage(f"Read {self.mesh.file.name}"):
            return read_mesh(self.mesh.file, self.mesh.units, self.shells, self.mesh.timeout)


def read_body_file(path: Path) -> BodyFile:
    """Read and check a body file; the mesh's path comes out relative to the working directory.

    Parameters
    ----------
    path : Path

    Returns
    -------
    BodyFile

    Raises
    ------
    BodyFileError
        Every wrong key at once, with what was found and what would do.
    """
    data = read_toml(path, BodyFileError, Kind.BODY)
    body = validated(BodyFile, data, BodyFileError, "docs/reference/body-file.md", path)
    return body.model_copy(update={"mesh": body.mesh.model_copy(update={"file": path.parent / body.mesh.file})})


def plain_tables(kind: type[Any], given: Sequence[Table], length: float = 1.0) -> tuple[Any, ...]:
    """The same as plain data, whose fields have the keys' names; what is not given has their defaults.

    Lengths in the mesh's units, `length` m each, come out in m.
    """
    found = []
    for one in given:
        values = {field.name: getattr(one, field.name) for field in fields(kind)}
        units = {name: length if OF_MESH in type(one).model_fields[name].metadata else 1.0 for name in values}
        plain = {name: _plain(value, length, units[name]) for name, value in values.items() if value is not None}
        found.append(kind(**plain))
    return tuple(found)


def _plain(value: Any, length: float, unit: float) -> Any:
    if isinstance(value, PlaceTable):
        return plain_tables(plain.Place, [value], length)[0]
    if isinstance(value, list):
        return tuple(_plain(one, length, unit) for one in value)
    return value * unit if isinstance(value, float) else value
