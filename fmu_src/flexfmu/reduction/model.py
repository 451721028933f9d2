"""The supported finite element model: a mesh with materials and supports, checked to be a body that can be reduced."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..config import BodyFile, MaterialTable
from ..errors import BodyFileError, ModelError
from ..mesh.checks import connected_parts
from ..mesh.model import NO_MATERIAL, IntArray, Material, Mesh

_AXES = {"x": 0, "y": 1, "z": 2}
# Relative size of a singular value below which a rigid motion is not held.
_FREE = 1e-9


@dataclass(frozen=True, slots=True)
class Model:
    """A mesh with materials and supports.

    Attributes
    ----------
    mesh : Mesh
    fixed : (n, 3) bool
        Translations held at zero.
    """

    mesh: Mesh
    fixed: NDArray[np.bool_]

    @property
    def free(self) -> IntArray:
        """Degrees of freedom that no support holds, ascending."""
        return np.flatnonzero(~self.fixed.ravel())

    @property
    def anchored(self) -> IntArray:
        """Nodes from which distances along the body count: those held in all directions, else all held ones."""
        whole = np.flatnonzero(self.fixed.all(axis=1))
        return whole if whole.size else np.flatnonzero(self.fixed.any(axis=1))


def node_set(mesh: Mesh, name: str, key: str) -> IntArray:
    """Nodes of a named set.

    Parameters
    ----------
    mesh : Mesh
    name : str
        Upper and lower case count as the same where that is unambiguous.
    key : str
        The key of the body file that asks, for the message.

    Returns
    -------
    (k,) int

    Raises
    ------
    BodyFileError
        No such set, or an empty one.
    """
    return _named_set(mesh.node_sets, "node", name, key)


def _named_set(sets: Mapping[str, IntArray], kind: str, name: str, key: str) -> IntArray:
    match = [known for known in sets if known == name] or [k for k in sets if k.lower() == name.lower()]
    if len(match) != 1:
        there = ", ".join(sorted(sets)) or "none"
        raise BodyFileError(f"{key}: the mesh has no {kind} set {name!r}; it has: {there}")
    members = sets[match[0]]
    if not members.size:
        raise BodyFileError(f"{key}: {kind} set {name!r} is empty, expected at least one {kind}")
    return members


def element_set(mesh: Mesh, name: str, key: str) -> IntArray:
    """Elements of a named set, counted over all blocks; see `node_set`."""
    return _named_set(mesh.element_sets, "element", name, key)


def assemble_model(mesh: Mesh, config: BodyFile) -> Model:
    """Give a mesh its materials and supports.

    Parameters
    ----------
    mesh : Mesh
        Checked.
    config : BodyFile

    Returns
    -------
    Model

    Raises
    ------
    BodyFileError
        Elements without material, or a set that is not there.
    ModelError
        A part of the body is free to move.
    """
    mesh = _with_material(mesh, config.material)
    fixed = mesh.fixed.copy()
    for number, support in enumerate(config.support, start=1):
        nodes = node_set(mesh, support.nodes, f"support[{number}].nodes")
        for axis in support.fix:
            fixed[nodes, _AXES[axis]] = True
    _check_held(mesh, fixed)
    return Model(mesh, fixed)


def _with_material(mesh: Mesh, table: MaterialTable | None) -> Mesh:
    missing = sum(int(np.sum(block.material == NO_MATERIAL)) for block in mesh.blocks)
    if not missing:
        return mesh
    if table is None:
        raise BodyFileError(
            f"{missing} of {mesh.element_count} elements have no material in the mesh file: add a [material] table "
            "with youngs_modulus, poissons_ratio and density (SI)"
        )
    index = len(mesh.materials)
    blocks = tuple(
        replace(block, material=np.where(block.material == NO_MATERIAL, index, block.material)) for block in mesh.blocks
    )
    material = Material("body file", table.youngs_modulus, table.poissons_ratio, table.density)
    return replace(mesh, blocks=blocks, materials=(*mesh.materials, material))


def _check_held(mesh: Mesh, fixed: NDArray[np.bool_]) -> None:
    """Refuse a part of the mesh that can still move as a rigid body."""
    part = connected_parts(mesh)
    for number in range(int(part.max()) + 1):
        nodes = np.flatnonzero(part == number)
        arm = mesh.points[nodes] - mesh.points[nodes].mean(axis=0)
        arm = arm / max(float(np.abs(arm).max()), 1e-300)
        motions = np.zeros((nodes.size, 3, 6))
        motions[:, :, :3] = np.eye(3)
        for axis in range(3):
            motions[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arm)
        held = motions[fixed[nodes]]
        values = np.linalg.svd(held, compute_uv=False) if held.size else np.zeros(6)
        free = 6 - int(np.sum(values > _FREE * max(values.max(), 1e-300)))
        if free:
            which = "the body" if int(part.max()) == 0 else f"the part of the mesh with node {mesh.labels[nodes[0]]}"
            raise ModelError(
                f"{which} is free to move in {free} rigid motions: the supports hold {int(fixed[nodes].sum())} of its "
                "translations; add a [[support]], or join the parts where they should share nodes"
            )
