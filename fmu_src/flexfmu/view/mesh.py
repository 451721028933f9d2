"""Views of a mesh before anything is reduced: node sets, supports, interfaces, frames, joints and cuts."""

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ..build.config import BodyFile, BodySpec
from ..build.reduce import check_sets
from ..files.array_types import FloatArray, IntArray
from ..files.progress import Reporter
from ..files.units import UnitSystem
from ..mesh.checks import checked
from ..mesh.formats import read_mesh
from ..mesh.model import Mesh
from ..model.reduced_body import GROUND
from ..reduction.cut.cut import cut_loops, cut_parts, part_configs
from ..reduction.frames import body_subdomains
from ..reduction.interfaces import fit_interface
from ..reduction.model import Model, assemble_model
from ..reduction.places import node_set
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
        check_sets(config, mesh)
        if config.cut == "auto":
            config, model, _ = cut_loops(config, model)
            mesh = model.mesh
    count = len(mesh.points)
    faces = mesh.faces
    numbered = []
    marks, places = [], []
    with report.stage("Divide into frames"):
        subdomains, names, frame = _frames(config, model, report)
    if subdomains:
        numbered.append(Region(FRAMES, names, frame))
    interfaces = [fit_interface(table, mesh, faces, ()) for table in config.interface]
    held = np.flatnonzero((model.fixed | (model.spring > 0.0)).any(axis=1))
    sets = [*(interface.nodes for interface in interfaces), held]
    titles = (*(interface.name for interface in interfaces), "supports")
    numbered.append(Region(INTERFACES, titles, set_numbers(count, sets)))
    for interface in interfaces:
        marks.append(Mark(MarkKind.INTERFACE, interface.name))
        places.append(interface.point)
    for name, domain in zip(names, subdomains, strict=True):
        if not domain.floating:
            marks.append(Mark(MarkKind.JOINT, name))
            places.append(domain.joint_point)
    for cut in config.cuts:
        marks.append(Mark(MarkKind.CUT, cut.nodes))
        places.append(mesh.points[node_set(mesh, cut.nodes, "[[cut]] nodes")].mean(axis=0))
    return _view(mesh, config.name, numbered, tuple(marks), np.array(places))


def _frames(config: BodyFile, model: Model, report: Reporter) -> tuple[list[Subdomain], tuple[str, ...], IntArray]:
    """Frames of the body, or of the parts of a cut one, their names, and which of them carries each node."""
    points = model.mesh.points
    pieces: list[tuple[BodySpec, Model]] = [(config, model)]
    if config.cut:
        opened, parts = cut_parts(model, [cut.nodes for cut in config.cuts], config.support)
        pieces = list(zip(part_configs(config, opened, parts), (part.model for part in parts), strict=True))
    every: list[Subdomain] = []
    names: list[str] = []
    number = np.full(len(points), GROUND)
    for k, (own, piece) in enumerate(pieces, start=1):
        mesh = piece.mesh
        found, warnings = body_subdomains(own, piece, mesh.volume_matrices, mesh.faces)
        for text in warnings:
            report.warning(text)
        carried = carrying_frames(len(mesh.points), found)
        # A part's mesh holds copies of the body's nodes.
        nodes = np.arange(len(points)) if len(pieces) == 1 else cKDTree(points).query(mesh.points)[1]
        number[nodes[carried >= 0]] = carried[carried >= 0] + len(every)
        prefix = f"part_{k}_" if len(pieces) > 1 and not own.frame else ""
        names += [prefix + domain.name for domain in found]
        every += found
    return every, tuple(names), number


def _view(
    mesh: Mesh,
    title: str,
    regions: list[Region],
    marks: tuple[Mark, ...],
    mark_points: FloatArray,
) -> View:
    nodes, corners = surface_nodes(mesh, mesh.faces)
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
