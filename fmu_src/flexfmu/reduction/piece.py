"""A body in one piece, or a part of a cut one: model → modes → interfaces and frames → reduced body."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..fe.stress import point_stress, stress_jumps
from ..files.array_types import FloatArray
from ..files.counts import plural
from ..files.progress import Reporter
from ..files.store import Store, content_key
from ..model.inertia import LumpedMass
from ..model.membrane import Membrane
from ..model.methods import Data, Mass, has_frames
from ..model.reduced_body import GROUND, ReducedBody, SecondOrder, Shadow, StressSet, Surface, Ties
from .basis import Matrices, completed_basis, modal_basis, stiffness_by_load, stiffness_by_mode
from .buckling import buckling_loads
from .cut.cut import Spring
from .frames import body_subdomains, fixable_root, several, whole_frame
from .inertia import element_lumps, lumped_mass
from .interfaces import InterfaceFit, fit_interface
from .making import NO_PARTS, Motion, Parts, made_body
from .masses import Centre, mass_centres, sub_masses
from .membrane import Stretching, membrane_energy
from .model import Model
from .modes import Modes, frequency_spread
from .options import BodyOptions, BodyUse
from .rigid_fit import by_node, modal_fit
from .second_order import node_readings, second_order
from .sets import element_set
from .shadow import THIRD_LEAST, THIRD_MOST, embedding, shadow_options
from .subdomains import FrameOperators, Subdomain, carrying_frame, frame_operators
from .surface import body_surface, second_order_fields, surface_nodes
from .third_order import third_order_loads, with_third_order
from .watched import watched_material

# Share of an interface's nodes outside the frame that carries it which is worth a warning.
_SPREAD = 0.1
# Share of the body's nodes that no interface is likely to have.
_MOST = 0.9
# Share of deflections that a coarse mesh may lack in silence.
_JUMPS = 0.05
# Frames of the tree that the mass of the turned body is taken from.
_FINE = 8


@dataclass(frozen=True, slots=True)
class Reduced:
    """A reduced piece, and what its whole needs beside it.

    Attributes
    ----------
    body : ReducedBody
        Without damping, names and properties.
    warping_work, shadow_work : (w, m) float
        Work of the nodal forces `warping` on the basis, and on that of the shadow.
    fine : ReducedBody or None
        Of held pieces: the same modes on a finer tree, with the mass of the turned body.
    shapes : (3n, m) float
        Its modes.
    span : (m, k) float
        Its coordinates in the motions of another basis.
    """

    body: ReducedBody
    warping_work: FloatArray
    shadow_work: FloatArray
    fine: ReducedBody | None
    shapes: FloatArray
    span: FloatArray


@dataclass(frozen=True, slots=True)
class _Divided:
    """A model with its frames and interfaces."""

    model: Model
    subdomains: list[Subdomain]
    interfaces: list[InterfaceFit]
    open_loops: bool

    def unit_loads(self) -> FloatArray:
        """Nodal loads (3n, 6i) of unit forces on all interfaces, then of unit moments."""
        nodal = [interface.nodal_loads(len(self.model.mesh.points)) for interface in self.interfaces]
        return np.concatenate([n[:, :3] for n in nodal] + [n[:, 3:] for n in nodal], axis=1)


@dataclass(frozen=True, slots=True)
class _Basis:
    """The modes of a divided model, and how its frames move with them."""

    matrices: Matrices
    modes: Modes
    key: str
    frames: FrameOperators


def reduced_piece(
    config: BodyOptions,
    model: Model,
    report: Reporter,
    store: Store,
    springs: Sequence[Spring] = (),
    warping: FloatArray | None = None,
    spanned: FloatArray | None = None,
) -> Reduced:
    """Reduce a model in one piece, or a part of a cut one.

    Parameters
    ----------
    config : BodyOptions
        Of the piece.
    model : Model
    report : Reporter
    store : Store
    springs : sequence of Spring
        From a part to the ground.
    warping : (3n, w) float, optional
        Nodal forces on a part's sections, for which the basis has room; none: the body is in one piece.
    spanned : (3n, k) float, optional
        Motions of another basis.

    Returns
    -------
    Reduced
    """
    divided = _divided(config, model, report)
    matrices = Matrices(model, report)
    loads, cut = divided.unit_loads(), warping is not None
    warping = np.zeros((len(loads), 0)) if warping is None else warping
    every = np.hstack([loads, warping])
    basis = _with_modes(config, divided, matrices, every, report, store)
    body = _reduced(config, divided, basis, springs, report, store, cut=cut)
    fine = _fine_tree(config, divided, basis, body.membrane) if config.certificate or not cut else None
    work = finer_work = warping.T @ basis.modes.shapes
    if config.certificate:
        with report.stage("Reduce the body once more, finer, to know its error"):
            finer, finer_basis = _shadow(config, divided, basis, every, springs, store, cut=cut)
        span = embedding(matrices.supported, finer_basis.modes.shapes, basis.modes.shapes)
        body, finer_work = replace(body, shadow=Shadow(finer, span)), warping.T @ finer_basis.modes.shapes
    shapes = basis.modes.shapes
    spanned = np.zeros((len(loads), 0)) if spanned is None else spanned
    return Reduced(body, work, finer_work, fine, shapes, embedding(matrices.supported, shapes, spanned))


def _shadow(
    config: BodyOptions,
    divided: _Divided,
    basis: _Basis,
    every: FloatArray,
    springs: Sequence[Spring],
    store: Store,
    cut: bool,
) -> tuple[ReducedBody, _Basis]:
    """The body once more, with more frames and all that its basis may lack under loads (3n, l)."""
    quiet, model = Reporter(), divided.model
    finer = shadow_options(config, divided.subdomains)
    loads, matrices = divided.unit_loads(), basis.matrices
    third = third_order_loads(matrices, basis.modes, loads, THIRD_LEAST, THIRD_MOST, store, quiet)
    buckled = store.arrays(
        content_key(__name__, "buckling", matrices.key, loads), "shapes of buckling", quiet,
        lambda: {"forces": buckling_loads(matrices, loads, quiet)},
    )["forces"]  # fmt: skip
    lacking = np.hstack([every, third, buckled])
    modes, key = completed_basis(basis.matrices, basis.modes, basis.key, lacking, store, quiet)
    again = _divided(finer, model, quiet)
    own = _Basis(basis.matrices, modes, key, frame_operators(model.mesh.points, modes.shapes, again.subdomains))
    return _reduced(finer, again, own, springs, quiet, store, cut=cut), own


def _reduced(
    config: BodyOptions,
    divided: _Divided,
    basis: _Basis,
    springs: Sequence[Spring],
    report: Reporter,
    store: Store,
    cut: bool,
) -> ReducedBody:
    """The body of a divided model in a basis."""
    mesh, subdomains, modes = divided.model.mesh, divided.subdomains, basis.modes
    loads = divided.unit_loads()
    # Parts of a cut body have constant mass.
    lumps = element_lumps(mesh, subdomains) if subdomains and not cut else []
    carried = [carrying_frame(subdomains, one.nodes) for one in mesh.masses]
    inertia: LumpedMass | None = None
    lump_centres: list[Centre] = []
    if lumps and Data.INERTIA in config.stored:
        inertia, lump_centres = lumped_mass(mesh, modes.shapes, lumps, basis.frames, carried)
    second, membrane = None, None
    if Data.SECOND_ORDER in config.stored and subdomains:
        second, curvature = _second_order(config, divided, basis, springs, lump_centres, report)
        if inertia is not None:
            inertia = replace(inertia, curvature=curvature)
        membrane = _membrane(config, divided, basis, loads, report, store, cut=cut)
    parts = replace(
        _parts(config, divided, basis, loads, second, report, store),
        inertia=inertia,
        ties=_springs(springs, divided, basis),
        membrane=membrane,
    )
    motion = Motion.of_tree(modes.angular_frequency, modes.shapes, divided.interfaces, subdomains, basis.frames)
    return made_body(motion, BodyUse(config.name), parts)


def _fine_tree(config: BodyOptions, divided: _Divided, basis: _Basis, membrane: Membrane | None) -> ReducedBody | None:
    """The modes on a tree of `_FINE` frames to second order, with its lumps, whatever the body's own frames are."""
    quiet, model, modes = Reporter(), divided.model, basis.modes
    unheard = config.variant.mass is Mass.CONFIGURATION or not has_frames(config.variant.method)
    if unheard or not divided.subdomains:
        return None
    alone = replace(
        config, levels=_FINE, levels_asked=False, frames=(), branches=(), acceleration=False,
        interfaces=config.interfaces[:1], stored=config.stored | {Data.SECOND_ORDER},
    )  # fmt: skip
    found = _divided(alone, model, quiet)
    frames = frame_operators(model.mesh.points, modes.shapes, found.subdomains)
    lumps = element_lumps(model.mesh, found.subdomains)
    carried = [carrying_frame(found.subdomains, one.nodes) for one in model.mesh.masses]
    inertia, centres = lumped_mass(model.mesh, modes.shapes, lumps, frames, carried)
    second, curvature = _second_order(alone, found, replace(basis, frames=frames), (), centres, quiet)
    motion = Motion.of_tree(modes.angular_frequency, modes.shapes, found.interfaces, found.subdomains, frames)
    parts = Parts(second=second, membrane=membrane, inertia=replace(inertia, curvature=curvature))
    return made_body(motion, BodyUse(config.name), parts)


def _with_modes(
    config: BodyOptions, divided: _Divided, matrices: Matrices, every: FloatArray, report: Reporter, store: Store
) -> _Basis:
    """The modes of a divided model, with room for loads (3n, l): of units on interfaces, and warping of sections."""
    chosen = config.basis.residual
    residual = every if chosen is True else every[:, list(chosen or ())]
    modes, key = modal_basis(config.basis, matrices, every, residual, store, report)
    if config.basis.by_need and Data.SECOND_ORDER in config.stored:
        modes, key = with_third_order(matrices, modes, key, divided.unit_loads(), store, report)
    _tell(modes, report)
    _tell_coarse(divided.model, modes, report)
    return _Basis(matrices, modes, key, frame_operators(divided.model.mesh.points, modes.shapes, divided.subdomains))


def _parts(
    config: BodyOptions,
    divided: _Divided,
    basis: _Basis,
    loads: FloatArray,
    second: SecondOrder | None,
    report: Reporter,
    store: Store,
) -> Parts:
    """What the body holds beside its motion, by its options."""
    model, subdomains, matrices = divided.model, divided.subdomains, basis.matrices
    modes, key, stored = basis.modes, basis.key, config.stored
    by_load, by_mode = Data.BY_LOAD in stored, Data.BY_MODE in stored
    surface = _surface(config, divided, basis, loads, second, report, store) if config.surface else None
    loaded = stiffness_by_load(matrices, modes, key, loads, config.acceleration, store, report) if by_load else None
    parts, spread = NO_PARTS, None
    if config.watched:
        spread = frequency_spread(matrices.supported, modes.angular_frequency, modes.shapes)
        turned = basis.frames.frame_rotation
        parts = Parts(*watched_material(model.mesh, modes.shapes, modes.angular_frequency, loads, subdomains, turned))
    return replace(
        parts,
        root_interface=fixable_root(config, model),
        whole=whole_frame(model, modes.shapes, config) if several(subdomains) else None,
        masses=sub_masses(model.mesh, modes.shapes, subdomains) if config.acceleration else None,
        stress_sets=_stress_sets(config, model, modes),
        stiffness_by_load=loaded,
        stiffness_by_mode=stiffness_by_mode(matrices, modes, key, store, report) if by_mode else None,
        frequency_spread=spread,
        damper=model.damper_rows(modes.shapes),
        surface=surface,
        second=second,
    )


def _divided(config: BodyOptions, model: Model, report: Reporter) -> _Divided:
    """Divide a model into frames, and fit its interfaces."""
    with report.stage("Divide into frames and fit interfaces"):
        subdomains, cuts = body_subdomains(config, model)
        interfaces = [fit_interface(table, model.mesh, subdomains) for table in config.interfaces]
    for interface in interfaces:
        _tell_interface(interface, model, subdomains, report)
    for text in cuts:
        report.warning(text)
    report.detail(f"{plural(len(subdomains), 'frame')}, {plural(len(interfaces), 'interface')}")
    if config.levels_asked and len(subdomains) < config.levels:
        report.warning(
            f"frames = {config.levels} were asked for, the body has layers of elements for {len(subdomains)} only: "
            "ask for fewer, or mesh it finer"
        )
    return _Divided(model, subdomains, interfaces, open_loops=bool(cuts))


def _tell_interface(interface: InterfaceFit, model: Model, subdomains: Sequence[Subdomain], report: Reporter) -> None:
    """Say what an interface is, and warn of what is hardly meant."""
    carrier = f"frame {subdomains[interface.frame].name}" if interface.frame >= 0 else "no frame"
    spread = "by area" if interface.by_area else "by node"
    report.note(
        f"interface {interface.name!r}: {interface.nodes.size} nodes, loads spread {spread}, carried by {carrier}"
    )
    if model.fixed[interface.nodes].all():
        report.doubt(f"interface {interface.name!r} lies on a support: it does not move, and its loads do nothing")
    if interface.nodes.size > _MOST * len(model.mesh.points):
        report.doubt(
            f"interface {interface.name!r} has {interface.nodes.size} of the body's {len(model.mesh.points)} nodes: "
            "its motion is an average over all of it; take the nodes where the body is joined to others"
        )
    if interface.frame >= 0 and not subdomains[interface.frame].floating:
        beyond = np.setdiff1d(interface.nodes, subdomains[interface.frame].body.nodes).size
        rigid = any(np.isin(interface.nodes, link.nodes).all() for link in model.mesh.links)
        if beyond > _SPREAD * interface.nodes.size and not rigid:
            report.warning(
                f"interface {interface.name!r}: {beyond} of its {interface.nodes.size} nodes lie outside frame "
                f"{subdomains[interface.frame].name}, which carries all of it; take a smaller set"
            )
    if interface.frame < 0 and subdomains:
        report.warning(
            f"interface {interface.name!r} touches no frame: it will move linearly; put its nodes into a [[frame]]"
        )


def _tell(modes: Modes, report: Reporter) -> None:
    """Say what modes there are."""
    hertz = modes.angular_frequency[modes.angular_frequency > 0.0] / (2.0 * np.pi)
    rigid = modes.angular_frequency.size - hertz.size
    report.detail(
        f"{f'{rigid} rigid motions, ' if rigid else ''}{hertz.size} modes, {hertz[0]:.4g} to {hertz[-1]:.4g} Hz; "
        f"|ΦᵀMΦ − I| = {modes.orthonormality_error:.1e}, "
        f"frequencies to {modes.frequency_error:.1e}"
    )
    if modes.splits_pair:
        report.warning(
            "a mode that is left out has the frequency of one that is not: the body will be softer in one direction "
            "than in the other; take both modes or none"
        )


def _tell_coarse(model: Model, modes: Modes, report: Reporter) -> None:
    """Warn of a mesh that is far too stiff for the first mode."""
    first = modes.shapes[:, np.argmax(modes.angular_frequency > 0.0)]
    share = stress_jumps(model.mesh, first, np.asarray(model.fixed.any(axis=1)))
    if share > _JUMPS:
        report.warning(
            f"the mesh is too stiff: stress jumps from element to element, by which deflections of the first mode are "
            f"some {100.0 * share:.0f} % too small; take quadratic elements or a finer mesh, shells "
            "instead of thin solids, and put mid-side nodes into the middle"
        )


def _second_order(
    config: BodyOptions,
    divided: _Divided,
    basis: _Basis,
    springs: Sequence[Spring],
    lump_centres: list[Centre],
    report: Reporter,
) -> tuple[SecondOrder, FloatArray]:
    """Where places go at second order: those that the body's kinematics read, and the lumps of its mass."""
    mesh, subdomains, modes = divided.model.mesh, divided.subdomains, basis.modes
    heavy = config.acceleration
    centres = mass_centres(mesh, subdomains)[2] if heavy else []
    centres = centres + lump_centres
    turned, nodes = basis.frames.frame_rotation, [by_node(spring.nodes) for spring in springs]
    readings = node_readings(
        mesh.points, modes.shapes, subdomains, turned, divided.interfaces, centres, nodes, modes.angular_frequency
    )
    rigid = np.flatnonzero(modes.angular_frequency == 0.0)
    floating = any(domain.floating for domain in subdomains)
    with report.stage(f"Find where {len(readings)} places go at second order"):
        every = second_order(
            mesh, basis.matrices.supported, modes.shapes, rigid, floating, readings, divided.model.bushings
        )
    last = len(every.displacement) - 2 * len(nodes)
    lumped = np.arange(last - len(lump_centres), last)
    displacement, rotation = (np.delete(part, lumped, 0) for part in (every.displacement, every.rotation))
    return SecondOrder(displacement, rotation), every.displacement[lumped]


def _membrane(
    config: BodyOptions, divided: _Divided, basis: _Basis, loads: FloatArray, report: Reporter, store: Store, cut: bool
) -> Membrane | None:
    """The energy of fourth order, where it is wanted and the body holds any; parts of a cut one keep no shapes."""
    if config.membrane is False:
        return None
    stretching = Stretching(basis.matrices, basis.modes, loads, report)
    asked = None if config.membrane == "auto" else (True, config.membrane is True)
    membrane = membrane_energy(stretching, basis.key, asked, not cut, store)
    if membrane is not None and divided.open_loops:
        report.warning(
            f"{len(divided.subdomains)} frames open a loop that stretches, one frame keeps it closed: take "
            'frames = 1, or cut = "auto"'
        )
    return membrane


def _surface(
    config: BodyOptions,
    divided: _Divided,
    basis: _Basis,
    loads: FloatArray,
    second: SecondOrder | None,
    report: Reporter,
    store: Store,
) -> Surface:
    """The surface for pictures, and how it moves."""
    model, modes, subdomains = divided.model, basis.modes, divided.subdomains
    fields = _surface_fields(basis, loads, store, report) if second is not None else None
    sets, held = [interface.nodes for interface in divided.interfaces], model.fixed | model.sprung
    moved = np.flatnonzero(held.any(axis=1))
    surface = body_surface(model.mesh, modes.shapes, subdomains, sets, moved, fields, config.surface_stress)
    rigid = modes.angular_frequency == 0.0
    if fields is None or not rigid.any() or subdomains[0].floating:
        return surface
    return replace(
        surface,
        turn=basis.frames.frame_rotation[:1] * rigid,
        pivot=subdomains[0].joint_point[None],
        piece=np.zeros(len(surface.points), dtype=np.int64),
    )


def _surface_fields(basis: _Basis, loads: FloatArray, store: Store, report: Reporter) -> tuple[FloatArray, FloatArray]:
    """What goes with q at second order all over the surface, for pictures."""
    mesh, shapes, omega = basis.matrices.model.mesh, basis.modes.shapes, basis.modes.angular_frequency

    def make() -> dict[str, FloatArray]:
        model = basis.matrices.supported
        with report.stage("Find where the surface goes at second order"):
            elastic, nodes = np.flatnonzero(omega > 0.0), surface_nodes(mesh)[0]
            fields, forms = second_order_fields(mesh, model, shapes, elastic, omega**2, loads, nodes)
            return {"fields": fields, "forms": forms}

    key = content_key(__name__, "surface", basis.key, loads)
    kept = store.arrays(key, "the surface at second order", report, make)
    return kept["fields"], kept["forms"]


def _springs(springs: Sequence[Spring], divided: _Divided, basis: _Basis) -> Ties | None:
    """Springs to the ground of a part of a cut body: they pull along the axes wherever the part turns."""
    mesh, shapes = divided.model.mesh, basis.modes.shapes
    found = []
    for spring in springs:
        nodes = spring.nodes
        weighted = by_node(nodes)
        centre = weighted.centre(mesh.points)
        displacement, rotation, rank = modal_fit(mesh.points, shapes, weighted, centre)
        frame = carrying_frame(divided.subdomains, nodes)
        if rank < 6 and frame >= 0:
            # A line or a point tells no rotation of its own.
            rotation = basis.frames.frame_rotation[frame]
        arm = mesh.points[nodes] - centre
        values, axes = np.linalg.eigh(arm.T @ arm / nodes.size)
        lever = axes * np.sqrt(np.maximum(values, 0.0))
        ends = (np.array([one, np.zeros_like(one)]) for one in (displacement, rotation))
        found.append((np.array([frame, GROUND]), np.array([centre, centre]), *ends, spring.stiffness, lever))
    return Ties(*(np.array(values) for values in zip(*found, strict=True))) if found else None


def _stress_sets(config: BodyOptions, model: Model, modes: Modes) -> tuple[StressSet, ...]:
    """Modal stress of the element sets whose stress is asked for."""
    mesh, result = model.mesh, []
    for table in config.stress:
        elements = element_set(mesh, table.elements, f"stress {table.name!r}, elements")
        result.append(StressSet(table.name, *point_stress(mesh, elements, modes.shapes)))
    return tuple(result)
