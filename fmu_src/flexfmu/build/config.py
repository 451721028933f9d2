"""The body file (TOML): its keys, checked, with errors that name the key; docs/file-formats.md describes it."""

from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from ..files.errors import BodyFileError
from ..files.inputs import Kind
from ..files.limits import MOST_FRAMES, MOST_MODES
from ..files.units import UnitSystem
from ..model.methods import ASKED_BY, DEFAULT, Data, Mass, Method, Variant, conflict, has_frames, needs
from ..model.errors import OptionError
from .old_keys import OLD_KEYS, replaced
from ..files.toml_files import Name, Table, Vector, read_toml, validated

ModeNumber = Annotated[int, Field(ge=1, le=MOST_MODES)]
_C_KEYWORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
"""
# Names become parts of FMU variable names and HDF5 paths.


class MeshUnits(Table):
    """What the numbers of a mesh and of `[material]` are in, and whether its own supports count."""

    units: UnitSystem = Field(default=UnitSystem.SI, strict=False)
    boundary: bool = True


class MeshTable(MeshUnits):
    """`[mesh]`: where the mesh is and in which units."""

    file: Path = Field(strict=False, examples=["arm.inp"])


class MaterialTable(Table):
    """`[material]`: what the mesh file does not tell, or of the material of a name; in the units of `[mesh]`."""

    name: str | None = Field(default=None, examples=["STEEL"])
    youngs_modulus: float | None = Field(default=None, gt=0.0)
    poissons_ratio: float | None = Field(default=None, gt=-1.0, lt=0.5)
    density: float | None = Field(default=None, gt=0.0)

    @model_validator(mode="after")
    def _tells_something(self) -> "MaterialTable":
        if self.youngs_modulus is None and self.poissons_ratio is None and self.density is None:
            raise ValueError("tells nothing: give youngs_modulus, poissons_ratio or density, or all of them")
        return self


class Place(Table):
    """Nodes by place, m: those that meet every condition given."""

    set: str | None = None
    numbers: Annotated[list[int], Field(min_length=1)] | None = None
    plane: Vector | None = None
    normal: Vector | None = None
    box: Annotated[list[Vector], Field(min_length=2, max_length=2)] | None = None
    cylinder: Annotated[list[Vector], Field(min_length=2, max_length=2)] | None = None
    patch: Vector | None = None
    radius: float | None = Field(default=None, gt=0.0)
    nearest: Vector | None = None
    tolerance: float | None = Field(default=None, gt=0.0)

    @model_validator(mode="after")
    def _complete(self) -> "Place":
        chosen = (self.set, self.numbers, self.plane, self.box, self.cylinder, self.patch, self.nearest)
        if all(one is None for one in chosen):
            raise ValueError("names no place: give set, numbers, plane, box, cylinder, patch or nearest")
        if (self.plane is None) != (self.normal is None) or (self.normal is not None and not any(self.normal)):
            raise ValueError("plane is a point of it and goes with normal = [x, y, z], not zero")
        if self.radius is None and (self.cylinder is not None or self.patch is not None):
            raise ValueError("cylinder (two points of its axis) and patch (a point) go with radius, in m")
        if self.cylinder is not None and self.cylinder[0] == self.cylinder[1]:
            raise ValueError("cylinder is given by two equal points of its axis, expected both its ends")
        return self


Nodes = str | Place | list[str | Place]


class SupportTable(Table):
    """`[[support]]`: translations held at zero, or springs to the ground."""

    nodes: Nodes = Field(examples=["CLAMP"])
    fix: list[Literal["x", "y", "z"]] = Field(default=[], examples=[["x", "y", "z"]])
    stiffness: Vector | None = Field(default=None, examples=[[1e6, 1e6, 1e6]])

    @field_validator("stiffness")
    @classmethod
    def _not_negative(cls, value: list[float] | None) -> list[float] | None:
        if value is not None and (min(value) < 0.0 or max(value) == 0.0):
            raise ValueError(f"is {value} N/m, expected three numbers ≥ 0 along x, y, z, not all of them zero")
        return value

    @model_validator(mode="after")
    def _holds_something(self) -> "SupportTable":
        if not self.fix and self.stiffness is None:
            raise ValueError('holds nothing: give fix = ["x", "y", "z"], or stiffness = [kx, ky, kz] in N/m')
        for axis, value in zip(("x", "y", "z"), self.stiffness or (), strict=False):
            if axis in self.fix and value > 0.0:
                raise ValueError(
                    f"both fixes {axis} and puts a spring of {value} N/m along it, expected one of the two"
                )
        return self


class InterfaceTable(Table):
    """`[[interface]]`: where loads come in and motion goes out."""

    name: Name = Field(examples=["tip"])
    nodes: Nodes = Field(examples=["FLANGE"])
    point: Vector | None = Field(default=None, examples=[[0.0, 0.0, 0.0]])
    weights: Literal["auto", "area", "node"] = "auto"
    compliance: bool = False
    follows: bool = False


class FrameTable(Table):
    """`[[frame]]`: a sub-domain with a frame of its own."""

    name: Name
    nodes: Nodes
    joint: str | Vector | None = None
    parent: str | None = None
    rotation_points: list[str] | None = None

    @field_validator("rotation_points")
    @classmethod
    def _one_or_three(cls, value: list[str] | None) -> list[str] | None:
        if value is not None and len(value) not in (1, 3):
            raise ValueError(
                f"lists {len(value)} node sets, expected one (the far end: chord from the joint) or three (a "
                "tetrahedron with the joint)"
            )
        return value


class BranchTable(Table):
    """`[[branch]]`: joints between frames on the way from the supports to an interface."""

    toward: str
    joints: list[Annotated[float, Field(gt=0.0)]] = Field(min_length=1)

    @field_validator("joints")
    @classmethod
    def _ascending(cls, value: list[float]) -> list[float]:
        if any(b <= a for a, b in pairwise(value)):
            raise ValueError(f"is {value}, expected ascending distances from the supports in m, such as [0.2, 0.5]")
        return value


class CutTable(Table):
    """`[[cut]]`: a section across the body at which it is cut into parts, joined again by stiff springs."""

    nodes: str


class Basis(Enum):
    """Modal basis."""

    NORMAL = "normal"
    """Eigenmodes with the supports in place."""
    CRAIG_BAMPTON = "craig_bampton"
    """Constraint modes of the interfaces and fixed-interface normal modes."""


class StressTable(Table):
    """`[[stress]]`: a part of the body whose largest von Mises stress goes out."""

    name: Name
    elements: str


class ReductionTable(Table):
    """`[reduction]`: the modal basis."""

    basis: Basis = Field(default=Basis.NORMAL, strict=False)
    modes: ModeNumber | Annotated[list[ModeNumber], Field(min_length=1)] = 10
    residual_flexibility: bool | Annotated[list[str], Field(min_length=1)] = False
    geometric_stiffness: list[Literal["by_load", "by_mode"]] | None = None
    inertia: bool | None = None
    second_order: bool | None = None
    membrane: bool | Literal["auto"] = "auto"

    @field_validator("modes")
    @classmethod
    def _ascending(cls, value: int | list[int]) -> int | list[int]:
        if isinstance(value, list) and any(b <= a for a, b in pairwise(value)):
            raise ValueError(f"is {value}, expected ascending numbers of modes, such as [1, 3, 5]")
        return value

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of the normal modes that are kept, in order of frequency, from 1."""
        return tuple(self.modes) if isinstance(self.modes, list) else tuple(range(1, self.modes + 1))


class DampingTable(Table):
    """`[damping]`: modal damping ratio, one for all modes or one each."""

    ratio: float | list[float] = Field(default=0.0, examples=[0.01])

    @field_validator("ratio")
    @classmethod
    def _below_critical(cls, value: float | list[float]) -> float | list[float]:
        for ratio in value if isinstance(value, list) else [value]:
            if ratio < 0.0:
                raise ValueError(f"a damping ratio is negative, {ratio:g}, expected ≥ 0")
            if ratio > 1.0:
                raise ValueError(
                    f"a damping ratio is {ratio:g}, expected at most 1, which is critical damping; {ratio:g} % is "
                    f"{ratio / 100.0:g}"
                )
        return value


class FormulationTable(Table):
    """`[formulation]`: the method that the FMU starts with; without one, see `BodyFile.variant`."""

    method: Method | None = Field(default=None, strict=False)
    mass: Mass = Field(default=Mass.CONSTANT, strict=False)

    @model_validator(mode="before")
    @classmethod
    def _without_old_keys(cls, data: object) -> object:
        old = {key: data[key] for key in OLD_KEYS if key in data} if isinstance(data, dict) else {}
        if old:
            raise ValueError(replaced(old))
        return data

    @model_validator(mode="after")
    def _meaningful(self) -> "FormulationTable":
        try:
            _ = self.variant
        except OptionError as error:
            raise ValueError(str(error)) from error
        return self

    @property
    def variant(self) -> Variant:
        """Method and mass of a body that has frames; a mass that the method does not know raises OptionError."""
        return Variant(self.method or DEFAULT, self.mass)


class InputTable(Table):
    """`[input]`: what else the FMU takes in."""

    acceleration: bool = False


class OutputTable(Table):
    """`[output]`: what else goes into the FMU."""

    velocities: bool = False
    surface: bool = True
    stress: bool = False

    @model_validator(mode="after")
    def _stress_on_the_surface(self) -> "OutputTable":
        if self.stress and not self.surface:
            raise ValueError("stress is stored for the surface: take surface = false out, or stress = true")
        return self


class BodySpec(Table):
    """What to make of a mesh: everything that a body file says, but for where the mesh is."""

    name: Name = Field(examples=["arm"])
    mesh: MeshUnits = MeshUnits()
    material: MaterialTable | list[MaterialTable] | None = None
    free: bool = False
    root: Name | None = None
    support: list[SupportTable] = []
    interface: list[InterfaceTable] = Field(min_length=1)
    frames: int | None = Field(default=None, ge=0, le=MOST_FRAMES)
    frame: list[FrameTable] = []
    branch: list[BranchTable] = []
    cut: list[CutTable] | Literal["auto"] | None = None
    stress: list[StressTable] = []
    reduction: ReductionTable = ReductionTable()
    damping: DampingTable = DampingTable()
    formulation: FormulationTable = FormulationTable()
    input: InputTable = InputTable()
    output: OutputTable = OutputTable()

    @field_validator("name")
    @classmethod
    def _identifier(cls, value: str) -> str:
        if value in _C_KEYWORDS.split():
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
        for kind, names in (
            ("interface", [i.name for i in self.interface]),
            ("frame", [f.name for f in self.frame]),
            ("stress", [s.name for s in self.stress]),
        ):
            for name in names:
                if names.count(name) > 1:
                    raise ValueError(f"two [[{kind}]] tables have the name {name!r}, expected different names")
        named = [None if table.name is None else table.name.upper() for table in self.materials]
        if len(set(named)) < len(named):
            raise ValueError("two [[material]] tables have the same name, or none, expected different names")
        if self.root is not None and self.root not in [i.name for i in self.interface]:
            raise ValueError(f"root is {self.root!r}, which is no [[interface]]")
        if self.root is not None and not self.free:
            raise ValueError("root names the interface from which a free body is divided: it needs free = true")
        if self.free and "by_load" in (self.reduction.geometric_stiffness or ()):
            raise ValueError(
                'geometric_stiffness "by_load" needs the stress of each load by itself, and a free body has none: what '
                "balances the load is not known before; take it out"
            )
        reason = conflict(self.variant, self.free, bool(self.cut))
        if reason is not None:
            raise ValueError(reason)
        if self.cut:
            self._check_cut()
        known = {f.name for f in self.frame}
        for f in self.frame:
            if f.parent is not None and f.parent not in known:
                raise ValueError(f"frame {f.name!r} has the parent {f.parent!r}, which is no [[frame]]")
        self._check_data()
        ratio = self.damping.ratio
        plain = self.reduction.basis is Basis.NORMAL and not self.reduction.residual_flexibility
        count = len(self.reduction.numbers)
        if plain and isinstance(ratio, list) and len(ratio) != count:
            raise ValueError(f"damping.ratio lists {len(ratio)} values for {count} modes")
        return self

    @property
    def cuts(self) -> list[CutTable]:
        """The `[[cut]]` tables; none where the build finds the sections."""
        return self.cut if isinstance(self.cut, list) else []

    @property
    def open_to_cuts(self) -> bool:
        """Whether the build decides if loops are cut: nothing is said of cuts or frames, or goes without cuts."""
        divided = self.frames is not None or self.frame or self.branch
        listed = isinstance(self.reduction.modes, list) or isinstance(self.damping.ratio, list)
        if self.cut is not None or divided or listed or self.variant != Variant(Method.SECOND_ORDER):
            return False
        try:
            self._check_cut()
        except ValueError:
            return False
        return True

    @property
    def without_pictures(self) -> Self:
        """The same body without what only pictures of it need."""
        return self.model_copy(update={"output": self.output.model_copy(update={"surface": False, "stress": False})})

    @property
    def materials(self) -> list[MaterialTable]:
        """The tables `[material]` or `[[material]]`."""
        return self.material if isinstance(self.material, list) else [] if self.material is None else [self.material]

    @property
    def variant(self) -> Variant:
        """Method and mass that the FMU starts with.

        Where no method is given, second order; linear for a body without frames; frames where
        `reduction.second_order` is false.
        """
        table = self.formulation
        if table.method is not None:
            return table.variant
        if self.frames == 0 and not self.free:
            return Variant(Method.LINEAR)
        possible = self.frames != 0 and self.reduction.second_order is not False
        return Variant(Method.SECOND_ORDER, table.mass) if possible else table.variant

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
            raise ValueError(
                f'method "{variant.words}" needs {ASKED_BY[data]}, and [reduction] says otherwise: take that key out'
            )
        if has_frames(variant.method) and self.frames == 0 and not self.free:
            raise ValueError(
                f'method "{variant.method.value}" needs frames, and frames is 0: take frames = 1 or more, or method '
                '"linear"'
            )

    def residual_columns(self) -> list[int]:
        """Places of the loads whose residual flexibility is listed, among forces of all interfaces, then moments."""
        names = [i.name for i in self.interface]
        listed = self.reduction.residual_flexibility
        kinds = ("force", "moment")
        known = [f"{name}.{kind}.{axis}" for kind in kinds for name in names for axis in ("x", "y", "z")]
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
                raise ValueError(
                    f"[[branch]] leads toward {name!r}, expected an interface"
                    f"{' or the nodes of a [[cut]]' if self.cut else ''}: {', '.join(ends)}"
                )
            if names.count(name) > 1:
                raise ValueError(f"two [[branch]] tables lead toward {name!r}: put the joints into one")

    def _check_cut(self) -> None:
        """Refuse what is made for bodies in one piece."""
        names = [c.nodes for c in self.cuts]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"two [[cut]] tables have the nodes {name!r}, expected different sections")
        if isinstance(self.reduction.residual_flexibility, list):
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

    mesh: MeshTable


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
    body = validated(BodyFile, data, BodyFileError, "docs/file-formats.md", path)
    mesh = body.mesh.model_copy(update={"file": path.parent / body.mesh.file})
    return body.model_copy(update={"mesh": mesh})
