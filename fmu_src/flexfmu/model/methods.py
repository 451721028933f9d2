"""The methods: what a user chooses, what each is made of, and which data it needs."""

from dataclasses import dataclass
from enum import Enum
from typing import TypeVar

from ..files.basics import OptionError


class Method(Enum):
    """How a body's motion follows from its modes; one row each of docs/methods.md."""

    LINEAR = "linear"
    """Modal superposition, equation (1)."""
    STIFFNESS_BY_LOAD = "stiffness_by_load"
    """Modal superposition with the geometric stiffness of each load's linear stress (the source's section 3)."""
    STIFFNESS_BY_MODE = "stiffness_by_mode"
    """The same with that of each mode's."""
    MODAL_ROTATION = "modal_rotation"
    """The source's section 4 as printed: displacements of each sub-domain by itself turned by its averaged rotation,
    and the moment (3) of displaced forces."""
    HALF_ROTATION = "half_rotation"
    """The same turned by half the rotation, onto the chord of the arc, in a tree."""
    FLOATING_FRAME = "floating_frame"
    """One frame for the whole body, loads on the deformed body."""
    FRAMES = "frames"
    """A tree of frames, loads on the deformed body."""
    FRAMES_STIFFNESS = "frames_stiffness"
    """The same with the geometric stiffness of each load that frames leave out."""
    SECOND_ORDER = "second_order"
    """A tree of frames, and what motions within frames lack at second order."""

    @property
    def label(self) -> str:
        """Its name as words."""
        return self.value.replace("_", " ")


class Mass(Enum):
    """Whose inertia the body has."""

    CONSTANT = "constant"
    """That of the undeformed body: ΦᵀMΦ = I."""
    CONFIGURATION = "configuration"
    """That of the deformed body, M(q) = JᵀMJ with J the kinematics' derivative; of "frames" and "second_order"."""
    POLYNOMIAL = "polynomial"
    """The same to second order in the coordinates; of "second_order", for held bodies in one piece."""


DEFAULT = Method.FRAMES
"""What needs no data besides frames: of bodies that are made without a body file."""


# How displacements follow from modal coordinates. LINEAR: modal superposition alone, (1). LITERAL: from a sub-domain's
# joint turned by its averaged rotation, as the words of the paper have it. SECANT: turned by half of that, onto the
# chord of the arc. COROTATED: the tree of corotated frames. SECOND_ORDER: the same, with what motions
# within frames lack then.
Kinematics = Enum("Kinematics", "LINEAR LITERAL SECANT COROTATED SECOND_ORDER")
# Where loads act: on the undeformed body; there, with the moment u × F of the paper's equation (3); on the deformed
# body, by the transpose of the kinematics' derivative.
LoadPlacement = Enum("LoadPlacement", "REFERENCE CORRECTIVE_MOMENT DEFORMED")
# How stress changes stiffness: not at all, Λ; by geometric stiffness of the linear stress of the loads, Σ f_l K_l; by
# that of the stress of the modal coordinates, Σ q_j K_j.
Stiffness = Enum("Stiffness", "CONSTANT BY_LOAD BY_MODE")
# How frames hang together: each on its parent, roots on the ground; each by itself, about the linear displacement of
# its joint; one for the whole body.
FrameLayout = Enum("FrameLayout", "TREE SEPARATE ONE")
_Choice = TypeVar("_Choice", Method, Mass)


class Data(Enum):
    """What a body holds for some methods only: attribute of `ReducedBody`, key of `[reduction]` that asks for it."""

    BY_LOAD = "stiffness_by_load", 'geometric_stiffness = ["by_load"]'
    BY_MODE = "stiffness_by_mode", 'geometric_stiffness = ["by_mode"]'
    INERTIA = "inertia", "inertia = true"
    SECOND_ORDER = "second", "second_order = true"

    def __init__(self, attribute: str, key: str):
        self.attribute, self.key = attribute, key


@dataclass(frozen=True, slots=True)
class Recipe:
    """What a method is made of: for the modules that make programs of it.

    Attributes
    ----------
    kinematics : Kinematics
    loads : LoadPlacement
    stiffness : Stiffness
    layout : FrameLayout
    """

    kinematics: Kinematics
    loads: LoadPlacement
    stiffness: Stiffness = Stiffness.CONSTANT
    layout: FrameLayout = FrameLayout.TREE


_RECIPES = {
    Method.LINEAR: Recipe(Kinematics.LINEAR, LoadPlacement.REFERENCE),
    Method.STIFFNESS_BY_LOAD: Recipe(Kinematics.LINEAR, LoadPlacement.REFERENCE, Stiffness.BY_LOAD),
    Method.STIFFNESS_BY_MODE: Recipe(Kinematics.LINEAR, LoadPlacement.REFERENCE, Stiffness.BY_MODE),
    Method.MODAL_ROTATION: Recipe(Kinematics.LITERAL, LoadPlacement.CORRECTIVE_MOMENT, layout=FrameLayout.SEPARATE),
    Method.HALF_ROTATION: Recipe(Kinematics.SECANT, LoadPlacement.CORRECTIVE_MOMENT),
    Method.FLOATING_FRAME: Recipe(Kinematics.COROTATED, LoadPlacement.DEFORMED, layout=FrameLayout.ONE),
    Method.FRAMES: Recipe(Kinematics.COROTATED, LoadPlacement.DEFORMED),
    Method.FRAMES_STIFFNESS: Recipe(Kinematics.COROTATED, LoadPlacement.DEFORMED, Stiffness.BY_LOAD),
    Method.SECOND_ORDER: Recipe(Kinematics.SECOND_ORDER, LoadPlacement.DEFORMED),
}


@dataclass(frozen=True, slots=True, order=False)
class Variant:
    """A method, and the mass with it.

    Attributes
    ----------
    method : Method
    mass : Mass

    Raises
    ------
    OptionError
        The deformed body's mass with a method that does not know it.
    """

    method: Method
    mass: Mass = Mass.CONSTANT

    def __post_init__(self) -> None:
        """Refuse a mass that the method does not know."""
        if self.mass not in masses_of(self.method):
            known = " and ".join(f'"{method.value}"' for method in Method if self.mass in masses_of(method))
            raise OptionError(
                f'mass "{self.mass.value}" goes with methods {known} only, not with "{self.method.value}": only there '
                f'the motion of every point of the body is known; take one of these, or mass "{Mass.CONSTANT.value}"'
            )

    @property
    def words(self) -> str:
        """The method's name, and the mass where it is not the usual one."""
        return self.method.value + ("" if self.mass is Mass.CONSTANT else f", mass {self.mass.value}")


def recipe_of(method: Method) -> Recipe:
    """What a method is made of."""
    return _RECIPES[method]


def masses_of(method: Method) -> tuple[Mass, ...]:
    """Masses that a method can have, the usual one first."""
    if method is Method.SECOND_ORDER:
        return tuple(Mass)
    return (Mass.CONSTANT, Mass.CONFIGURATION) if method is Method.FRAMES else (Mass.CONSTANT,)


def named(kind: type[_Choice], value: _Choice | str) -> _Choice:
    """A method or a mass by itself or by its name.

    Parameters
    ----------
    kind : type
        `Method` or `Mass`.
    value : Method, Mass or str

    Returns
    -------
    Method or Mass

    Raises
    ------
    OptionError
        There is none of this name.
    """
    try:
        return kind(value)
    except ValueError:
        names = ", ".join(choice.value for choice in kind)
        raise OptionError(f"{kind.__name__.lower()} is {value!r}, expected one of {names}") from None


def has_frames(method: Method) -> bool:
    """Whether a method moves the body by frames."""
    return _RECIPES[method].kinematics is not Kinematics.LINEAR


def needs(method: Method, mass: Mass = Mass.CONSTANT) -> frozenset[Data]:
    """Data that a method needs besides modes, interfaces and frames.

    Parameters
    ----------
    method : Method
    mass : Mass

    Returns
    -------
    frozenset of Data
    """
    row = _RECIPES[method]
    found = {
        Data.BY_LOAD: row.stiffness is Stiffness.BY_LOAD,
        Data.BY_MODE: row.stiffness is Stiffness.BY_MODE,
        Data.INERTIA: mass is Mass.CONFIGURATION,
        Data.SECOND_ORDER: row.kinematics is Kinematics.SECOND_ORDER,
    }
    return frozenset(data for data, wanted in found.items() if wanted)


def conflict(variant: Variant, free: bool, cut: bool) -> str | None:
    """Why a kind of body cannot be built for a method; None where it can.

    Parameters
    ----------
    variant : Variant
    free : bool
        Whether nothing holds the body.
    cut : bool
        Whether it has `[[cut]]` tables.

    Returns
    -------
    str or None
    """
    name, needed = variant.method.value, needs(variant.method, variant.mass)
    if free and Data.BY_LOAD in needed:
        found = f'method "{name}" needs the stress of each load by itself, and a free body has none'
        return f'{found}: what balances the load is not known before; take "{Method.SECOND_ORDER.value}"'
    if cut and needed & {Data.BY_LOAD, Data.BY_MODE}:
        return f'[[cut]] goes without geometric stiffness, which method "{name}" needs: it knows bodies in one piece'
    if cut and variant.mass is not Mass.CONSTANT:
        return '[[cut]] goes with mass "constant" only'
    if cut and _RECIPES[variant.method].layout is FrameLayout.ONE:
        return f'[[cut]] gives each part frames of its own: it does not go with method "{name}"'
    return None
