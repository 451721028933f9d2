"""Reduced bodies with fewer modes, found from a reduced body with many, without the mesh."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.linalg

from ..files.array_types import FloatArray
from ..model.arrays import BODY, INERTIA, MASSES, POLYNOMIAL, SECOND, STRESS, TIES, WHOLE, Entry
from ..model.reduced_body import ReducedBody
from .scene.config import BasisChoice

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
    elastic = squares > 0.0
    # Work of unit loads, one column a load: what residual flexibility and constraint modes answer.
    work = np.concatenate([body.interface_displacement, body.interface_rotation], axis=1).reshape(-1, body.mode_count).T
    statics = np.zeros_like(work)
    statics[elastic] = work[elastic] / squares[elastic, None]
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
    shapes = normal_shapes(body, basis)
    return np.linalg.norm(body.angular_frequency[:, None] * shapes, axis=0)


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

    def changed(part: Any, entries: Sequence[Entry]) -> dict[str, Any]:
        """Arrays of a part that have modal axes, which are their last ones."""
        found = {}
        for entry in entries:
            array, axes = getattr(part, entry.name), entry.shape.split().count("m")
            if array is not None and axes == 1:
                found[entry.name] = array @ turn
            elif array is not None and axes == 2:
                found[entry.name] = turn.T @ array @ turn
            elif array is not None and axes == 3:
                found[entry.name] = np.einsum("abc,ai,bj,ck->ijk", array, turn, turn, turn, optimize=True)
        return found

    parts = {
        "whole": WHOLE,
        "masses": MASSES,
        "ties": TIES,
        "inertia": INERTIA,
        "polynomial": POLYNOMIAL,
        "second": SECOND,
    }
    known = {name: (getattr(body, name), entries) for name, entries in parts.items()}
    changes = changed(body, [entry for entry in BODY if entry.shape != "m"])
    changes |= {name: part and replace(part, **changed(part, entries)) for name, (part, entries) in known.items()}
    return replace(
        body,
        angular_frequency=angular_frequency,
        frequency_spread=None,
        damping_ratio=np.full(len(angular_frequency), body.damping_ratio[0]),
        surface=body.surface and body.surface.in_coordinates(turn),
        membrane=body.membrane and body.membrane.turned(turn, angular_frequency**2),
        stress_sets=tuple(replace(part, **changed(part, STRESS)) for part in body.stress_sets),
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
    ends = np.flatnonzero(np.diff(angular_frequency) > _PAIR * angular_frequency[1:]) + 1
    return [int(end) for end in ends]
