"""Models that are tried: what a body file would say of them, their error and the cost of their steps."""

from dataclasses import dataclass
from functools import cached_property

from ...body import FlexibleBody
from ...build import reduce_body
from ...config import BodyFile, BranchTable
from ...methods import Variant, lean
from ...model.errors import RuntimeBodyError
from ...model.reduced_body import ReducedBody
from ...progress import Reporter
from ...store import Store
from ..candidates import GIVEN, Reduction, reduction_config
from ..config import BasisChoice
from ..measure import Errors, communication_step, errors, step_cost
from ..reference import Reference, references
from ..scene import Scene

Joints = tuple[tuple[str, tuple[float, ...]], ...]
"""[[branch]] tables: where each leads, and the distances of its joints from the supports, m."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A reduction as a body file would ask for it.

    Attributes
    ----------
    basis : BasisChoice
    modes : int or tuple of int
        The lowest so many normal modes, or their numbers, from 1.
    frames : int or Joints
        Equal levels, `GIVEN`, or joints of branches.
    residual : tuple of str
        Loads by name whose residual flexibility is wanted; none: of all, where the basis has it.
    """

    basis: BasisChoice
    modes: int | tuple[int, ...]
    frames: int | Joints
    residual: tuple[str, ...] = ()

    @property
    def numbers(self) -> tuple[int, ...]:
        """Numbers of the normal modes."""
        return tuple(range(1, self.modes + 1)) if isinstance(self.modes, int) else self.modes


@dataclass(slots=True)
class Choice:
    """A model that will do.

    Attributes
    ----------
    plan : Plan
    variant : Variant
    body : ReducedBody
    errors : Errors
    cost : float
        Fastest step seen, s.
    """

    plan: Plan
    variant: Variant
    body: ReducedBody
    errors: Errors
    cost: float = float("inf")


def plan_config(config: BodyFile, plan: Plan, variants: list[Variant]) -> BodyFile:
    """Body file of a plan, with what some variants need aboard, the first of them to start with.

    Parameters
    ----------
    config : BodyFile
    plan : Plan
    variants : list of Variant

    Returns
    -------
    BodyFile
    """
    levels = plan.frames if isinstance(plan.frames, int) else 1
    found = reduction_config(config, Reduction(plan.basis, plan.numbers[-1], levels), variants)
    branch = config.branch if plan.frames == GIVEN else []
    if not isinstance(plan.frames, int):
        branch = [BranchTable(toward=toward, joints=list(joints)) for toward, joints in plan.frames]
        found = found.model_copy(update={"frames": None})
    modes = plan.modes if isinstance(plan.modes, int) else list(plan.modes)
    table = found.reduction.model_copy(update={"modes": modes})
    if plan.residual:
        table = table.model_copy(update={"residual_flexibility": list(plan.residual)})
    return found.model_copy(update={"branch": branch, "reduction": table})


class Search:
    """Reduces a scene's body, remembers what it reduced, and measures models of it.

    Parameters
    ----------
    scene : Scene
    report : Reporter
    store : Store, optional
        Where modes, and the references, are kept from run to run.
    """

    def __init__(self, scene: Scene, report: Reporter, store: Store | None = None):
        self.scene = scene
        self.report = report
        self.store = store or Store()
        self._bodies: dict[Plan, tuple[ReducedBody, frozenset[Variant]]] = {}
        self._step: float | None = None
        self.tried = 0

    @cached_property
    def known(self) -> dict[str, Reference]:
        """The references, found when first needed."""
        return references(self.scene, self.report, self.store)

    def body(self, plan: Plan, variants: list[Variant]) -> ReducedBody:
        """Reduce the body for some variants, once."""
        found = self._bodies.get(plan)
        if found is None or not set(variants) <= found[1]:
            config = plan_config(self.scene.config, plan, variants)
            found = self._bodies[plan] = reduced(config.without_pictures, self.store), frozenset(variants)
        return found[0]

    def errors(self, body: ReducedBody, variant: Variant) -> Errors:
        """Error of a reduced body under a variant."""
        self.tried += 1
        try:
            return errors(self.scene, self.known, FlexibleBody(lean(body, variant)))
        except RuntimeBodyError as error:
            return Errors(failure=str(error))

    def cost(self, body: ReducedBody, variant: Variant) -> float:
        """Fastest step, s."""
        model = FlexibleBody(lean(body, variant))
        return step_cost(self.scene, model, self.step(model)).fastest

    def step(self, model: FlexibleBody) -> float:
        """Step (s) at which all models are timed."""
        if self._step is None:
            self._step = communication_step(self.scene, model)
        return self._step


def reduced(config: BodyFile, store: Store) -> ReducedBody:
    """Reduce a body in silence: the search tells what it tries."""
    return reduce_body(config, Reporter(), store)
