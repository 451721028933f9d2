"""What elements are at their integration points: gradients of shape functions, volume, elasticity, layers of shells.

C3D8I adds to its shape functions three of its own, 1 − ξ_b², whose gradients are taken with the Jacobian of the
element's centre, scaled by its determinant's ratio, so that a constant strain stays one (R. L. Taylor, P. J. Beresford,
E. L. Wilson, Int. J. Numer. Meth. Engng. 10 (1976) 1211). Their amplitudes are eliminated element by element.

Layers of shells are each in plane stress. Shear of a laminate is that of the stress which equilibrium needs beside
bending about either axis (R. Rolfes, K. Rohwer, Int. J. Numer. Meth. Engng. 40 (1997) 51): 5/6 of the modulus where
there is one layer.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from ..files.basics import FloatArray, IntArray
from ..mesh.elements import ElementBlock, ElementType, jacobians
from ..mesh.model import Layer, Material, Mesh
from ..mesh.shapes import Quadrature

# What cells have of each element; numbers of the operators of a block up to which the mesh keeps them.
_OF_EACH, _KEPT = ("nodes", "gradient", "volume", "elasticity"), 10_000_000
# Places of the components xx, yy, zz, xy, yz, zx.
VOIGT = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))


@dataclass(frozen=True)
class Cells:
    """Some elements of one type, for their stiffness; what is asked of them undeformed is found once.

    Attributes
    ----------
    nodes : (e, a) int
        Rows of `Mesh.points`.
    value : (q, a) float
        Shape functions of the nodes.
    gradient : (e, q, a + b, 3) float
        ∂N/∂X, 1/m; after the nodes' the elements' own shape functions, none but with incompatible modes.
    volume : (e, q) float
        m³.
    elasticity : (e, 6, 6) float
        N/m², of strain xx, yy, zz and twice xy, yz, zx, in global axes.
    """

    nodes: IntArray
    value: FloatArray
    gradient: FloatArray
    volume: FloatArray
    elasticity: FloatArray

    def part(self, chosen: slice) -> "Cells":
        """Some of the elements, and what is known of them."""
        found = replace(self, **{name: getattr(self, name)[chosen] for name in _OF_EACH})
        vars(found).update({name: getattr(self, name)[chosen] for name in ("shape_slopes", "undeformed_operator")})
        return found

    @property
    def own(self) -> slice:
        """Unknowns of the elements' own shape functions, after those of the nodes."""
        return slice(3 * self.nodes.shape[1], None)

    def eliminated(self, matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Eliminate the elements' own unknowns from matrices (e, 3(a + b), 3(a + b)).

        Returns
        -------
        matrices : (e, 3a, 3a) float
        own : (e, 3b, 3a) float
            Own unknowns per nodal displacement.
        """
        last = self.own.start
        coupling = matrices[:, last:, :last]
        if not coupling.size:
            return matrices[:, :last, :last], coupling
        own: FloatArray = -np.linalg.solve(matrices[:, last:, last:], coupling).astype(np.float64)
        return matrices[:, :last, :last] + coupling.swapaxes(1, 2) @ own, own

    @property
    def rows(self) -> IntArray:
        """Both slopes (r, 2) of strains X_i·u_j + X_j·u_i, half of which they are where i is j."""
        found: IntArray = np.array(VOIGT)[:, None] + 3 * np.arange(self.gradient.shape[1])[None, :, None]
        return found.reshape(-1, 2)

    @cached_property
    def shape_slopes(self) -> FloatArray:
        """∂N/∂X_J (e, 3q, a + b)."""
        return _rows(self.gradient)

    def slopes(self, fields: FloatArray) -> FloatArray:
        """∂u/∂X_J (e, 3q, 3, k) of displacements (n, 3, k), with what the elements' own shape functions add."""
        return _product(self.shape_slopes, self.amplitudes(fields))

    def turn(self, fields: FloatArray) -> FloatArray:
        """½ (∇u − ∇uᵀ) (e, q, 3, 3, k) of displacements (n, 3, k), with what the elements' own shape functions add."""
        found = _product(_rows(self.gradient), self.amplitudes(fields))
        found = found.reshape(len(found), -1, 3, *found.shape[2:])
        return 0.5 * (found.swapaxes(2, 3) - found)

    def amplitudes(self, fields: FloatArray) -> FloatArray:
        """Displacements (e, a + b, 3, k) of the nodes, and amplitudes of the own shape functions in equilibrium."""
        local = fields[self.nodes]
        if self.gradient.shape[2] == self.nodes.shape[1]:
            return local
        amplitude = self.eliminated(self.elastic)[1] @ local.reshape(len(local), -1, local.shape[3])
        return np.concatenate([local, amplitude.reshape(len(local), -1, 3, local.shape[3])], axis=1)

    def products(self, slopes: FloatArray, pairs: IntArray) -> FloatArray:
        """Strains (e, r, p), shear twice, of second order of pairs (p, 2) of fields: ½ sym G_aᵀ G_b."""
        first, second = (np.unique(one, return_inverse=True) for one in pairs.T)
        # Products of all that are in any pair: small matrices, several times as fast as pair by pair.
        every = self.all_products(slopes[..., first[0]], slopes[..., second[0]])
        # Twice as fast as an index, since it does not look for those out of range.
        return every.reshape(*every.shape[:2], -1).take(first[1] * len(second[0]) + second[1], axis=2, mode="clip")

    def all_products(self, one: FloatArray, other: FloatArray) -> FloatArray:
        """The same (e, r, k, l) of all pairs of two kinds of slopes (e, s, 3, k) and (e, s, 3, l)."""
        i, j = self.rows.T
        left = np.where(i == j, 0.25, 0.5)[:, None, None] * np.concatenate([one[:, i], one[:, j]], axis=2)
        return left.swapaxes(2, 3) @ np.concatenate([other[:, j], other[:, i]], axis=2)

    def strains(self, fields: FloatArray) -> FloatArray:
        """Strains (e, r, k), shear twice, of displacements (n, 3, k)."""
        local = self.amplitudes(fields)
        return self.undeformed_operator @ local.reshape(len(local), -1, local.shape[3])

    def work(self, strains: FloatArray) -> FloatArray:
        """What works on strains (e, r, k): stress times volume, of the same shape."""
        stress = self.elasticity @ strains.reshape(len(strains), 6, -1)
        return stress.reshape(len(stress), -1, strains.shape[2]) * np.tile(self.volume, 6)[:, :, None]

    def nodal(self, work: FloatArray, slopes: FloatArray | None = None) -> FloatArray:
        """Forces (e, a + b, 3, …, k) of what works on strains (e, r, k) where places have slopes, as of `operator`."""
        several = () if slopes is None else slopes.shape[3:]
        found = (self.undeformed_operator if slopes is None else self.operator(slopes)).swapaxes(1, 2) @ work
        return found.reshape(len(found), -1, 3, *several, work.shape[2])

    def operator(self, slopes: FloatArray) -> FloatArray:
        """B (e, r, 3(a + b)): Green-Lagrange strains, shear twice, per displacement, where places have slopes.

        Of several slopes (e, s, 3, …) all at once.
        """
        base, slope = slopes.reshape(*slopes.shape[:2], 1, -1), self.shape_slopes[..., None]
        i, j = self.rows.T
        b = slope[:, i] * base[:, j]
        # From the first row of shear on.
        last = slice(int(np.argmin(i == j)), None)
        b[:, last] += slope[:, j[last]] * (np.where(i == j, 0.0, 1.0)[last, None, None] * base[:, i[last]])
        return b.reshape(*b.shape[:2], -1)

    @cached_property
    def undeformed_operator(self) -> FloatArray:
        """`operator` of the undeformed elements."""
        return self.operator(self.undeformed)

    @cached_property
    def elastic(self) -> FloatArray:
        """∫ Bᵀ C B dV (e, 3(a + b), 3(a + b)) of the undeformed elements."""
        return self.undeformed_operator.swapaxes(1, 2) @ self.work(self.undeformed_operator)

    @property
    def undeformed(self) -> FloatArray:
        """Slopes (1, 3q, 3) of the undeformed places."""
        return np.tile(np.eye(3), (self.gradient.shape[1], 1))[None]

    def geometric(self, work: FloatArray) -> FloatArray:
        """Stiffness (e, a + b, a + b), in each direction, of what works on strains (e, r)."""
        (i, j), slope = self.rows.T, self.shape_slopes
        half = (slope[:, i] * (work * np.where(i == j, 0.5, 1.0))[..., None]).swapaxes(1, 2) @ slope[:, j]
        return half + half.swapaxes(1, 2)

    def turned(self, turn: FloatArray) -> FloatArray:
        """Slopes (e, s, 3, k) that turns (e, q, 3, 3, k) give to the undeformed places."""
        return turn.swapaxes(2, 3).reshape(len(turn), -1, 3, turn.shape[4])

    def relaxed(self, nodal: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nodal forces of initial stresses with forces (e, a + b, 3, k) that the own shape functions have relaxed.

        Returns
        -------
        forces : (e, a, 3, k) float
            N.
        energies : (k, k) float
            What relaxing takes away of twice the strain energy, J; (0, 0) where elements have no such functions.
        """
        outer, amplitude = nodal[:, : self.nodes.shape[1]], self._own_response(nodal)
        if not amplitude.size:
            return outer, np.zeros((0, 0))
        inner = nodal[:, self.nodes.shape[1] :].reshape(amplitude.shape)
        back = self.elastic[:, : self.own.start, self.own] @ amplitude
        energies: FloatArray = np.einsum("eik,eil->kl", inner, amplitude, optimize=True)
        return outer - back.reshape(outer.shape), energies

    def relaxation(self, work: FloatArray) -> FloatArray:
        """Strains (e, r, k) by which the elements' own shape functions relax what works on strains."""
        return -self.undeformed_operator[:, :, self.own] @ self._own_response(self.nodal(work))

    def _own_response(self, nodal: FloatArray) -> FloatArray:
        """What forces (e, a + b, 3, k) do to the elements' own unknowns (e, 3b, k)."""
        inner = nodal[:, self.nodes.shape[1] :].reshape(len(nodal), -1, nodal.shape[3])
        if not inner.size:
            return inner
        return np.linalg.solve(self.elastic[:, self.own, self.own], inner).astype(np.float64)


def _rows(gradient: FloatArray) -> FloatArray:
    """Gradients (e, q, a, 3) as slopes (e, 3q, a)."""
    return gradient.swapaxes(2, 3).reshape(len(gradient), -1, gradient.shape[2])


def _product(slopes: FloatArray, local: FloatArray) -> FloatArray:
    """Slopes (e, s, 3, k) by those of shape functions (e or 1, s, a) from their amplitudes (e, a, 3, k)."""
    found = slopes @ local.reshape(*local.shape[:2], -1)
    return found.reshape(*found.shape[:2], *local.shape[2:])


def cells(mesh: Mesh, block: ElementBlock, size: int) -> Iterator[tuple[slice, Cells]]:
    """Yield a block's elements at their stiffness points, some at a time.

    Parameters
    ----------
    mesh : Mesh
    block : ElementBlock
        Every element with a material.
    size : int
        Elements at a time.

    Yields
    ------
    places : slice
        In the block.
    cells : Cells
    """
    shape, rule = block.type.shape, block.type.stiffness
    value, slope = shape.value(rule.points), shape.gradient(rule.points)
    for first in range(0, len(block.labels), size):
        places = slice(first, min(first + size, len(block.labels)))
        nodes = block.connectivity[places]
        corners = mesh.points[nodes]
        inverse, determinant = jacobians(corners, slope)
        gradient = slope @ inverse
        if block.type.incompatible:
            gradient = np.concatenate([gradient, _incompatible(corners, determinant, block.type)], axis=2)
        chosen = block.part(np.arange(places.start, places.stop))
        yield places, Cells(nodes, value, gradient, determinant * rule.weights, elasticity(mesh, chosen))


def kept_cells(mesh: Mesh, block: ElementBlock, size: int) -> Iterator[Cells]:
    """The same of a mesh's own block; of few elements the mesh keeps them: they are asked for many times."""
    numbers = 18 * len(block.type.stiffness.weights) * block.connectivity.size
    if numbers > _KEPT:
        yield from (some for _, some in cells(mesh, block, size))
        return
    key = f"cells {id(block)}"
    if key not in mesh.kept:
        mesh.kept[key] = [some for _, some in cells(mesh, block, len(block.labels))]
    for whole in mesh.kept[key]:
        yield from (whole.part(slice(start, start + size)) for start in range(0, len(whole.nodes), size))


def elasticity(mesh: Mesh, block: ElementBlock) -> FloatArray:
    """Elasticity of each element in global axes.

    Parameters
    ----------
    mesh : Mesh
    block : ElementBlock
        Every element with a material.

    Returns
    -------
    (n_elements, 6, 6) float
        N/m²; from strain xx, yy, zz and twice xy, yz, zx to stress xx, yy, zz, xy, yz, zx.
    """
    found = np.array([material.elasticity for material in mesh.materials])[block.material]
    if block.axes is None:
        return found
    turn = turning(block.axes)
    return turn @ found @ turn.swapaxes(1, 2)


def turning(axes: FloatArray) -> FloatArray:
    """Stress xx, yy, zz, xy, yz, zx (e, 6, 6) of A S Aᵀ by that of S, for A (e, 3, 3).

    The transpose of that of Aᵀ turns strain, shear twice.
    """
    i, j = np.array(VOIGT).T
    both = axes[:, i[:, None], i] * axes[:, j[:, None], j] + axes[:, i[:, None], j] * axes[:, j[:, None], i]
    return np.where(i == j, 0.5, 1.0) * both


def _incompatible(corners: FloatArray, determinant: FloatArray, kind: ElementType) -> FloatArray:
    """Gradients (e, q, 3, 3) of 1 − ξ_b² by the centre's Jacobian: −2 ξ_b (j₀/j) J₀⁻ᵀ e_b."""
    inverse, size = jacobians(corners, kind.shape.gradient(np.zeros((1, 3))))
    return -2.0 * np.einsum("qb,eq,ebJ->eqbJ", kind.stiffness.points, size / determinant, inverse[:, 0])


# Strains in the plane, and shear across it, among xx, yy, zz, xy, yz, zx.
_PLANE, _ACROSS = np.array([0, 1, 3]), np.array([5, 4])
# Sine of the angle to the normal below which the first axis gives no direction: 0.1 degrees.
_NORMAL = np.sin(np.radians(0.1))
# Bending stiffness that differs by less is the same in all directions.
_EVEN = 1e-6


@dataclass(frozen=True, slots=True)
class Laminate:
    """Shells of the same material.

    Attributes
    ----------
    heights : (l + 1,) float
        Of the layers' faces, −1 to 1.
    elastic : (l, 6, 6) float
        In the material's axes, N/m²; across, the modulus alone, which keeps the thickness.
    axes : (e, 3, 3) float or None
        The material's, as columns; None where it has no direction.
    fixed : bool
        Whether the third of them is that of the angles, and not the shells' normal.
    bending : float
        As of `Material`.
    """

    heights: FloatArray
    elastic: FloatArray
    axes: FloatArray | None
    fixed: bool
    bending: float

    def rule(self, whole: Quadrature) -> tuple[Quadrature, IntArray]:
        """A rule with two points across each layer for one with two across all, and the layer of each point."""
        plane = whole.points[:, 2] > 0.0
        middle, half = 0.5 * (self.heights[1:] + self.heights[:-1]), 0.5 * np.diff(self.heights)
        across = (middle[:, None] + half[:, None] * [-(3.0**-0.5), 3.0**-0.5]).ravel()
        count, places = int(plane.sum()), whole.points[plane, :2]
        points = np.column_stack([np.tile(places, (across.size, 1)), np.repeat(across, count)])
        weights = np.tile(whole.weights[plane], across.size) * np.repeat(half, 2 * count)
        return Quadrature(points, weights), np.repeat(np.arange(half.size), 2 * count)

    def at(self, local: FloatArray, layer: int) -> FloatArray:
        """Elasticity (e or 1, 6, 6) of a layer in axes (e, 3, 3), rows, the third the normal."""
        if self.axes is None:
            return self.elastic[layer][None]
        normal, first = local[:, 2], self.axes[:, :, 0]
        along = first - np.sum(first * normal, axis=1, keepdims=True) * normal
        steep = np.linalg.norm(along, axis=1) < _NORMAL
        third = self.axes[steep, :, 2]
        along[steep] = third - np.sum(third * normal[steep], axis=1, keepdims=True) * normal[steep]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        below = np.sum(self.axes[:, :, 2] * normal, axis=1, keepdims=True) < 0.0
        up = np.where(below & self.fixed, -1.0, 1.0) * normal
        turn = turning(local @ np.stack([along, np.cross(up, along), up], axis=2))
        return turn @ self.elastic[layer] @ turn.swapaxes(1, 2)


def laminates(mesh: Mesh, block: ElementBlock) -> Iterator[tuple[IntArray, Laminate]]:
    """Shells of a block by their material: places in the block, and what they are made of."""
    for row in np.unique(block.material).tolist():
        chosen, material = np.flatnonzero(block.material == row), mesh.materials[row]
        axes = np.tile(np.eye(3), (len(chosen), 1, 1)) if block.axes is None else block.axes[chosen]
        directed = material.layers or material.constants is not None
        yield chosen, Laminate(*stack(material), axes if directed else None, not material.by_normal, material.bending)


def bent(strains: FloatArray, points: FloatArray, factor: float) -> FloatArray:
    """Strains (q, …, 6, r) at points in pairs across the middle: those in the plane that are odd there by a factor."""
    other = (np.abs(points[:, None] - points * [1.0, 1.0, -1.0]).max(axis=2) < _EVEN).argmax(axis=1)
    changed = strains.copy()
    changed[..., _PLANE, :] += 0.5 * (factor - 1.0) * (strains - strains[other])[..., _PLANE, :]
    return changed


@cache
def stack(material: Material) -> tuple[FloatArray, FloatArray]:
    """Heights (l + 1,) of the faces of a material's layers, −1 to 1, and their elasticity (l, 6, 6) in its axes."""
    layers = material.layers or (Layer(1.0, 0.0, tuple(material.elasticity.ravel().tolist())),)
    heights = np.cumsum([0.0, *(layer.share for layer in layers)])
    heights = 2.0 * heights / heights[-1] - 1.0
    soft = np.linalg.inv(np.array([layer.constants for layer in layers]).reshape(-1, 6, 6))
    elastic = np.zeros_like(soft)
    for part in (_PLANE, _ACROSS):
        elastic[:, part[:, None], part] = np.linalg.inv(soft[:, part[:, None], part])
    elastic[:, 2, 2] = 1.0 / soft[:, 2, 2]
    elastic = _turned(elastic, np.array([layer.angle for layer in layers]))
    # Bending about either axis by itself is another thing in other axes: those of the largest bending stiffness.
    main = _stiffest(np.einsum("lij,l->ij", elastic[:, _PLANE[:, None], _PLANE], np.diff(heights**3)))
    whole = np.zeros((1, 6, 6))
    whole[0, _ACROSS[:, None], _ACROSS] = _shear(0.5 * heights, _turned(elastic, np.full(len(layers), -main)))
    elastic[:, _ACROSS[:, None], _ACROSS] = _turned(whole, np.array([main]))[:, _ACROSS[:, None], _ACROSS]
    return heights, elastic


def _turned(elastic: FloatArray, angle: FloatArray) -> FloatArray:
    """Elasticity (l, 6, 6) turned about the third axis by angles (l,), rad."""
    turn = np.tile(np.eye(3), (len(angle), 1, 1))
    turn[:, 0, 0], turn[:, 1, 1] = np.cos(angle), np.cos(angle)
    turn[:, 1, 0], turn[:, 0, 1] = np.sin(angle), -np.sin(angle)
    both = turning(turn)
    return both @ elastic @ both.swapaxes(1, 2)


def _stiffest(bend: FloatArray) -> float:
    """Angle, rad, of the direction in which the bending stiffness (3, 3) is largest."""

    def slopes(angle: float) -> tuple[float, float, float]:
        c, s = np.cos(2.0 * angle), np.sin(2.0 * angle)
        place, first = np.array([0.5 + 0.5 * c, 0.5 - 0.5 * c, s]), np.array([-s, s, 2.0 * c])
        second = np.array([-2.0 * c, 2.0 * c, -4.0 * s])
        return place @ bend @ place, first @ bend @ place, first @ bend @ first + second @ bend @ place

    angles = np.linspace(0.0, np.pi, 180, endpoint=False)
    sizes = [slopes(angle)[0] for angle in angles]
    if np.ptp(sizes) < _EVEN * max(sizes):
        return 0.0
    best: float = angles[np.argmax(sizes)]
    for _ in range(4):
        _, slope, curve = slopes(best)
        best -= slope / curve
    return best


def _shear(z: FloatArray, elastic: FloatArray) -> FloatArray:
    """Shear stiffness (2, 2) of zx and yz, over the thickness, of layers between heights over it."""
    plane, across = elastic[:, _PLANE[:, None], _PLANE], elastic[:, _ACROSS[:, None], _ACROSS]
    stretch, both, bend = (np.einsum("lij,l->ij", plane, np.diff(z**power) / power) for power in (1, 2, 3))
    flexible = np.linalg.inv(np.block([[stretch, both], [both, bend]]))[:, 3:]
    # Stress by moments is linear across a layer, so is the shear by shear forces quadratic.
    along, length = np.polynomial.legendre.leggauss(3)
    below: FloatArray = np.zeros((2, 2))
    soft: FloatArray = np.zeros((2, 2))
    rows, columns = np.array([[0, 2], [2, 1]]), np.array([[0, 1], [0, 1]])
    for low, high, own, shear in zip(z[:-1], z[1:], plane, across, strict=True):

        def upto(height: float, low: float = low, own: FloatArray = own) -> FloatArray:
            first, second = height - low, 0.5 * (height**2 - low**2)
            return (own @ (first * flexible[:3] + second * flexible[3:]))[rows, columns]

        for place, weight in zip(along, length, strict=True):
            stress = below + upto(0.5 * (low + high + place * (high - low)))
            soft += 0.5 * weight * (high - low) * stress.T @ np.linalg.solve(shear, stress)
        below = np.asarray(below + upto(high), dtype=np.float64)
    return np.linalg.inv(soft).astype(np.float64)
