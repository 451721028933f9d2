"""Modal coordinates that a model goes through in a scene, and what each mode moves there."""

from dataclasses import dataclass

import numpy as np

from ...body.flexible_body import FlexibleBody
from ...files.array_types import FloatArray
from ...model.errors import EquilibriumError, RuntimeBodyError
from ...model.methods import Variant, lean
from ...model.reduced_body import ReducedBody
from ..scenes.config import BasisChoice
from ..scenes.measure import within
from ..scenes.scene import Scene
from ..scenes.subspace import normal_shapes

# An interface that moves less than this share of the one that moves farthest does not count.
_STILL = 1e-3


@dataclass(frozen=True, slots=True)
class Course:
    """A case as a model goes through it.

    Attributes
    ----------
    name : str
    q : (T, m) float
        Modal coordinates: one row of a static load, or one a communication point.
    acceleration : (T, m) float
        Their second derivatives, by differences over steps; zero under a static load.
    """

    name: str
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
            try:
                state = model.static(case.peak.scaled(factor))
            except EquilibriumError:
                continue
            found.append(Course(f"{case.name} × {factor:g}", state.q[None], np.zeros((1, state.q.size))))
    heavy = model.model.masses is not None
    for transient in scene.transient:
        state = model.rest()
        rows, rates = [state.q], [state.v]
        try:
            for start, end in zip(transient.start_loads, transient.end_loads, strict=True):
                first, last = start.packed(heavy), end.packed(heavy)
                same = np.array_equal(first, last)
                state, _ = model.step_packed(state, first, transient.step, None if same else last)
                rows.append(state.q)
                rates.append(state.v)
        except RuntimeBodyError:
            continue
        q, acceleration = np.array(rows), np.gradient(np.array(rates), transient.step, axis=0)
        if filtered and transient.frequencies is not None:
            q, acceleration = (within(x, transient.frequencies, transient.step) for x in (q, acceleration))
        found.append(Course(transient.name, q, acceleration))
    return found


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
