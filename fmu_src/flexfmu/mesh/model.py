"""The finite element mesh as data: nodes, blocks of solid elements, sets and materials; SI units throughout."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from flexfmu.mesh.listing import listed

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NO_MATERIAL = -1


class ElementType(Enum):
    """The solid elements that a body may be made of, by their Abaqus and CalculiX names.

    Node order is that of the decks, which is meshio's (VTK's) too for these five.
    """

    C3D4 = "C3D4"
    C3D8 = "C3D8"
    C3D10 = "C3D10"
    C3D20 = "C3D20"
    C3D20R = "C3D20R"

    @property
    def node_count(self) -> int:
        """Nodes per element."""
        return {"C3D4": 4, "C3D8": 8, "C3D10": 10, "C3D20": 20, "C3D20R": 20}[self.value]


@dataclass(frozen=True, slots=True)
class Material:
    """Isotropic linear elasticity; the same constants serve St. Venant-Kirchhoff.

    Attributes
    ----------
    name : str
    youngs_modulus : float
        N/m².
    poissons_ratio : float
        Between −1 and 0.5, both excluded.
    density : float
        kg/m³.
    """

    name: str
    youngs_modulus: float
    poissons_ratio: float
    density: float


@dataclass(frozen=True, slots=True)
class ElementBlock:
    """Elements of one type.

    Attributes
    ----------
    type : ElementType
    labels : (n_elements,) int
        The file's element numbers.
    connectivity : (n_elements, node_count) int
        Rows of `Mesh.points`.
    material : (n_elements,) int
        Rows of `Mesh.materials`; `NO_MATERIAL` where the file gives none.
    """

    type: ElementType
    labels: IntArray
    connectivity: IntArray
    material: IntArray


@dataclass(frozen=True, slots=True, repr=False)
class Mesh:
    """A body's mesh.

    Attributes
    ----------
    points : (n, 3) float
        Node coordinates, m, global frame.
    labels : (n,) int
        The file's node numbers.
    blocks : tuple of ElementBlock
    node_sets : mapping of str to (k,) int
        Rows of `points`, ascending, none twice. Names as the file spells them.
    element_sets : mapping of str to (k,) int
        Positions in the blocks' elements, laid end to end.
    materials : tuple of Material
    fixed : (n, 3) bool
        Translations that the file itself holds at zero.
    notes : tuple of str
        What the reader left unused, for the log.
    """

    points: FloatArray
    labels: IntArray
    blocks: tuple[ElementBlock, ...]
    node_sets: Mapping[str, IntArray]
    element_sets: Mapping[str, IntArray]
    materials: tuple[Material, ...]
    fixed: NDArray[np.bool_]
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Size, kinds of elements, sets."""
        kinds = ", ".join(f"{len(block.labels)} {block.type.value}" for block in self.blocks)
        sets = f"node sets {listed(self.node_sets)}; element sets {listed(self.element_sets)}"
        return f"<Mesh: {len(self.points)} nodes, {kinds or 'no elements'}; {sets}>"

    @property
    def element_count(self) -> int:
        """Number of elements over all blocks."""
        return sum(len(block.labels) for block in self.blocks)
