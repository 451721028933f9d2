"""Models of a body that may do for a scene: basis, modes, frames and method; and their words."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

from ..body.flexible_body import StepLimits
from ..build.config import BodyFile
from ..build.tables import FormulationTable
from ..files.basics import plural
from ..model.methods import Data, Mass, Method, Variant, conflict, has_frames, masses_of, needs
from ..reduction.options import Basis
from .scene.config import BasisChoice
from .scene.scene import Scene

REDUCED = "reduced"
"""Who solves a reduced model; all others are finite element models."""
GIVEN = -1
"""Number of frames that stands for the body's own [[frame]] tables."""

SINGLE, EXACT = math.inf, 0.0
"""Internal steps that have no tolerance: one a communication step, whatever its error; and one that has no error."""
# A tolerance that every step meets; the FMU's parameter has to be finite.
_ANY_ERROR = 1e300


@dataclass(frozen=True, slots=True)
class Reduction:
    """A reduction as a body file would ask for it.

    Attributes
    ----------
    basis : BasisChoice
    modes : int
        The lowest so many normal modes; interface modes come on top.
    frames : int
        Equal levels, 0 for none, `GIVEN` for the body's own.
    """

    basis: BasisChoice
    modes: int
    frames: int


@dataclass(frozen=True, slots=True)
class Candidate:
    """A reduction under a method, with its internal step.

    Attributes
    ----------
    reduction : Reduction
    variant : Variant
    internal_step : float
        Error accepted per step; or `SINGLE`, `EXACT`.
    """

    reduction: Reduction
    variant: Variant
    internal_step: float = StepLimits().tolerance

    @property
    def key(self) -> tuple[str, ...]:
        """What tells it from others, in the order of the records' columns."""
        r, words = self.reduction, (self.variant.method.value, self.variant.mass.value)
        return (REDUCED, "", r.basis.value, str(r.modes), str(r.frames), *words, self.internal_step_word)

    @property
    def internal_step_word(self) -> str:
        """The internal step as records have it."""
        return {SINGLE: "single", EXACT: "exact"}.get(self.internal_step, f"{self.internal_step:g}")

    @property
    def limits(self) -> StepLimits:
        """The internal step as the body takes it."""
        exact = self.internal_step == EXACT
        return StepLimits() if exact else StepLimits(tolerance=min(self.internal_step, _ANY_ERROR))


def candidates(scene: Scene) -> list[Candidate]:
    """Every combination that `[sweep]` asks for and that has a meaning for the body, each once, fewest frames first.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    list of Candidate
    """
    sweep, config, usual = scene.file.sweep, scene.config, StepLimits().tolerance
    tolerances = [SINGLE if one == "single" else float(one) for one in sweep.internal_step]
    if not scene.transient:
        # Nothing shows the error of a step: one will do, the default where it is listed.
        tolerances = [usual if usual in tolerances else tolerances[-1]]
    # A cut body always has residual flexibility.
    bases = [BasisChoice.RESIDUAL if config.cut and b is BasisChoice.NORMAL else b for b in sweep.basis]
    found: dict[Candidate, tuple[int, int, str]] = {}
    for method, mass in product(sweep.methods, sweep.mass):
        # Without motion no mass is felt.
        if mass not in (masses_of(method) if scene.transient else (Mass.CONSTANT,)):
            continue
        frames = offered_frames(config, sweep.frames) if has_frames(method) else [linear_frames(config)]
        if method is Method.FLOATING_FRAME:
            # One frame for the whole body is the same in a body of any number.
            frames = [1]
        steps = [EXACT] if method is Method.LINEAR else tolerances
        for basis, modes, count, internal in product(bases, sweep.modes, frames, steps):
            candidate = Candidate(Reduction(basis, modes, count), Variant(method, mass), internal)
            if has_meaning(config, candidate):
                found.setdefault(candidate, (count, modes, basis.value))
    return sorted(found, key=lambda candidate: found[candidate])


def linear_frames(config: BodyFile) -> int:
    """Number of frames for linear kinematics, which know nothing of them; parts of a cut body have one each anyway."""
    return 1 if config.cut else 0


def offered_frames(config: BodyFile, numbers: Iterable[int]) -> list[int]:
    """Numbers of frames, ascending, with the body's own among them where it has some."""
    counts = {number: number for number in numbers} | ({GIVEN: len(config.frame)} if config.frame else {})
    return sorted(counts, key=lambda number: (counts[number], number))


def has_meaning(config: BodyFile, candidate: Candidate) -> bool:
    """Whether the body file would take a combination."""
    possible = conflict(candidate.variant, config.free, bool(config.cut)) is None
    return possible and not (config.cut and candidate.reduction.frames == 0)


def reduction_config(config: BodyFile, reduction: Reduction, variants: list[Variant]) -> BodyFile:
    """Body file of a reduction, with the data that some methods need.

    Parameters
    ----------
    config : BodyFile
    reduction : Reduction
    variants : list of Variant
        The first is the one that the body starts with.

    Returns
    -------
    BodyFile
    """
    data = {one for variant in variants for one in needs(variant.method, variant.mass)}
    listed = {Data.BY_LOAD: "by_load", Data.BY_MODE: "by_mode"}
    table = config.reduction.model_copy(
        update={
            "basis": Basis.CRAIG_BAMPTON if reduction.basis is BasisChoice.CRAIG_BAMPTON else Basis.NORMAL,
            "modes": reduction.modes,
            "residual_flexibility": reduction.basis is BasisChoice.RESIDUAL,
            "geometric_stiffness": [word for one, word in listed.items() if one in data],
            "inertia": Data.INERTIA in data,
            "second_order": Data.SECOND_ORDER in data,
        }
    )
    frames: dict[str, object] = {"frames": reduction.frames, "frame": [], "branch": []}
    if reduction.frames == GIVEN:
        frames = {"frames": None, "frame": config.frame, "branch": config.branch}
    start = FormulationTable(method=variants[0].method, mass=variants[0].mass)
    return config.model_copy(update={**frames, "reduction": table, "formulation": start})


def grouped(found: Sequence[Candidate], most: Callable[[Reduction], Reduction]) -> Iterator[list[Candidate]]:
    """Candidates of one basis and division of `most` together: one build serves them, whatever their modes."""
    kinds = [(one.frames, one.basis) for one in (most(candidate.reduction) for candidate in found)]
    for kind in dict.fromkeys(kinds):
        yield [candidate for candidate, own in zip(found, kinds, strict=True) if own == kind]


BASES = {"normal": "normal", "residual": "normal + residual", "craig_bampton": "Craig-Bampton"}
"""Bases by the word of a scene file."""
_MODES = {"normal": "normal mode", "residual": "normal mode", "craig_bampton": "mode"}
_STATIC_SHAPES = {"residual": " + residual", "craig_bampton": ", Craig-Bampton"}


def modes_words(basis: str, modes: int) -> str:
    """A number of modes of a basis."""
    return plural(modes, _MODES.get(basis, "mode")) + _STATIC_SHAPES.get(basis, "")


def frames_words(frames: int) -> str:
    """A number of frames."""
    return "the body's own frames" if frames == GIVEN else plural(frames, "frame")


def short(value: float) -> str:
    """A number in three digits at most."""
    if not math.isfinite(value):
        return "no answer"
    return f"{value:.3g}" if abs(value) < 1e4 else f"{value:.2g}"


def times(share: float) -> str:
    """An error over what is accepted."""
    return f"{share:.2g}" if share < 100.0 else f"{share:.0f}" if math.isfinite(share) else "no answer"
