"""Models of a body that may do for a scene: basis, modes, frames and formulation."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..config import Basis, BodyFile, FormulationTable
from ..mesh.model import IntArray
from ..runtime.errors import OptionError
from ..runtime.reduced_body import (
    Division,
    Formulation,
    Kinematics,
    LoadPlacement,
    Mass,
    ReducedBody,
    SecondOrder,
    Stiffness,
)
from ..runtime.stepping import StepLimits
from .config import BasisChoice
from .records import REDUCED
from .scene import Scene

GIVEN = -1
"""Number of frames that stands for the body's own [[frame]] tables."""

SINGLE, EXACT = math.inf, 0.0
"""Internal steps that have no tolerance: one a communication step, whatever its error; and one that has no error."""
# A tolerance that every step meets; the FMU's parameter has to be finite.
_ANY_ERROR = 1e300


@dataclass(frozen=True, slots=True)
class Reduction:
    """What one reduction of the body serves.

    Attributes
    ----------
    basis : BasisChoice
    modes : int
        Normal modes; interface modes come on top.
    frames : int
        0: none; `GIVEN`: the body's own.
    """

    basis: BasisChoice
    modes: int
    frames: int


@dataclass(frozen=True, slots=True)
class Candidate:
    """A reduction under a formulation, with its internal step.

    Attributes
    ----------
    reduction : Reduction
    formulation : Formulation
    internal_step : float
        Error accepted per step; or `SINGLE`, `EXACT`.
    """

    reduction: Reduction
    formulation: Formulation
    internal_step: float = StepLimits().tolerance

    @property
    def key(self) -> tuple[str, ...]:
        """What tells it from others, in the order of the records' columns."""
        r, f = self.reduction, self.formulation
        words = f.kinematics.value, f.loads.value, f.stiffness.value, f.mass.value, f.division.value
        return (REDUCED, "", r.basis.value, str(r.modes), str(r.frames), *words, self.internal_step_word)

    @property
    def internal_step_word(self) -> str:
        """The internal step as records have it."""
        return {SINGLE: "single", EXACT: "exact"}.get(self.internal_step, f"{self.internal_step:g}")

    @property
    def limits(self) -> StepLimits:
        """The internal step as the body takes it."""
        if self.internal_step == EXACT:
            return StepLimits()
        return StepLimits(tolerance=_ANY_ERROR if self.internal_step == SINGLE else self.internal_step)


def candidates(scene: Scene) -> list[Candidate]:
    """Every combination that `[sweep]` asks for and that has a meaning for the body, each once, fewest frames first.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    list of Candidate
    """
    sweep, config = scene.file.sweep, scene.config
    tolerances = [SINGLE if one == "single" else float(one) for one in sweep.internal_step]
    if not scene.transient:
        # Nothing shows the error of a step: one will do, the default where it is listed.
        tolerances = [StepLimits().tolerance if StepLimits().tolerance in tolerances else tolerances[-1]]
    bases = [_known_basis(config, basis) for basis in sweep.basis]
    found: dict[Candidate, None] = {}
    for parts in product(sweep.kinematics, sweep.loads, sweep.stiffness, sweep.mass, sweep.division):
        formulation = _meaningful(config, *parts)
        if formulation is None:
            continue
        linear = formulation.kinematics is Kinematics.LINEAR
        frames = [linear_frames(config)] if linear else offered_frames(config, sweep.frames)
        if parts[-1] is Division.ONE and not linear:
            # One frame for the whole body is the tree of one.
            frames = [1]
        steps = [EXACT] if is_exact(config, formulation) else tolerances
        for basis, modes, count, internal in product(bases, sweep.modes, frames, steps):
            here = formulation
            if formulation.division is Division.SEPARATE and _frame_count(config, count) < 2:
                here = replace(formulation, division=Division.TREE)
            candidate = Candidate(Reduction(basis, modes, count), here, internal)
            if has_meaning(config, candidate):
                found[candidate] = None
    order = {candidate: place for place, candidate in enumerate(found)}
    return sorted(found, key=lambda c: (_reduction_key(c.reduction), order[c]))


def _meaningful(
    config: BodyFile,
    kinematics: Kinematics,
    loads: LoadPlacement,
    stiffness: Stiffness,
    mass: Mass,
    division: Division,
) -> Formulation | None:
    """The formulation, under the one name of those that are the same; None where it has no meaning."""
    if kinematics is Kinematics.LINEAR:
        division = Division.TREE
        if loads is LoadPlacement.DEFORMED:
            # The same as on the undeformed body.
            loads = LoadPlacement.REFERENCE
    if division is Division.ONE:
        # Each part of a cut body turns by itself.
        if config.cut:
            return None
        division = Division.TREE
    curved = kinematics is Kinematics.SECOND_ORDER
    if division is not Division.TREE and (curved or mass is not Mass.CONSTANT):
        return None
    if curved and loads is LoadPlacement.DEFORMED and stiffness is Stiffness.BY_LOAD:
        # Such loads are the geometric stiffness already.
        return None
    try:
        return Formulation(kinematics, loads, stiffness, mass, division)
    except OptionError:
        return None


def _known_basis(config: BodyFile, basis: BasisChoice) -> BasisChoice:
    """The basis, under the one name of those that are the same: a cut body always has residual flexibility."""
    return BasisChoice.RESIDUAL if config.cut and basis is BasisChoice.NORMAL else basis


def _frame_count(config: BodyFile, frames: int) -> int:
    return len(config.frame) if frames == GIVEN else frames


def is_exact(config: BodyFile, formulation: Formulation) -> bool:
    """Whether no load depends on the motion, so that a step of any length is exact."""
    plain = formulation.stiffness is Stiffness.CONSTANT and formulation.mass is Mass.CONSTANT
    # What joins the parts of a cut body follows its frames, where they turn.
    joined = bool(config.cut) and formulation.kinematics is not Kinematics.LINEAR
    return plain and formulation.loads is LoadPlacement.REFERENCE and not joined


def _reduction_key(reduction: Reduction) -> tuple[int, int, str]:
    return reduction.frames, reduction.modes, reduction.basis.value


def linear_frames(config: BodyFile) -> int:
    """Number of frames for linear kinematics, which know nothing of them; parts of a cut body have one each anyway."""
    return 1 if config.cut else 0


def offered_frames(config: BodyFile, numbers: Iterable[int]) -> list[int]:
    """Numbers of frames, ascending, with the body's own among them where it has some."""
    own = [(len(config.frame), GIVEN)] if config.frame else []
    return [frames for _, frames in sorted([*((n, n) for n in set(numbers)), *own])]


def has_meaning(config: BodyFile, candidate: Candidate) -> bool:
    """Whether the body file would take a combination."""
    formulation, frames = candidate.formulation, candidate.reduction.frames
    if config.free and formulation.stiffness is Stiffness.BY_LOAD:
        return False
    plain = formulation.stiffness is Stiffness.CONSTANT and formulation.mass is Mass.CONSTANT
    return not (config.cut and (not plain or frames == 0))


def reduction_config(config: BodyFile, reduction: Reduction, formulations: list[Formulation]) -> BodyFile:
    """Body file of a reduction, with what some formulations need aboard.

    Parameters
    ----------
    config : BodyFile
    reduction : Reduction
    formulations : list of Formulation
        The first is the one that the body starts with.

    Returns
    -------
    BodyFile
    """
    needed = sorted({f.stiffness.value for f in formulations if f.stiffness is not Stiffness.CONSTANT})
    table = config.reduction.model_copy(
        update={
            "basis": Basis.CRAIG_BAMPTON if reduction.basis is BasisChoice.CRAIG_BAMPTON else Basis.NORMAL,
            "modes": reduction.modes,
            "residual_flexibility": reduction.basis is BasisChoice.RESIDUAL,
            "geometric_stiffness": needed,
            "inertia": any(f.mass is Mass.CONFIGURATION for f in formulations),
            "second_order": any(f.kinematics is Kinematics.SECOND_ORDER for f in formulations),
        }
    )
    first = formulations[0]
    start = FormulationTable(
        kinematics=first.kinematics,
        loads=first.loads,
        stiffness=first.stiffness,
        mass=first.mass,
        division=first.division,
    )
    own = reduction.frames == GIVEN
    frames = {"frames": None if own else reduction.frames, "frame": config.frame if own else []}
    return config.model_copy(update={**frames, "reduction": table, "formulation": start})


def lean(body: ReducedBody, formulation: Formulation) -> ReducedBody:
    """The body with nothing aboard that a formulation does not need."""
    return replace(
        body,
        formulation=formulation,
        stiffness_by_load=body.stiffness_by_load if formulation.stiffness is Stiffness.BY_LOAD else None,
        stiffness_by_mode=body.stiffness_by_mode if formulation.stiffness is Stiffness.BY_MODE else None,
        inertia=body.inertia if formulation.mass is Mass.CONFIGURATION else None,
        second=body.second if formulation.kinematics is Kinematics.SECOND_ORDER else None,
    )


def with_modes(body: ReducedBody, kept: IntArray) -> ReducedBody:
    """The body with some of its modes only.

    Parameters
    ----------
    body : ReducedBody
    kept : (k,) int
        Ascending.

    Returns
    -------
    ReducedBody
    """
    square = np.ix_(kept, kept)
    whole, masses, surface, inertia, ties = body.whole, body.masses, body.surface, body.inertia, body.ties
    second = body.second
    if second is not None:
        chosen = kept[:, None], kept
        displacement, rotation = second.displacement[:, :, *chosen], second.rotation[:, :, *chosen]
        second = SecondOrder(displacement, rotation)
    if whole is not None:
        names = ("joint_displacement", "joint_rotation", "frame_rotation")
        whole = replace(whole, **{name: getattr(whole, name)[..., kept] for name in names})
    if masses is not None:
        masses = replace(masses, displacement=masses.displacement[..., kept])
    if surface is not None:
        surface = replace(surface, modes=surface.modes[..., kept])
    if ties is not None:
        ties = replace(ties, displacement=ties.displacement[..., kept], rotation=ties.rotation[..., kept])
    if inertia is not None:
        moments = np.concatenate([[0], kept + 1])
        inertia = replace(
            inertia,
            first=inertia.first[:, moments],
            second=inertia.second[:, moments][:, :, moments],
            ground=inertia.ground[square],
        )
    by_load, by_mode = body.stiffness_by_load, body.stiffness_by_mode
    linear = ("interface_displacement", "interface_rotation", "joint_displacement", "joint_rotation", "frame_rotation")
    return replace(
        body,
        angular_frequency=body.angular_frequency[kept],
        damping_ratio=body.damping_ratio[kept],
        whole=whole,
        masses=masses,
        surface=surface,
        inertia=inertia,
        ties=ties,
        second=second,
        stress_sets=tuple(replace(part, stress=part.stress[..., kept]) for part in body.stress_sets),
        stiffness_by_load=None if by_load is None else by_load[:, kept][:, :, kept],
        stiffness_by_mode=None if by_mode is None else by_mode[np.ix_(kept, kept, kept)],
        **{name: getattr(body, name)[..., kept] for name in linear},
    )


def grouped(found: list[Candidate]) -> Iterator[tuple[Reduction, list[Candidate]]]:
    """Candidates by the reduction that serves them."""
    for reduction in dict.fromkeys(candidate.reduction for candidate in found):
        yield reduction, [candidate for candidate in found if candidate.reduction == reduction]
