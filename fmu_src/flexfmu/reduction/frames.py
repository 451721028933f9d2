"""The frames that a body file asks for: at equal levels, at distances branch by branch, or by hand."""

from collections.abc import Sequence

import numpy as np

from ..files.basics import FloatArray, IntArray
from ..mesh.model import Mesh
from ..model.reduced_body import GROUND, WholeFrame
from .division import Joints, divide, divide_branches, open_loops
from .model import Model
from .options import Basis, BodyOptions, BranchJoints, Nodes
from .places import node_set
from .subdomains import (
    FrameRequest,
    Subdomain,
    division_warnings,
    floating_frame,
    frame_operators,
    hinge_frame,
    mean_rotation,
    on_floating_frame,
    requested_subdomains,
    section,
    volume_weighted,
)

# Of a body that nothing holds.
_RIGID_MOTIONS = 6


def body_subdomains(config: BodyOptions, model: Model) -> tuple[list[Subdomain], tuple[str, ...]]:
    """Frames by hand or by themselves; those of a free body hang on a floating one.

    Parameters
    ----------
    config : BodyOptions
    model : Model

    Returns
    -------
    subdomains : list of Subdomain
    warnings : tuple of str

    Raises
    ------
    BodyFileError
        Frames that the body cannot be divided into.
    """
    mesh = model.mesh
    anchored = hanging(model, config)
    held = anchored if is_free(model) else model.held
    # Parts of a cut body turn with their ties: their coordinates are no rigid motions any more.
    top = [] if config.cuts else root_frame(model)
    if config.branches:
        branches = [
            Joints(b.toward, node_set(mesh, _end(config, b), f"[[branch]] toward {b.toward!r}"), b.joints)
            for b in config.branches
        ]
        division = divide_branches(mesh, anchored, branches)
        return top + on_floating_frame(division.subdomains, len(top)), _advised(division.cuts)
    if not config.frames:
        if config.levels == 0:
            return top, ()
        division = divide(mesh, anchored, config.levels)
        advice = _advised(division.cuts) if config.levels_asked else ()
        return top + on_floating_frame(division.subdomains, len(top)), advice
    requests = frame_requests(config, mesh)
    subdomains = requested_subdomains(mesh, held, requests)
    warnings = division_warnings(mesh, subdomains) + _advised(open_loops(mesh, subdomains))
    return top + on_floating_frame(subdomains, len(top)), warnings


def frame_requests(config: BodyOptions, mesh: Mesh) -> list[FrameRequest]:
    """Frames by hand, with the nodes of their sets."""
    requests = []
    for table in config.frames:
        joint: IntArray | FloatArray | None = None
        if isinstance(table.joint, str):
            joint = node_set(mesh, table.joint, f"frame {table.name!r}, joint")
        elif table.joint is not None:
            joint = np.array(table.joint)
        nodes = node_set(mesh, table.nodes, f"frame {table.name!r}, nodes")
        key = f"frame {table.name!r}, rotation_points"
        points = tuple(node_set(mesh, name, key) for name in table.rotation_points)
        requests.append(FrameRequest(table.name, nodes, joint, table.parent, points))
    return requests


def is_free(model: Model) -> bool:
    """Whether nothing holds the body, so that its frames hang on a floating one."""
    return bool(model.rigid.shape[1] == _RIGID_MOTIONS)


def root_frame(model: Model) -> list[Subdomain]:
    """The frame that turns with a body that is free to turn; none for others."""
    if is_free(model):
        return [floating_frame(model.mesh)]
    if not model.rigid.shape[1]:
        return []
    found = hinge_frame(model.mesh, model.rigid, np.asarray(model.fixed.all(axis=1)))
    return [] if found is None else [found]


def _end(config: BodyOptions, branch: BranchJoints) -> Nodes:
    """Node set at which a branch ends: an interface's, or that of a section in a part of a cut body."""
    return next((i.nodes for i in config.interfaces if i.name == branch.toward), branch.toward)


def _advised(loops: Sequence[str]) -> tuple[str, ...]:
    """Say what to do about loops that the tree cuts."""
    return tuple(
        f"{loop}: the tree does not know that the body hangs together there, its modes do so linearly; where it turns "
        'far, cut it (cut = "auto", or a [[cut]] table with the nodes of a section of the loop)'
        for loop in loops
    )


def several(subdomains: list[Subdomain]) -> bool:
    """Whether there is more than one frame beside a floating one."""
    return sum(not domain.floating for domain in subdomains) > 1


def whole_frame(model: Model, shapes: FloatArray, config: BodyOptions) -> WholeFrame:
    """A frame for the whole body about its supports, to be compared with the tree."""
    mesh = model.mesh
    body = volume_weighted(mesh, mesh.volume_matrices, np.arange(mesh.element_count))
    joint = section(mesh, hanging(model, config))
    every = np.arange(mesh.element_count)
    turn = mean_rotation(mesh, every)
    domain = Subdomain("whole", GROUND, every, body, turn, joint, joint.centre(mesh.points))
    found = frame_operators(mesh.points, shapes, [domain])
    operators = found.joint_displacement[0], found.joint_rotation[0], found.frame_rotation[0]
    return WholeFrame(domain.joint_point, *operators)


def hanging(model: Model, config: BodyOptions) -> IntArray:
    """Nodes from which frames are counted: the best supports, or a free body's root interface."""
    if not is_free(model):
        return model.anchored
    root = config.interfaces[config.root_place]
    return np.sort(node_set(model.mesh, root.nodes, f"interface {root.name!r}, nodes"))


def fixable_root(config: BodyOptions, model: Model) -> int:
    """The same where a scene may fix it: the body moves freely, and the basis holds its constraint modes."""
    if model.rigid.shape[1] and config.basis.kind is Basis.CRAIG_BAMPTON:
        return config.root_place
    return GROUND
