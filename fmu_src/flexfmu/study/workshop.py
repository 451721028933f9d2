"""Models of a scene's body: reduced, held against the references, and timed; what chart and fit have in common."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, TypeVar

from ..body.flexible_body import FlexibleBody, StepLimits
from ..build.config import BodyFile
from ..build.reduce import reduce_body
from ..files.progress import Reporter
from ..files.store import REUSED, Store
from ..model.errors import RuntimeBodyError
from ..model.methods import Variant
from ..model.reduced_body import ReducedBody
from ..model.variants import lean
from .candidates import Reduction, reduction_config
from .cost import StepCost, time_steps
from .jobs import Crew
from .pace import Clock
from .scene.config import BasisChoice
from .scene.measure import SceneErrors, errors, on_interfaces
from .scene.reference import Reference, references
from .scene.scene import Scene
from .scene.whole_model import WholeModel
from .subspace import subset

T = TypeVar("T")
_EQUILIBRIA = 3


class Heard(Reporter):
    """Keeps notes and warnings; passes warnings on, once each, where someone is given who wants them.

    Parameters
    ----------
    report : Reporter, optional
    """

    def __init__(self, report: Reporter | None = None):
        self._report = report
        self.notes: list[str] = []
        self.warnings: list[str] = []

    def note(self, text: str) -> None:
        """Keep it."""
        self.notes.append(text)

    def warning(self, text: str) -> None:
        """Keep it, and pass it on if it is new."""
        if self._report is not None and text not in self.warnings:
            self._report.warning(text)
        self.warnings.append(text)

    def doubt(self, text: str) -> None:
        """Keep it as a warning, and pass it on as what it is, which may end the job."""
        if self._report is not None and text not in self.warnings:
            self._report.doubt(text)
        self.warnings.append(text)


@dataclass(frozen=True, slots=True)
class Built:
    """A reduced body.

    Attributes
    ----------
    body : ReducedBody
    seconds : float
        What its reduction took.
    reused : bool
        Whether parts of it came from an earlier build.
    """

    body: ReducedBody
    seconds: float
    reused: bool


class Workshop:
    """Reduces a scene's body and measures models of it; a copy in another process says nothing and finds no references.

    Parameters
    ----------
    scene : Scene
    report : Reporter
    store : Store, optional
        Where modes, and the references, are kept from run to run.
    crew : Crew, optional
        Processes that measure; default: this one.
    solve : bool
        Whether the finite element model is solved for static cases without results; else a fine reduced model is.
    """

    def __init__(
        self, scene: Scene, report: Reporter, store: Store | None = None, crew: Crew | None = None, solve: bool = True
    ):
        self.solve = solve
        self.scene = scene
        self.report = report
        self.store = store or Store()
        self.crew = crew or Crew()
        self.tried = 0
        self._bodies: dict[Reduction, tuple[Built, tuple[Variant, ...]]] = {}
        self._step: float | None = None

    def __reduce__(self) -> tuple[object, ...]:
        """Send what another process needs to measure models."""
        return _elsewhere, (self.scene, self.store, self.known)

    def of(self, scene: Scene) -> "Workshop":
        """A workshop for the same scene's body, cut otherwise: the references stay."""
        other = Workshop(scene, self.report, self.store, self.crew)
        other.known, other.tried = self.known, self.tried
        return other

    @cached_property
    def whole(self) -> WholeModel:
        """The finite element model."""
        return WholeModel(self.scene, self.report, self.store)

    @cached_property
    def known(self) -> dict[str, Reference]:
        """The references, found when first needed."""
        return references(self.scene, self.report, self.store, self.whole, self.solve)

    @property
    def plenty(self) -> int:
        """The most modes of the sweep."""
        return max(self.scene.file.sweep.modes)

    def ample(self, frames: int) -> Reduction:
        """So many frames with plenty of modes and residual flexibility."""
        return Reduction(BasisChoice.RESIDUAL, self.plenty, frames)

    def build(self, reduction: Reduction, variants: list[Variant]) -> Built:
        """Reduce the body unless it was reduced for these variants, maybe among others, before."""
        found, before = self._bodies.get(reduction, (None, ()))
        if found is None or not set(variants) <= set(before):
            before = tuple(dict.fromkeys([*variants, *before]))
            config = reduction_config(self.scene.config, reduction, list(before))
            found = build(config.without_pictures, self.store)
            self._bodies[reduction] = found, before
        return found

    def body(self, reduction: Reduction, variants: list[Variant]) -> ReducedBody:
        """Reduce the body for some variants, once."""
        return self.build(reduction, variants).body

    def shared(self, reduction: Reduction, variants: list[Variant]) -> Built:
        """Reduce the body with the most modes of the sweep, once, and leave modes out.

        A cut body, whose parts have modes of their own, is reduced as it is asked for.
        """
        if self.scene.config.cut or reduction.modes >= self.plenty:
            return self.build(reduction, variants)
        built = self.build(replace(reduction, modes=self.plenty), variants)
        return replace(built, body=subset(built.body, reduction.basis, reduction.modes))

    def errors(self, body: ReducedBody, variant: Variant, limits: StepLimits | None = None) -> SceneErrors:
        """Error of a reduced body under a variant."""
        self.tried += 1
        try:
            return errors(self.scene, self.known, FlexibleBody(lean(body, variant), limits=limits))
        except RuntimeBodyError as error:
            return SceneErrors(failure=str(error))

    def own_errors(self, reduction: Reduction, models: Sequence[tuple[Variant, StepLimits | None]]) -> list[float]:
        """The largest errors of static cases that models of a reduction tell of themselves.

        Not a number where one has no answer.
        """
        variants = list(dict.fromkeys(variant for variant, _ in models))
        config = reduction_config(self.scene.config, reduction, variants).without_pictures
        certified = config.model_copy(update={"output": config.output.model_copy(update={"error": True})})
        body, found = build(certified, self.store).body, []
        loads = [case.peak.scaled(factor) for case in self.scene.static for factor in case.factors]
        for variant, limits in models:
            try:
                model = FlexibleBody(lean(body, variant), limits=limits)
                found.append(max((model.error(model.static(one), one).relative for one in loads), default=math.nan))
            except RuntimeBodyError:
                found.append(math.nan)
        return found

    def each(self, work: Callable[..., T], arguments: Sequence[tuple[Any, ...]]) -> Iterator[T]:
        """Share work among the crew: `work(workshop, *one)` of each of some arguments, in their order."""
        for result, tried in self.crew.each([partial(_counted, work, self, *one) for one in arguments]):
            self.tried += tried
            yield result

    def cost(self, body: ReducedBody, variant: Variant) -> StepCost:
        """Time of a step."""
        return self.time_steps(FlexibleBody(lean(body, variant)))

    def time_steps(self, model: FlexibleBody) -> StepCost:
        """Time of a step of a model under the scene's `timing_loads`."""
        heavy = model.model.masses is not None
        rows = [on_interfaces(self.scene, model, loads).packed(heavy) for loads in self.scene.timing_loads]
        return time_steps(model, rows, self.step(model))

    def time_equilibrium(self, model: FlexibleBody) -> float:
        """Time (s) of the equilibrium under the first static case, from rest, if there is one; the fastest of a few."""
        times = []
        for case in self.scene.static[:1] * _EQUILIBRIA:
            loads = on_interfaces(self.scene, model, case.peak.scaled(case.factors[-1]))
            clock = Clock()
            model.static(loads)
            times.append(clock.elapsed())
        return min(times, default=math.nan)

    def step(self, model: FlexibleBody) -> float:
        """Step (s) at which all models are timed: the first transient's, else what the first body suggests."""
        if self._step is None:
            self._step = self.scene.transient[0].step if self.scene.transient else model.model.suggested_step
        return self._step


def _counted(work: Callable[..., T], workshop: Workshop, *arguments: Any) -> tuple[T, int]:
    """Result, and how many models were measured for it."""
    before = workshop.tried
    result = work(workshop, *arguments)
    tried, workshop.tried = workshop.tried - before, before
    return result, tried


def _elsewhere(scene: Scene, store: Store, known: dict[str, Reference]) -> Workshop:
    """Make a workshop in another process."""
    workshop = Workshop(scene, Reporter(), store)
    workshop.known = known
    return workshop


def build(config: BodyFile, store: Store, report: Reporter | None = None) -> Built:
    """Reduce a body in silence: who asked tells what is tried.

    Parameters
    ----------
    config : BodyFile
    store : Store
    report : Reporter, optional
        To whom warnings go.

    Returns
    -------
    Built
    """
    heard, start = Heard(report), time.perf_counter()
    body = reduce_body(config, heard, store)
    return Built(body, time.perf_counter() - start, any(REUSED in note for note in heard.notes))
