"""Frames and interfaces that a body file asks for, bodies made of them, and the options of their shadows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..fe.assembly import area_matrix, select
from ..files.basics import MOST_FRAMES, BodyFileError, FloatArray, IntArray
from ..files.outputs import fields_of
from ..mesh.model import Mesh
from ..model.methods import Data, Method, Variant
from ..model.reduced_body import GROUND, ReducedBody, WholeFrame
from . import subdomains as domains
from .division import divide, divide_branches, open_loops
from .model import Model
from .options import BodyOptions, BodyUse, InterfaceNodes, node_set, reference
from .rigid_fit import Weighted, by_node, rigid_fit
from .supported import Supported

# Of a body that nothing holds.
_RIGID_MOTIONS = 6


def body_subdomains(config: BodyOptions, model: Model) -> tuple[list[domains.Subdomain], tuple[str, ...]]:
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
        # Or a section's in a part of a cut body.
        ends = {one.name: one.nodes for one in config.interfaces}
        branches = [
            (toward, node_set(mesh, ends.get(toward, toward), f"[[branch]] toward {toward!r}"), joints)
            for toward, joints in config.branches
        ]
        division = divide_branches(mesh, anchored, branches)
        return top + domains.on_floating_frame(division.subdomains, len(top)), _advised(division.cuts)
    if not config.frames:
        if config.levels == 0:
            return top, ()
        division = divide(mesh, anchored, config.levels)
        advice = _advised(division.cuts) if config.levels_asked else ()
        return top + domains.on_floating_frame(division.subdomains, len(top)), advice
    subdomains = domains.requested_subdomains(mesh, held, frame_requests(config, mesh))
    warnings = domains.division_warnings(mesh, subdomains) + _advised(open_loops(mesh, subdomains))
    return top + domains.on_floating_frame(subdomains, len(top)), warnings


def frame_requests(config: BodyOptions, mesh: Mesh) -> list[domains.FrameRequest]:
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
        requests.append(domains.FrameRequest(table.name, nodes, joint, table.parent, points))
    return requests


def is_free(model: Model) -> bool:
    """Whether nothing holds the body, so that its frames hang on a floating one."""
    return bool(model.rigid.shape[1] == _RIGID_MOTIONS)


def root_frame(model: Model) -> list[domains.Subdomain]:
    """The frame that turns with a body that is free to turn; none for others."""
    if is_free(model):
        return [domains.floating_frame(model.mesh)]
    if not model.rigid.shape[1]:
        return []
    found = domains.hinge_frame(model.mesh, model.rigid, np.asarray(model.fixed.all(axis=1)))
    return [] if found is None else [found]


def _advised(loops: Sequence[str]) -> tuple[str, ...]:
    """Say what to do about loops that the tree cuts."""
    return tuple(
        f"{loop}: the tree does not know that the body hangs together there, its modes do so linearly; where it turns "
        'far, cut it (cut = "auto", or a [[cut]] table with the nodes of a section of the loop)'
        for loop in loops
    )


def several(subdomains: list[domains.Subdomain]) -> bool:
    """Whether there is more than one frame beside a floating one."""
    return sum(not domain.floating for domain in subdomains) > 1


def whole_frame(model: Model, shapes: FloatArray, config: BodyOptions) -> WholeFrame:
    """A frame for the whole body about its supports, to be compared with the tree."""
    mesh = model.mesh
    body = domains.volume_weighted(mesh, mesh.volume_matrices, np.arange(mesh.element_count))
    joint = domains.section(mesh, hanging(model, config))
    every = np.arange(mesh.element_count)
    turned = domains.mean_rotation(mesh, every)
    domain = domains.Subdomain("whole", GROUND, every, body, turned, joint, joint.centre(mesh.points))
    found = domains.frame_operators(mesh.points, shapes, [domain])
    operators = found.joint_displacement[0], found.joint_rotation[0], found.frame_rotation[0]
    return WholeFrame(domain.joint_point, *operators)


def hanging(model: Model, config: BodyOptions) -> IntArray:
    """Nodes from which frames are counted: the best supports, or a free body's root interface."""
    if not is_free(model):
        return model.anchored
    root = config.interfaces[config.root_place]
    return np.sort(node_set(model.mesh, root.nodes, f"interface {root.name!r}, nodes"))


# Weight of all nodes that are added to a line or a point, over all of theirs.
_AROUND = 1e-3


@dataclass(frozen=True, slots=True)
class InterfaceFit:
    """An interface fitted to its node set.

    Attributes
    ----------
    name : str
    point : (3,) float
        Reference point, m.
    nodes : (k,) int
        Of the set; where these lie on a line or in one point, those of their elements too.
    added : (j,) int
        Those of them that are not of the set.
    operator : (6, 3k) float
        From displacements of the nodes to displacement and rotation; its transpose spreads loads.
    by_area : bool
        Whether loads are spread over the area of the set's faces.
    frame : int
        The sub-domain that carries it, or `GROUND`.
    """

    name: str
    point: FloatArray
    nodes: IntArray
    added: IntArray
    operator: FloatArray
    by_area: bool
    frame: int

    def motion(self, shapes: FloatArray) -> FloatArray:
        """Displacement and rotation (6, m) per unit modal coordinate, from mode shapes (3n, m)."""
        return self.operator @ shapes.reshape(-1, 3, shapes.shape[1])[self.nodes].reshape(-1, shapes.shape[1])

    def nodal_loads(self, node_count: int) -> FloatArray:
        """Nodal forces (3n, 6) of unit forces and moments at the reference point."""
        result = np.zeros((node_count, 3, 6))
        result[self.nodes] = self.operator.T.reshape(-1, 3, 6)
        return result.reshape(-1, 6)


def fit_interface(table: InterfaceNodes, mesh: Mesh, subdomains: Sequence[domains.Subdomain]) -> InterfaceFit:
    """Fit an interface of the body file.

    Parameters
    ----------
    table : InterfaceNodes
    mesh : Mesh
    subdomains : sequence of Subdomain

    Returns
    -------
    InterfaceFit

    Raises
    ------
    BodyFileError
        A set that is missing or empty, that tells no rotation, or that is no area where one is asked for.
    """
    key = f"interface {table.name!r}"
    nodes = node_set(mesh, table.nodes, f"{key}, nodes")
    weighted = _weighted(table, mesh, nodes)
    point = reference(mesh, table.nodes) if table.point is None else np.array(table.point)
    if point is None:
        point = weighted.centre(mesh.points)
    operator, rank = rigid_fit(mesh.points, weighted, point)
    if rank < 6:
        # A line or a point tells no rotation about itself and takes no moment: its elements do, and hardly a force.
        touched = [b.connectivity[np.isin(b.connectivity, nodes).any(axis=1)].ravel() for b in mesh.blocks]
        around = np.unique(np.concatenate([nodes, *touched]))
        weighted = by_node(around, np.where(np.isin(around, nodes), 1.0, _AROUND * nodes.size / around.size))
        operator, rank = rigid_fit(mesh.points, weighted, point)
    if rank < 6:
        raise BodyFileError(
            f"{key}: the {nodes.size} nodes of {table.nodes!r} and those of their elements lie on a line or in one "
            "point, which tells no rotation and takes no moment; give the interface at least three nodes off a line"
        )
    added, by_area = np.setdiff1d(weighted.nodes, nodes), weighted.weight.nnz > weighted.nodes.size
    frame = domains.carrying_frame(subdomains, nodes)
    return InterfaceFit(table.name, point, weighted.nodes, added, operator, by_area, frame)


def _weighted(table: InterfaceNodes, mesh: Mesh, nodes: IntArray) -> Weighted:
    if table.weights == "node":
        return by_node(nodes)
    # A section inside the body is an area too; a set that holds whole elements is a piece of it.
    for outer in (True, False) if not domains.elements_within(mesh, nodes).size else (True,):
        faces = select(mesh.faces, nodes, outer=outer)
        covered = np.unique(np.concatenate([nodes[:0], *(block.ravel() for block in faces)]))
        # An edge of shells across a joint holds the knot's other lines, too: of no face here, and rigid with it.
        knots = [link.nodes for link in mesh.links if np.isin(link.nodes, covered).any()]
        kept = covered if np.isin(nodes, np.concatenate([covered, *knots])).all() else nodes
        if (matrix := area_matrix(mesh.points, faces, kept)) is not None:
            return Weighted(kept, matrix)
    if table.weights == "area":
        raise BodyFileError(
            f'interface {table.name!r}: weights = "area" needs a set that consists of whole element faces, '
            f"on the surface or across the body, and {table.nodes!r} does not; add the missing nodes or take "
            'weights = "node"'
        )
    return by_node(nodes)


def motion_of_tree(
    angular_frequency: FloatArray, shapes: FloatArray, interfaces: Sequence[InterfaceFit],
    subdomains: Sequence[domains.Subdomain], frames: domains.FrameOperators,
) -> dict[str, Any]:  # fmt: skip
    """How interfaces and frames move with mode shapes (3n, m): fields of `ReducedBody` by name."""
    moved = np.array([interface.motion(shapes) for interface in interfaces])
    return {
        "angular_frequency": angular_frequency,
        "interface_names": tuple(interface.name for interface in interfaces),
        "interface_point": np.array([interface.point for interface in interfaces]),
        "interface_displacement": moved[:, :3],
        "interface_rotation": moved[:, 3:],
        "interface_frame": np.array([interface.frame for interface in interfaces]),
        "frame_names": tuple(domain.name for domain in subdomains),
        "frame_parent": np.array([domain.parent for domain in subdomains], dtype=np.int64),
        "joint_point": np.array([domain.joint_point for domain in subdomains]),
        **fields_of(frames),
        "floating": any(domain.floating for domain in subdomains),
    }


def motion_of_interfaces(
    angular_frequency: FloatArray, points: Mapping[str, Sequence[float] | FloatArray], moved: FloatArray
) -> dict[str, Any]:
    """Motion (I, 6, m) of interfaces alone, at points (3,), m, by their names; as of `motion_of_tree`."""
    empty = np.zeros((0, 3, angular_frequency.size))
    return {
        "angular_frequency": angular_frequency,
        "interface_names": tuple(points),
        "interface_point": np.array([list(point) for point in points.values()], dtype=float),
        "interface_displacement": moved[:, :3],
        "interface_rotation": moved[:, 3:],
        "interface_frame": np.full(len(points), GROUND),
        **dict.fromkeys(("joint_displacement", "joint_rotation", "frame_rotation"), empty),
    }


def made_body(use: BodyUse, **given: Any) -> ReducedBody:
    """Make a reduced body.

    Parameters
    ----------
    use : BodyUse
    **given : object
        Its motion, and what it holds beside it: fields of `ReducedBody`.

    Returns
    -------
    ReducedBody

    Raises
    ------
    BodyFileError
        Damping ratios that are not one a mode.
    """
    return used_body(ReducedBody(name=use.name, damping_ratio=np.zeros(given["angular_frequency"].size), **given), use)


def used_body(body: ReducedBody, use: BodyUse) -> ReducedBody:
    """The body with another use; parameters as of `made_body`."""
    given = fields_of(use)
    variant, damping = given.pop("variant"), given.pop("damping")
    given |= {"method": variant.method, "mass": variant.mass, "provenance": dict(use.provenance)}
    return replace(body, damping_ratio=_damping(damping, body.angular_frequency, body.rigid_count), **given)


def linear_use(name: str, damping: float | FloatArray, provenance: Mapping[str, str]) -> BodyUse:
    """Use of a body that knows method "linear" only."""
    return BodyUse(name, damping, Variant(Method.LINEAR), provenance=provenance)


def _damping(ratio: float | Sequence[float] | FloatArray, angular_frequency: FloatArray, rigid: int) -> FloatArray:
    """Damping ratios (m,), as of `BodyUse`; a list for elastic modes alone leaves rigid motions without."""
    values, count = np.asarray(ratio, dtype=np.float64), angular_frequency.size
    if values.ndim == 2:
        values = np.interp(angular_frequency[rigid:] / (2.0 * np.pi), *values.T)
    if values.ndim and values.size == count - rigid:
        values = np.concatenate([np.zeros(rigid), values])
    if values.ndim and values.size != count:
        raise BodyFileError(
            f"damping.ratio lists {values.size} values, and the basis has {count - rigid} elastic modes, interface "
            "modes and static shapes included"
        )
    return np.broadcast_to(values, (count,))


FINER = 2
"""Frames of the shadow for each of the body's."""
# Energy of shapes of second and third order that it has beside the body's own, and how many, of all interfaces and of
# each: posts of a tower that is pressed at two places bend in more ways than two each. Of bodies that bend far, which
# have more of their own: of 1.4 % that a strip on edge was off past its buckling, the first told 0.1, these 1.1.
THIRD = {False: (1e-3, (6, 4)), True: (1e-4, (12, 8))}


def shadow_options(config: BodyOptions, subdomains: Sequence[domains.Subdomain]) -> BodyOptions:
    """Options of the shadow: second order and stretching, and twice the frames, all of them levels.

    One frame that was taken by itself stays one: more would open a loop, or lie on joints that tell nothing.

    Parameters
    ----------
    config : BodyOptions
        Of the body.
    subdomains : sequence of Subdomain
        Its frames.

    Returns
    -------
    BodyOptions
    """
    own = sum(not domain.floating for domain in subdomains)
    found = not (config.frames or config.branches)
    levels = max(FINER * (config.levels if found and own > 1 else own), FINER)
    if found and own == 1 and not config.levels_asked:
        levels = 1
    return finer_shadow(config, levels)


def finer_shadow(config: BodyOptions, levels: int) -> BodyOptions:
    """Options of a shadow with so many levels of frames: second order and stretching, and nothing to look at."""
    return replace(
        config, levels=min(levels, MOST_FRAMES), levels_asked=True, frames=(), branches=(), stress=(), membrane="finer",
        variant=Variant(Method.SECOND_ORDER), stored=frozenset({Data.SECOND_ORDER}), surface=False,
        surface_stress=False, certificate=False, watched=False,
    )  # fmt: skip


def embedding(model: Supported, shadow: FloatArray, shapes: FloatArray) -> FloatArray:
    """The coordinates (M, m), of a basis (3n, M), of the motions (3n, m) of another one: P = Φ_Sᵀ M Φ."""
    return model.unknowns.of(shadow).T @ (model.mass @ model.unknowns.of(shapes))
