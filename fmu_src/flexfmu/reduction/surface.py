"""The body's outer faces and how they move, for pictures: mode shapes, second-order part, stress."""

from collections.abc import Sequence

import numpy as np

from ..fe.gradients import nodal_stress, quadratic_strain
from ..files.basics import FloatArray, IntArray
from ..files.outputs import tell_nobody
from ..mesh.model import Mesh
from ..model.arrays import SECOND_BITS, short
from ..model.reduced_body import GROUND, Surface
from .basis import Matrices
from .fourth_order import pair_products
from .modes import Modes
from .subdomains import Subdomain, first_of

# Directions in the modal coordinates whose pairs are kept: 300 pairs, as many static responses.
_DIRECTIONS = 24
_AT_A_TIME = 16
# Share of the largest below which what pairs add is left out.
_SMALL = 1e-3


def surface_nodes(mesh: Mesh) -> tuple[IntArray, IntArray]:
    """Corner nodes of the outer faces, rows of the mesh's points, and the faces (f, 4), outward, in them."""
    centres = mesh.element_means(mesh.points)
    corners = []
    for block in mesh.faces:
        outer = block.nodes[block.outer, : block.corner_count]
        if not len(outer):
            continue
        # Seen from outside, corners go round against the clock.
        ring = mesh.points[outer]
        normal = np.cross(ring[:, 1] - ring[:, 0], ring[:, 2] - ring[:, 0])
        inward = np.einsum("fi,fi->f", normal, ring.mean(axis=1) - centres[block.element[block.outer]]) < 0.0
        outer = np.where(inward[:, None], outer[:, ::-1], outer)
        corners.append(outer if block.corner_count == 4 else outer[:, [0, 1, 2, 2]])
    nodes, index = np.unique(np.concatenate(corners), return_inverse=True)
    return nodes, index.reshape(-1, 4)


def face_normals(points: FloatArray, faces: IntArray) -> FloatArray:
    """Unit normals (f, 3) of faces (f, 4), triangles with their last corner twice; zero of those without area."""
    ring = points[faces]
    last = np.where((faces[:, 2] == faces[:, 3])[:, None], ring[:, 0], ring[:, 3])
    normal = np.cross(ring[:, 2] - ring[:, 0], last - ring[:, 1])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return normal / np.where(length > 0.0, length, 1.0)


def face_edges(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Ends (e, 2), ascending, of the edges of faces (f, 4), and the face (e,) of each."""
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    real = ends[:, 0] != ends[:, 1]
    return ends[real], np.repeat(np.arange(len(faces)), 4)[real]


def carrying_frames(count: int, subdomains: Sequence[Subdomain]) -> IntArray:
    """The frame that carries each of `count` nodes, or `GROUND`."""
    # A floating frame, the first, would take everything: it has what is left.
    own = [domain.body.nodes[: 0 if domain.floating else None] for domain in subdomains]
    return first_of(own, count, 0 if any(domain.floating for domain in subdomains) else GROUND)


def body_surface(
    mesh: Mesh,
    shapes: FloatArray,
    subdomains: Sequence[Subdomain],
    interfaces: Sequence[IntArray],
    held: IntArray,
    second: tuple[FloatArray, FloatArray] | None = None,
    stress: bool = False,
) -> Surface:
    """Corner nodes of the outer faces.

    Parameters
    ----------
    mesh : Mesh
    shapes : (3n, m) float
    subdomains : sequence of Subdomain
    interfaces : sequence of (k,) int
        Node sets of the interfaces.
    held : (k,) int
        Nodes that supports hold.
    second : (3k, r) and (r, m, m) float, optional
        As of `second_order_fields`, of the nodes of `surface_nodes`.
    stress : bool
        Whether the modes' stress goes along.

    Returns
    -------
    Surface
    """
    count = len(mesh.points)
    nodes, corners = surface_nodes(mesh)
    fields, forms = second or (None, None)
    return Surface(
        mesh.points[nodes],
        corners,
        shapes.reshape(count, 3, -1)[nodes],
        carrying_frames(count, subdomains)[nodes],
        first_of(interfaces, count)[nodes],
        first_of([held], count)[nodes] + 1,
        None if fields is None else fields.reshape(nodes.size, 3, -1),
        forms,
        stress=nodal_stress(mesh, nodes, shapes) if stress else None,
    )


def _turning_directions(
    mesh: Mesh, phi: FloatArray, omega: FloatArray, loads: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Directions (k, e) in coordinates times `size`, how far each turns the material (k,), and `size` (e,)."""
    # Coordinates of unit strain energy under each load, and of each mode alone as slow loads move it.
    answers = (loads.T @ phi) / omega**2
    energy = np.linalg.norm(answers * omega, axis=1)
    answers = answers[energy > 0.0] / energy[energy > 0.0, None]
    amplitudes = np.vstack([answers, np.diag(omega[0] / omega**2)])
    # By how far they turn the material: differences over the elements' edges tell it well enough.
    edges = np.concatenate([np.sort(block.connectivity[:, :2]) for block in mesh.blocks])
    length = np.linalg.norm(np.diff(mesh.points[edges], axis=1)[:, 0], axis=1)
    u = phi.reshape(len(mesh.points), 3, -1)
    turned = np.linalg.norm((u[edges[:, 1]] - u[edges[:, 0]]) / length[:, None, None], axis=(0, 1))
    size = np.where(turned > 0.0, turned, 1.0)
    _, values, axes = np.linalg.svd(amplitudes * size, full_matrices=False)
    return axes[:_DIRECTIONS], values[:_DIRECTIONS], size


def second_order_fields(
    matrices: Matrices, modes: Modes, loads: FloatArray, nodes: IntArray, answers: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Displacement ½ w(q, q) of some nodes that goes with q at second order, as few fields w = Σ W_r (qᵀ c_r q).

    Of many coordinates the directions count into which static loads and the lowest modes turn the material most.

    Parameters
    ----------
    matrices : Matrices
    modes : Modes
    loads : (3n, j) float
        Of which static displacements are made.
    nodes : (k,) int
    answers : (3n, p) float, optional
        As of `Stretching.answers`.

    Returns
    -------
    fields : (3k, r) float
        W_r, seen from the floating frame of a body that has one, else from the ground.
    forms : (r, m, m) float
        c_r, symmetric.
    """
    mesh, model = matrices.model.mesh, matrices.supported
    elastic = np.flatnonzero(modes.angular_frequency > 0.0)
    phi = modes.shapes[:, elastic]
    axes, values, size = _turning_directions(mesh, phi, modes.angular_frequency[elastic], loads)
    kept = values.size
    directions = (axes / size).T
    first, second = np.triu_indices(kept)
    # Pairs are weighed by how large they get.
    weight = values[first] * values[second]
    # Of the body's inside nothing is kept: all pairs of a large mesh at once would take more than the factorisation.
    rows = (3 * nodes[:, None] + np.arange(3)).ravel()
    pairs = np.empty((rows.size, first.size))
    for start in range(0, first.size, _AT_A_TIME):
        part = slice(start, start + _AT_A_TIME)
        one, other = first[part], second[part]
        if answers is None:
            forces, _ = quadratic_strain(mesh, phi @ directions, np.stack([one, other], axis=1), tell_nobody)
            found = model.whole(model.static(model.forces(forces)))[rows]
        else:
            found = answers[rows] @ pair_products(directions[:, one], directions[:, other])
        # Twice the displacement that a pair's strain (18a) makes: ½ w holds it in both orders.
        pairs[:, part] = -2.0 * found * weight[part]
    squares, turn = np.linalg.eigh(pairs.T @ pairs)
    turn = turn[:, squares > (_SMALL**2) * squares[-1]]
    # y = axes (size q): the coordinates of the directions.
    onto = np.zeros((kept, modes.shapes.shape[1]))
    onto[:, elastic] = axes * size
    forms = np.zeros((turn.shape[1], kept, kept))
    forms[:, first, second] = forms[:, second, first] = (turn / weight[:, None]).T
    return pairs @ turn, short(onto.T @ forms @ onto, modes.angular_frequency, SECOND_BITS[True])
