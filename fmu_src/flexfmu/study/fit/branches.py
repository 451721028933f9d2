"""Where a body turns in a scene, branch by branch, and joints between frames that share it out evenly.

What a frame of length l leaves out is the shortening and the work of its own bending about its mean rotation, which
goes with κ²l³ for a curvature κ. For a given number of frames the sum of that over a branch is least where each holds
the same ∫κ^⅔ dx; equal levels do no better on a body that bends alike everywhere, and worse on any other.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...build.body_model import read_body_model
from ...build.config import BodyFile
from ...files.array_types import FloatArray
from ...files.progress import Reporter
from ...model.reduced_body import GROUND, ReducedBody
from ...reduction.cut.cut import SIDES, cut_loops, cut_parts, part_configs, side_set
from ...reduction.division import distance_along, divide
from ...reduction.frames import hanging, root_frame
from ...reduction.model import Model
from ...reduction.options import BodyOptions
from ...reduction.places import node_set
from ...reduction.subdomains import carrying_frame
from ..candidates import Joints

LEVELS = 24
"""Equal levels of the model that tells where the body turns."""
# Significant digits of a joint's place.
_DIGITS = 4


@dataclass(frozen=True, slots=True)
class Branch:
    """A piece of the body between supports, junctions and ends, as frames of the model of `LEVELS` levels.

    Attributes
    ----------
    ends : tuple of str
        Interfaces and cuts beyond it, as a body file names them.
    part : int
        The part of a cut body that it belongs to.
    frames : tuple of int
        In order from the supports; places in the model's list of frames.
    near : (k + 1,) float
        Where they begin, and where the last one ends: distance from the supports, m.
    first : bool
        Whether it begins at a support; else at a junction.
    """

    ends: tuple[str, ...]
    part: int
    frames: tuple[int, ...]
    near: FloatArray
    first: bool


def find_branches(config: BodyFile) -> list[Branch]:
    """Branches of a body that lead to its interfaces and cuts.

    Parameters
    ----------
    config : BodyFile

    Returns
    -------
    list of Branch
    """
    read = read_body_model(config, Reporter())
    options, model = read.options, read.model
    if options.find_cuts:
        options, model, _ = cut_loops(options, model)
    if not options.cuts:
        return _branches(model, options, 0, len(root_frame(model, model.mesh.volume_matrices)))[0]
    opened, parts = cut_parts(model, options.cuts, options.supports)
    found: list[Branch] = []
    count = 0
    for number, (part, own) in enumerate(zip(parts, part_configs(options, opened, parts), strict=True)):
        more, frames = _branches(part.model, own, number, count)
        found, count = [*found, *more], count + frames
    return found


def _branches(model: Model, config: BodyOptions, part: int, offset: int) -> tuple[list[Branch], int]:
    """Branches of a model in one piece, and its number of frames."""
    mesh = model.mesh
    supported = hanging(model, config)
    domains = divide(mesh, mesh.volume_matrices, mesh.faces, supported, LEVELS).subdomains
    distance = distance_along(mesh, supported)
    middle = np.concatenate([distance[block.connectivity].mean(axis=1) for block in mesh.blocks])
    cuts = {side_set(cut, side): cut for cut in config.cuts for side in SIDES}
    beyond: dict[int, list[str]] = {}
    for table in config.interfaces:
        # Others are a support's springs.
        if table.name.isidentifier() or table.name in cuts:
            s = carrying_frame(domains, node_set(mesh, table.nodes, table.name))
            while s != GROUND:
                beyond.setdefault(s, []).append(cuts.get(table.name, table.name))
                s = domains[s].parent
    chains: list[list[int]] = []
    chain_of: dict[int, int] = {}
    for s in sorted(beyond):
        parent = domains[s].parent
        siblings = sum(domains[other].parent == parent for other in beyond)
        if parent == GROUND or siblings > 1:
            chain_of[s] = len(chains)
            chains.append([s])
        else:
            chain_of[s] = chain_of[parent]
            chains[chain_of[s]].append(s)

    def begins(s: int) -> float:
        """Distance between the last element before a frame's joint and the first one beyond it."""
        if domains[s].parent == GROUND:
            return 0.0
        first, before = float(middle[domains[s].elements].min()), middle[domains[domains[s].parent].elements]
        return 0.5 * (first + float(before[before < first].max(initial=0.0)))

    found = []
    for chain in chains:
        near = np.array([*map(begins, chain), float(distance[domains[chain[-1]].body.nodes].max())])
        frames, root = tuple(offset + s for s in chain), domains[chain[0]].parent == GROUND
        found.append(Branch(tuple(beyond[chain[0]]), part, frames, near, root))
    return found, len(domains)


def turning(branch: Branch, body: ReducedBody, states: Sequence[FloatArray]) -> FloatArray:
    """How far each of a branch's pieces turns in itself: the largest of some states.

    Parameters
    ----------
    branch : Branch
    body : ReducedBody
        Of `LEVELS` levels.
    states : sequence of (m,) float
        Modal coordinates.

    Returns
    -------
    (k,) float
        rad.
    """
    frames = list(branch.frames)
    operator = body.frame_rotation[frames] - body.joint_rotation[frames]
    # The mean rotation of a piece that turns evenly is half the turn from end to end.
    angles = [2.0 * np.linalg.norm(operator @ q, axis=1) for q in states]
    result: FloatArray = np.max(angles, axis=0, initial=0.0)
    return result


def spread_joints(branches: Sequence[Branch], turns: Sequence[FloatArray], counts: Sequence[int]) -> Joints:
    """Joints that divide each branch into so many frames with the same share of its turning.

    Parameters
    ----------
    branches : sequence of Branch
    turns : sequence of (k,) float
        Of each branch, as of `turning`.
    counts : sequence of int
        Frames of each.

    Returns
    -------
    Joints
    """
    size = max(float(branch.near[-1]) for branch in branches)
    places: dict[str, set[float]] = {}
    part_of: dict[str, int] = {}
    for branch, turn, count in zip(branches, turns, counts, strict=True):
        length = np.diff(branch.near)
        share = turn ** (2.0 / 3.0) * length ** (1.0 / 3.0)
        if not np.any(share):
            share = length
        # Some of everything, so that the sum grows and its inverse is a function.
        total = np.concatenate([[0.0], np.cumsum(share + 1e-6 * np.sum(share))])
        inner = np.interp(total[-1] * np.arange(1, count) / count, total, branch.near)
        chosen = [] if branch.first else [float(branch.near[0])]
        digits = _DIGITS - 1 - int(np.floor(np.log10(size)))
        where = {round(place, digits) for place in [*chosen, *inner.tolist()]}
        toward = branch.ends[0]
        if part_of.setdefault(toward, branch.part) != branch.part:
            # Both parts of a cut body end at the cut, and a body file names it once.
            places[toward] = max(places.get(toward, set()), where, key=len)
        elif where:
            places.setdefault(toward, set()).update(where)
    return tuple((toward, tuple(sorted(found))) for toward, found in places.items() if found)


def frames_of(branches: Sequence[Branch], counts: Sequence[int], body: ReducedBody) -> list[list[int]] | None:
    """Frames of each branch in a body that was divided by `spread_joints`; None where it has others.

    Parameters
    ----------
    branches : sequence of Branch
    counts : sequence of int
    body : ReducedBody

    Returns
    -------
    list of list of int, or None
    """
    found: list[list[int]] = [[] for _ in branches]
    for name, last in zip(body.interface_names, body.interface_frame, strict=True):
        way: list[int] = []
        s = int(last)
        while s != GROUND and not (body.floating and s == 0):
            way.insert(0, s)
            s = int(body.frame_parent[s])
        passed = [k for k, branch in enumerate(branches) if name in branch.ends]
        if sum(counts[k] for k in passed) != len(way):
            return None
        for k in passed:
            found[k], way = way[: counts[k]], way[counts[k] :]
    return found
