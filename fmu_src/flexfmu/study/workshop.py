"""Models of a scene's body: reduced, held against the references, and timed; what chart and fit have in common.

Of a reduced body with many modes, those with fewer are found without the mesh. Accuracy runs are shared by
processes; timings never are.
"""

import math
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib import import_module
from typing import Any, TypeVar

import numpy as np
import scipy.linalg

from ..body.flexible_body import Errors, FlexibleBody, StepLimits
from ..build.config import BodyFile
from ..build.reduce import reduce_body
from ..core.interface import parameter
from ..files.basics import FlexfmuError, FloatArray, RuntimeBodyError
from ..files.outputs import Heard, Reporter
from ..files.store import REUSED, Store
from ..model.methods import Mass, Variant
from ..model.reduced_body import ReducedBody
from ..model.variants import lean, turned_parts
from .candidates import Candidate, Reduction, candidates, reduction_config
from .cost import StepCost, time_steps
from .pace import Clock
from .scene.config import BasisChoice
from .scene.reference import Reference, SceneErrors, errors, on_interfaces, references
from .scene.scene import Scene
from .scene.whole_model import WholeModel

T = TypeVar("T")


class JobsError(FlexfmuError):
    """Processes that were asked for are not to be had."""


class Crew(AbstractContextManager["Crew"]):
    """Processes among which tasks are shared; a context, at whose end they end.

    Parameters
    ----------
    jobs : int
        1: this one alone, -1: one a core.

    Raises
    ------
    JobsError
        0, or less than -1.
    """

    def __init__(self, jobs: int = 1):
        if jobs == 0 or jobs < -1:
            raise JobsError(f"jobs is {jobs}, expected 1 or more, or -1: one process for each core")
        self.count = jobs if jobs > 0 else import_module("joblib").cpu_count()

    def each(self, tasks: Sequence[Callable[[], T]]) -> Iterator[T]:
        """Do tasks, and yield their results in the order of the tasks as soon as they are there.

        Parameters
        ----------
        tasks : sequence of callable
            Functions of modules, or `functools.partial` of them: they are sent to other processes.

        Yields
        ------
        object
        """
        if self.count == 1 or len(tasks) < 2:
            yield from (task() for task in tasks)
            return
        import joblib

        with joblib.parallel_config(n_jobs=min(self.count, len(tasks)), backend="loky", inner_max_num_threads=1):
            yield from joblib.Parallel(return_as="generator", batch_size=1)(joblib.delayed(_deaf)(t) for t in tasks)

    def __exit__(self, *_: object) -> None:
        """End the processes."""
        if self.count > 1:
            # Otherwise they wait for more for some minutes.
            with suppress(Exception):
                import_module("joblib").externals.loky.get_reusable_executor().shutdown(wait=False, kill_workers=True)


def _deaf(task: Callable[[], T]) -> T:
    """Do a task in another process, which is ended by who began it: Ctrl-C is for that one alone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return task()


# As in reduction/modes.py: the share of a static shape's strain energy below which modes hold it already.
_HELD_ALREADY = 1e-12
# Relative difference of frequencies below which modes are a pair, whose axes are arbitrary.
_PAIR = 1e-4


def subset(body: ReducedBody, basis: BasisChoice, count: int) -> ReducedBody:
    """The body as a build with fewer normal modes makes it, in the same basis.

    Parameters
    ----------
    body : ReducedBody
        In one piece; with more modes, one damping ratio for all, and the interfaces of the build.
    basis : BasisChoice
    count : int
        Normal modes (of Craig-Bampton: with the interfaces held) to keep, the lowest.

    Returns
    -------
    ReducedBody
    """
    rigid = np.arange(body.rigid_count)
    if basis is BasisChoice.NORMAL:
        kept = body.rigid_count + count
        return in_subspace(body, np.eye(body.mode_count)[:, :kept], body.angular_frequency[:kept])
    phi = normal_shapes(body, basis)[:, :count]
    squares = body.angular_frequency**2
    # Work of unit loads, one column a load: what residual flexibility and constraint modes answer.
    work = np.concatenate([body.interface_displacement, body.interface_rotation], axis=1).reshape(-1, body.mode_count).T
    statics = np.divide(work, squares[:, None], out=np.zeros_like(work), where=squares[:, None] > 0.0)
    energy = np.einsum("ij,i,ij->j", statics, squares, statics)
    statics = statics[:, energy > 0.0] / np.sqrt(energy[energy > 0.0])
    stiff = squares[:, None]
    rest = statics - phi @ np.linalg.solve(phi.T @ (stiff * phi), phi.T @ (stiff * statics))
    energies, turn = np.linalg.eigh(rest.T @ (stiff * rest))
    needed = energies > _HELD_ALREADY
    span = np.hstack([phi, rest @ (turn[:, needed] / np.sqrt(energies[needed]))])
    ritz, small = scipy.linalg.eigh(span.T @ (stiff * span), span.T @ span)
    every = np.hstack([np.eye(body.mode_count)[:, rigid], span @ small])
    return in_subspace(body, every, np.concatenate([np.zeros(rigid.size), np.sqrt(ritz)]))


def normal_shapes(body: ReducedBody, basis: BasisChoice) -> FloatArray:
    """Normal modes (m, n) in a body's modal coordinates, ascending; with Craig-Bampton those of the held interfaces."""
    if basis is not BasisChoice.CRAIG_BAMPTON:
        # Residual shapes are orthogonal to the normal modes, and so of higher frequency than all of them.
        return np.eye(body.mode_count)[:, body.rigid_count :]
    motion = np.concatenate([body.interface_displacement, body.interface_rotation], axis=1).reshape(-1, body.mode_count)
    free = scipy.linalg.null_space(motion / np.linalg.norm(motion, axis=1)[:, None])
    _, small = scipy.linalg.eigh(free.T @ (body.angular_frequency[:, None] ** 2 * free))
    return free @ small


def normal_frequencies(body: ReducedBody, basis: BasisChoice) -> FloatArray:
    """Angular frequencies (n,) of `normal_shapes`, rad/s."""
    return np.linalg.norm(body.angular_frequency[:, None] * normal_shapes(body, basis), axis=0)


def in_subspace(body: ReducedBody, turn: FloatArray, angular_frequency: FloatArray) -> ReducedBody:
    """The body in coordinates p, with q = turn @ p.

    Parameters
    ----------
    body : ReducedBody
        With one damping ratio for all modes.
    turn : (m, k) float
        Orthonormal columns.
    angular_frequency : (k,) float
        rad/s.

    Returns
    -------
    ReducedBody
    """
    changes = turned_parts(body, turn)
    # Products that the mass leaves out are of the old coordinates: a trial goes without their watch.
    changes["polynomial"] = body.polynomial and replace(changes["polynomial"], factor=None, further=None)
    return replace(
        body,
        angular_frequency=angular_frequency,
        frequency_spread=None,
        damping_ratio=np.full(len(angular_frequency), body.damping_ratio[0]),
        membrane=body.membrane and body.membrane.turned(turn, angular_frequency**2),
        shadow=body.shadow and replace(body.shadow, embedding=body.shadow.embedding @ turn),
        **changes,
    )


def pair_ends(angular_frequency: FloatArray) -> list[int]:
    """Numbers of the lowest modes that split no pair of equal frequency.

    Parameters
    ----------
    angular_frequency : (m,) float
        Ascending. The other half of the last one may be the next.

    Returns
    -------
    list of int
    """
    return [int(end) + 1 for end in np.flatnonzero(np.diff(angular_frequency) > _PAIR * angular_frequency[1:])]


_EQUILIBRIA = 3
# A limit over the largest bound that was seen, and the largest limit.
_ABOVE, _MOST = 1.05, 0.98


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
        return _elsewhere, (self.scene, Store(self.store.folder), self.known)

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
            found = build(reduction_config(self.scene.config, reduction, list(before)).without_pictures, self.store)
            self._bodies[reduction] = found, before
        return found

    def body(self, reduction: Reduction, variants: list[Variant]) -> ReducedBody:
        """Reduce the body for some variants, once."""
        return self.build(reduction, variants).body

    @cached_property
    def _tried(self) -> list[Candidate]:
        """All that the sweep may try."""
        return candidates(self.scene)

    def most(self, reduction: Reduction) -> Reduction:
        """The reduction of the sweep from which this one is found by leaving out: with most modes, and residual shapes.

        A cut body, whose parts have modes of their own, is reduced as it is asked for.
        """
        if self.scene.config.cut:
            return reduction
        bases = {one.reduction.basis for one in self._tried if one.reduction.frames == reduction.frames}
        # Normal modes are the first coordinates of a residual basis.
        larger = reduction.basis is BasisChoice.NORMAL and BasisChoice.RESIDUAL in bases
        basis = BasisChoice.RESIDUAL if larger else reduction.basis
        return replace(reduction, basis=basis, modes=max(self.plenty, reduction.modes))

    def shared(self, reduction: Reduction) -> Built:
        """Reduce the body as `most` says, once, for all methods that the sweep may try, and leave out the rest."""
        most = self.most(reduction)
        variants = dict.fromkeys(one.variant for one in self._tried if self.most(one.reduction) == most)
        # The body starts with the first: of lumped mass alone no polynomial is known. An FMU of it serves all methods.
        order = (Mass.POLYNOMIAL, Mass.CONSTANT, Mass.CONFIGURATION).index
        built = self.build(most, sorted(variants, key=lambda one: order(one.mass)))
        return replace(built, body=_part(built.body, most, reduction))

    def errors(self, body: ReducedBody, variant: Variant, limits: StepLimits | None = None) -> SceneErrors:
        """Error of a reduced body under a variant."""
        self.tried += 1
        try:
            return errors(self.scene, self.known, FlexibleBody(lean(body, variant), limits=limits))
        except RuntimeBodyError as error:
            return SceneErrors(failure=str(error))

    def own_errors(self, models: Sequence[Candidate]) -> list[float]:
        """The largest errors of static cases that models of one `most` tell of themselves; nan without an answer."""
        most, variants = self.most(models[0].reduction), list(dict.fromkeys(one.variant for one in models))
        whole, found = build(reduction_config(self.scene.config, most, variants).certified, self.store).body, []
        for one in models:
            try:
                own = self._own(FlexibleBody(lean(_part(whole, most, one.reduction), one.variant), limits=one.limits))
                found.append(max((told.relative for told in own), default=math.nan))
            except RuntimeBodyError:
                found.append(math.nan)
        return found

    def _own(self, model: FlexibleBody) -> list[Errors]:
        """Errors of static cases that a model tells of itself."""
        peaks = [case.peak.scaled(factor) for case in self.scene.static for factor in case.factors]
        return [model.error(model.static(one), one) for one in (on_interfaces(self.scene, model, p) for p in peaks)]

    def accepted(self, body: ReducedBody, met: bool) -> float:
        """Relative error above which an FMU warns: what the scene accepts.

        Where the body's bound of its own error is larger in a static case, though it was measured within that, the
        bound, up to twice as much. Transients have no such bound: at least as much as FMUs accept by default.
        """
        file, scene, usual = self.scene.file.tolerance, self.scene, parameter("ERROR_LIMIT").start
        limit = max(file.transient.displacement, usual) if scene.transient else 0.0
        limit = max(file.static.displacement if scene.static else 0.0, limit)
        if met and body.shadow is not None:
            bound = max((one.bound for one in self._own(FlexibleBody(body))), default=0.0)
            limit = min(max(limit, float(f"{_ABOVE * bound:.3g}")), 2.0 * limit, _MOST)
        return limit

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


def _part(body: ReducedBody, most: Reduction, reduction: Reduction) -> ReducedBody:
    """The body of a reduction out of that of `Workshop.most`."""
    return body if most == reduction else subset(body, reduction.basis, reduction.modes)


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


def build(config: BodyFile, store: Store) -> Built:
    """Reduce a body in silence: who asked tells what is tried.

    Parameters
    ----------
    config : BodyFile
    store : Store

    Returns
    -------
    Built
    """
    heard, start = Heard(Reporter()), time.perf_counter()
    body = reduce_body(config, heard, store)
    return Built(body, time.perf_counter() - start, any(REUSED in text for _, text in heard.said))
