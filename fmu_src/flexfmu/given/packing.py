"""Bodies of modes that another program found: frames, interfaces and masses from the modes alone."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np

from ..build.choices import Interface, NodeChoices, Nodes, checked_spec, plain as plain_value
from ..build.config import BodySpec
from ..files.basics import BodyFileError, FloatArray, IntArray, OptionError, UnitSystem, own_version, plural
from ..files.outputs import SCRIPT, Reporter
from ..fmu.built_body import BuiltBody, load
from ..mesh.checks import checked
from ..mesh.in_memory import Contents, from_contents
from ..mesh.model import Material, Mesh
from ..model.methods import Mass, Method, Variant, needs
from ..model.reduced_body import GROUND, Masses, ReducedBody
from ..model.summary import first_frequency
from ..reduction import bodies
from ..reduction.model import Model
from ..reduction.options import BodyOptions, node_set
from ..reduction.rigid_fit import by_node
from ..reduction.subdomains import Subdomain, fitted_rotation, frame_operators, on_floating_frame, requested_subdomains
from ..reduction.surface import body_surface
from .linear import SUFFIX as SID, read_sid
from .modes import GivenModes, checked_modes, read_given


def pack(
    modes: GivenModes | str | Path,
    interfaces: Mapping[str, Interface | Nodes],
    supports: Sequence[Nodes] = (),
    *,
    method: Method | str | None = None,
    frames: int | Sequence[Mapping[str, Any]] | None = None,
    damping: float | Sequence[float] = 0.0,
    name: str | None = None,
    acceleration: bool = False,
    velocities: bool = False,
    surface: bool = True,
    report: Reporter = SCRIPT,
) -> BuiltBody:
    """Make a body of modes that another program found.

    Parameters
    ----------
    modes : GivenModes or path
        A path of .npz or .h5.
    interfaces : mapping of str to Interface or Nodes
    supports : sequence of Nodes
        Where the frames hang if no node is held by all modes: the nodes of springs, say.
    method : Method or str, optional
        One that needs no stiffness; default: "frames".
    frames : int or sequence of mapping, optional
        How many, which takes cells; or tables as of `[[frame]]`.
    damping : float or sequence of float
        Default: that of the modes.
    name : str, optional
    acceleration, velocities, surface : bool
        Keys of `[input]` and `[output]`.
    report : Reporter, optional

    Returns
    -------
    BuiltBody

    Examples
    --------
    >>> arm = flexfmu.pack("modes.npz", {"tip": "TIP"}, frames=2, damping=0.01)
    >>> arm.method.value
    'frames'
    """
    given = modes if isinstance(modes, GivenModes) else read_given(modes)
    choices = NodeChoices(_nodes_alone(given), UnitSystem.SI)
    data: dict[str, Any] = {
        "name": name or given.name,
        **choices.tables(supports, interfaces),
        "damping": {"ratio": plain_value(damping)},
        "input": {"acceleration": acceleration},
        "output": {"velocities": velocities, "surface": surface},
        **({"reduction": {"second_order": False}} if method is None else {"formulation": {"method": method}}),
    }
    if frames is not None:
        data["frames" if isinstance(frames, int) else "frame"] = plain_value(frames)
    return BuiltBody(reduce_given(replace(given, sets=choices.mesh.node_sets), checked_spec(data), report))


def pack_file(
    file: Path,
    interfaces: Sequence[str],
    supports: Sequence[str],
    frames: int | None,
    method: str | None,
    damping: float,
    name: str | None,
    report: Reporter,
) -> BuiltBody:
    """Make a body of a file of given modes, or of a modal file, as `flexfmu pack` does.

    Parameters
    ----------
    file : Path
    interfaces : sequence of str
        "NAME=SET", or a set's name alone.
    supports : sequence of str
    frames : int or None
    method : str or None
    damping : float
    name : str or None
    report : Reporter

    Returns
    -------
    BuiltBody
    """
    if _is_modal_file(file):
        if interfaces or supports or frames is not None or damping or name:
            raise BodyFileError(f"{file} is a modal file, a body as it is: only --method and --output go with it")
        return load(file, method)
    if file.suffix.lower() == SID:
        if interfaces or supports or frames or damping:
            raise BodyFileError(f"{file} is SID_FEM, a linear body as it is: only --name and --output go with it")
        return BuiltBody(read_sid(file, name), method)
    given = read_given(file)
    if not interfaces:
        there = ", ".join(given.sets) or "none"
        raise BodyFileError(f"no interface: give --interface NAME=SET, which may be repeated; sets of {file}: {there}")
    pairs = (text.partition("=") for text in interfaces)
    named = {name.strip(): (nodes or name).strip() for name, _, nodes in pairs}
    return pack(given, named, supports, method=method, frames=frames, damping=damping, name=name, report=report)


def _is_modal_file(file: Path) -> bool:
    """Whether an HDF5 file is a body of ours rather than modes alone."""
    if not file.is_file() or not h5py.is_hdf5(file):
        return False
    try:
        with h5py.File(file) as contents:
            return "format" in contents.attrs
    except OSError:
        return False


def reduce_given(given: GivenModes, spec: BodySpec, report: Reporter) -> ReducedBody:
    """Reduced body of given modes.

    Parameters
    ----------
    given : GivenModes
    spec : BodySpec
        Its interfaces, frames, supports (where the tree hangs, if no node is held), damping and outputs; modes,
        material and units are those of `given`.
    report : Reporter

    Returns
    -------
    ReducedBody

    Raises
    ------
    GivenModesError
        Modes, masses or sets that do not belong together.
    BodyFileError
        Interfaces or frames that the body cannot have.
    OptionError
        A method that needs the body's stiffness.
    """
    variant = _variant(spec)
    given, notes, warnings = checked_modes(given)
    mesh, rows = _mesh(given)
    report.tell((*notes, *mesh.notes), warnings)
    shapes = given.modes[:, rows].reshape(len(given.modes), -1).T
    options = replace(spec.options, variant=variant, stored=frozenset())
    model = _model(given, mesh, options, shapes, rows)
    subdomains = _frames(given, options, model, rows, report)
    interfaces = [bodies.fit_interface(one, mesh, subdomains) for one in options.interfaces]
    frames = frame_operators(mesh.points, shapes, subdomains)
    frequency = 2.0 * np.pi * given.frequency
    use = replace(
        spec.use,
        damping=spec.damping.ratio if spec.damping.ratio or given.damping is None else given.damping,
        variant=variant,
        provenance={"modes_of": given.name, "nodes": str(len(given.nodes)), "flexfmu_version": own_version()},
    )
    surface = None
    if options.surface and mesh.blocks:
        held = np.flatnonzero(model.fixed.any(axis=1))
        surface = body_surface(mesh, shapes, subdomains, [interface.nodes for interface in interfaces], held)
    body = bodies.made_body(
        use,
        **bodies.motion_of_tree(frequency, shapes, interfaces, subdomains, frames),
        whole=bodies.whole_frame(model, shapes, options) if bodies.several(subdomains) and mesh.blocks else None,
        masses=_masses(given, subdomains, shapes, mesh, rows) if options.acceleration else None,
        surface=surface,
    )
    found = f"{plural(body.mode_count, 'mode')}, {plural(body.frame_count, 'frame')}, {given.nodal_mass.sum():.4g} kg"
    report.note(f"{found}; first frequency {first_frequency(body.angular_frequency)}")
    return body


def _variant(spec: BodySpec) -> Variant:
    """Method and mass to start with: frames, unless another is asked for that needs nothing but modes."""
    if spec.formulation.method is None:
        method = Method.LINEAR if spec.frames == 0 and not spec.free else Method.FRAMES
        return Variant(method, spec.formulation.mass or Mass.CONSTANT)
    variant = spec.formulation.variant
    if needs(variant.method, variant.mass):
        raise OptionError(
            f'method "{variant.words}" needs the body\'s stiffness and elements, which modes alone do not hold: take '
            '"frames" (several of them), or build the body from its mesh'
        )
    if spec.cut or spec.stress:
        raise OptionError("[[cut]] and [[stress]] need the body's mesh and material: build it from its mesh")
    return variant


def _nodes_alone(given: GivenModes) -> Mesh:
    """Nodes and their sets as a mesh without elements."""
    count = len(given.nodes)
    return Mesh(given.nodes, np.arange(count), (), dict(given.sets), {}, (), np.zeros((count, 3), dtype=bool))


def _mesh(given: GivenModes) -> tuple[Mesh, IntArray]:
    """Nodes and cells as a mesh of one density, and the rows of the nodes that it has."""
    labels = np.arange(len(given.nodes))
    if not given.cells:
        return _nodes_alone(given), labels
    plain = meshio.Mesh(given.nodes, list(given.cells.items()), point_sets=dict(given.sets))
    mesh = from_contents(Contents(plain, labels), "the cells", UnitSystem.SI)
    mesh = checked(mesh)
    blocks = tuple(replace(block, material=np.zeros(len(block.labels), dtype=np.int64)) for block in mesh.blocks)
    density = float(given.nodal_mass.sum()) / float(mesh.volumes.sum())
    # Stiffness is in the modes; it is never asked for here.
    return replace(mesh, blocks=blocks, materials=(Material("given", 1.0, 0.0, density),)), mesh.labels


def _model(given: GivenModes, mesh: Mesh, options: BodyOptions, shapes: FloatArray, rows: IntArray) -> Model:
    """Where the tree hangs: nodes that no mode moves, or the supports that are named."""
    fixed = np.zeros((len(mesh.points), 3), dtype=bool)
    fixed[np.isin(rows, given.held)] = True
    for number, support in enumerate(options.supports, start=1):
        fixed[node_set(mesh, support.nodes, f"support[{number}].nodes")] = True
    rigid = shapes[:, given.frequency == 0.0]
    if rigid.shape[1] and options.supports:
        raise BodyFileError("the modes are those of a body that nothing holds: take out the supports")
    if not rigid.shape[1] and not fixed.any():
        found = "no node is held by all modes, and they are not those of a free body"
        advice = "name the nodes from which the body's frames hang (support = …), such as those of its springs"
        raise BodyFileError(f"{found}: {advice}")
    return Model(mesh, fixed, np.zeros(fixed.shape), rigid, np.zeros(fixed.shape))


def _frames(given: GivenModes, options: BodyOptions, model: Model, rows: IntArray, report: Reporter) -> list[Subdomain]:
    """Frames: of elements where there are some; of nodes alone one frame, or those of node sets."""
    points = model.mesh.points
    mass = given.nodal_mass[rows]
    heavy = np.flatnonzero(mass > 0.0)
    whole = by_node(heavy, mass[heavy])
    none, turn = np.zeros(0, dtype=np.int64), fitted_rotation(points, whole)
    free = Subdomain("floating", GROUND, none, whole, turn, whole, whole.centre(points), (), True)
    floating = [free] if model.rigid.shape[1] else []
    if model.mesh.blocks:
        found, warnings = bodies.body_subdomains(options, model)
        report.tell(warnings=warnings)
        # The floating frame is that of the given mass, not of the elements' volume.
        return [*floating, *found[len(floating) :]]
    if options.branches or (options.levels_asked and options.levels > 1):
        fault = "the modes come without cells: the body cannot be divided by itself"
        raise BodyFileError(f"{fault}; give the cells, or node sets of the frames ([[frame]] tables), or frames = 1")
    if options.frames:
        held = np.flatnonzero(model.fixed.any(axis=1))
        asked = bodies.frame_requests(options, model.mesh)
        return floating + on_floating_frame(requested_subdomains(model.mesh, held, asked), len(floating))
    if floating or options.levels == 0:
        return floating
    joint = by_node(np.flatnonzero(model.fixed.any(axis=1)))
    return [Subdomain("body", GROUND, none, whole, turn, joint, joint.centre(points))]


def _masses(given: GivenModes, subdomains: list[Subdomain], shapes: FloatArray, mesh: Mesh, rows: IntArray) -> Masses:
    """Mass of each sub-domain, and of what lies in none; nodes of several count for each in equal shares."""
    inside = np.zeros((len(subdomains) + 1, len(rows)))
    for s, domain in enumerate(subdomains):
        if not domain.floating:
            inside[s, domain.body.nodes] = 1.0
    inside[0 if subdomains and subdomains[0].floating else -1, ~inside.any(axis=0)] = 1.0
    share = inside / inside.sum(axis=0) * given.nodal_mass[rows]
    mass = share.sum(axis=1)
    kept = mass > 0.0
    mean = share[kept] / mass[kept, None]
    displacement = np.tensordot(mean, shapes.reshape(len(rows), 3, -1), axes=1)
    return Masses(mass[kept], mean @ mesh.points, displacement, np.append(np.arange(len(subdomains)), GROUND)[kept])
