"""Views of a mesh before anything is reduced: node sets, supports, interfaces, frames, joints and cuts."""

from pathlib import Path

import numpy as np

from ..build import _check_sets
from ..config import BodyFile
from ..fe.assembly import volume_matrices
from ..fe.faces import element_faces
from ..mesh.checks import checked
from ..mesh.formats import read_mesh
from ..mesh.model import Mesh
from ..mesh.units import UnitSystem
from ..model.reduced_body import FloatArray
from ..progress import Reporter
from ..reduction.frames import body_subdomains
from ..reduction.interfaces import fit_interface
from ..reduction.model import assemble_model, node_set
from ..reduction.subdomains import Subdomain
from ..reduction.surface import carrying_frames, set_numbers, surface_nodes
from .model import Mark, MarkKind, Region, View
from .motions import FRAMES, INTERFACES


def mesh_view(path: Path) -> View:
    """A mesh file with its node sets; lengths are taken for metres."""
    mesh = checked(read_mesh(path, UnitSystem.SI))
    return _view(mesh, path.name, [], (), np.zeros((0, 3)))


def body_file_view(config: BodyFile, report: Reporter) -> View:
    """A body file's mesh with what the file says of it, without any reduction.

    Parameters
    ----------
    config : BodyFile
    report : Reporter

    Returns
    -------
    View

    Raises
    ------
    FlexfmuError
        What the mesh does not provide.
    """
    with report.stage(f"Read {config.mesh.file.name}"):
        mesh = checked(read_mesh(config.mesh.file, config.mesh.units))
        model = assemble_model(mesh, config)
        mesh = model.mesh
        _check_sets(config, mesh)
    count = len(mesh.points)
    faces = element_faces(mesh)
    numbered = []
    marks, places = [], []
    subdomains: list[Subdomain] = []
    if not config.cut:
        with report.stage("Divide into frames"):
            subdomains, warnings = body_subdomains(config, model, volume_matrices(mesh), faces)
        for text in warnings:
            report.warning(text)
        if subdomains:
            names = tuple(domain.name for domain in subdomains)
            numbered.append(Region(FRAMES, names, carrying_frames(count, subdomains)))
    interfaces = [fit_interface(table, mesh, faces, subdomains) for table in config.interface]
    held = np.flatnonzero((model.fixed | (model.spring > 0.0)).any(axis=1))
    sets = [*(interface.nodes for interface in interfaces), held]
    titles = (*(interface.name for interface in interfaces), "supports")
    numbered.append(Region(INTERFACES, titles, set_numbers(count, sets)))
    for interface in interfaces:
        marks.append(Mark(MarkKind.INTERFACE, interface.name))
        places.append(interface.point)
    for domain in subdomains:
        if not domain.floating:
            marks.append(Mark(MarkKind.JOINT, domain.name))
            places.append(domain.joint_point)
    for cut in config.cut:
        marks.append(Mark(MarkKind.CUT, cut.nodes))
        places.append(mesh.points[node_set(mesh, cut.nodes, "[[cut]] nodes")].mean(axis=0))
    return _view(mesh, config.name, numbered, tuple(marks), np.array(places))


def _view(
    mesh: Mesh,
    title: str,
    regions: list[Region],
    marks: tuple[Mark, ...],
    mark_points: FloatArray,
) -> View:
    nodes, corners = surface_nodes(mesh, element_faces(mesh))
    row = np.full(len(mesh.points), -1)
    row[nodes] = np.arange(nodes.size)
    sets = {name: row[rows][row[rows] >= 0] for name, rows in mesh.node_sets.items()}
    shown = [Region(region.title, region.names, region.number[nodes]) for region in regions]
    size = " × ".join(f"{side:.4g}" for side in np.ptp(mesh.points, axis=0))
    return View(
        title=title,
        subtitle=f"{len(mesh.points)} nodes, {mesh.element_count} elements, {size} m",
        points=mesh.points[nodes],
        faces=corners,
        regions=tuple(shown),
        marks=marks,
        mark_points=mark_points,
        sets={name: rows for name, rows in sets.items() if rows.size},
        colour=shown[0].title if shown else "",
    )
