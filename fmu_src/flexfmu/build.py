"""The pipeline: mesh → model → modes → interfaces and frames → reduced body."""

import hashlib
from pathlib import Path

import numpy as np

from . import __version__
from .config import BodyFile, InterfaceTable
from .errors import BodyFileError
from .fe.assembly import mass, stiffness, volume_matrices
from .fe.faces import FaceBlock, area_matrix, element_faces, select
from .fe.factorisation import Factorisation
from .mesh.checks import checked
from .mesh.formats import read_mesh
from .mesh.model import FloatArray, IntArray, Mesh
from .progress import Reporter
from .reduction.division import divide
from .reduction.model import Model, assemble_model, node_set
from .reduction.modes import normal_modes
from .reduction.rigid_fit import Weighted, by_node, modal_fit
from .reduction.subdomains import (
    FrameRequest,
    Subdomain,
    carrying_frame,
    frame_operators,
    requested_subdomains,
)
from .reduction.surface import body_surface
from .runtime.reduced_body import Formulation, ReducedBody


def reduce_body(config: BodyFile, report: Reporter) -> ReducedBody:
    """Reduce a finite element body.

    Parameters
    ----------
    config : BodyFile
        With the mesh's path resolved.
    report : Reporter

    Returns
    -------
    ReducedBody

    Raises
    ------
    FlexfmuError
        Anything that the body file or the mesh does not provide, with what to do.
    """
    with report.stage(f"Read {config.mesh.file.name}"):
        mesh = checked(read_mesh(config.mesh.file, config.mesh.units))
        model = assemble_model(mesh, config)
        mesh = model.mesh
        _check_sets(config, mesh)
    report.note(f"{len(mesh.points)} nodes, {mesh.element_count} elements, {model.free.size} free degrees of freedom")
    for text in mesh.notes:
        report.note(text)

    with report.stage("Assemble stiffness and mass"):
        volumes = volume_matrices(mesh)
        k, m = stiffness(mesh), mass(mesh, volumes)
    with report.stage("Factorise the stiffness"):
        factor = Factorisation(k[model.free][:, model.free], model.free // 3)
    with report.stage(f"Find {config.reduction.modes} normal modes"):
        modes = normal_modes(k, m, model.free, factor, config.reduction.modes)
    hertz = modes.angular_frequency / (2.0 * np.pi)
    report.note(
        f"{hertz[0]:.4g} to {hertz[-1]:.4g} Hz; |ΦᵀMΦ − I| = {modes.orthonormality_error:.1e}, "
        f"residual {modes.residual:.1e}"
    )
    if modes.splits_pair:
        report.warning(
            f"mode {config.reduction.modes + 1} has the frequency of mode {config.reduction.modes} and is left out: "
            "the body will be softer in one direction than in the other; take one mode more or less"
        )

    with report.stage("Divide into frames and fit interfaces"):
        faces = element_faces(mesh)
        subdomains, cuts = _subdomains(config, model, volumes, faces)
        frames = frame_operators(mesh.points, modes.shapes, subdomains)
        fits = [_interface(table, mesh, modes.shapes, faces, subdomains, report) for table in config.interface]
    for text in cuts:
        report.warning(text)
    report.note(f"{len(subdomains)} frames, {len(fits)} interfaces")

    count = modes.angular_frequency.size
    return ReducedBody(
        name=config.name,
        angular_frequency=modes.angular_frequency,
        damping_ratio=np.broadcast_to(np.asarray(config.damping.ratio, dtype=np.float64), (count,)),
        interface_names=tuple(table.name for table in config.interface),
        interface_point=np.array([fit[0] for fit in fits]),
        interface_displacement=np.array([fit[1] for fit in fits]),
        interface_rotation=np.array([fit[2] for fit in fits]),
        interface_frame=np.array([fit[3] for fit in fits]),
        frame_names=tuple(domain.name for domain in subdomains),
        frame_parent=np.array([domain.parent for domain in subdomains], dtype=np.int64),
        joint_point=np.array([domain.joint_point for domain in subdomains]),
        joint_displacement=frames.joint_displacement,
        joint_rotation=frames.joint_rotation,
        frame_rotation=frames.frame_rotation,
        formulation=Formulation(config.formulation.kinematics, config.formulation.loads),
        velocity_outputs=config.output.velocities,
        provenance=_provenance(config, mesh),
        surface=body_surface(mesh, modes.shapes, faces, subdomains) if config.output.surface else None,
    )


def _check_sets(config: BodyFile, mesh: Mesh) -> None:
    """Find every set that will be asked for before the expensive work begins."""
    for interface in config.interface:
        node_set(mesh, interface.nodes, f"interface {interface.name!r}, nodes")
    for frame in config.frame:
        node_set(mesh, frame.nodes, f"frame {frame.name!r}, nodes")
        if isinstance(frame.joint, str):
            node_set(mesh, frame.joint, f"frame {frame.name!r}, joint")


def _subdomains(
    config: BodyFile, model: Model, volumes: tuple[FloatArray, ...], faces: tuple[FaceBlock, ...]
) -> tuple[list[Subdomain], tuple[str, ...]]:
    """Frames by hand or by themselves; without either key the body gets one."""
    if not config.frame:
        levels = 1 if config.frames is None else config.frames
        if levels == 0:
            return [], ()
        division = divide(model.mesh, volumes, faces, model.anchored, levels)
        return list(division.subdomains), division.cuts
    requests = []
    for table in config.frame:
        joint: IntArray | FloatArray | None = None
        if isinstance(table.joint, str):
            joint = node_set(model.mesh, table.joint, f"frame {table.name!r}, joint")
        elif table.joint is not None:
            joint = np.array(table.joint)
        nodes = node_set(model.mesh, table.nodes, f"frame {table.name!r}, nodes")
        requests.append(FrameRequest(table.name, nodes, joint, table.parent))
    held = np.flatnonzero(model.fixed.any(axis=1))
    return requested_subdomains(model.mesh, volumes, faces, held, requests), ()


def _interface(
    table: InterfaceTable,
    mesh: Mesh,
    shapes: FloatArray,
    faces: tuple[FaceBlock, ...],
    subdomains: list[Subdomain],
    report: Reporter,
) -> tuple[FloatArray, FloatArray, FloatArray, int]:
    """Point, displacement, rotation and frame of an interface."""
    key = f"interface {table.name!r}"
    nodes = node_set(mesh, table.nodes, f"{key}, nodes")
    weighted = _weighted(table, mesh, faces, nodes)
    point = weighted.centre(mesh.points) if table.point is None else np.array(table.point)
    displacement, rotation, rank = modal_fit(mesh.points, shapes, weighted, point)
    if rank < 6:
        raise BodyFileError(
            f"{key}: the {nodes.size} nodes of {table.nodes!r} lie on a line or in one point, which tells no rotation "
            "and takes no moment; give the interface at least three nodes off a line"
        )
    frame = carrying_frame(subdomains, nodes)
    carrier = f"frame {subdomains[frame].name}" if frame >= 0 else "no frame"
    spread = "by area" if weighted.weight.nnz > nodes.size else "by node"
    report.note(f"{key}: {nodes.size} nodes, loads spread {spread}, carried by {carrier}")
    if frame < 0 and subdomains:
        report.warning(f"{key} touches no frame: it will move linearly; put its nodes into a [[frame]]")
    return point, displacement, rotation, frame


def _weighted(table: InterfaceTable, mesh: Mesh, faces: tuple[FaceBlock, ...], nodes: IntArray) -> Weighted:
    if table.weights == "node":
        return by_node(nodes)
    matrix = area_matrix(mesh.points, select(faces, nodes, outer=True), nodes)
    if matrix is not None:
        return Weighted(nodes, matrix)
    if table.weights == "area":
        raise BodyFileError(
            f'interface {table.name!r}: weights = "area" needs a set that consists of whole element faces on the '
            f'surface, and {table.nodes!r} does not; add the missing nodes or take weights = "node"'
        )
    return by_node(nodes)


def _provenance(config: BodyFile, mesh: Mesh) -> dict[str, str]:
    """Hashes of what went in, and what made it."""
    return {
        "mesh_file": config.mesh.file.name,
        "mesh_sha256": hashlib.sha256(Path(config.mesh.file).read_bytes()).hexdigest(),
        "body_sha256": hashlib.sha256(config.model_dump_json(exclude={"mesh": {"file"}}).encode()).hexdigest(),
        "nodes": str(len(mesh.points)),
        "elements": str(mesh.element_count),
        "flexfmu_version": __version__,
    }
