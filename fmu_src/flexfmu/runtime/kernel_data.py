"""What the compiled step (kernel.c) reads of a body, as arrays."""

import numpy as np
from numpy.typing import NDArray

from .dynamics import Dynamics
from .tied_stepping import TiedSteps
from .ties import resisting
from .tree import Tree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Share of the largest below which a direction bends nothing but by round-off, and of all coordinates up to which those
# of a part are worth turning to.
_NO_BEND, _WORTH = 1e-13, 0.75


def kernel_arrays(
    dynamics: Dynamics, turning: FloatArray, tied: TiedSteps | None
) -> tuple[dict[str, FloatArray], dict[str, IntArray]]:
    """Arrays of the struct `Body` of kernel.c by name; what the body does not have is left out.

    Parameters
    ----------
    dynamics : Dynamics
    turning : (3n, m) float
    tied : TiedSteps or None

    Returns
    -------
    numbers, places : dict
        Of float, and of int.
    """
    tree, ties = dynamics.tree, dynamics.ties
    optional = {"by_load": dynamics.by_load, "by_mode": dynamics.by_mode}
    numbers = {
        "offset": tree.offset,
        "base": tree.base,
        "point": tree.point,
        "operator": tree.operator,
        "load_operator": dynamics.load_operator,
        "mass": dynamics.mass,
        "inertia": dynamics.inertia_operator,
        "omega": np.sqrt(dynamics.stiffness),
        "weight": dynamics.weight,
        "turning": turning,
        **{name: array for name, array in optional.items() if array is not None},
    }
    places = {"parent": tree.parent}
    if ties is not None and tied is not None:
        numbers |= {"tie_stiffness": ties.stiffness, "tie_lever": ties.lever, "tie_apart": ties.apart}
        numbers |= {"tie_initial": ties.initial, "material": tied.coupled_damping}
        places["pull"] = resisting(ties)
    if tree.curvature is not None:
        bending, rows = _curvature_by_parts(tree, tree.curvature)
        numbers |= bending
        places |= rows
    return numbers, places


def _curvature_by_parts(tree: Tree, curvature: FloatArray) -> tuple[dict[str, FloatArray], dict[str, IntArray]]:
    """Curvature in the coordinates that bend each part: nodes of one root, of a body that was cut one of its pieces.

    There are far fewer of them than q has, and the step's cost goes by their square. In one piece q itself stays.

    Returns
    -------
    numbers : dict
        "curvature": (r, r) of each row that has one, in turn; "basis": (r, m) of each part in turn, unless it is q.
    places : dict
        "part": (6K,) part of each row, or −1; "core": (6K,) where its (r, r) begins; "extent": (parts,) r.
    """
    modes, root = curvature.shape[-1], tree.parent.copy()
    for node, parent in enumerate(tree.parent):
        root[node] = node if parent < 0 else root[parent]
    size = np.abs(curvature).max(axis=(1, 2))
    owner = np.where(size > 0.0, np.tile(np.repeat(root, 3), 2), -1)
    part = np.full(len(owner), -1)
    bases = []
    for number, name in enumerate(np.unique(owner[owner >= 0])):
        rows = np.flatnonzero(owner == name)
        part[rows] = number
        scaled = curvature[rows] / size[rows, None, None]
        _, strength, directions = np.linalg.svd(scaled.reshape(-1, modes), full_matrices=False)
        bases.append(directions[strength > _NO_BEND * strength[0]])
    if not bases or max(len(basis) for basis in bases) > _WORTH * modes:
        part, bases = np.where(size > 0.0, 0, -1), []
    cores, core, start = [], np.zeros(len(owner)), 0
    for row in np.flatnonzero(part >= 0):
        basis = bases[part[row]] if bases else None
        cores.append(curvature[row] if basis is None else basis @ curvature[row] @ basis.T)
        core[row], start = start, start + cores[-1].size
    numbers = {"curvature": np.concatenate([c.ravel() for c in cores]) if cores else np.zeros(1)}
    if bases:
        numbers["basis"] = np.concatenate(bases)
    extent = np.array([len(basis) for basis in bases] or [modes])
    return numbers, {"part": part, "core": core.astype(np.int64), "extent": extent}
