"""A body in one piece, or a part of a cut one: model → modes → interfaces and frames → reduced body."""

import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ..fe.gradients import point_stress, stress_jumps
from ..files.basics import FloatArray, plural
from ..files.outputs import Reporter
from ..files.store import Store, content_key
from ..mesh.model import Mesh
from ..model.inertia import LumpedMass, Membrane
from ..model.methods import Data, Mass, has_frames
from ..model.reduced_body import GROUND, ReducedBody, SecondOrder, Shadow, StressSet, Surface, Ties
from . import basis as bases, bodies
from .cut.cut import Spring, ground_springs
from .masses import Centre, element_lumps, lumped_mass, mass_centres, sub_masses
from .membrane import Stretching, completed_body, membrane_energy
from .model import Model
from .modes import Modes, frequency_spread
from .options import Basis, BodyOptions, BodyUse, element_set
from .rigid_fit import by_node, modal_fit
from .second_order import node_readings, second_order
from .subdomains import FrameOperators, Subdomain, carrying_frame, frame_operators
from .surface import body_surface, carrying_frames, second_order_fields, surface_nodes
from .watched import watched_material

# Share of an interface's nodes outside the frame that carries it which is worth a warning, and of the body's size below
# which it does not matter.
_SPREAD, _SHORT = 0.1, 0.25
# How far from the middle of a bore all its nodes are, over the farthest: all of it is one joint.
_HOLLOW = 0.25
# Share of the body's nodes that no interface is likely to have; of deflections that a coarse mesh lacks in silence.
_MOST, _JUMPS = 0.9, 0.05
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
    certified : callable
        Makes the same with its shadow.
    third : callable
        Makes the body of its shadow, or its own while it has none, with the energy of what places miss at third order.
    other : Reduced, optional
        The same with another shadow: with loops through supports opened, or shapes of second order as coordinates.
    """

    body: ReducedBody
    warping_work: FloatArray
    shadow_work: FloatArray
    fine: ReducedBody | None
    shapes: FloatArray
    span: FloatArray
    certified: Callable[[], "Reduced"]
    third: Callable[[], ReducedBody]
    other: "Reduced | None" = None


@dataclass(frozen=True, slots=True)
class _Divided:
    """A model with its frames and interfaces, and the options and the springs to the ground of a part of a cut body."""

    config: BodyOptions
    model: Model
    subdomains: list[Subdomain]
    interfaces: list[bodies.InterfaceFit]
    open_loops: bool
    springs: Sequence[Spring]
    cut: bool

    def unit_loads(self) -> FloatArray:
        """Nodal loads (3n, 6i) of unit forces on all interfaces, then of unit moments."""
        nodal = [interface.nodal_loads(len(self.model.mesh.points)) for interface in self.interfaces]
        return np.concatenate([n[:, :3] for n in nodal] + [n[:, 3:] for n in nodal], axis=1)


@dataclass(frozen=True, slots=True)
class _Basis:
    """The modes of a divided model, and how its frames move with them; and whether their stretches are found."""

    matrices: bases.Matrices
    modes: Modes
    key: str
    frames: FrameOperators
    stretched: bool = False

    def stretching(self, divided: _Divided) -> Stretching:
        """What is asked for how the modes stretch; what was asked last is known."""
        loads, how = divided.unit_loads(), (bool(divided.springs), divided.cut)
        make = partial(Stretching, self.matrices, self.modes, loads, self.key, *how)
        found: Stretching = self.matrices.store.last("stretching", content_key(self.key, loads, *how), make)
        return found


def reduced_piece(
    config: BodyOptions, model: Model, report: Reporter, store: Store, springs: Sequence[Spring] = (),
    warping: FloatArray | None = None, spanned: FloatArray | None = None,
) -> Reduced:  # fmt: skip
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
    cut = warping is not None
    divided = _divided(config, model, report, springs, cut)
    matrices, loads = bases.Matrices(model, report, store), divided.unit_loads()
    warping = np.zeros((len(loads), 0)) if warping is None else warping
    every = np.hstack([loads, warping])
    basis = _with_modes(divided, matrices, every)
    body = _reduced(divided, basis)
    fine = _fine_tree(divided, basis, body.membrane) if config.certificate or not cut else None
    work, own = warping.T @ basis.modes.shapes, basis.modes.shapes
    span = np.zeros((own.shape[1], 0)) if spanned is None else bodies.embedding(matrices.supported, own, spanned)

    def certified() -> Reduced:
        with report.stage("Reduce the body once more, finer, to know its error"):
            finer, finer_basis = _shadow(divided, basis, every, body.membrane is not None)
        key, shapes = content_key(__name__, "embedding", basis.key, finer_basis.key), finer_basis.modes.shapes
        found = matrices.kept(key, "embedding", lambda: bodies.embedding(matrices.supported, shapes, own))

        def known(one: ReducedBody, other: Reduced | None = None) -> Reduced:
            third, shadow = partial(completed_body, stretching, one), Shadow(one, found)
            return replace(piece, body=replace(body, shadow=shadow), shadow_work=worked, third=third, other=other)

        worked, stretching = warping.T @ shapes, finer_basis.stretching(divided)
        if finer.membrane is None or model.rigid.size or not finer.membrane.linear.any():
            return known(finer)
        # With the body's shapes as coordinates; whether others belong to them equilibria tell.
        rows = np.zeros((0, body.mode_count)) if body.membrane is None else body.membrane.linear
        kept = np.sqrt(2.0) * rows[[any(row) for row in rows]] / body.angular_frequency**2
        return known(replace(finer, membrane=stretching.keeping(finer.membrane, found @ kept.T)), known(finer))

    third = partial(completed_body, basis.stretching(divided), body)
    piece = Reduced(body, work, work, fine, own, span, certified, third)
    return piece


def _shadow(divided: _Divided, basis: _Basis, every: FloatArray, stretches: bool) -> tuple[ReducedBody, _Basis]:
    """The body once more, with more frames and all that its basis may lack under loads (3n, l)."""
    matrices, model, loads = basis.matrices.quiet, divided.model, divided.unit_loads()
    finer = bodies.shadow_options(divided.config, divided.subdomains)

    def kept(name: str, find: Callable[..., FloatArray], key: object, *more: Any) -> FloatArray:
        return matrices.kept(content_key(__name__, name, key, loads), name, partial(find, matrices, *more))

    far, cut = divided.config.far, divided.cut
    third = partial(kept, "shapes of third order", bases.third_order_loads, (basis.key, far, cut), basis.modes, loads)
    added = [every, third(*bodies.THIRD[far], cut)]
    added.append(kept("shapes of buckling", bases.buckling_loads, (matrices.key, cut), loads, cut))
    if stretches and not divided.cut:
        added.append(kept("displacements of second order", bases.turning_loads, matrices.key, loads))
    modes, key = bases.completed_basis(matrices, basis.modes, basis.key, np.hstack(added))
    again = _divided(finer, model, matrices.report, divided.springs, divided.cut)
    if not divided.cut and not model.rigid.size:
        # Springs at turned nodes pull less than their linear energy says.
        turning = [part for _, one in ground_springs(model, finer.supports) for part in _by_frame(one, again)]
        again = replace(again, springs=(*again.springs, *turning))
    own = _Basis(matrices, modes, key, frame_operators(model.mesh.points, modes.shapes, again.subdomains))
    return _reduced(again, own), own


def _reduced(divided: _Divided, basis: _Basis) -> ReducedBody:
    """The body of a divided model in a basis."""
    stored, loads = divided.config.stored, divided.unit_loads()
    inertia: LumpedMass | None = None
    lump_centres: list[Centre] = []
    # Parts of a cut body have constant mass.
    if Data.INERTIA in stored and not divided.cut:
        inertia, lump_centres = _lumped(divided, basis)
    second, membrane = None, None
    if Data.SECOND_ORDER in stored and divided.subdomains:
        membrane = _membrane(divided, basis)
        basis = replace(basis, stretched=membrane is not None)
        second, curvature = _second_order(divided, basis, lump_centres)
        inertia = inertia and replace(inertia, curvature=curvature)
    parts = _parts(divided, basis, loads, second)
    return _made(divided, basis, inertia=inertia, ties=_springs(divided, basis), membrane=membrane, **parts)


def _made(divided: _Divided, basis: _Basis, **beside: Any) -> ReducedBody:
    """A body without damping and names."""
    modes, subdomains = basis.modes, divided.subdomains
    motion = bodies.motion_of_tree(modes.angular_frequency, modes.shapes, divided.interfaces, subdomains, basis.frames)
    return bodies.made_body(BodyUse(divided.config.name), **motion, **beside)


def _lumped(divided: _Divided, basis: _Basis) -> tuple[LumpedMass | None, list[Centre]]:
    """Mass of the turned body, in lumps of its frames, and their centres; none without frames of elements."""
    mesh, subdomains = divided.model.mesh, divided.subdomains
    lumps = element_lumps(mesh, subdomains) if subdomains else []
    carried = [carrying_frame(subdomains, one.nodes) for one in mesh.masses]
    return lumped_mass(mesh, basis.modes.shapes, lumps, basis.frames, carried) if lumps else (None, [])


def _fine_tree(divided: _Divided, basis: _Basis, membrane: Membrane | None) -> ReducedBody | None:
    """The modes on a tree of `_FINE` frames to second order, with its lumps, whatever the body's own frames are."""
    config, model, kept = divided.config, divided.model, divided.model.mesh.kept
    unheard = config.variant.mass is Mass.CONFIGURATION or not has_frames(config.variant.method)
    if unheard or not divided.subdomains:
        return None
    alone = replace(
        config, levels=_FINE, levels_asked=False, frames=(), branches=(), acceleration=False,
        interfaces=config.interfaces[:1], stored=config.stored | {Data.SECOND_ORDER},
    )  # fmt: skip
    key = "fine tree", basis.key, pickle.dumps((config.name, alone.interfaces, config.cuts, membrane))
    if key in kept:
        return kept[key]
    found = _divided(alone, model, Reporter(), (), divided.cut)
    frames = frame_operators(model.mesh.points, basis.modes.shapes, found.subdomains)
    own = replace(basis, frames=frames, matrices=basis.matrices.quiet, stretched=membrane is not None)
    inertia, centres = _lumped(found, own)
    second, curvature = _second_order(found, own, centres)
    inertia = inertia and replace(inertia, curvature=curvature)
    kept[key] = _made(found, own, second=second, membrane=membrane, inertia=inertia)
    return kept[key]


def _with_modes(divided: _Divided, matrices: bases.Matrices, every: FloatArray) -> _Basis:
    """The modes of a divided model, with room for loads (3n, l): of units on interfaces, and warping of sections."""
    wanted, stored = divided.config.basis, divided.config.stored
    residual = every if wanted.residual is True else every[:, list(wanted.residual or ())]
    # Sections would be too stiff against each other with the static shapes alone that loads need most.
    modes, key = bases.modal_basis(replace(wanted, by_need=False) if divided.cut else wanted, matrices, every, residual)
    if wanted.by_need and Data.SECOND_ORDER in stored:
        modes, key = bases.with_third_order(matrices, modes, key, divided.unit_loads(), divided.config.far, divided.cut)
    _tell(modes, matrices.report)
    _tell_coarse(divided.model, modes, matrices.report)
    return _Basis(matrices, modes, key, frame_operators(divided.model.mesh.points, modes.shapes, divided.subdomains))


def _parts(divided: _Divided, basis: _Basis, loads: FloatArray, second: SecondOrder | None) -> dict[str, Any]:
    """What the body holds beside its motion, by its options: fields of `ReducedBody`."""
    config, model, subdomains, matrices = divided.config, divided.model, divided.subdomains, basis.matrices
    modes, key, stored = basis.modes, basis.key, config.stored
    surface = _surface(divided, basis, second) if config.surface else None
    of_loads = matrices, modes, key, loads, config.acceleration
    craig_bampton = config.basis.kind is Basis.CRAIG_BAMPTON
    return {
        **(_watched(divided, basis, loads) if config.watched else {}),
        # A scene may fix the root of a body that moves freely where the basis holds its constraint modes.
        "root_interface": config.root_place if model.rigid.shape[1] and craig_bampton else GROUND,
        "whole": bodies.whole_frame(model, modes.shapes, config) if bodies.several(subdomains) else None,
        "masses": sub_masses(model.mesh, modes.shapes, subdomains) if config.acceleration else None,
        "stress_sets": _stress_sets(config, model, modes),
        "stiffness_by_load": bases.stiffness_by_load(*of_loads) if Data.BY_LOAD in stored else None,
        "stiffness_by_mode": bases.stiffness_by_mode(matrices, modes, key) if Data.BY_MODE in stored else None,
        "damper": model.damper_rows(modes.shapes),
        "surface": surface,
        "second": second,
    }


def _watched(divided: _Divided, basis: _Basis, loads: FloatArray) -> dict[str, Any]:
    """What tells while the body runs how far its material turns and strains, and what its modes are made of."""
    matrices, shapes, omega = basis.matrices, basis.modes.shapes, basis.modes.angular_frequency
    subdomains, turned = divided.subdomains, basis.frames.frame_rotation

    def make() -> dict[str, Any]:
        names = ("watched_frame", "watched_rotation", "watched_strain")
        found = watched_material(matrices.model.mesh, shapes, omega, loads, subdomains, turned)
        find = partial(frequency_spread, matrices.supported, omega, shapes)
        spread = matrices.kept(content_key(__name__, "spread", basis.key), "frequency spread", find)
        return {**dict(zip(names, found, strict=True)), "frequency_spread": spread}

    key = content_key(__name__, "watched", basis.key, loads, turned, *(domain.elements for domain in subdomains))
    return matrices.store.arrays(key, "material that is watched", matrices.report, make)


def _divided(config: BodyOptions, model: Model, report: Reporter, springs: Sequence[Spring], cut: bool) -> _Divided:
    """Divide a model into frames, and fit its interfaces."""
    with report.stage("Divide into frames and fit interfaces"):
        subdomains, cuts = bodies.body_subdomains(config, model)
        interfaces = [bodies.fit_interface(table, model.mesh, subdomains) for table in config.interfaces]
    for interface in interfaces:
        _tell_interface(interface, model, subdomains, report)
    report.tell(warnings=cuts)
    report.detail(f"{plural(len(subdomains), 'frame')}, {plural(len(interfaces), 'interface')}")
    if config.levels_asked and len(subdomains) < config.levels:
        found = f"frames = {config.levels} were asked for, the body has layers of elements for {len(subdomains)} only"
        report.warning(f"{found}: ask for fewer, or mesh it finer")
    return _Divided(config, model, subdomains, interfaces, bool(cuts), springs, cut)


def _tell_interface(one: bodies.InterfaceFit, model: Model, subdomains: Sequence[Subdomain], report: Reporter) -> None:
    """Say what an interface is, and warn of what is hardly meant."""
    carrier = f"frame {subdomains[one.frame].name!r}" if one.frame >= 0 else "no frame"
    spread = "by area" if one.by_area else "by node"
    count = f"{one.nodes.size - one.added.size} nodes"
    if one.added.size:
        count += f" in a line or point, and {one.added.size} more of their elements, which take the moment"
    report.note(f"interface {one.name!r}: {count}, loads spread {spread}, carried by {carrier}")
    points = model.mesh.points
    if model.fixed[one.nodes].all():
        report.doubt(f"interface {one.name!r} lies on a support: it does not move, and its loads do nothing")
    if one.nodes.size > _MOST * len(points):
        found = f"interface {one.name!r} has {one.nodes.size} of the body's {len(points)} nodes"
        advice = "its motion is an average over all of it; take the nodes where the body is joined to others"
        report.doubt(f"{found}: {advice}")
    if one.frame >= 0 and not subdomains[one.frame].floating:
        told = np.setdiff1d(one.nodes, one.added)
        beyond = np.setdiff1d(told, subdomains[one.frame].body.nodes).size
        rigid = any(np.isin(one.nodes, link.nodes).all() for link in model.mesh.links)
        # Over a short stretch frames turn so little against each other that nothing is lost.
        reach, size = (np.linalg.norm(np.ptp(points, axis=0)) for points in (points[told], points))
        if beyond > _SPREAD * told.size and reach > _SHORT * size and not rigid:
            away = np.linalg.norm(points[told] - points[told].mean(axis=0), axis=1)
            advice = "fewer frames, or rigid = true" if away.min() > _HOLLOW * away.max() else "a smaller set"
            report.warning(
                f"interface {one.name!r}: {beyond} of its {told.size} nodes lie outside frame "
                f"{subdomains[one.frame].name}, which carries all of it; take {advice}"
            )
    if one.frame < 0 and subdomains:
        found = f"interface {one.name!r} touches no frame and moves linearly"
        report.warning(f"{found}; put its nodes into a [[frame]]")


def _tell(modes: Modes, report: Reporter) -> None:
    """Say what modes there are."""
    hertz = modes.angular_frequency[modes.angular_frequency > 0.0] / (2.0 * np.pi)
    rigid = modes.angular_frequency.size - hertz.size
    found = f"{f'{rigid} rigid motions, ' if rigid else ''}{hertz.size} modes, {hertz[0]:.4g} to {hertz[-1]:.4g} Hz"
    report.detail(f"{found}; |ΦᵀMΦ − I| = {modes.orthonormality_error:.1e}, frequencies to {modes.frequency_error:.1e}")
    if modes.splits_pair:
        found = "a mode that is left out has the frequency of one that is not"
        report.warning(f"{found}: the body will be softer in one direction than in the other; take both modes or none")


def _tell_coarse(model: Model, modes: Modes, report: Reporter) -> None:
    """Warn of a mesh that is far too stiff for the first mode."""
    first = modes.shapes[:, np.argmax(modes.angular_frequency > 0.0)]
    share = stress_jumps(model.mesh, first, np.asarray(model.fixed.any(axis=1)))
    if share > _JUMPS:
        report.warning(
            f"the mesh is too stiff: stress jumps from element to element, by which deflections of the first mode are "
            f"{'at least' if share > 0.5 else 'some'} {100.0 * share:.0f} % too small; {_softer(model.mesh)}"
        )


def _softer(mesh: Mesh) -> str:
    """What makes a mesh that is too stiff softer, and is not so already."""
    blocks = [block for block in mesh.blocks if not block.type.beam]
    locks = any(not block.type.shape.quadratic and not block.type.incompatible for block in blocks)
    found = f"take {'quadratic elements or ' if locks else ''}a finer mesh"
    if not all(block.type.shell for block in blocks):
        found += ", or shells instead of thin solids"
    middles = any(block.type.shape.quadratic for block in blocks)
    return f"{found}; mid-side nodes off the middle of an edge stiffen it, too" if middles else found


def _second_order(divided: _Divided, basis: _Basis, lump_centres: list[Centre]) -> tuple[SecondOrder, FloatArray]:
    """Where places go at second order: those that the body's kinematics read, and the lumps of its mass."""
    mesh, subdomains, modes = divided.model.mesh, divided.subdomains, basis.modes
    centres = (mass_centres(mesh, subdomains)[2] if divided.config.acceleration else []) + lump_centres
    turned, nodes = basis.frames.frame_rotation, [by_node(spring.nodes) for spring in divided.springs]
    what = subdomains, turned, divided.interfaces, centres, nodes, modes.angular_frequency
    readings = node_readings(mesh.points, modes.shapes, *what)
    matrices, floating = basis.matrices, any(domain.floating for domain in subdomains)
    joined = divided.cut or bool(divided.model.sprung.any())

    def make() -> dict[str, FloatArray]:
        with matrices.report.stage(f"Find where {len(readings)} places go at second order"):
            answers = basis.stretching(divided).answers(basis.stretched)
            found = second_order(matrices, modes, floating, joined, readings, answers)
        return {"displacement": found.displacement, "rotation": found.rotation}

    parts = [part for reading in readings for part in reading.parts]
    key = content_key(__name__, "second order", basis.key, floating, joined, basis.stretched, *parts)
    every = SecondOrder(**matrices.store.arrays(key, "places at second order", matrices.report, make))
    last = len(every.displacement) - 2 * len(nodes)
    lumped = np.arange(last - len(lump_centres), last)
    displacement, rotation = (np.delete(part, lumped, 0) for part in (every.displacement, every.rotation))
    return SecondOrder(displacement, rotation), every.displacement[lumped]


def _membrane(divided: _Divided, basis: _Basis) -> Membrane | None:
    """The energy of fourth order, where it is wanted and the body holds any; parts of a cut one keep no shapes."""
    membrane = membrane_energy(basis.stretching(divided), divided.config.membrane, not divided.cut)
    if membrane is not None and divided.open_loops:
        count, do = len(divided.subdomains), 'take frames = 1, or cut = "auto"'
        basis.matrices.report.warning(f"{count} frames open a loop that stretches, one frame keeps it closed: {do}")
    return membrane


def _surface(divided: _Divided, basis: _Basis, second: SecondOrder | None) -> Surface:
    """The surface for pictures, and how it moves."""
    model, modes, subdomains = divided.model, basis.modes, divided.subdomains
    fields = _surface_fields(basis, basis.stretching(divided)) if second is not None else None
    sets, held = [interface.nodes for interface in divided.interfaces], model.fixed | model.sprung
    moved = np.flatnonzero(held.any(axis=1))
    surface = body_surface(model.mesh, modes.shapes, subdomains, sets, moved, fields, divided.config.surface_stress)
    rigid = modes.angular_frequency == 0.0
    if fields is None or not rigid.any() or subdomains[0].floating:
        return surface
    return replace(
        surface,
        turn=basis.frames.frame_rotation[:1] * rigid,
        pivot=subdomains[0].joint_point[None],
        piece=np.zeros(len(surface.points), dtype=np.int64),
    )


def _surface_fields(basis: _Basis, stretching: Stretching) -> tuple[FloatArray, FloatArray]:
    """What goes with q at second order all over the surface, for pictures."""
    matrices, loads = basis.matrices, stretching.loads

    def make() -> dict[str, FloatArray]:
        with matrices.report.stage("Find where the surface goes at second order"):
            nodes, answers = surface_nodes(matrices.model.mesh)[0], stretching.answers(basis.stretched)
            fields, forms = second_order_fields(matrices, basis.modes, loads, nodes, answers)
            return {"fields": fields, "forms": forms}

    key = content_key(__name__, "surface", basis.key, loads, basis.stretched)
    kept = matrices.store.arrays(key, "the surface at second order", matrices.report, make)
    return kept["fields"], kept["forms"]


def _by_frame(spring: Spring, divided: _Divided) -> list[Spring]:
    """A spring's nodes, those that turn together by themselves."""
    frame = carrying_frames(len(divided.model.mesh.points), divided.subdomains)[spring.nodes]
    found = [spring.nodes[frame == own] for own in np.unique(frame)]
    return [replace(spring, nodes=nodes, stiffness=divided.model.spring[nodes].sum(axis=0)) for nodes in found]


def _springs(divided: _Divided, basis: _Basis) -> Ties | None:
    """Springs to the ground as joints: they pull along the axes wherever their frame turns."""
    mesh, shapes = divided.model.mesh, basis.modes.shapes
    found = []
    for spring in divided.springs:
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
    for name, elements_name in config.stress:
        elements = element_set(mesh, elements_name, f"stress {name!r}, elements")
        result.append(StressSet(name, *point_stress(mesh, elements, modes.shapes)))
    return tuple(result)
