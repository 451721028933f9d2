"""The reduced body: what is left of the finite element model once modes, interfaces and frames are known."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ..files.basics import FloatArray, IntArray, ModalFileError
from .arrays import ARRAYS, in_single, settle
from .inertia import LumpedMass, MassPolynomial, Membrane
from .methods import DEFAULT, Mass, Method, masses_of

# Steps per period of the lowest mode: smooth curves without waste.
_STEPS_PER_PERIOD = 40
# rad/s: a vibration of two centuries, and one far beyond any mesh; their squares are numbers.
_SLOWEST, _FASTEST = 1e-9, 1e15

GROUND = -1
"""Parent of a root frame, and frame of an interface that no frame carries."""


@dataclass(frozen=True, slots=True)
class Surface:
    """The body's outer faces, for viewing only; kept in single precision.

    Attributes
    ----------
    points : (n_points, 3) float
        Undeformed corner nodes, m, global frame.
    faces : (n_faces, 4) int
        Rows of `points`, outward; a triangle repeats its last corner.
    modes : (n_points, 3, m) float
        Mode shapes, kg^-1/2.
    frame : (n_points,) int
        The frame that carries each point, or `GROUND`.
    interface : (n_points,) int or None
        The interface whose node set holds the point, or −1.
    support : (n_points,) int or None
        1 where a support holds the point, else 0.
    second : (n_points, 3, r) float or None
    form : (r, m, m) float or None
        What goes with q at second order, ½ Σ second_r (qᵀ form_r q), as `SecondOrder` has it of the tree's nodes.
    turn : (g, 3, m) float or None
    pivot : (g, 3) float or None
        Rotations about points by which that is to be turned back to the ground, of bodies or parts that can turn.
    piece : (n_points,) int or None
        Which of these each point takes part in.
    stress : (n_points, 6, m) float or None
        As `StressSet.stress`.
    """

    points: FloatArray
    faces: IntArray
    modes: FloatArray
    frame: IntArray
    interface: IntArray | None = None
    support: IntArray | None = None
    second: FloatArray | None = None
    form: FloatArray | None = None
    turn: FloatArray | None = None
    pivot: FloatArray | None = None
    piece: IntArray | None = None
    stress: FloatArray | None = None

    def in_coordinates(self, turn: FloatArray) -> "Surface":
        """The surface with q = turn z, (m, k), in the coordinates z."""
        form = self.form
        return replace(
            self,
            modes=self.modes @ turn,
            form=None if form is None else np.einsum("rab,ac,bd->rcd", form, turn, turn, optimize=True),
            turn=None if self.turn is None else self.turn @ turn,
            stress=None if self.stress is None else self.stress @ turn,
        )


@dataclass(frozen=True, slots=True)
class WholeFrame:
    """A frame for the whole body, to be compared with the tree.

    Attributes
    ----------
    joint_point : (3,) float
        Centre of the supports, m.
    joint_displacement, joint_rotation, frame_rotation : (3, m) float
        As of the frames of the tree.
    """

    joint_point: FloatArray
    joint_displacement: FloatArray
    joint_rotation: FloatArray
    frame_rotation: FloatArray


@dataclass(frozen=True, slots=True)
class Masses:
    """Mass of each sub-domain at its centre: all that a uniform acceleration knows of the body.

    Attributes
    ----------
    mass : (P,) float
        kg.
    point : (P, 3) float
        Centres of mass, m.
    displacement : (P, 3, m) float
        Displacement of the centres per unit modal coordinate, kg^-1/2.
    frame : (P,) int
        The frame that carries each, or `GROUND`.
    """

    mass: FloatArray
    point: FloatArray
    displacement: FloatArray
    frame: IntArray


@dataclass(frozen=True, slots=True)
class Ties:
    """Springs that join two sections of the body, or one to the ground, wherever frames carry them.

    The modes hold them linearly.

    Attributes
    ----------
    frame : (T, 2) int
        The frames that carry the ends; `GROUND` for an end that does not move.
    point : (T, 2, 3) float
        Centres of the sections, m.
    displacement, rotation : (T, 2, 3, m) float
        The rigid fits of the sections; zero on the ground.
    stiffness : (T, 3) float
        Along the global axes, N/m; the same along all between two sections that both turn.
    lever : (T, 3, 3) float
        In its columns three points about the centre at which springs of this stiffness resist tilting, m.
    """

    frame: IntArray
    point: FloatArray
    displacement: FloatArray
    rotation: FloatArray
    stiffness: FloatArray
    lever: FloatArray

    @property
    def joins(self) -> bool:
        """Whether any joins two sections."""
        return bool(np.any(self.frame[:, 1] != GROUND))


@dataclass(frozen=True, slots=True)
class SecondOrder:
    """Motions at second order in q, docs/theory.md equation (18).

    Seen from the floating frame of a body that has one, else from the ground. One row for each node of the tree: frames
    (their joints), interfaces, centres of mass, ends a of all ties, ends b.

    Attributes
    ----------
    displacement, rotation : (K, 3, m, m) float
        Second derivatives of displacements and of rotation vectors, m/(kg m²) and rad/(kg m²); symmetric.
    """

    displacement: FloatArray
    rotation: FloatArray


@dataclass(frozen=True, slots=True)
class StressSet:
    """Modal stress at points of a named part of the body.

    Attributes
    ----------
    name : str
    point : (P, 3) float
        Undeformed places, m.
    stress : (P, 6, m) float
        xx, yy, zz, xy, yz, zx per unit modal coordinate, N/m²/(kg^1/2 m), in axes that turn with the material.
    """

    name: str
    point: FloatArray
    stress: FloatArray


@dataclass(frozen=True, slots=True)
class Properties:
    """What the body is made of, and how large it is, of K materials: nothing is computed from it.

    Attributes
    ----------
    box : (2, 3) float
        Smallest and largest coordinates of the undeformed body, m.
    material_names : tuple of str
    volume, youngs_modulus, poissons_ratio, density : (K,) float
        Of each material; m³, N/m², 1 and kg/m³.
    point_mass, spring : (P,) float or None, (3,) float or None
        Masses at points, kg; all springs to the ground, N/m.
    support_names, support_point, support_spring : tuple of str, (k, 3) float and (k,) int, or None
        Where the supports are, m, and 1 where one is of springs.
    """

    box: FloatArray
    material_names: tuple[str, ...]
    volume: FloatArray
    youngs_modulus: FloatArray
    poissons_ratio: FloatArray
    density: FloatArray
    point_mass: FloatArray | None = None
    spring: FloatArray | None = None
    support_names: tuple[str, ...] = ()
    support_point: FloatArray | None = None
    support_spring: IntArray | None = None

    @property
    def mass(self) -> float:
        """Of the whole body, kg."""
        return float(self.volume @ self.density) + (0.0 if self.point_mass is None else float(self.point_mass.sum()))


@dataclass(frozen=True, slots=True, repr=False)
class ReducedBody:
    """A flexible body in m modal coordinates with I interfaces and S frames.

    Everything is linear in the modal coordinates q (kg^1/2 m): a displacement is `displacement @ q` (m), a small
    rotation `rotation @ q` (rad), both in the global frame. Arrays are made read-only.

    Attributes
    ----------
    name : str
    angular_frequency : (m,) float
        ω, rad/s, ascending; zero for the rigid motions of a body that can move freely.
    damping_ratio : (m,) float
        Modal damping ratios ζ, not negative.
    interface_names : tuple of str
    interface_point : (I, 3) float
        Reference points P_i, m.
    interface_displacement, interface_rotation : (I, 3, m) float
        The rigid fit of each interface's node set.
    interface_frame : (I,) int
        The frame that carries each interface, or `GROUND`.
    frame_names : tuple of str
    frame_parent : (S,) int
        Parents stand before their children; `GROUND` for a root.
    joint_point : (S, 3) float
        Where the frame hangs on its parent, X_s, m.
    joint_displacement : (S, 3, m) float
    joint_rotation : (S, 3, m) float
        Rotation of the joint's section; used only to tell how much a frame's own material turns in it.
    frame_rotation : (S, 3, m) float
        Averaged rotation Θ_s of the sub-domain.
    whole : WholeFrame or None
        Of bodies with several frames.
    masses : Masses or None
        Where the body's mass is, for accelerations of its supports.
    stress_sets : tuple of StressSet
    stiffness_by_load : (6I or 6I + 3, m, m) float or None
        Reduced geometric stiffness of each unit load: forces of all interfaces, then moments, then, of a body with
        masses, accelerations of the supports; 1/(s² N), 1/(s² N m), 1/m.
    stiffness_by_mode : (m, m, m) float or None
        Reduced geometric stiffness of each unit modal coordinate, 1/(s² kg^1/2 m).
    watched_frame, watched_rotation, watched_strain, frequency_spread, damper : arrays or None
        (w,), (w, 3, m), (v, 6, m): frames and rotations of watched elements, strain of each material in each frame;
        (m,): `modes.frequency_spread`; (d, m): rows D of the damping DᵀD beside ratios, s^-1/2.
    method : Method
        The one that the body file asks for; another may be chosen when the body is used.
    mass : Mass
        The same of the mass.
    velocity_outputs : bool
        Whether the FMU offers velocities and angular velocities.
    compliance_interfaces : tuple of str
        Interfaces whose compliance the FMU offers.
    following_interfaces : tuple of str
        Interfaces whose forces and moments turn with them: given on the axes of the undeformed body, carried along.
    tolerance : float or None
        Relative error of displacements above which the FMU warns; None: its default.
    mass_modes : int
        How many of the first coordinates the mass of lumps knows of, where more than the slow ones count.
    root_interface : int
        Of a free body whose basis holds the constraint modes of its interfaces: the one that the tree of frames hangs
        on when it is fixed. Else `GROUND`.
    floating : bool
        Whether frame 0 is the floating frame of a body that nothing holds.
    provenance : dict of str to str
        Where the body comes from: input hashes and versions.
    surface : Surface or None
    inertia, polynomial, ties : LumpedMass, MassPolynomial and Ties, or None
        What the mass of the deformed body is made of, that to second order, and what joins the parts of a cut body.
    second, membrane : SecondOrder and Membrane, or None
        What method "second_order" needs, and has beside it of bodies that stretch when they bend.
    properties : Properties or None
        Mass, size and materials, for people; files from before it was kept do not have it.
    shadow : Shadow or None
        What tells the error of the body's motion.
    """

    name: str
    angular_frequency: FloatArray
    damping_ratio: FloatArray
    interface_names: tuple[str, ...]
    interface_point: FloatArray
    interface_displacement: FloatArray
    interface_rotation: FloatArray
    interface_frame: IntArray
    frame_names: tuple[str, ...] = ()
    frame_parent: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    joint_point: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    joint_displacement: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 0)))
    joint_rotation: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 0)))
    frame_rotation: FloatArray = field(default_factory=lambda: np.zeros((0, 3, 0)))
    whole: WholeFrame | None = None
    masses: Masses | None = None
    stress_sets: tuple[StressSet, ...] = ()
    stiffness_by_load: FloatArray | None = None
    stiffness_by_mode: FloatArray | None = None
    watched_frame: IntArray | None = None
    watched_rotation: FloatArray | None = None
    watched_strain: FloatArray | None = None
    frequency_spread: FloatArray | None = None
    damper: FloatArray | None = None
    method: Method = DEFAULT
    mass: Mass = Mass.CONSTANT
    velocity_outputs: bool = False
    compliance_interfaces: tuple[str, ...] = ()
    following_interfaces: tuple[str, ...] = ()
    tolerance: float | None = None
    mass_modes: int = 0
    root_interface: int = GROUND
    floating: bool = False
    provenance: dict[str, str] = field(default_factory=dict)
    surface: Surface | None = None
    inertia: LumpedMass | None = None
    polynomial: MassPolynomial | None = None
    ties: Ties | None = None
    second: SecondOrder | None = None
    membrane: Membrane | None = None
    properties: Properties | None = None
    shadow: "Shadow | None" = None

    def __post_init__(self) -> None:
        """Bring the arrays into their types and check shapes and physics."""
        sizes = {"m": np.size(self.angular_frequency), "I": len(self.interface_names), "S": len(self.frame_names)}
        sizes["L"] = 6 * sizes["I"] + (0 if self.masses is None else 3)
        sizes["K"] = sizes["S"] + sizes["I"] + (0 if self.masses is None else np.size(self.masses.mass))
        sizes["K"] += 0 if self.ties is None else 2 * len(self.ties.stiffness)
        settle(self, ARRAYS["body"], sizes)
        for part in GROUPS:
            value = getattr(self, part)
            if value is not None:
                settle(value, ARRAYS[part], sizes, part)
        for stresses in self.stress_sets:
            settle(stresses, ARRAYS["stress"], sizes, f"stress set {stresses.name!r}")
        if self.shadow is not None:
            settle(self.shadow, ARRAYS["shadow"], {"m": sizes["m"], "M": self.shadow.body.mode_count}, "shadow")
        self._check_physics()

    def _check_physics(self) -> None:
        for name, lowest in (("ties", GROUND), ("masses", GROUND), ("surface", GROUND), ("inertia", 0)):
            part = getattr(self, name)
            if part is not None and np.any((part.frame < lowest) | (part.frame >= self.frame_count)):
                other = " of frames, or -1" if lowest < 0 else " of frames"
                raise ModalFileError(f"{name}: frame holds numbers beyond those of the body, expected those{other}")
        if self.ties is not None and np.any(self.ties.stiffness < 0.0):
            raise ModalFileError("ties: stiffness must not be negative")
        if any(not len(stresses.point) for stresses in self.stress_sets):
            raise ModalFileError("a stress set has no points, expected at least one")
        if self.mode_count == 0:
            raise ModalFileError("the body has no modes, expected at least one")
        if np.any(self.angular_frequency < 0.0) or np.any(np.diff(self.angular_frequency) < 0.0):
            raise ModalFileError("angular_frequency must be ascending and not negative")
        if self.angular_frequency[-1] == 0.0:
            raise ModalFileError("the body has rigid motions only, expected at least one elastic mode")
        slowest, fastest = self.angular_frequency[self.rigid_count], self.angular_frequency[-1]
        if slowest < _SLOWEST or fastest > _FASTEST:
            found = f"angular_frequency of elastic modes is {slowest:.3g} to {fastest:.3g} rad/s"
            raise ModalFileError(f"{found}, expected {_SLOWEST:.0e} to {_FASTEST:.0e}")
        if self.mass not in masses_of(self.method):
            raise ModalFileError(f'mass is "{self.mass.value}", which method "{self.method.value}" does not know')
        for kind in ("compliance_interfaces", "following_interfaces"):
            if not set(named := getattr(self, kind)) <= set(self.interface_names):
                raise ModalFileError(f"{kind} are {named}, expected names of interfaces")
        if not GROUND <= self.root_interface < self.interface_count:
            raise ModalFileError("root_interface must name an interface, or be -1")
        if self.shadow is not None and (
            self.shadow.body.interface_names != self.interface_names
            or self.shadow.body.rigid_count != self.rigid_count
            or (self.shadow.body.masses is None) != (self.masses is None)
        ):
            raise ModalFileError("the shadow must have the interfaces, rigid motions and accelerations of the body")
        if self.floating and not self.frame_count:
            raise ModalFileError("a floating body must have its floating frame")
        if np.any(self.damping_ratio < 0.0):
            raise ModalFileError("damping_ratio must not be negative")
        if len(set(self.interface_names)) < len(self.interface_names) or not self.interface_names:
            raise ModalFileError("interface names must be there and differ from each other")
        order = np.arange(self.frame_count)
        if np.any(self.frame_parent >= order) or np.any(self.frame_parent < GROUND):
            raise ModalFileError("frame_parent must name an earlier frame, or -1 for a root")
        if np.any(self.interface_frame >= self.frame_count) or np.any(self.interface_frame < GROUND):
            raise ModalFileError("interface_frame must name a frame, or -1")

    def __repr__(self) -> str:
        """Name and size."""
        size = f"{self.mode_count} modes, {self.frame_count} frames"
        return f"<ReducedBody {self.name!r}: {size}, interfaces {', '.join(self.interface_names)}>"

    @property
    def mode_count(self) -> int:
        """Number of modal coordinates m."""
        return int(self.angular_frequency.size)

    @property
    def rigid_count(self) -> int:
        """Number of rigid motions, which are the first modal coordinates."""
        return int(np.sum(self.angular_frequency == 0.0))

    @property
    def suggested_step(self) -> float:
        """Communication step (s) that resolves the lowest elastic mode, rounded down to 1, 2 or 5 times 10ⁿ."""
        step = 2.0 * math.pi / float(self.angular_frequency[self.rigid_count]) / _STEPS_PER_PERIOD
        power = 10.0 ** math.floor(math.log10(step))
        return float(f"{max(f for f in (1, 2, 5) if f * power <= step * (1 + 1e-12)) * power:.6g}")

    @property
    def frame_count(self) -> int:
        """Number of frames S."""
        return len(self.frame_names)

    @property
    def interface_count(self) -> int:
        """Number of interfaces I."""
        return len(self.interface_names)

    @property
    def extent(self) -> float:
        """Largest side of the box about interfaces and joints, m; one where all are in one place."""
        return float(np.ptp(np.concatenate([self.interface_point, self.joint_point]), axis=0).max()) or 1.0


@dataclass(frozen=True, slots=True, repr=False)
class Shadow:
    """The same body reduced finer, for method "second_order"; docs/theory.md, section 7a.

    Attributes
    ----------
    body : ReducedBody
        Of the same interfaces; what of it is of second order is rounded to single precision: it tells an estimate.
    embedding : (m_S, m) float
        Its coordinates at unit coordinates of the body; columns are orthonormal.
    """

    body: ReducedBody
    embedding: FloatArray

    def __post_init__(self) -> None:
        rounded = {name: in_single(getattr(self.body, name)) for name in ("second", "membrane")}
        object.__setattr__(self, "body", replace(self.body, **rounded))


GROUPS: dict[str, type] = {
    "whole": WholeFrame,
    "masses": Masses,
    "inertia": LumpedMass,
    "polynomial": MassPolynomial,
    "ties": Ties,
    "second": SecondOrder,
    "membrane": Membrane,
    "properties": Properties,
    "surface": Surface,
}
"""What a body may hold besides its own arrays, by its attribute, which names the group of the modal file, too."""
