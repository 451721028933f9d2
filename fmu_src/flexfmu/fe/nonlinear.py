"""Static equilibrium of the whole finite element model with geometric nonlinearity: the reference of reduced bodies.

Total Lagrangian: the second Piola-Kirchhoff stress is linear in the Green-Lagrange strain (Saint Venant-Kirchhoff), as
CalculiX has it for *ELASTIC with NLGEOM. Loads keep their direction and their distribution over the undeformed body.
Newton's method with load increments that are cut back where it fails. Source: J. Bonet, R. D. Wood, Nonlinear Continuum
Mechanics for Finite Element Analysis, 2nd ed., chapter 9.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import felupe
import numpy as np
import scipy.sparse as sp

from ..errors import AccuracyError, ModelError
from ..mesh.model import ElementBlock, FloatArray, IntArray, Mesh
from ..progress import Reporter
from .elements import rule
from .factorisation import Factorisation, dissection_order

# |residual| / |load|: Newton's last iteration goes far below it.
_TOLERANCE = 1e-8
# |change| / |displacement| from which on a soft body on stiff elements has settled although round-off of its internal
# forces keeps the residual above that, but not above this part of the load.
_SETTLED, _ROUND_OFF = 1e-9, 1e-4
_ITERATIONS = 12
# An increment that took fewer iterations lets the next one be twice as long.
_EASY = 6
# The first part of the load: one increment for all of it might land beyond a limit load on the far side.
_FIRST = 0.25
# Displacement of an increment over what the tangent at its start foresees; near a limit load it grows without bound.
_JUMP = 3.0
# The smallest part of the load that an increment may be.
_SMALLEST = 1e-4


@dataclass(frozen=True, slots=True)
class LoadPath:
    """Equilibria along a growing load.

    Attributes
    ----------
    factor : (f,) float
        Parts of the load.
    displacement : (f, 3n) float
        m.
    increments, iterations : int
        What it took.
    """

    factor: FloatArray
    displacement: FloatArray
    increments: int
    iterations: int


class _Body:
    """Internal forces and their derivative at a displacement."""

    def __init__(self, mesh: Mesh, spring: FloatArray):
        self._size = len(mesh.points)
        self._spring = spring.ravel()
        self._parts = [part for block in mesh.blocks for part in _solids(mesh, block)]

    def forces(self, displacement: FloatArray) -> FloatArray:
        """Internal forces (3n,), N."""
        result = self._spring * displacement
        for field, solid in self._parts:
            field[0].values[:] = displacement.reshape(-1, 3)
            result += solid.assemble.vector(field).toarray().ravel()
        return result

    def tangent(self, displacement: FloatArray) -> sp.csr_array:
        """Their derivative (3n, 3n), N/m."""
        total = sp.csr_array(sp.diags_array(self._spring))
        for field, solid in self._parts:
            field[0].values[:] = displacement.reshape(-1, 3)
            total = total + sp.csr_array(solid.assemble.matrix(field))
        return sp.csr_array(0.5 * (total + total.T))


def _solids(mesh: Mesh, block: ElementBlock) -> list[tuple[felupe.FieldContainer, felupe.SolidBody]]:
    choice = rule(block.type)
    found = []
    for index in np.unique(block.material):
        material = mesh.materials[int(index)]
        e, nu = material.youngs_modulus, material.poissons_ratio
        lame, shear = e * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 0.5 * e / (1.0 + nu)
        law = felupe.Material(stress=_stress, elasticity=_elasticity, lame=lame, shear=shear)
        cells = block.connectivity[block.material == index]
        region = felupe.Region(felupe.Mesh(mesh.points, cells, "unused"), choice.element, choice.stiffness)
        field = felupe.FieldContainer([felupe.Field(region, dim=3)])
        found.append((field, felupe.SolidBody(law, field)))
    return found


def _second_stress(gradient: FloatArray, lame: float, shear: float) -> FloatArray:
    """Second Piola-Kirchhoff stress S = λ tr(E) I + 2μE of deformation gradients (3, 3, ...)."""
    strain = 0.5 * (np.einsum("kI...,kJ...->IJ...", gradient, gradient) - _identity(gradient))
    result: FloatArray = 2.0 * shear * strain + lame * np.einsum("II...->...", strain) * _identity(gradient)
    return result


def _identity(like: FloatArray) -> FloatArray:
    return np.eye(3).reshape(3, 3, *(1,) * (like.ndim - 2))


def _stress(x: list[FloatArray], lame: float, shear: float) -> list[FloatArray]:
    """First Piola-Kirchhoff stress P = F S, in the form that felupe asks for."""
    gradient = x[0]
    return [np.einsum("iM...,MJ...->iJ...", gradient, _second_stress(gradient, lame, shear)), x[-1]]


def _elasticity(x: list[FloatArray], lame: float, shear: float) -> list[FloatArray]:
    """∂P_iJ/∂F_kL = δ_ik S_JL + λ F_iJ F_kL + μ [(F Fᵀ)_ik δ_JL + F_iL F_kJ]."""
    f = x[0]
    stress, one = _second_stress(f, lame, shear), np.eye(3)
    result = np.einsum("ik,JL...->iJkL...", one, stress)
    result += lame * np.einsum("iJ...,kL...->iJkL...", f, f)
    result += shear * np.einsum("iL...,kJ...->iJkL...", f, f)
    result += shear * np.einsum("iM...,kM...,JL->iJkL...", f, f, one)
    return [result]


def load_path(
    mesh: Mesh, free: IntArray, spring: FloatArray, load: FloatArray, factors: Sequence[float], report: Reporter
) -> LoadPath:
    """Equilibria of the whole model under parts of a load.

    Parameters
    ----------
    mesh : Mesh
        Every element with a material.
    free : (k,) int
        Degrees of freedom that no support holds.
    spring : (n, 3) float
        Stiffness of springs to the ground, N/m.
    load : (3n,) float
        Nodal forces, N.
    factors : sequence of float
        Parts of the load at which equilibria are wanted, ascending and positive.
    report : Reporter

    Returns
    -------
    LoadPath

    Raises
    ------
    AccuracyError
        No equilibrium is found beyond some part of the load.
    """
    body = _Body(mesh, spring)
    size = float(np.linalg.norm(load[free]))
    u = np.zeros(load.size)
    order = dissection_order(body.tangent(u)[free][:, free], free // 3)
    found, reached, increment = [], 0.0, _FIRST * float(factors[-1])
    increments = iterations = 0
    for factor in factors:
        while reached < factor:
            target = min(factor, reached + increment)
            solution, used = _newton(body, free, order, u, target * load, size)
            iterations += used
            increments += 1
            if solution is None:
                increment = 0.5 * (target - reached)
                if increment < _SMALLEST:
                    raise AccuracyError(
                        f"no equilibrium of the finite element model beyond {100.0 * reached:.2f} % of the load: it is "
                        "near a limit or critical load; lower the load"
                    )
                continue
            u, reached = solution, target
            report.note(f"{100.0 * reached:.4g} % of the load after {used} iterations")
            if used < _EASY:
                increment *= 2.0
        found.append(u.copy())
    return LoadPath(np.asarray(factors, dtype=np.float64), np.array(found), increments, iterations)


def _newton(
    body: _Body, free: IntArray, order: IntArray, start: FloatArray, load: FloatArray, size: float
) -> tuple[FloatArray | None, int]:
    """Newton's method from `start`; None where it fails, or leaves the stable path that leads from there."""
    u, foreseen = start.copy(), 0.0
    residual = load[free] - body.forces(u)[free]
    for iteration in range(1, _ITERATIONS + 1):
        try:
            tangent = Factorisation(body.tangent(u)[free][:, free], free // 3, order)
        except ModelError:
            return None, iteration
        if not tangent.positive_definite:
            return None, iteration
        change = tangent.solve(residual)
        if iteration == 1:
            foreseen = float(np.linalg.norm(change))
        u[free] += change
        residual = load[free] - body.forces(u)[free]
        error = float(np.linalg.norm(residual))
        if not np.isfinite(error):
            return None, iteration
        settled = float(np.linalg.norm(change)) <= _SETTLED * float(np.linalg.norm(u)) and error <= _ROUND_OFF * size
        if error <= _TOLERANCE * size or settled:
            # Much farther than the tangent foresaw: a jump to another branch.
            jumped = float(np.linalg.norm(u - start)) > _JUMP * foreseen
            return (None if jumped else u), iteration
    return None, _ITERATIONS
