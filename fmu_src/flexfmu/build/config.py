"""The body file (TOML): all its tables together, checked, with errors that name the key."""

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from ..files.errors import BodyFileError
from ..files.inputs import Kind
from ..files.limits import MOST_FRAMES
from ..files.toml_files import Name, Table, read_toml, validated
from ..model.methods import ASKED_BY, Data, Method, Variant, conflict, has_frames, needs
from ..reduction.options import (
    DEFAULT_FRAMES,
    Basis,
    BasisOptions,
    BodyOptions,
    BodyUse,
    BranchJoints,
    FrameNodes,
    InterfaceNodes,
    MaterialConstants,
    StressElements,
    SupportNodes,
)
from ..reduction.options import Nodes as PlainNodes
from .tables import (
    BranchTable,
    CutTable,
    DampingTable,
    FormulationTable,
    FrameTable,
    InputTable,
    InterfaceTable,
    MaterialTable,
    MeshTable,
    MeshUnits,
    Nodes,
    OutputTable,
    Place,
    ReductionTable,
    StressTable,
    SupportTable,
)

__all__ = [
    "Basis",
    "BodyFile",
    "BodySpec",
    "BranchTable",
    "CutTable",
    "DampingTable",
    "FormulationTable",
    "FrameTable",
    "InputTable",
    "InterfaceTable",
    "MaterialTable",
    "MeshTable",
    "MeshUnits",
    "Nodes",
    "OutputTable",
    "Place",
    "ReductionTable",
    "StressTable",
    "SupportTable",
    "read_body_file",
]

_C_KEYWORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
"""


class BodySpec(Table):
    """What to make of a mesh: everything that a body file says, but for where the mesh is.

    Attributes
    ----------
    name
        Name of the body and the FMU.
    frames
        Number of frames along the body, counted from the supports (at most one per element layer). 0: linear.
        Default: 4, shared by the parts of a cut body; 1 where several would open a loop
    free
        Nothing holds the body, or only a hinge.
    root
        Free body: interface from which frames are counted, and which a master may hold. Default: the first interface
    cut
        `"auto"`: cut loops between supports at slender sections; `[]`: never; or `[[cut]]` tables.
        Default: where parts turn far against each other, if no key divides the body
    """

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
        plain = self.reduction.basis is Basis.NORMAL and not self.residual
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
        if self.cut is not None or divided or self._listed or self.variant != Variant(Method.SECOND_ORDER):
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
        if said is None:
            return self.reduction.basis is Basis.NORMAL and not self._listed
        return said

    @property
    def _listed(self) -> bool:
        return isinstance(self.reduction.modes, list) or isinstance(self.damping.ratio, list)

    @property
    def without_pictures(self) -> Self:
        """The same body without what only pictures of it need."""
        return self.model_copy(update={"output": self.output.model_copy(update={"surface": False, "stress": False})})

    @property
    def use(self) -> BodyUse:
        """How the body will be used."""
        return BodyUse(
            self.name,
            self.damping.ratio,
            self.variant,
            self.output.velocities,
            tuple(one.name for one in self.interface if one.compliance),
            tuple(one.name for one in self.interface if one.follows),
        )

    @property
    def options(self) -> BodyOptions:
        """The same as plain data."""
        residual = self.residual
        return BodyOptions(
            name=self.name,
            interfaces=tuple(
                InterfaceNodes(one.name, plain_nodes(one.nodes), _tuple(one.point), one.weights)
                for one in self.interface
            ),
            supports=tuple(
                SupportNodes(plain_nodes(one.nodes), tuple(one.fix), _tuple(one.stiffness)) for one in self.support
            ),
            materials=tuple(
                MaterialConstants(one.name, one.youngs_modulus, one.poissons_ratio, one.density)
                for one in self.materials
            ),
            units=self.mesh.units,
            boundary=self.mesh.boundary,
            free=self.free,
            root=self.root,
            levels=DEFAULT_FRAMES if self.frames is None else self.frames,
            levels_asked=self.frames is not None,
            frames=tuple(
                FrameNodes(
                    one.name,
                    plain_nodes(one.nodes),
                    one.joint if isinstance(one.joint, str) else _tuple(one.joint),
                    one.parent,
                    tuple(one.rotation_points or ()),
                )
                for one in self.frame
            ),
            branches=tuple(BranchJoints(one.toward, tuple(one.joints)) for one in self.branch),
            cuts=tuple(one.nodes for one in self.cuts),
            find_cuts=self.cut == "auto",
            may_cut=self.open_to_cuts,
            stress=tuple(StressElements(one.name, one.elements) for one in self.stress),
            basis=BasisOptions(
                self.reduction.basis,
                self.reduction.numbers,
                self.reduction.counted,
                tuple(self.residual_columns()) if isinstance(residual, list) else residual,
            ),
            membrane=self.reduction.membrane,
            variant=self.variant,
            stored=self.stored,
            acceleration=self.input.acceleration,
            surface=self.output.surface,
            surface_stress=self.output.stress,
        )

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
        listed = self.residual
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


def plain_nodes(nodes: Nodes) -> PlainNodes:
    """Nodes of a body file as plain data."""
    if isinstance(nodes, str):
        return nodes
    if isinstance(nodes, list):
        return tuple(one if isinstance(one, str) else one.plain for one in nodes)
    return nodes.plain


def _tuple(values: list[float] | None) -> tuple[float, ...] | None:
    return None if values is None else tuple(values)


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
    body = validated(BodyFile, data, BodyFileError, "docs/reference/body-file.md", path)
    mesh = body.mesh.model_copy(update={"file": path.parent / body.mesh.file})
    return body.model_copy(update={"mesh": mesh})
