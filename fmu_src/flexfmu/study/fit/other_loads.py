"""Loads that a scene does not have: a fitted body must not be rigid under them.

A unit load w answers with the static displacement wᵀΛ⁻¹w along itself. Of that a basis holds the part that lies, in the
strain energy, within its span; the rest is missed. Linear theory, of the body as it stands.
"""

from collections.abc import Collection

import numpy as np

from ...files.array_types import BoolArray, FloatArray, IntArray
from ...model.reduced_body import ReducedBody
from ..scenes.scene import AXES

# Compliance below this part of the largest of its kind is round-off.
_NOTHING = 1e-12


def load_names(body: ReducedBody) -> list[str]:
    """Forces, then moments, of all interfaces, as FMU inputs."""
    kinds = ("force", "moment")
    return [f"{name}.{kind}.{axis}" for kind in kinds for name in body.interface_names for axis in AXES]


def static_shapes(body: ReducedBody) -> FloatArray:
    """Answers (m, 6I) to unit loads in the order of `load_names`, scaled so that their squares are strain energies."""
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
        In the order of `load_names`; 1 where the body is rigid.
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
        In the order of `load_names`.
    """
    names, shapes = load_names(whole), static_shapes(whole)
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
