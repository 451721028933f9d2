"""From a body file to the finite element model: read, checked, with materials and supports."""

from dataclasses import dataclass

from ..files.progress import Reporter
from ..mesh.checks import checked
from ..mesh.formats import read_mesh
from ..mesh.model import Mesh
from ..reduction.model import Model, assemble_model, needless
from ..reduction.options import BodyOptions
from ..reduction.places import by_name, element_set, node_set
from .config import BodyFile, BodySpec


@dataclass(frozen=True, slots=True)
class BodyModel:
    """A finite element model, and what to make of it.

    Attributes
    ----------
    options : BodyOptions
        With places turned into node sets of the mesh.
    model : Model
    unused_material : bool
        Whether `[material]` is for nothing.
    """

    options: BodyOptions
    model: Model
    unused_material: bool


def read_body_model(config: BodyFile, report: Reporter) -> BodyModel:
    """Read the mesh of a body file; see `body_model`."""
    with report.stage(f"Read {config.mesh.file.name}"):
        mesh = read_mesh(config.mesh.file, config.mesh.units, config.shells, config.mesh.timeout)
    return body_model(mesh, config)


def body_model(mesh: Mesh, config: BodySpec) -> BodyModel:
    """Give a mesh the materials and supports of a body file, and find every set that will be asked for.

    Parameters
    ----------
    mesh : Mesh
    config : BodySpec

    Returns
    -------
    BodyModel

    Raises
    ------
    FlexfmuError
        Anything that the body file or the mesh does not provide, with what to do.
    """
    mesh, options = by_name(checked(mesh), config.options)
    unused = needless(mesh, options)
    model = assemble_model(mesh, options)
    _check_sets(options, model.mesh)
    return BodyModel(options, model, unused)


def _check_sets(options: BodyOptions, mesh: Mesh) -> None:
    """Find every set that will be asked for before the expensive work begins."""
    for cut in options.cuts:
        node_set(mesh, cut, "[[cut]] nodes")
    for interface in options.interfaces:
        node_set(mesh, interface.nodes, f"interface {interface.name!r}, nodes")
    for stress in options.stress:
        element_set(mesh, stress.elements, f"stress {stress.name!r}, elements")
    for frame in options.frames:
        node_set(mesh, frame.nodes, f"frame {frame.name!r}, nodes")
        if isinstance(frame.joint, str):
            node_set(mesh, frame.joint, f"frame {frame.name!r}, joint")
        for name in frame.rotation_points:
            node_set(mesh, name, f"frame {frame.name!r}, rotation_points")
