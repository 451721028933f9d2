"""What elements are at their integration points: gradients of shape functions, volume, elasticity.

C3D8I adds to its shape functions three of its own, 1 − ξ_b², whose gradients are taken with the Jacobian of the
element's centre, scaled by its determinant's ratio, so that a constant strain stays one (R. L. Taylor, P. J. Beresford,
E. L. Wilson, Int. J. Numer. Meth. Engng. 10 (1976) 1211). Their amplitudes are eliminated element by element.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..files.array_types import FloatArray, IntArray
from ..mesh.blocks import ElementBlock, jacobians
from ..mesh.elements import ElementType
from ..mesh.model import Mesh

# Places of the components xx, yy, zz, xy, yz, zx.
VOIGT = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
_ROWS, _COLUMNS = (np.array(index) for index in zip(*VOIGT, strict=True))


@dataclass(frozen=True, slots=True)
class Cells:
    """Some elements of one type, for their stiffness.

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

    def displacement_gradient(self, fields: FloatArray) -> FloatArray:
        """∂u_i/∂X_J (e, q, 3, 3, k) of displacements (n, 3, k), with what the elements' own shape functions add."""
        local = fields[self.nodes]
        if self.gradient.shape[2] > self.nodes.shape[1]:
            _, own = self.eliminated(self.stiffness())
            amplitude = own @ local.reshape(len(local), -1, local.shape[3])
            local = np.concatenate([local, amplitude.reshape(len(local), -1, 3, local.shape[3])], axis=1)
        return np.einsum("eaik,eqaJ->eqiJk", local, self.gradient, optimize=True)

    def relaxed(self, stress: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Nodal forces of initial stresses (e, q, 3, 3, k) that the elements' own shape functions have relaxed.

        Returns
        -------
        forces : (e, a, 3, k) float
            ∫ σ ∂N/∂X dV, N.
        energies : (k, k) float
            What relaxing takes away of twice the strain energy, J.
        """
        nodal, amplitude = self._own_response(stress)
        outer = nodal[:, : self.nodes.shape[1]]
        if not amplitude.size:
            return outer, np.zeros((stress.shape[4], stress.shape[4]))
        inner = nodal[:, self.nodes.shape[1] :].reshape(amplitude.shape)
        back = self.stiffness()[:, : self.own.start, self.own] @ amplitude
        energies: FloatArray = np.einsum("eik,eil->kl", inner, amplitude, optimize=True)
        return outer - back.reshape(outer.shape), energies

    def relaxation(self, stress: FloatArray) -> FloatArray:
        """∂u_i/∂X_J (e, q, 3, 3, k) by which the elements' own shape functions relax initial stresses of that shape."""
        amplitude = self._own_response(stress)[1].reshape(len(stress), -1, 3, stress.shape[4])
        own = self.gradient[:, :, self.nodes.shape[1] :]
        result: FloatArray = -np.einsum("ebik,eqbJ->eqiJk", amplitude, own, optimize=True)
        return result

    def _own_response(self, stress: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Forces (e, a + b, 3, k) of initial stresses, and what they do to the elements' own unknowns (e, 3b, k)."""
        weighted = stress * self.volume[:, :, None, None, None]
        nodal = np.einsum("eqaJ,eqiJk->eaik", self.gradient, weighted, optimize=True)
        inner = nodal[:, self.nodes.shape[1] :].reshape(len(nodal), -1, stress.shape[4])
        return nodal, np.linalg.solve(self.stiffness()[:, self.own, self.own], inner) if inner.size else inner

    def stiffness(self, deformation: FloatArray | None = None) -> FloatArray:
        """∫ Bᵀ C B dV (e, 3(a + b), 3(a + b)), by default of the undeformed elements."""
        b = strain_operator(self.gradient, deformation)
        e, q, _, unknowns = b.shape
        weighted = (self.elasticity[:, None] @ b) * self.volume[:, :, None, None]
        return b.reshape(e, 6 * q, unknowns).swapaxes(1, 2) @ weighted.reshape(e, 6 * q, unknowns)

    def stress(self, strain: FloatArray) -> FloatArray:
        """Stress (e, q, 3, 3, ...) of symmetric strains of the same shape."""
        voigt = strain[:, :, _ROWS, _COLUMNS] * np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0]).reshape(
            6, *(1,) * (strain.ndim - 4)
        )
        found = np.einsum("eij,eqj...->eqi...", self.elasticity, voigt, optimize=True)
        result = np.empty_like(strain)
        result[:, :, _ROWS, _COLUMNS] = result[:, :, _COLUMNS, _ROWS] = found
        return result


def strain_operator(gradient: FloatArray, deformation: FloatArray | None = None) -> FloatArray:
    """B (e, q, 6, 3a): strain, shear twice, per displacement, from gradients (e, q, a, 3).

    Parameters
    ----------
    gradient : (e, q, a, 3) float
    deformation : (e, q, 3, 3) float, optional
        Deformation gradient at which the Green-Lagrange strain is differentiated; by default none.

    Returns
    -------
    (e, q, 6, 3a) float
    """
    e, q, a, _ = gradient.shape
    result = np.zeros((e, q, 6, a, 3))
    for row, (i, j) in enumerate(VOIGT):
        if deformation is None:
            result[:, :, row, :, i] += gradient[..., j]
            if i != j:
                result[:, :, row, :, j] += gradient[..., i]
        else:
            result[:, :, row] += gradient[..., j, None] * deformation[:, :, None, :, i]
            if i != j:
                result[:, :, row] += gradient[..., i, None] * deformation[:, :, None, :, j]
    return result.reshape(e, q, 6, 3 * a)


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
    turn = np.empty((len(found), 6, 6))
    for row, (i, j) in enumerate(VOIGT):
        for column, (k, m) in enumerate(VOIGT):
            turn[:, row, column] = block.axes[:, i, k] * block.axes[:, j, m]
            if k != m:
                turn[:, row, column] += block.axes[:, i, m] * block.axes[:, j, k]
    return turn @ found @ turn.swapaxes(1, 2)


def _incompatible(corners: FloatArray, determinant: FloatArray, kind: ElementType) -> FloatArray:
    """Gradients (e, q, 3, 3) of 1 − ξ_b² by the centre's Jacobian: −2 ξ_b (j₀/j) J₀⁻ᵀ e_b."""
    inverse, size = jacobians(corners, kind.shape.gradient(np.zeros((1, 3))))
    return -2.0 * np.einsum("qb,eq,ebJ->eqbJ", kind.stiffness.points, size / determinant, inverse[:, 0])
