"""Whether modes that another program found can be true: orthonormality, rigid motions, units."""

import math
from dataclasses import replace

import numpy as np

from ..files.array_types import FloatArray
from ..files.units import UnitSystem
from ..mesh.plausibility import DENSITY_RANGE, SIZE_RANGE
from ..reduction.model import rigid_basis
from .modes import GivenModes, GivenModesError

# Frequencies below this share of the next are those of rigid motions.
_RIGID_FREQUENCY = 1e-2
# Largest part of a rigid motion that may be none, of a rigid mode's own size.
_NOT_RIGID = 1e-2
# Products of different modes, with modal masses of one: a warning, and what no mass that belongs to the modes has.
_DOUBTFUL, _WRONG = 0.01, 0.1
# Modal masses that count as one already: lumped masses are not those that the modes were normalised with.
_NORMALISED = 0.1
# Product of an elastic mode with a rigid motion below which the body is free, and its rigid motions were left out.
_BALANCED = 0.02
# No solid is faster, m/s: half a wave along the body takes at least its length over this.
_FASTEST = 2.5e4


def rigid_motions(given: GivenModes) -> FloatArray:
    """Rigid motions (3n, 6) of modal masses one, orthogonal to each other."""
    flat = rigid_basis(given.nodes).reshape(-1, 6)
    values, vectors = np.linalg.eigh(flat.T @ given.momentum(flat))
    if values[0] <= 1e-12 * values[-1]:
        raise GivenModesError("the masses lie on a line or in a point: they tell no rotation, expected a body in space")
    return flat @ (vectors / np.sqrt(values))


def checked_modes(given: GivenModes) -> tuple[GivenModes, tuple[str, ...], tuple[str, ...]]:
    """Modes in SI units, with modal masses of one and exact rigid motions.

    Parameters
    ----------
    given : GivenModes

    Returns
    -------
    GivenModes
        Frequencies of rigid motions are zero.
    notes, warnings : tuple of str

    Raises
    ------
    GivenModesError
        The mass does not belong to the modes, or what should be rigid is not.
    """
    units, given = given.units, given.in_si
    notes, warnings = [], list(_implausible(given, units))
    shapes = given.shapes
    gram = shapes.T @ given.momentum(shapes)
    modal = np.diagonal(gram).copy()
    warnings += _not_orthogonal(gram, modal)
    if np.any(np.abs(modal - 1.0) > _NORMALISED):
        notes.append(f"modal masses are {modal.min():.4g} to {modal.max():.4g} kg: made one")
        shapes = shapes / np.sqrt(modal)
    frequency, damping = given.frequency.copy(), given.damping
    rigid = _rigid_count(frequency)
    if rigid:
        if rigid != 6 or given.held.size:
            raise GivenModesError(
                f"{rigid} modes below {_RIGID_FREQUENCY:g} of the next frequency are rigid motions, expected 6 of a "
                "body that nothing holds, or none"
            )
        exact = rigid_motions(given)
        wrong = shapes[:, :6] - exact @ (exact.T @ given.momentum(shapes[:, :6]))
        part = float(np.sqrt(np.abs(np.diagonal(wrong.T @ given.momentum(wrong))).max()))
        if part > _NOT_RIGID:
            raise GivenModesError(
                f"the first 6 modes have almost no frequency and are no rigid motions ({part:.2g} of them is not): the "
                "body is a mechanism, or modes and nodes are in different axes"
            )
        shapes = np.hstack([exact, shapes[:, 6:]])
        frequency[:6] = 0.0
    elif not given.held.size:
        exact = rigid_motions(given)
        if np.abs(exact.T @ given.momentum(shapes)).max() < _BALANCED:
            notes.append("nothing holds the body and its rigid motions are not among the modes: added")
            shapes = np.hstack([exact, shapes])
            frequency = np.concatenate([np.zeros(6), frequency])
            damping = None if damping is None else np.concatenate([np.zeros(6), damping])
    modes = shapes.T.reshape(shapes.shape[1], -1, 3)
    return replace(given, modes=modes, frequency=frequency, damping=damping), tuple(notes), tuple(warnings)


def _not_orthogonal(gram: FloatArray, modal: FloatArray) -> list[str]:
    """A warning where modes are not orthogonal by mass; an error where the mass cannot be theirs."""
    if np.any(modal <= 0.0):
        raise GivenModesError(f"mode {int(np.argmin(modal)) + 1} moves no mass: the mass belongs to other nodes")
    product = gram / np.sqrt(np.outer(modal, modal)) - np.eye(len(modal))
    worst = np.unravel_index(int(np.argmax(np.abs(product))), product.shape)
    off = abs(float(product[worst]))
    told = f"modes {worst[0] + 1} and {worst[1] + 1} have the product {off:.2g} by mass, expected 0"
    if off > _WRONG:
        raise GivenModesError(
            f"{told}: the mass is not that of these modes (nodes in another order, a part without its mass, mass of "
            "mid-side nodes left out), or the modes are no eigenmodes"
        )
    if off > _DOUBTFUL:
        return [f"{told}: lumped masses are coarse here; a consistent mass matrix would be exact"]
    return []


def _rigid_count(frequency: FloatArray) -> int:
    """How many of the first frequencies are those of rigid motions."""
    if frequency[-1] == 0.0:
        raise GivenModesError("all frequencies are zero, expected at least one elastic mode, in Hz")
    for count in range(min(6, len(frequency) - 1), 0, -1):
        if frequency[count - 1] <= _RIGID_FREQUENCY * frequency[count]:
            return count
    return 0


def _implausible(given: GivenModes, units: UnitSystem) -> list[str]:
    """What no solid body is likely to be; numbers in SI."""
    found = []
    sides = np.ptp(given.nodes, axis=0)
    size, mass = float(sides.max()), float(given.nodal_mass.sum())
    if not SIZE_RANGE[0] <= size <= SIZE_RANGE[1]:
        found.append(f"the body measures {size:.4g} m")
    if mass > DENSITY_RANGE[1] * float(np.prod(np.maximum(sides, 1e-3 * size))) or mass <= 0.0:
        found.append(f"the body has {mass:.4g} kg within {' × '.join(f'{side:.4g}' for side in sides)} m")
    elastic = given.frequency[given.frequency > 0.0]
    if elastic.size and elastic[0] * size > _FASTEST:
        found.append(f"the first frequency is {elastic[0]:.4g} Hz of a body of {size:.4g} m")
    if math.isnan(mass):
        found.append("the mass is not a number")
    known = ", ".join(f'"{system.value}"' for system in UnitSystem)
    return [f"{text}: implausible. Give the units of the modes (found {units.value}, known: {known})" for text in found]
