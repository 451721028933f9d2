"""Tables of the body file (TOML), each with its keys, checked. The page of keys is made from what stands here."""

from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from ..files.basics import MOST_MODES, OptionError, UnitSystem
from ..files.toml_files import Axes, Name, NotNegative, Positive, Share, Table, Vector, ascending
from ..model.methods import DEFAULT, Mass, Method, Variant
from ..reduction.options import Basis

OF_MESH = "length in the mesh's units"
"""Marks keys that are in m as plain data."""
Firm = Annotated[list[NotNegative], Field(min_length=3, max_length=3)]
ModeNumber = Annotated[int, Field(ge=1, le=MOST_MODES)]
_ASCENDING_MODES = ascending("numbers of modes, such as [1, 3, 5]")


class MeshUnits(Table):
    """`[mesh]` of a mesh in memory.

    Attributes
    ----------
    units
        [Units](../file-formats.md#units) of the mesh and of `[material]`.
    boundary
        Use the boundary conditions of the mesh file as supports.
    """

    units: UnitSystem = Field(default=UnitSystem.SI, strict=False)
    boundary: bool = True


class MeshTable(MeshUnits):
    """`[mesh]`: where the mesh is and in which units.

    Attributes
    ----------
    file
        Deck (`.inp`) or another [mesh file](../file-formats.md#mesh).
    timeout
        s that the reader of another mesh file may take. Default: 60, and 10 for each MB
    """

    file: Path = Field(strict=False, examples=["arm.inp"])

    @field_validator("file")
    @classmethod
    def _no_escapes(cls, value: Path) -> Path:
        if not str(value).isprintable():
            raise ValueError(f"is {str(value)!r}: a backslash in double quotes is an escape; write / or single quotes")
        return value

    timeout: float | None = Field(default=None, gt=0.0)


class ShellTable(Table):
    """`[[shell]]`: triangles and quads of a mesh file without sections that are shells.

    Attributes
    ----------
    elements
        Their set in the file. Default: all, where it holds no solids
    thickness
        In the mesh's units.
    offset
        Middle of the shell over the nodes along the normal, over the thickness: 0.5 puts the lower face on them.
    """

    elements: str = Field(default="", examples=["WEB"])
    thickness: float = Field(gt=0.0, examples=[2.0])
    offset: float = 0.0


class MaterialTable(Table):
    """`[material]`: constants that the mesh file lacks, or that replace those of one of its materials.

    Attributes
    ----------
    name
        Material in the mesh file to override, or element set to give one. Repeat as `[[material]]` for several.
    youngs_modulus, poissons_ratio, density
        Used for elements without a material and for materials without a density.
    """

    name: str | None = Field(default=None, examples=["STEEL"])
    youngs_modulus: float | None = Field(default=None, gt=0.0)
    poissons_ratio: float | None = Field(default=None, gt=-1.0, lt=0.5)
    density: float | None = Field(default=None, gt=0.0)

    @model_validator(mode="after")
    def _tells_something(self) -> "MaterialTable":
        if self.youngs_modulus is None and self.poissons_ratio is None and self.density is None:
            raise ValueError("tells nothing: give youngs_modulus, poissons_ratio or density, or all of them")
        return self


class PlaceTable(Table):
    """`nodes = { … }`: nodes by place, in the mesh's units. They meet every condition that is given.

    Attributes
    ----------
    set
        Nodes of this set.
    numbers
        Nodes with these numbers.
    plane, normal
        Nodes on the plane through a point, with its normal.
    box
        Nodes between two opposite corners.
    cylinder, radius
        Nodes on the cylinder about the line between two points: a bore.
    patch, radius
        Nodes of the surface within the radius about a point.
    nearest
        The node nearest to a point.
    tolerance
        Largest distance from plane, box, cylinder or patch. Default: 10⁻⁴ of the body's longest side
    """

    set: str | None = None
    numbers: Annotated[list[int], Field(min_length=1)] | None = None
    plane: Annotated[Vector | None, OF_MESH] = None
    normal: Vector | None = None
    box: Annotated[Annotated[list[Vector], Field(min_length=2, max_length=2)] | None, OF_MESH] = None
    cylinder: Annotated[Annotated[list[Vector], Field(min_length=2, max_length=2)] | None, OF_MESH] = None
    patch: Annotated[Vector | None, OF_MESH] = None
    radius: Annotated[float | None, OF_MESH] = Field(default=None, gt=0.0)
    nearest: Annotated[Vector | None, OF_MESH] = None
    tolerance: Annotated[float | None, OF_MESH] = Field(default=None, gt=0.0)

    @model_validator(mode="after")
    def _complete(self) -> "PlaceTable":
        chosen = (self.set, self.numbers, self.plane, self.box, self.cylinder, self.patch, self.nearest)
        if all(one is None for one in chosen):
            raise ValueError("names no place: give set, numbers, plane, box, cylinder, patch or nearest")
        if (self.plane is None) != (self.normal is None) or (self.normal is not None and not any(self.normal)):
            raise ValueError("plane is a point of it and goes with normal = [x, y, z], not zero")
        if self.radius is None and (self.cylinder is not None or self.patch is not None):
            raise ValueError("cylinder (two points of its axis) and patch (a point) go with radius")
        if self.cylinder is not None and self.cylinder[0] == self.cylinder[1]:
            raise ValueError("cylinder is given by two equal points of its axis, expected both its ends")
        return self


Nodes = str | PlaceTable | list[str | PlaceTable]


class SupportTable(Table):
    """`[[support]]`: translations held at zero, or springs to the ground.

    Attributes
    ----------
    nodes
        Node set or [place](#places).
    fix
        Directions that are held: of `"x"`, `"y"`, `"z"`.
    stiffness
        Springs to the ground instead: `[kx, ky, kz]` in N/m, divided equally among the nodes.
    rotational_stiffness
        Makes a bushing, N m/rad: it acts on the nodes' mean displacement and rotation.
    damping
        Dampers beside the springs: `[cx, cy, cz]` in N s/m, divided likewise.
    rotational_damping
        Of a bushing, N m s/rad.
    axes
        Bushing's x, and a vector in the plane of its x and y. Default: global
    """

    nodes: Nodes = Field(examples=["CLAMP"])
    fix: list[Literal["x", "y", "z"]] = Field(default=[], examples=[["x", "y", "z"]])
    stiffness: Firm | None = Field(default=None, examples=[[1e6, 1e6, 1e6]])
    rotational_stiffness: Firm | None = Field(default=None, examples=[[100.0, 100.0, 0.0]])
    damping: Firm | None = Field(default=None, examples=[[1e3, 1e3, 1e3]])
    rotational_damping: Firm | None = Field(default=None, examples=[[0.1, 0.1, 0.1]])
    axes: Axes | None = Field(default=None, examples=[[[0, 1, 0], [0, 0, 1]]])

    @model_validator(mode="after")
    def _holds_something(self) -> "SupportTable":
        turning, dampers = self.rotational_stiffness, (*(self.damping or ()), *(self.rotational_damping or ()))
        bushing = turning is not None or self.rotational_damping is not None
        if not self.fix and not any((*(self.stiffness or ()), *(turning or ()), *dampers)):
            raise ValueError('holds nothing: give fix = ["x", "y", "z"], or stiffness = [kx, ky, kz] in N/m')
        if self.axes is not None and not bushing:
            raise ValueError("has axes, which take rotational_stiffness = [kx, ky, kz] in N m/rad, zeros if need be")
        if self.fix and bushing:
            raise ValueError("both fixes directions and is a bushing (rotational_stiffness), expected one of the two")
        for kind, values in (("spring of {} N/m", self.stiffness), ("damper of {} N s/m", self.damping)):
            for axis, value in zip(("x", "y", "z"), values or (), strict=False):
                if axis in self.fix and value > 0.0:
                    found = f"both fixes {axis} and puts a {kind.format(value)} along it"
                    raise ValueError(f"{found}, expected one of them")
        return self


class InterfaceTable(Table):
    """`[[interface]]`: where loads act and motion is measured.

    Attributes
    ----------
    name
        Name in the FMU's variables.
    nodes
        Node set or [place](#places). To a line or point the nodes of its elements are added.
    point
        Reference point, in the mesh's units. Default: weighted centre
    weights
        `"area"` weighs nodes by element faces, also inside the body; `"node"` equally; `"auto"` by area where possible.
    rigid
        Its nodes move as one rigid body. Default: as the mesh file says of a coupling
    compliance
        Offer the compliance over a step to masters that iterate.
    follows
        Force and moment turn with the interface; for methods with frames. Their axes are global while it is undeformed.
    """

    name: Name = Field(examples=["tip"])
    nodes: Nodes = Field(examples=["FLANGE"])
    point: Annotated[Vector | None, OF_MESH] = Field(default=None, examples=[[0.0, 0.0, 0.0]])
    weights: Literal["auto", "area", "node"] = "auto"
    rigid: bool | None = Field(default=None, examples=[True])
    compliance: bool = False
    follows: bool = False


class FrameTable(Table):
    """`[[frame]]`: a sub-domain with a frame of its own, in place of `frames = n`.

    Attributes
    ----------
    name
        Name of the frame.
    nodes
        Nodes of the sub-domain's elements. Neighbours have the nodes of their section in common.
    parent
        Frame that it hangs on. Default: none, a root
    joint
        Node set or point where it hangs on its parent. Default: common nodes; at a root those with supports
    rotation_points
        Average the rotation by one node set (chord from the joint) or three (tetrahedron). Default: mean of ½ curl u
    """

    name: Name
    nodes: Nodes
    joint: Annotated[str | Vector | None, OF_MESH] = None
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
    """`[[branch]]`: distances at which frames meet on the way to one place, in place of `frames = n`.

    Attributes
    ----------
    toward
        Interface, or `nodes` of a `[[cut]]`, at the end of the way. Other branches get no joints.
    joints
        Distances from the supports, in the mesh's units, ascending, measured from node to node.
    """

    toward: str
    joints: Annotated[list[Positive], OF_MESH, ascending("distances from the supports, such as [0.2, 0.5]")] = Field(
        min_length=1
    )


class CutTable(Table):
    """`[[cut]]`: a section at which the body is cut into parts, joined again by stiff springs.

    Attributes
    ----------
    nodes
        Section of whole element faces through a closed loop. Each part needs a support; a frame belongs to one part.
    """

    nodes: str


class StressTable(Table):
    """`[[stress]]`: a part of the body whose largest von Mises stress is an output.

    Attributes
    ----------
    name
        Name in the FMU's variables.
    elements
        Element set.
    """

    name: Name
    elements: str


class ReductionTable(Table):
    """`[reduction]`: the modal basis, and what is stored for other methods.

    Attributes
    ----------
    basis
        `"normal"`: eigenmodes; `"craig_bampton"`: fixed-interface modes and six constraint modes an interface.
    modes
        Number of normal modes, or a list of their numbers. Of a cut body: in each part.
        Default: 8, fewer of a coarse mesh, and the ninth where it is one of a pair with the eighth; as many as damping
        ratios are listed
    residual_flexibility
        Add static shapes of interface loads: `true` (up to six an interface), or a list such as `["tip.force.y"]`.
        Default: as many as bring every load within 0.5 %, and up to six of second and third order;
        none where modes or damping ratios are listed one by one
    geometric_stiffness
        Store `"by_load"`, `"by_mode"`, or both. Default: as the method needs
    inertia
        Store the lumps that `mass = "configuration"` needs. Default: as the method needs
    second_order
        Store second derivatives: 6 m² numbers a frame, interface and centre of mass. Default: as the method needs
    membrane
        Store the energy of bending that stretches the body or flattens its sections. `"auto"`: where it matters.
    """

    basis: Basis = Field(default=Basis.NORMAL, strict=False)
    modes: ModeNumber | Annotated[list[ModeNumber], Field(min_length=1), _ASCENDING_MODES] = 8
    residual_flexibility: bool | Annotated[list[str], Field(min_length=1)] | None = None
    geometric_stiffness: list[Literal["by_load", "by_mode"]] | None = None
    inertia: bool | None = None
    second_order: bool | None = None
    membrane: bool | Literal["auto"] = "auto"

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of the normal modes that are kept, in order of frequency, from 1."""
        return tuple(self.modes) if isinstance(self.modes, list) else tuple(range(1, self.modes + 1))

    @property
    def counted(self) -> bool:
        """Whether the file says how many modes it wants: else a coarse mesh may have fewer."""
        return "modes" in self.model_fields_set


class DampingTable(Table):
    """`[damping]`: modal damping.

    Attributes
    ----------
    ratio
        Damping ratio, 0 to 1: a number, or one per mode.
    measured
        Ratios from test instead: `[frequency in Hz, ratio]`, ascending. Linear between them, and constant beyond.
    """

    ratio: Share | list[Share] = Field(default=0.0, examples=[0.01])
    measured: list[Annotated[list[float], Field(min_length=2, max_length=2)]] = Field(
        default=[], examples=[[[54.6, 0.012], [210.0, 0.008]]]
    )

    @model_validator(mode="after")
    def _one_of_both(self) -> "DampingTable":
        frequencies, ratios = [one[0] for one in self.measured], [one[1] for one in self.measured]
        if self.measured and self.ratio != 0.0:
            raise ValueError("gives ratio and measured, expected one of the two")
        ascend = all(0.0 <= a < b for a, b in pairwise([*frequencies, float("inf")]))
        if not ascend or any(not 0.0 <= one <= 1.0 for one in ratios):
            raise ValueError(f"measured is {self.measured}, expected [Hz from 0, ratio 0 to 1], frequencies ascending")
        return self


class FormulationTable(Table):
    """`[formulation]`: the method that the FMU starts with.

    Attributes
    ----------
    method
        [Method](../methods.md).
        Default: `"second_order"`; where that is impossible `"frames"`; with `frames = 0` `"linear"`
    mass
        `"constant"`: of the undeformed body; `"configuration"`: of the deformed one; `"polynomial"`: to second order.
        Default: `"polynomial"` (`"configuration"` where that ends too soon) with `"second_order"` in one piece; else
        `"constant"`
    """

    method: Method | None = Field(default=None, strict=False)
    mass: Mass | None = Field(default=None, strict=False)

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
        usual = Method.SECOND_ORDER if self.mass is Mass.POLYNOMIAL else DEFAULT
        return Variant(self.method or usual, self.mass or Mass.CONSTANT)


class InputTable(Table):
    """`[input]`: further inputs.

    Attributes
    ----------
    acceleration
        Inputs for the acceleration of the supports, weight included.
    """

    acceleration: bool = False


class OutputTable(Table):
    """`[output]`: further outputs, and what pictures need.

    Attributes
    ----------
    velocities
        Outputs for velocities and angular velocities.
    surface
        Store the surface's mode shapes for [pictures](../view.md). They grow with the mesh.
    stress
        Store the stress of the surface's points as well.
    error
        Tell the error of the motion: the body is reduced once more, finer.
    tolerance
        Relative error above which the FMU warns: the limits of `watch.error`, `watch.truncation`,
        `watch.inertia_missed`, `watch.steps_missed` and `watch.softness_missed` start with it. Default: theirs, 0.01
    """

    velocities: bool = False
    surface: bool = True
    stress: bool = False
    error: bool = True
    tolerance: float | None = Field(default=None, gt=0.0, lt=1.0)

    @model_validator(mode="after")
    def _stress_on_the_surface(self) -> "OutputTable":
        if self.stress and not self.surface:
            raise ValueError("stress is stored for the surface: take surface = false out, or stress = true")
        return self
