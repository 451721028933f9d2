"""Springs and dampers between places of a body and to the ground: what they read of its nodes (docs/theory.md, 1).

Every end goes by twelve numbers that are linear in displacements: the mean place of its nodes, and how they lie about
it. What a spring reads of both ends is a function of these, so that one function gives its stiffness, its second order
and its forces in turns of any size.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..files.basics import FloatArray, IntArray, ModelError
from ..mesh.model import Along, SpringDamper
from ..model.rotations import PERMUTATION, rotation_vector, turned_by

# A bushing's averaged motion couples all of its nodes.
_MOST_AVERAGED = 2000
# Second moments of nodes over the largest below which they do not lie off a line, or a point.
_FLAT = 1e-9
# Step of complex differences, and of central differences of these, over the size of a spring.
_TINY, _SMALL = 1e-30, 3e-5
# Parts of a motion around zero: the mean of its readings there over their cubes is the third order, to 1e-16.
_AROUND = 0.1 * np.exp(0.125j * np.pi * np.arange(16))
_ROUNDS = 60
_Numbers = NDArray[Any]


class End:
    """How one end of a spring moves by its numbers (z,), m: the mean displacement of its nodes, how they lie about it.

    Parameters
    ----------
    points : (n, 3) float
    nodes : (k,) int
        None: the ground.
    place : (3,) float
    """

    def __init__(self, points: FloatArray, nodes: IntArray, place: FloatArray):
        self.nodes, self.place = nodes, place
        self.mean = points[nodes].mean(axis=0) if nodes.size else place
        arm = points[nodes] - self.mean
        self.size = float(np.sqrt((arm**2).sum() / max(nodes.size, 1)))
        self.spread = arm.T @ arm / max(nodes.size, 1) / (self.size or 1.0)
        # By how much the nodes' places are turned; about the line of nodes on one that cannot be told.
        self._ease = np.linalg.pinv(np.trace(self.spread) * np.eye(3) - self.spread, rcond=_FLAT)
        values = np.linalg.eigvalsh(self.spread)
        self.rank = int((values > _FLAT * values[-1]).sum()) if self.size else 0
        rows = [np.full(nodes.size, 1.0 / max(nodes.size, 1))] if nodes.size else []
        if self.rank:
            rows += list(arm.T / (nodes.size * self.size))
        # Of each direction: its mean, and its moments about the mean along x, y and z.
        self.rows = np.kron(np.array(rows).reshape(len(rows), nodes.size), np.eye(3))

    def rotation(self, z: _Numbers) -> _Numbers:
        """Rotations (..., 3, 3) that fit how the nodes lie, for numbers (..., z)."""
        found = np.broadcast_to(np.eye(3, dtype=z.dtype), (*z.shape[:-1], 3, 3))
        if not self.rank:
            return found
        lie = self.spread + z[..., 3:].reshape(*z.shape[:-1], 3, 3).swapaxes(-1, -2)
        for _ in range(_ROUNDS):
            step = np.einsum("ijk,...kj->...i", PERMUTATION, found.swapaxes(-1, -2) @ lie) @ self._ease
            found = found @ turned_by(step)
            if np.abs(step.real).max(initial=0.0) < 1e-14 and np.abs(step.imag).max(initial=0.0) < 1e-14 * _TINY:
                break
        return found

    def at(self, z: _Numbers, turn: _Numbers, point: FloatArray) -> _Numbers:
        """Where the end carries a point (3,) of the undeformed body, (..., 3)."""
        return self.mean + (z[..., :3] if self.nodes.size else 0.0) + turn @ (point - self.mean)


class SpringReading:
    """What a spring reads of its ends.

    Parameters
    ----------
    points : (n, 3) float
    spring : SpringDamper
    """

    def __init__(self, points: FloatArray, spring: SpringDamper):
        self.spring = spring
        for nodes in spring.ends:
            if nodes.size > _MOST_AVERAGED:
                raise ModelError(f"{spring.name} acts on {nodes.size} nodes, at most {_MOST_AVERAGED}: take fewer")
        self.ends = [End(points, nodes, place) for nodes, place in zip(spring.ends, spring.places, strict=True)]
        self.length = float(np.linalg.norm(spring.places[0] - spring.places[1]))
        self.nodes = np.concatenate(spring.ends)
        self.columns = (3 * self.nodes[:, None] + np.arange(3)).ravel()
        first, second = (end.rows for end in self.ends)
        self._split = len(first)
        self.rows = np.zeros((len(first) + len(second), self.columns.size))
        self.rows[: len(first), : first.shape[1]], self.rows[len(first) :, first.shape[1] :] = first, second
        self._size = max(self.length, *(end.size for end in self.ends)) or 1.0
        # Without turning ends displacements along axes are linear.
        self.linear = spring.along is not Along.LINE and not any(end.rank for end in self.ends)

    def values(self, z: _Numbers) -> _Numbers:
        """Displacements along the axes and turns about them (..., 6), for the numbers (..., z) of both ends."""
        a, b = self.ends
        own, other = z[..., : self._split], z[..., self._split :]
        turn, carrier = a.rotation(own), b.rotation(other)
        axes, spring = self.spring.axes, self.spring
        if spring.along is Along.LINE:
            way = a.at(own, turn, spring.places[0]) - b.at(other, carrier, spring.places[1])
            return (np.sqrt((way**2).sum(axis=-1, keepdims=True)) - self.length) * np.eye(6)[0]
        if spring.along is Along.FIXED:
            apart = spring.places[0] - spring.places[1]
            shift = a.at(own, turn, spring.places[0]) - b.at(other, carrier, spring.places[1]) - apart
            angle = rotation_vector(turn) - rotation_vector(carrier)
        else:
            shift = a.at(own, turn, spring.joint) - b.at(other, carrier, spring.joint)
            back = carrier.swapaxes(-1, -2)
            shift, angle = (back @ shift[..., None])[..., 0], rotation_vector(back @ turn)
        return np.concatenate([shift, angle], axis=-1) @ np.kron(np.eye(2), axes).T

    def slope(self, z: FloatArray) -> FloatArray:
        """First derivatives (..., 6, z) of the values at numbers (..., z)."""
        step = _TINY * self._size
        return self.values(z[..., None, :] + 1j * step * np.eye(z.shape[-1])).imag.swapaxes(-1, -2) / step

    def bend(self, z: FloatArray) -> FloatArray:
        """Second derivatives (6, z, z) of the values at numbers (z,)."""
        step = _SMALL * self._size
        if self.linear:
            return np.zeros((6, z.size, z.size))
        ahead, behind = np.split(self.slope(z + step * np.concatenate([np.eye(z.size), -np.eye(z.size)])), 2)
        found = ((ahead - behind) / (2.0 * step)).transpose(1, 0, 2)
        return 0.5 * (found + found.swapaxes(1, 2))

    def force(self, displacement: FloatArray, _factor: float, _derived: bool = True) -> tuple[FloatArray, FloatArray]:
        """Forces (3k,) on its nodes against displacements (3n,), whatever the load, and their derivative (3k, 3k)."""
        z = self.rows @ displacement[self.columns]
        slope, pull = self.slope(z), self.spring.stiffness * self.values(z)
        tangent = slope.T @ (self.spring.stiffness[:, None] * slope) + np.tensordot(pull, self.bend(z), axes=1)
        return self.rows.T @ (slope.T @ pull), self.rows.T @ tangent @ self.rows


class Bushings:
    """All springs and dampers of a mesh.

    Parameters
    ----------
    points : (n, 3) float
    springs : sequence of SpringDamper
    """

    def __init__(self, points: FloatArray, springs: Sequence[SpringDamper]):
        self.size = points.size
        self.readings = [SpringReading(points, one) for one in springs]
        self.linear = [one.slope(np.zeros(len(one.rows))) @ one.rows for one in self.readings]

    @cached_property
    def rows(self) -> sp.csr_array:
        """Readings (6b, 3n) of all springs over displacements, by the root of their stiffness."""
        return self._weighed("stiffness")

    @property
    def idle(self) -> list[str]:
        """Names of springs and dampers whose turns do nothing: an end on a single node cannot turn."""
        return [
            one.spring.name
            for one in self.readings
            if (one.spring.stiffness + one.spring.damping)[3:].any()
            and any(end.nodes.size and not end.rank for end in one.ends)
        ]

    @property
    def unit_rows(self) -> sp.csr_array:
        """Rows that are not zero, each of length one."""
        size = sp.linalg.norm(self.rows, axis=1)
        return sp.csr_array(sp.diags_array(1.0 / size[size > 0.0]) @ self.rows[np.flatnonzero(size)])

    @property
    def key(self) -> tuple[Any, ...]:
        """All that stiffness and its second order depend on."""
        return self.rows.data, self.rows.indices, *((one.spring.along.value, one.length) for one in self.readings)

    @cached_property
    def dampers(self) -> sp.csr_array:
        """The same by the root of their damping."""
        return self._weighed("damping")

    def _weighed(self, name: str) -> sp.csr_array:
        count = 6 * len(self.readings)
        if not count:
            return sp.csr_array((0, self.size))
        readings = zip(self.readings, self.linear, strict=True)
        values = [np.sqrt(getattr(one.spring, name))[:, None] * own for one, own in readings]
        columns = [np.tile(one.columns, 6) for one in self.readings]
        starts = np.cumsum([0, *(one.columns.size for one in self.readings for _ in range(6))])
        whole = (np.concatenate([own.ravel() for own in values]), np.concatenate(columns), starts)
        found = sp.csr_array(whole, shape=(count, self.size))
        # A node at both ends stands once.
        found.sum_duplicates()
        found.eliminate_zeros()
        return found

    def curvature(self, shapes: FloatArray) -> FloatArray:
        """Second derivatives (6b, m, m) of what `rows` reads of displacements by shapes (3n, m)."""
        found = []
        for one in self.readings:
            local = one.rows @ shapes[one.columns]
            root = np.sqrt(one.spring.stiffness)[:, None, None]
            found.append(root * (local.T @ one.bend(np.zeros(len(one.rows))) @ local))
        return np.concatenate(found) if found else np.zeros((0, shapes.shape[1], shapes.shape[1]))

    def pulled(self, shapes: FloatArray) -> FloatArray:
        """Nodal forces (3n, m, m) by what springs pull in displacements by shapes (3n, m) and how others turn that."""
        found = np.zeros((self.size, shapes.shape[1], shapes.shape[1]))
        for one, own in zip(self.readings, self.linear, strict=True):
            z, pull = one.rows @ (u := shapes[one.columns]), one.spring.stiffness[:, None] * (own @ u)
            np.add.at(found, one.columns, np.einsum("ra,rzb,zk->kab", pull, one.bend(0.0 * z[:, 0]) @ z, one.rows))
        return found

    def third(self, shapes: FloatArray, amplitudes: FloatArray) -> FloatArray:
        """Readings (k, 6b) like those of `rows` at third order, by shapes (3n, m) and amplitudes (m, k)."""
        found = [np.zeros((amplitudes.shape[1], 0))]
        for one in self.readings:
            z = ((one.rows @ shapes[one.columns]) @ amplitudes).T
            # No rotation fits a small end whose nodes go farther than it is wide.
            near = min((end.size for end in one.ends if end.rank), default=np.inf)
            wide = np.maximum(np.abs(z).max(axis=1, keepdims=True) / near, 1.0)
            cubic = np.einsum("p,pkr->kr", _AROUND**-3 / 16.0, one.values(np.multiply.outer(_AROUND, z / wide))).real
            found.append(np.sqrt(one.spring.stiffness) * wide**3 * cubic)
        return np.hstack(found)


def resisted(
    several: Sequence[Any], displacement: FloatArray, factor: float, derived: bool = True
) -> tuple[FloatArray, sp.csr_array]:
    """Nodal forces (3n,) against displacements (3n,) of any size, and their derivative, where that is asked for.

    Of springs, and of whatever else has their `columns` and `force` at a part of the loads.
    """
    force, entries = np.zeros(displacement.size), []
    for one in several:
        own, tangent = one.force(displacement, factor, derived)
        np.add.at(force, one.columns, own)
        entries.append((tangent.ravel(), np.repeat(one.columns, len(tangent)), np.tile(one.columns, len(tangent))))
    values, rows, columns = (np.concatenate(part) for part in zip(*entries, strict=True))
    return force, sp.csr_array(sp.coo_array((values, (rows, columns)), shape=(force.size, force.size)))
