"""The energy of strain of second order that no displacement takes away, docs/theory.md section 4c."""

from dataclasses import dataclass

import numpy as np

from ..files.basics import FloatArray

# Part of a shape's energy below which other coordinates do not hold it.
_GONE = 1e-9


@dataclass(frozen=True, slots=True)
class Membrane:
    """Stretches σ_r = l_r·q + qᵀS_r q; the strain energy is ½ qᵀΛq + Σ s_r (σ_r² − (l_r·q)²).

    Attributes
    ----------
    quadratic : (R, m, m) float
        S_r, J^½/(kg m²); symmetric.
    linear : (R, m) float
        l_r, J^½/(kg^½ m). Where it is not zero, √2 Λ⁻¹ l_r is a shape of unit energy, orthogonal to the others.
    sign : (R,) float
        s_r: 1, or −1 of sections that flatten as they bend.
    """

    quadratic: FloatArray
    linear: FloatArray
    sign: FloatArray

    @property
    def words(self) -> str:
        """What there is, for people."""
        flat = int((self.sign < 0.0).sum())
        shapes = int(np.any(self.linear != 0.0, axis=1).sum())
        found = [f"{len(self.sign) - flat} stretches"] * (len(self.sign) > flat)
        found += [f"{shapes} of shapes that bend the body themselves"] * (shapes > 0)
        return ", ".join(found + [f"{flat} flattenings"] * (flat > 0))

    def shift(self, stiffness: FloatArray) -> FloatArray:
        """Second derivatives (m, m, m) of the modal coordinates that the shapes take of the second-order displacement.

        Parameters
        ----------
        stiffness : (m,) float
            Λ, 1/s².
        """
        shapes = np.divide(self.linear, stiffness, out=np.zeros_like(self.linear), where=stiffness > 0.0)
        return 4.0 * np.einsum("rc,rab->cab", shapes, self.quadratic)

    def taken(self, stiffness: FloatArray, q: FloatArray) -> FloatArray:
        """Modal coordinates (m,) by which q, the shapes being in it, falls short of a motion at second order."""
        return 0.5 * self.shift(stiffness) @ q @ q

    def turned(self, turn: FloatArray, stiffness: FloatArray) -> "Membrane":
        """The same in coordinates z with q = turn @ z.

        Parameters
        ----------
        turn : (m, k) float
        stiffness : (k,) float
            Of z: turnᵀ Λ turn is its diagonal matrix.

        Returns
        -------
        Membrane
        """
        quadratic, linear = turn.T @ self.quadratic @ turn, self.linear @ turn
        own = np.any(self.linear != 0.0, axis=1)
        shapes = np.divide(linear[own], stiffness, out=np.zeros_like(linear[own]), where=stiffness > 0.0)
        # What z holds of the shapes, made orthonormal again.
        held, axes = np.linalg.eigh(2.0 * linear[own] @ shapes.T)
        axes, root = axes[:, held > _GONE], np.sqrt(held[held > _GONE])[:, None]
        return Membrane(
            np.concatenate([quadratic[~own], root[:, :, None] * np.tensordot(axes.T, quadratic[own], axes=1)]),
            np.concatenate([linear[~own], axes.T @ linear[own] / root]),
            np.concatenate([self.sign[~own], np.ones(len(root))]),
        )
