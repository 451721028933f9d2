"""Views of a mesh before anything is reduced: node sets, supports, interfaces, frames, joints and cuts."""

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ..files.basics import FloatArray, IntArray, UnitSystem
from ..files.outputs import Reporter
from ..mesh.checks import checked
from ..mesh.formats import read_mesh
from ..mesh.model import Mesh
from ..model.reduced_body import GROUND
from ..reduction.bodies import body_subdomains, fit_interface
from ..reduction.cut.cut import cut_parts, part_configs
from ..reduction.cut.parts import cut_loops
from ..reduction.model import Model
from ..reduction.options import PLACED, BodyOptions, node_set, support_places
from ..reduction.subdomains import Subdomain, first_of
from ..reduction.surface import carrying_frames, surface_nodes
from .model import Mark, Region, View
from .motions import FRAMES, INTERFACES, support_marks


def mesh_view(path: Path) -> View:
    """A mesh file with its node sets; lengths are taken for metres."""
    return _view(checked(read_mesh(path, UnitSystem.SI)), path.name, [], (), np.zeros((0, 3)))


def model_view(options: BodyOptions, model: Model, report: Reporter) -> View:
    """A finite element model with its supports, interfaces, frames and cuts, without any reduction.

    Parameters
    ----------
    options : BodyOptions
    model : Model
    report : Reporter

    Returns
    -------
    View

    Raises
    ------
    FlexfmuError
        What the mesh does not provide.
    """
    if options.find_cuts:
        options, model, _ = cut_loops(options, model)
    mesh = model.mesh
    count = len(mesh.points)
    numbered = []
    with report.stage("Divide into frames"):
        subdomains, names, frame = _frames(options, model, report)
    if subdomains:
        numbered.append(Region(FRAMES, names, frame))
    interfaces = [fit_interface(table, mesh, ()) for table in options.interfaces]
    held = np.flatnonzero((model.fixed | model.sprung).any(axis=1))
    sets = [*(interface.nodes for interface in interfaces), held]
    titles = (*(interface.name for interface in interfaces), "supports")
    numbered.append(Region(INTERFACES, titles, first_of(sets, count)))
    supports, points, springs = support_places(mesh, options.supports)
    marks = [Mark("interface", interface.name) for interface in interfaces] + support_marks(supports, springs)
    places = [*(interface.point for interface in interfaces), *points]
    for name, domain in zip(names, subdomains, strict=True):
        if not domain.floating:
            marks.append(Mark("joint", name))
            places.append(domain.joint_point)
    for cut in options.cuts:
        marks.append(Mark("cut", cut))
        places.append(mesh.points[node_set(mesh, cut, "[[cut]] nodes")].mean(axis=0))
    return _view(mesh, options.name, numbered, tuple(marks), np.array(places))


def _frames(config: BodyOptions, model: Model, report: Reporter) -> tuple[list[Subdomain], tuple[str, ...], IntArray]:
    """Frames of the body, or of the parts of a cut one, their names, and which of them carries each node."""
    points = model.mesh.points
    pieces: list[tuple[BodyOptions, Model]] = [(config, model)]
    if config.cuts:
        opened, parts = cut_parts(model, config.cuts, config.supports)
        pieces = list(zip(part_configs(config, opened, parts), (part.model for part in parts), strict=True))
    every: list[Subdomain] = []
    names: list[str] = []
    number = np.full(len(points), GROUND)
    for k, (own, piece) in enumerate(pieces, start=1):
        mesh = piece.mesh
        found, warnings = body_subdomains(own, piece)
        report.tell(warnings=warnings)
        carried = carrying_frames(len(mesh.points), found)
        # A part's mesh holds copies of the body's nodes.
        nodes = np.arange(len(points)) if len(pieces) == 1 else cKDTree(points).query(mesh.points)[1]
        number[nodes[carried >= 0]] = carried[carried >= 0] + len(every)
        prefix = f"part_{k}_" if len(pieces) > 1 and not own.frames else ""
        names += [prefix + domain.name for domain in found]
        every += found
    return every, tuple(names), number


def _view(mesh: Mesh, title: str, regions: list[Region], marks: tuple[Mark, ...], mark_points: FloatArray) -> View:
    nodes, corners = surface_nodes(mesh)
    row = np.full(len(mesh.points), -1)
    row[nodes] = np.arange(nodes.size)
    named = {name: rows for name, rows in mesh.node_sets.items() if not name.startswith(PLACED)}
    sets = {name: row[rows][row[rows] >= 0] for name, rows in named.items()}
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
