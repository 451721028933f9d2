"""What each mode does for a scene, and what a choice of modes misses under loads that the scene does not have.

A unit load w answers with the static displacement wᵀΛ⁻¹w along itself. Of that a basis holds the part that lies, in the
strain energy, within its span; the rest is missed. Linear theory, of the body as it stands.
"""

from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ...body.flexible_body import FlexibleBody
from ...files.array_types import BoolArray, FloatArray, IntArray
from ...model.errors import EquilibriumError, RuntimeBodyError
from ...model.methods import Variant
from ...model.reduced_body import ReducedBody
from ...model.variants import lean
from ..scene.config import BasisChoice
from ..scene.measure import within
from ..scene.reference import states_through
from ..scene.scene import AXES, Scene
from ..subspace import normal_shapes

# An interface that moves less than this share of the one that moves farthest does not count.
_STILL = 1e-3


@dataclass(frozen=True, slots=True)
class Course:
    """A case as a model goes through it.

    Attributes
    ----------
    q : (T, m) float
        Modal coordinates: one row of a static load, or one a communication point.
    acceleration : (T, m) float
        Their second derivatives, by differences over steps; zero under a static load.
    """

    q: FloatArray
    acceleration: FloatArray


def courses(scene: Scene, model: FlexibleBody, filtered: bool = True) -> list[Course]:
    """What a model goes through in each case; cases that it has no answer to are left out.

    Parameters
    ----------
    scene : Scene
    model : FlexibleBody
        With the interfaces of `scene.config`.
    filtered : bool
        Whether motion over time is filtered to the frequencies that count.

    Returns
    -------
    list of Course
    """
    found = []
    for case in scene.static:
        for factor in case.factors:
            with suppress(EquilibriumError):
                q = model.static(case.peak.scaled(factor)).q
                found.append(Course(q[None], np.zeros((1, q.size))))
    for transient in scene.transient:
        try:
            states = list(states_through(model, transient))
        except RuntimeBodyError:
            continue
        q, rates = np.array([state.q for state in states]), np.array([state.v for state in states])
        acceleration = np.gradient(rates, transient.step, axis=0)
        if filtered and transient.frequencies is not None:
            q, acceleration = (within(x, transient.frequencies, transient.step) for x in (q, acceleration))
        found.append(Course(q, acceleration))
    return found


def configurations(scene: Scene, model: FlexibleBody) -> list[FloatArray]:
    """Modal coordinates (m,) that a model goes through, over all cases."""
    return [q for course in courses(scene, model, filtered=False) for q in course.q]


def contributions(
    scene: Scene, body: ReducedBody, variant: Variant, basis: BasisChoice = BasisChoice.NORMAL
) -> FloatArray:
    """How much each normal mode has to do with the motion of the scene's interfaces.

    Parameters
    ----------
    scene : Scene
    body : ReducedBody
        With the interfaces of `scene.config`.
    variant : Variant
    basis : BasisChoice
        Of the body. With residual flexibility modes are there for vibration only, q + Q/ω² = −q̈/ω²: what follows the
        loads is there without them. Craig-Bampton's normal modes hold the interfaces still: what counts is their part
        in the strain.

    Returns
    -------
    (n,) float
        Of the elastic modes; with residual flexibility of its shapes too, after the normal modes. The largest over all
        cases: of a static one the displacement that the mode adds to an interface, over the interface's; of motion
        over time the rms of both, within the frequencies that count.
    """
    found = courses(scene, FlexibleBody(lean(body, variant)))
    shapes = normal_shapes(body, basis)
    part = np.zeros(shapes.shape[1])
    for course in found:
        if basis is BasisChoice.CRAIG_BAMPTON:
            strain = body.angular_frequency * course.q
            held = np.einsum("mn,m,tm->tn", shapes, body.angular_frequency, strain)
            scale = np.linalg.norm(body.angular_frequency[:, None] * shapes, axis=0)
            size = float(np.sqrt(np.mean(np.sum(strain**2, axis=1))))
            if size > 0.0:
                part = np.maximum(part, np.sqrt(np.mean((held / scale) ** 2, axis=0)) / size)
            continue
        own = course.q @ shapes
        added = own
        if basis is BasisChoice.RESIDUAL:
            added = (course.acceleration / np.maximum(body.angular_frequency, 1e-300) ** 2) @ shapes
        motion = body.interface_displacement[scene.read_index] @ shapes
        each = np.linalg.norm(motion, axis=1) * np.sqrt(np.mean(added**2, axis=0))
        whole = np.einsum("ian,tn->tia", motion, own)
        size = np.sqrt(np.mean(np.sum(whole**2, axis=2), axis=0))
        counts = size > _STILL * np.max(size, initial=0.0)
        if np.any(counts):
            part = np.maximum(part, np.max(each[counts] / size[counts, None], axis=0))
    return part


# Compliance below this part of the largest of its kind is round-off.
_NOTHING = 1e-12


def loads_by_kind(body: ReducedBody) -> list[str]:
    """Forces, then moments, of all interfaces, as FMU inputs."""
    kinds = ("force", "moment")
    return [f"{name}.{kind}.{axis}" for kind in kinds for name in body.interface_names for axis in AXES]


def static_shapes(body: ReducedBody) -> FloatArray:
    """Answers (m, 6I) to unit loads as of `loads_by_kind`, scaled so that their squares are strain energies."""
    work = np.concatenate([body.interface_displacement, body.interface_rotation]).reshape(-1, body.mode_count)
    elastic = body.angular_frequency > 0.0
    result = np.zeros_like(work.T)
    result[elastic] = work.T[elastic] / body.angular_frequency[elastic, None]
    return result


def missed(body: ReducedBody, whole: ReducedBody) -> FloatArray:
    """Part of the static displacement under each load, along it, that a body lacks.

    Parameters
    ----------
    body : ReducedBody
    whole : ReducedBody
        The same with residual flexibility of all loads.

    Returns
    -------
    (6I,) float
        In the order of `loads_by_kind`; 1 where the body is rigid.
    """
    here, there = (np.sum(static_shapes(one) ** 2, axis=0) for one in (body, whole))
    return np.where(_counts(there), np.maximum(1.0 - here / np.where(there > 0.0, there, 1.0), 0.0), 0.0)


def loads_to_keep(whole: ReducedBody, chosen: IntArray, loaded: Collection[str], limit: float) -> tuple[str, ...]:
    """Loads whose static shapes make up for what modes and the shapes of a scene's own loads miss.

    Parameters
    ----------
    whole : ReducedBody
        With residual flexibility of all loads; its normal modes come first.
    chosen : (k,) int
        Elastic normal modes that are kept, from 0.
    loaded : collection of str
        Loads of the scene, which are kept in any case.
    limit : float
        Part of the static displacement that any load may miss.

    Returns
    -------
    tuple of str
        In the order of `loads_by_kind`.
    """
    names, shapes = loads_by_kind(whole), static_shapes(whole)
    counts = _counts(np.sum(shapes**2, axis=0))
    left = np.where(counts, shapes / np.where(counts, np.linalg.norm(shapes, axis=0), 1.0), 0.0)
    left[whole.rigid_count + chosen] = 0.0
    kept = [names.index(name) for name in names if name in loaded]
    for place in kept:
        left = _without(left, place)
    # The one that is worst off first: its shape helps those that are like it.
    while (worst := int(np.argmax(np.sum(left**2, axis=0)))) not in kept and np.sum(left[:, worst] ** 2) > limit:
        kept.append(worst)
        left = _without(left, worst)
    return tuple(names[place] for place in sorted(kept))


def _without(shapes: FloatArray, place: int) -> FloatArray:
    """Shapes less their parts along one of them."""
    size = float(np.linalg.norm(shapes[:, place]))
    if size == 0.0:
        return shapes
    along = shapes[:, place] / size
    result: FloatArray = shapes - np.outer(along, along @ shapes)
    result[:, place] = 0.0
    return result


def _counts(compliance: FloatArray) -> BoolArray:
    """Whether a load moves the body at all; forces and moments each by themselves."""
    halves = compliance.reshape(2, -1)
    result: BoolArray = (halves > _NOTHING * halves.max(axis=1, keepdims=True)).ravel()
    return result
