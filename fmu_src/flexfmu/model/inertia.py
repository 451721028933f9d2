"""Mass of the deformed body (docs/theory.md, section 9; core/inertia.c), and its membrane energy (section 4c).

A lump's mass moves as one point, its centre of mass, however far the body bends. What its matter turns about that point
and how it is bent within it, goes by its frame. With w the frame's spin on its own axes the kinetic energy is

    Σ ½ m |x'|² + Σ (½ w I w + w · H v) + ½ vᵀ E v,   I = ∫ρ (|r|² 1 − r rᵀ),   H_j = ∫ρ r × e_j,

r and e_j being places and remainders (5) less their means over the lump, and E constant. Momenta of rigid motions are
exact. What is left out is that lumps turn and bend in themselves: an error that falls with the square of their size.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields

import numpy as np

from ..files.basics import FloatArray, IntArray
from .arrays import ARRAYS, settle, triangles, whole

# Part of a shape's energy below which other coordinates do not hold it.
_GONE = 1e-9


@dataclass(frozen=True, slots=True)
class Membrane:
    """Stretches σ_r = l_r·q + qᵀS_r q; the strain energy is ½ qᵀΛq + Σ s_r (σ_r² − (l_r·q)²).

    S_r is BᵀF_rB: stretches come in groups, each of which knows few coordinates Bq.

    Attributes
    ----------
    basis : (b, m) float
        B of each group in turn, kg^-½ m⁻¹.
    extent, rows : (G,) int
        How many rows of it each group has, and how many stretches.
    form : (N,) float
        F_r of each group in turn, J^½: lower triangles.
    linear : (R, m) float
        l_r, J^½/(kg^½ m). Where it is not zero, √2 Λ⁻¹ l_r is a shape of unit energy, orthogonal to the others.
    sign : (R,) float
        s_r: 1, or −1 of sections that flatten as they bend.
    stiff : (R,) float
        The same in the tangent stiffness: 0 of what a shadow's places miss at third order.
    """

    basis: FloatArray
    extent: IntArray
    rows: IntArray
    form: FloatArray
    linear: FloatArray
    sign: FloatArray
    stiff: FloatArray

    def __post_init__(self) -> None:
        """Bring the arrays into their types and check their shapes.

        Raises
        ------
        ModalFileError
            Naming the array that is wrong, and how.
        """
        numbers = sum(rows * (extent * (extent + 1) // 2) for extent, rows in zip(self.extent, self.rows, strict=False))
        sizes = {"m": self.linear.shape[-1], "b": self.extent.sum(), "R": self.rows.sum(), "N": numbers}
        settle(self, ARRAYS["membrane"], sizes, "membrane")

    @classmethod
    def of(cls, basis: FloatArray, forms: FloatArray, linear: FloatArray, *signs: FloatArray) -> "Membrane":
        """One group: B, F_r (R, b, b), l_r, s_r and its part in the stiffness."""
        return cls(basis, np.array([len(basis)]), np.array([len(linear)]), triangles(forms).ravel(), linear, *signs)

    @classmethod
    def joined(cls, several: Iterable["Membrane"]) -> "Membrane":
        """All groups of several, of the same modes."""
        return cls(*(np.concatenate([getattr(one, f.name) for one in several]) for f in fields(cls)))

    def groups(self) -> Iterator[tuple[FloatArray, FloatArray, slice]]:
        """B and F_r (r, b, b) of each group, and which of the stretches they are."""
        pairs, last = self.extent * (self.extent + 1) // 2, np.cumsum(self.rows)
        bases, forms = np.split(self.basis, np.cumsum(self.extent)), np.split(self.form, np.cumsum(self.rows * pairs))
        for basis, form, count, end, rows in zip(bases, forms, pairs, last, self.rows, strict=False):
            yield basis, whole(form.reshape(rows, count)), slice(end - rows, end)

    @property
    def quadratic(self) -> FloatArray:
        """S_r (R, m, m), J^½/(kg m²)."""
        return np.concatenate([basis.T @ forms @ basis for basis, forms, _ in self.groups()])

    @property
    def words(self) -> str:
        """What there is, for people."""
        flat, shapes = int((self.sign < 0.0).sum()), int(np.any(self.linear != 0.0, axis=1).sum())
        found = [f"{len(self.sign) - flat} stretches"] * (len(self.sign) > flat)
        found += [f"{shapes} of shapes that bend the body themselves"] * (shapes > 0)
        return ", ".join(found + [f"{flat} flattenings"] * (flat > 0))

    @property
    def shapeless(self) -> "Membrane":
        """The same without shapes that stay coordinates, or itself where it has none."""
        left = np.array([not any(row) for row in self.linear], bool)
        rest = (self.linear, self.sign, self.stiff)
        several = [Membrane.of(b, f[left[r]], *(one[r][left[r]] for one in rest)) for b, f, r in self.groups()]
        return self if left.all() else Membrane.joined(several)

    def shift(self, stiffness: FloatArray) -> FloatArray:
        """Second derivatives (m, m, m) of the modal coordinates that the shapes take of the second-order displacement.

        Parameters
        ----------
        stiffness : (m,) float
            Λ, 1/s².
        """
        shapes = np.divide(self.linear, stiffness, out=np.zeros_like(self.linear), where=stiffness > 0.0)
        return 4.0 * np.tensordot(shapes, self.quadratic, (0, 0))

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
        found = []
        for basis, forms, rows in self.groups():
            linear = self.linear[rows] @ turn
            own = np.any(self.linear[rows] != 0.0, axis=1)
            shapes = np.divide(linear[own], stiffness, out=np.zeros_like(linear[own]), where=stiffness > 0.0)
            # What z holds of the shapes, which are of one group, made orthonormal again.
            held, axes = np.linalg.eigh(2.0 * linear[own] @ shapes.T)
            axes, root = axes[:, held > _GONE], np.sqrt(held[held > _GONE])[:, None]
            of_shapes = root[:, :, None] * np.tensordot(axes.T, forms[own], axes=1), axes.T @ linear[own] / root
            signs = (np.append(one[rows][~own], np.ones(len(root))) for one in (self.sign, self.stiff))
            both = map(np.concatenate, zip((forms[~own], linear[~own]), of_shapes, strict=True))
            found.append(Membrane.of(basis @ turn, *both, *signs))
        return Membrane.joined(found)


@dataclass(frozen=True, slots=True)
class LumpedMass:
    """Mass of P lumps on S frames; arrays are made read-only.

    Attributes
    ----------
    frame : (P,) int
        The frame that carries each lump.
    mass : (P,) float
        kg.
    point : (P, 3) float
        Centres of mass, m.
    displacement : (P, 3, m) float
        Displacement of the centres per unit modal coordinate, kg^-1/2.
    turning : (S, 3, 3) float
        I of each frame: rotary inertia of its lumps about their own centres, kg m².
    sweep : (S, 3, m) float
        H of each frame, kg^1/2 m.
    curvature : (P, 3, m, m) float or None
        Second derivatives of the centres' displacements, as in `SecondOrder`, m/(kg m²).
    """

    frame: IntArray
    mass: FloatArray
    point: FloatArray
    displacement: FloatArray
    turning: FloatArray
    sweep: FloatArray
    curvature: FloatArray | None = None

    def __post_init__(self) -> None:
        """Bring the arrays into their types and check their shapes.

        Raises
        ------
        ModalFileError
            Naming the array that is wrong, and how.
        """
        settle(self, ARRAYS["inertia"], {"m": self.displacement.shape[-1], "S": len(self.turning)}, "inertia")

    def at_rest(self, frame_rotation: FloatArray) -> FloatArray:
        """Share of lumps and frames in the modal mass (m, m) at q = 0; `frame_rotation` is (S, 3, m)."""
        half = 0.5 * np.einsum("p,pia,pib->ab", self.mass, self.displacement, self.displacement, optimize=True)
        turned = 0.5 * self.turning @ frame_rotation + self.sweep
        half += np.einsum("sia,sib->ab", frame_rotation, turned, optimize=True)
        return half + half.T


@dataclass(frozen=True, slots=True)
class MassPolynomial:
    """Mass of the deformed body to second order, (13a): M(q) = 1 + Σ_k (l_k·q + qᵀV_k q) U_k.

    Attributes
    ----------
    form : (R, m, m) float
        U_k, symmetric.
    linear : (R, m) float
        l_k, kg^-1/2 m^-1.
    square : (R, m, m) float
        V_k, symmetric, kg^-1 m^-2.
    centre, centre_square : (3, m) and (3, m, m) float, or None
        Of a body that slides freely, whose M is that about the centre of mass: displacement c·q + qᵀC q of that
        centre in the root frame's axes.
    factor : (n, 2) int, or None
        Of products that are left out a coordinate, and which coordinate, or pair of slow ones behind these.
    further : (R, n) float, or None
        What these would add to l_k·q + qᵀV_k q.
    """

    form: FloatArray
    linear: FloatArray
    square: FloatArray
    centre: FloatArray | None = None
    centre_square: FloatArray | None = None
    factor: IntArray | None = None
    further: FloatArray | None = None

    def __post_init__(self) -> None:
        """Bring the arrays into their types and check their shapes.

        Raises
        ------
        ModalFileError
            Naming the array that is wrong, and how.
        """
        settle(self, ARRAYS["polynomial"], {"m": self.linear.shape[-1]}, "polynomial")


def without_frames(inertia: LumpedMass, gone: int) -> LumpedMass:
    """The mass of the same body, the first frames taken away.

    Parameters
    ----------
    inertia : LumpedMass
    gone : int
        Number of frames that are taken away. What they carry moves linearly from then on, with constant mass.

    Returns
    -------
    LumpedMass
    """
    kept = inertia.frame >= gone
    curvature = None if inertia.curvature is None else inertia.curvature[kept]
    lumps = inertia.mass[kept], inertia.point[kept], inertia.displacement[kept]
    return LumpedMass(inertia.frame[kept] - gone, *lumps, inertia.turning[gone:], inertia.sweep[gone:], curvature)
