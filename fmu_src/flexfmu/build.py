"""The pipeline: mesh → model → modes → interfaces and frames → reduced body."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from . import __version__
from .config import BodyFile, BodySpec
from .errors import BodyFileError
from .fe.assembly import volume_matrices
from .fe.faces import FaceBlock, element_faces
from .fe.stress import point_stress
from .mesh.checks import checked
from .mesh.formats import file_origin, read_mesh
from .mesh.model import FloatArray, Mesh
from .mesh.plausibility import implausible
from .methods import Data, Mass, has_frames
from .model.reduced_body import GROUND, Properties, ReducedBody, SecondOrder, StressSet, Surface, Ties
from .program.missed_inertia import missed_inertia
from .progress import Reporter
from .reduction.basis import Matrices, modal_basis, stiffness_by_load, stiffness_by_mode
from .reduction.cut import SIDES, Spring, cut_loops, cut_parts, on_section, part_configs, section_tractions, side_set
from .reduction.frames import body_subdomains, fixable_root, several, whole_frame
from .reduction.inertia import element_lumps, lumped_mass
from .reduction.interfaces import Interface, fit_interface
from .reduction.joining import Weld, joined
from .reduction.masses import body_properties, mass_shares, sub_masses
from .reduction.materials import needless
from .reduction.membrane import Stretching, membrane_energy
from .reduction.model import Model, assemble_model
from .reduction.modes import Modes
from .reduction.places import by_name, node_set
from .reduction.rigid_fit import by_node, modal_fit
from .reduction.second_order import hourglass_warnings, node_readings, second_order
from .reduction.sets import element_set
from .reduction.subdomains import Subdomain, carrying_frame, frame_operators
from .reduction.surface import body_surface, second_order_fields
from .store import Store, content_key
from .summary import first_frequency, summary

# Share of an interface's nodes outside the frame that carries it which is worth a warning.
_SPREAD = 0.1
# Modal damping ratio of the first mode above which percent were likely given: rubber has 0.1, a shaken pillow 0.3.
_HEAVY_DAMPING = 0.3
# Sizes of the body beyond which a reference point is hardly meant.
_FAR = 3.0
NUMBERS = "normal_modes"
"""Where a body's origin tells the numbers of its normal modes, if the body file chose them."""


def reduce_body(config: BodyFile, report: Reporter, store: Store | None = None) -> ReducedBody:
    """Read the mesh of a body file and reduce it; see `reduce_mesh`.

    Parameters
    ----------
    config : BodyFile
        With the mesh's path resolved.
    report : Reporter
    store : Store, optional

    Returns
    -------
    ReducedBody
    """
    file = config.mesh.file
    with report.stage(f"Read {file.name}"):
        mesh = read_mesh(file, config.mesh.units)
    return reduce_mesh(mesh, config, file_origin(file), report, store)


def reduce_mesh(
    mesh: Mesh, config: BodySpec, origin: Mapping[str, str], report: Reporter, store: Store | None = None
) -> ReducedBody:
    """Reduce a finite element body.

    Parameters
    ----------
    mesh : Mesh
    config : BodySpec
    origin : mapping of str to str
        Where the mesh is from, for the body's provenance.
    report : Reporter
    store : Store, optional
        Where modes and the like are kept from build to build; default: nowhere.

    Returns
    -------
    ReducedBody

    Raises
    ------
    FlexfmuError
        Anything that the specification or the mesh does not provide, with what to do.
    """
    with report.stage("Check the mesh"):
        given = config
        mesh, config = by_name(checked(mesh), config)
        unused = needless(mesh, config)
        model = assemble_model(mesh, config)
        mesh = model.mesh
        _check_sets(config, mesh)
        properties = body_properties(mesh, volume_matrices(mesh))
    report.note(f"{len(mesh.points)} nodes, {mesh.element_count} elements, {model.free.size} free degrees of freedom")
    for text in (*mesh.notes, *map(" ".join, summary(properties))):
        report.note(text)
    for text in (*implausible(mesh, config.mesh.units), *_distant_points(config, properties)):
        report.warning(text)
    if unused:
        report.warning("[material] is not used: the mesh file gives every element a material; take one of them out")
    store = store or Store()
    if config.cut == "auto":
        with report.stage("Look for loops to cut"):
            config, model, notes = cut_loops(config, model)
        for text in notes:
            report.note(text)
        mesh = model.mesh
    body = _cut_body(config, model, report, store) if config.cut else _reduced(config, model, report, store)[0]
    damping_ratio = _damping(config.damping.ratio, body.mode_count)
    first = float(damping_ratio[body.rigid_count])
    if first > _HEAVY_DAMPING:
        report.warning(
            f"damping.ratio = {first:g} of the first mode: it hardly swings; the ratio is a share of critical damping, "
            "1 % is 0.01"
        )
    report.note(f"first frequency {first_frequency(body.angular_frequency)}")
    if body.surface is not None:
        report.note(_surface_words(body.surface))
    return replace(
        body,
        damping_ratio=damping_ratio,
        compliance_interfaces=tuple(table.name for table in config.interface if table.compliance),
        following_interfaces=tuple(table.name for table in config.interface if table.follows),
        method=config.variant.method,
        mass=config.variant.mass,
        velocity_outputs=config.output.velocities,
        provenance=_provenance(given, mesh, origin),
        properties=properties,
    )


def _reduced(
    config: BodySpec,
    model: Model,
    report: Reporter,
    store: Store,
    springs: Sequence[Spring] = (),
    warping: FloatArray | None = None,
    *,
    cut: bool = False,
) -> tuple[ReducedBody, FloatArray]:
    """Reduce a model in one piece, or a part of a cut one; damping and names are left to be set.

    Also returns the work of the nodal forces `warping` (3n, w), for which the basis has room, (w, m).
    """
    mesh = model.mesh
    with report.stage("Divide into frames and fit interfaces"):
        volumes = volume_matrices(mesh)
        faces = element_faces(mesh)
        subdomains, cuts = body_subdomains(config, model, volumes, faces)
        interfaces = _interfaces(config, model, faces, subdomains, report)
    for text in cuts:
        report.warning(text)
    report.note(f"{len(subdomains)} frames, {len(interfaces)} interfaces")
    if config.frames is not None and len(subdomains) < config.frames:
        report.warning(
            f"frames = {config.frames} were asked for, the body has layers of elements for {len(subdomains)} only: "
            "ask for fewer, or mesh it finer"
        )

    matrices = Matrices(model, volumes, report)
    nodal = [interface.nodal_loads(len(mesh.points)) for interface in interfaces]
    # Forces of all interfaces, then moments.
    loads = np.concatenate([n[:, :3] for n in nodal] + [n[:, 3:] for n in nodal], axis=1)
    one_piece = warping is None
    warping = np.zeros((len(loads), 0)) if warping is None else warping
    every = np.hstack([loads, warping])
    residual = every if config.reduction.residual_flexibility is True else loads[:, config.residual_columns()]
    modes, key = modal_basis(config.reduction, matrices, every, residual, store, report)
    _tell(modes, report)
    frames = frame_operators(mesh.points, modes.shapes, subdomains)
    motion = np.array([interface.motion(modes.shapes) for interface in interfaces])
    stored = config.stored
    by_load = by_mode = None
    if Data.BY_LOAD in stored:
        by_load = stiffness_by_load(matrices, modes, key, loads, config.input.acceleration, store, report)
    if Data.BY_MODE in stored:
        by_mode = stiffness_by_mode(matrices, modes, key, store, report)

    # Parts of a cut body have constant mass.
    lumps = element_lumps(mesh, volumes, subdomains) if one_piece and subdomains else []
    inertia, lump_shares = None, np.zeros((0, len(mesh.points)))
    if lumps and Data.INERTIA in stored:
        inertia, lump_shares = lumped_mass(mesh, volumes, modes.shapes, lumps, frames)
    second = None
    if Data.SECOND_ORDER in stored and subdomains:
        for text in hourglass_warnings(mesh, subdomains):
            report.warning(text)
        heavy = config.input.acceleration
        shares = mass_shares(mesh, volumes, subdomains) if heavy else np.zeros((0, len(mesh.points)))
        shares = np.concatenate([shares, lump_shares])
        turned, nodes = frames.frame_rotation, [by_node(spring.nodes) for spring in springs]
        readings = node_readings(mesh.points, modes.shapes, subdomains, turned, interfaces, shares, nodes)
        rigid = np.flatnonzero(modes.angular_frequency == 0.0)
        floating = any(domain.floating for domain in subdomains)
        with report.stage(f"Find where {len(readings)} places go at second order"):
            second = second_order(mesh, matrices.supported, modes.shapes, rigid, floating, readings)
        if inertia is not None:
            last = len(second.displacement) - 2 * len(nodes)
            lumped = np.arange(last - len(lump_shares), last)
            inertia = replace(inertia, curvature=second.displacement[lumped])
            displacement, rotation = (np.delete(part, lumped, 0) for part in (second.displacement, second.rotation))
            second = SecondOrder(displacement, rotation)

    surface = None
    if config.output.surface:
        fields = _surface_fields(matrices, modes, key, loads, store, report) if second is not None else None
        sets, held = [interface.nodes for interface in interfaces], model.fixed | (model.spring > 0.0)
        moved = np.flatnonzero(held.any(axis=1))
        surface = body_surface(mesh, modes.shapes, faces, subdomains, sets, moved, fields, config.output.stress)
        rigid = modes.angular_frequency == 0.0
        if fields is not None and rigid.any() and not subdomains[0].floating:
            surface = replace(
                surface,
                turn=frames.frame_rotation[:1] * rigid,
                pivot=subdomains[0].joint_point[None],
                piece=np.zeros(len(surface.points), dtype=np.int64),
            )
    membrane = None
    # Parts of a cut body hardly stretch, and its steps would take several times as long.
    wanted = config.reduction.membrane
    if second is not None and (wanted is True or (wanted == "auto" and not cut)):
        stretching = Stretching(matrices, modes, loads, report)
        membrane = membrane_energy(stretching, key, wanted is True, not cut, store)

    body = ReducedBody(
        name=config.name,
        angular_frequency=modes.angular_frequency,
        damping_ratio=np.zeros(modes.angular_frequency.size),
        interface_names=tuple(interface.name for interface in interfaces),
        interface_point=np.array([interface.point for interface in interfaces]),
        interface_displacement=motion[:, :3],
        interface_rotation=motion[:, 3:],
        interface_frame=np.array([interface.frame for interface in interfaces]),
        root_interface=fixable_root(config, model),
        floating=any(domain.floating for domain in subdomains),
        frame_names=tuple(domain.name for domain in subdomains),
        frame_parent=np.array([domain.parent for domain in subdomains], dtype=np.int64),
        joint_point=np.array([domain.joint_point for domain in subdomains]),
        joint_displacement=frames.joint_displacement,
        joint_rotation=frames.joint_rotation,
        frame_rotation=frames.frame_rotation,
        whole=whole_frame(model, volumes, faces, modes.shapes, config) if several(subdomains) else None,
        masses=sub_masses(mesh, volumes, modes.shapes, subdomains) if config.input.acceleration else None,
        inertia=inertia,
        stress_sets=_stress_sets(config, mesh, modes.shapes),
        stiffness_by_load=by_load,
        stiffness_by_mode=by_mode,
        surface=surface,
        ties=_springs(springs, mesh, modes.shapes, subdomains, frames.frame_rotation),
        second=second,
        membrane=membrane,
    )
    if lumps and not body.rigid_count and config.variant.mass is Mass.CONSTANT and has_frames(config.variant.method):
        known = inertia or lumped_mass(mesh, volumes, modes.shapes, lumps, frames)[0]
        body = replace(body, missed_inertia=missed_inertia(replace(body, inertia=known)))
    return body, warping.T @ modes.shapes


def _cut_body(config: BodySpec, model: Model, report: Reporter, store: Store) -> ReducedBody:
    """Reduce the parts of a body each by itself and join them again."""
    names = [table.nodes for table in config.cuts]
    with report.stage("Cut into parts"):
        opened, parts = cut_parts(model, names, config.support)
        configs = part_configs(config, opened, parts)
    fields = _unit_responses(config, model, report, store)
    warping = {}
    for name in names:
        part = next(part for part in parts if side_set(name, SIDES[0]) in part.sections)
        warping[name] = section_tractions(part, side_set(name, SIDES[0]), fields)
    bodies, works = [], []
    for number, (part, own) in enumerate(zip(parts, configs, strict=True), start=1):
        report.note(
            f"part {number} of {len(parts)}: {part.elements.size} elements, interfaces "
            f"{', '.join(table.name for table in own.interface)}"
        )
        sides = [(warping[name], side_set(name, side)) for name in names for side in SIDES]
        forces = [on_section(part, side, shapes) for shapes, side in sides if side in part.sections]
        body, work = _reduced(own, part.model, report, store, part.springs, np.hstack(forces), cut=True)
        widths = np.cumsum([force.shape[1] for force in forces])[:-1]
        works.append(
            dict(zip((side for _, side in sides if side in part.sections), np.split(work, widths), strict=True))
        )
        for name in part.sections:
            if body.interface_frame[body.interface_names.index(name)] < 0:
                raise BodyFileError(f"[[cut]] {name}: no [[frame]] holds nodes of the section, expected one")
        if not own.frame and len(parts) > 1:
            body = replace(body, frame_names=tuple(f"part_{number}_{name}" for name in body.frame_names))
        bodies.append(body)
    ends = [
        {name: (p, body.interface_names.index(name)) for name in parts[p].sections} for p, body in enumerate(bodies)
    ]
    place = {name: end for part in ends for name, end in part.items()}
    loose = [np.array([spring.interface is not None for spring in part.springs], dtype=bool) for part in parts]
    welds = []
    for name in names:
        first, second = (place[side_set(name, side)] for side in SIDES)
        warp = works[first[0]][side_set(name, SIDES[0])], works[second[0]][side_set(name, SIDES[1])]
        welds.append(Weld(first, second, *warp))
    with report.stage(f"Join {len(parts)} parts"):
        body, note = joined(bodies, welds, loose, [table.name for table in config.interface])
    hertz = body.angular_frequency / (2.0 * np.pi)
    report.note(f"{hertz.size} modes, {hertz[0]:.4g} to {hertz[-1]:.4g} Hz; {note}")
    return body


def _unit_responses(config: BodySpec, model: Model, report: Reporter, store: Store) -> FloatArray:
    """Static displacements (3n, l) of the body in one piece under its interfaces' unit loads, of unit work."""
    mesh = model.mesh
    faces = element_faces(mesh)
    loads = np.hstack(
        [fit_interface(table, mesh, faces, ()).nodal_loads(len(mesh.points)) for table in config.interface]
    )
    matrices = Matrices(model, volume_matrices(mesh), report)

    def make() -> dict[str, FloatArray]:
        whole = matrices.supported
        with report.stage(f"Find the static response to {loads.shape[1]} unit loads in one piece"):
            return {"fields": whole.whole(whole.static(loads[whole.free]))}

    found = store.arrays(content_key(__name__, "fields", matrices.key, loads), "static response", report, make)[
        "fields"
    ]
    work = np.einsum("ij,ij->j", loads, found)
    # Loads on a support do nothing.
    fields: FloatArray = found[:, work > 0.0] / np.sqrt(work[work > 0.0])
    return fields


def _surface_fields(
    matrices: Matrices, modes: Modes, modes_key: str, loads: FloatArray, store: Store, report: Reporter
) -> tuple[FloatArray, FloatArray]:
    """What goes with q at second order all over the body, for pictures."""
    mesh, shapes, omega = matrices.model.mesh, modes.shapes, modes.angular_frequency

    def make() -> dict[str, FloatArray]:
        model = matrices.supported
        with report.stage("Find where the surface goes at second order"):
            elastic = np.flatnonzero(omega > 0.0)
            fields, forms = second_order_fields(mesh, model, shapes, elastic, omega**2, loads)
            return {"fields": fields, "forms": forms}

    key = content_key(__name__, "surface", modes_key, loads)
    kept = store.arrays(key, "the surface at second order", report, make)
    return kept["fields"], kept["forms"]


def _surface_words(surface: Surface) -> str:
    """What pictures need of the modal file, and how to leave it out."""
    sizes = {"shapes": surface.modes, "second order": surface.second, "stress": surface.stress}
    # In single precision.
    parts = [f"{words} {part.nbytes / 2048:.0f} KiB" for words, part in sizes.items() if part is not None]
    return f"surface for pictures: {len(surface.points)} points, {', '.join(parts)} ([output] surface, stress)"


def _springs(
    springs: Sequence[Spring],
    mesh: Mesh,
    shapes: FloatArray,
    subdomains: list[Subdomain],
    frame_rotation: FloatArray,
) -> Ties | None:
    """Springs to the ground of a part of a cut body: they pull along the axes wherever the part turns."""
    found = []
    for spring in springs:
        nodes = spring.nodes
        weighted = by_node(nodes)
        centre = weighted.centre(mesh.points)
        displacement, rotation, rank = modal_fit(mesh.points, shapes, weighted, centre)
        frame = carrying_frame(subdomains, nodes)
        if rank < 6 and frame >= 0:
            # A line or a point tells no rotation of its own.
            rotation = frame_rotation[frame]
        arm = mesh.points[nodes] - centre
        values, axes = np.linalg.eigh(arm.T @ arm / nodes.size)
        lever = axes * np.sqrt(np.maximum(values, 0.0))
        zero = np.zeros_like(displacement)
        found.append(
            (
                np.array([frame, GROUND]),
                np.array([centre, centre]),
                np.array([displacement, zero]),
                np.array([rotation, zero]),
                spring.stiffness,
                lever,
            )
        )
    return Ties(*(np.array(values) for values in zip(*found, strict=True))) if found else None


def _tell(modes: Modes, report: Reporter) -> None:
    """Say what modes there are."""
    hertz = modes.angular_frequency[modes.angular_frequency > 0.0] / (2.0 * np.pi)
    rigid = modes.angular_frequency.size - hertz.size
    report.note(
        f"{f'{rigid} rigid motions, ' if rigid else ''}{hertz.size} modes, {hertz[0]:.4g} to {hertz[-1]:.4g} Hz; "
        f"|ΦᵀMΦ − I| = {modes.orthonormality_error:.1e}, "
        f"frequencies to {modes.frequency_error:.1e}"
    )
    if modes.splits_pair:
        report.warning(
            "a mode that is left out has the frequency of one that is not: the body will be softer in one direction "
            "than in the other; take both modes or none"
        )


def _damping(ratio: float | list[float], count: int) -> FloatArray:
    values = np.asarray(ratio, dtype=np.float64)
    if values.ndim and values.size != count:
        raise BodyFileError(
            f"damping.ratio lists {values.size} values, and the basis has {count} modes, interface modes included"
        )
    return np.broadcast_to(values, (count,))


def _check_sets(config: BodySpec, mesh: Mesh) -> None:
    """Find every set that will be asked for before the expensive work begins."""
    for cut in config.cuts:
        node_set(mesh, cut.nodes, "[[cut]] nodes")
    for interface in config.interface:
        node_set(mesh, interface.nodes, f"interface {interface.name!r}, nodes")
    for stress in config.stress:
        element_set(mesh, stress.elements, f"stress {stress.name!r}, elements")
    for frame in config.frame:
        node_set(mesh, frame.nodes, f"frame {frame.name!r}, nodes")
        if isinstance(frame.joint, str):
            node_set(mesh, frame.joint, f"frame {frame.name!r}, joint")
        for name in frame.rotation_points or ():
            node_set(mesh, name, f"frame {frame.name!r}, rotation_points")


def _distant_points(config: BodySpec, properties: Properties) -> list[str]:
    """Say which reference points lie far from the body: they are in m, whatever the mesh is in."""
    low, high = properties.box
    size = float(np.max(high - low))
    points = [(f"interface {table.name!r}", table.point) for table in config.interface if table.point is not None]
    return [
        f"{name}: point = {point} lies {away:.4g} m outside the body, which measures {size:.4g} m; points of the body "
        f"file are in m (the mesh: {config.mesh.units.factors.length_name})"
        for name, point in points
        if (away := float(np.linalg.norm(np.clip(point, low, high) - point))) > _FAR * size
    ]


def _interfaces(
    config: BodySpec, model: Model, faces: tuple[FaceBlock, ...], subdomains: list[Subdomain], report: Reporter
) -> list[Interface]:
    interfaces = [fit_interface(table, model.mesh, faces, subdomains) for table in config.interface]
    for interface in interfaces:
        carrier = f"frame {subdomains[interface.frame].name}" if interface.frame >= 0 else "no frame"
        spread = "by area" if interface.by_area else "by node"
        report.note(
            f"interface {interface.name!r}: {interface.nodes.size} nodes, loads spread {spread}, carried by {carrier}"
        )
        if model.fixed[interface.nodes].all():
            report.warning(
                f"interface {interface.name!r} lies on a support: it does not move, and its loads do nothing"
            )
        if interface.frame >= 0 and not subdomains[interface.frame].floating:
            beyond = np.setdiff1d(interface.nodes, subdomains[interface.frame].body.nodes).size
            if beyond > _SPREAD * interface.nodes.size:
                report.warning(
                    f"interface {interface.name!r}: {beyond} of its {interface.nodes.size} nodes lie outside frame "
                    f"{subdomains[interface.frame].name}, which carries all of it; take a smaller set"
                )
        if interface.frame < 0 and subdomains:
            report.warning(
                f"interface {interface.name!r} touches no frame: it will move linearly; put its nodes into a [[frame]]"
            )
    return interfaces


def _stress_sets(config: BodySpec, mesh: Mesh, shapes: FloatArray) -> tuple[StressSet, ...]:
    result = []
    for table in config.stress:
        elements = element_set(mesh, table.elements, f"stress {table.name!r}, elements")
        result.append(StressSet(table.name, *point_stress(mesh, elements, shapes)))
    return tuple(result)


def _provenance(config: BodySpec, mesh: Mesh, origin: Mapping[str, str]) -> dict[str, str]:
    """Hashes of what went in, and what made it."""
    return {
        **origin,
        "body_sha256": hashlib.sha256(config.model_dump_json(exclude={"mesh": {"file"}}).encode()).hexdigest(),
        "nodes": str(len(mesh.points)),
        "elements": str(mesh.element_count),
        "flexfmu_version": __version__,
        **({NUMBERS: " ".join(map(str, config.reduction.numbers))} if isinstance(config.reduction.modes, list) else {}),
    }
