"""The pipeline: mesh → model → modes → interfaces and frames → reduced body → FMU."""

import hashlib
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..body.reference_loads import apart, differs_more, keeps_its_mass, lumps_are_fine, mass_modes, missed_by_lines
from ..files.basics import FlexfmuError, FloatArray, UnitSystem, own_version, plural
from ..files.outputs import Reporter, Tentative
from ..files.store import Store
from ..files.threads import in_one_thread
from ..mesh.checks import checked, implausible
from ..mesh.formats import file_origin
from ..mesh.model import Mesh
from ..model.methods import Data, Mass, Variant
from ..model.reduced_body import Properties, ReducedBody, Surface
from ..model.summary import NORMAL_MODES, first_frequency, missed_words, summary
from ..model.variants import chosen, shortened
from ..program.mass_polynomial import mass_polynomial
from ..program.mechanics import inertial_modes
from ..reduction.bodies import used_body
from ..reduction.cut.parts import AGAINST_OPENED, Joined, Opened, chosen_cuts, reduced_parts, reduced_whole
from ..reduction.masses import body_properties
from ..reduction.model import Model, assemble_model, needless
from ..reduction.options import DEFAULT_FRAMES, BodyOptions, BodyUse, by_name, element_set, node_set, support_places
from ..reduction.piece import Reduced
from ..reduction.rigid_nodes import stretch_free
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
    return body_model(config.read_mesh(report), config)


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
    model = assemble_model(mesh, options)
    _check_sets(options, model.mesh)
    return BodyModel(options, model, needless(mesh, options))


def _check_sets(options: BodyOptions, mesh: Mesh) -> None:
    """Find every set that will be asked for before the expensive work begins."""
    for cut in options.cuts:
        node_set(mesh, cut, "[[cut]] nodes")
    for interface in options.interfaces:
        node_set(mesh, interface.nodes, f"interface {interface.name!r}, nodes")
    for name, elements in options.stress:
        element_set(mesh, elements, f"stress {name!r}, elements")
    for frame in options.frames:
        node_set(mesh, frame.nodes, f"frame {frame.name!r}, nodes")
        if isinstance(frame.joint, str):
            node_set(mesh, frame.joint, f"frame {frame.name!r}, joint")
        for name in frame.rotation_points:
            node_set(mesh, name, f"frame {frame.name!r}, rotation_points")


# Modal damping ratio of the first mode above which percent were likely given: rubber has 0.1, a shaken pillow 0.3.
_HEAVY_DAMPING = 0.3
_DRIFTING = (
    "nodes are held in some directions, and others in all: as frames turn far, they drift in those directions, by 1 % "
    "of the deflection where it is an eighth of the body's size; an interface on them shows it"
)
# Sizes of the body beyond which a reference point is hardly meant.
_FAR = 3.0
_FAR_BENT = 'loads may pass the range of its mass polynomial: reduced again with lumps, unless mass = "polynomial"'
# Own error at reference loads from which on a body is tried with its loops cut; what that has to leave of it, and where
# it leaves less than that.
_WRONG, _CLEARLY, _BETTER = 0.01, 0.2, 0.75
_OPENED = f"its frames turn apart where a loop through supports closes: {AGAINST_OPENED}"
_COARSE = "lumps on its frames are too coarse: it keeps the polynomial, and refuses steps past it; take more frames"


def reduce_body(
    config: BodyFile, report: Reporter, store: Store | None = None, levels: int | None = None
) -> ReducedBody:
    """Read the mesh of a body file and reduce it; see `reduce_mesh`.

    Parameters
    ----------
    config : BodyFile
        With the mesh's path resolved.
    report : Reporter
    store : Store, optional
    levels : int, optional

    Returns
    -------
    ReducedBody
    """
    file, store = config.mesh.file, store or Store()
    key = repr((file.is_file() and file.stat().st_mtime_ns, config.mesh, config.shells))
    mesh = store.last("mesh", key, partial(config.read_mesh, report))
    return reduce_mesh(mesh, config, file_origin(file), report, store, levels)


@in_one_thread
def reduce_mesh(
    mesh: Mesh,
    config: BodySpec,
    origin: Mapping[str, str],
    report: Reporter,
    store: Store | None = None,
    levels: int | None = None,
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
        Where modes and the like are kept from build to build, and the model itself; default: nowhere.
    levels : int, optional
        Frames of a body whose file does not tell their number.

    Returns
    -------
    ReducedBody

    Raises
    ------
    FlexfmuError
        Anything that the specification or the mesh does not provide, with what to do.
    """
    with report.stage("Check the mesh"):
        try:
            prepared = body_model(mesh, config)
        except FlexfmuError:
            # What the file's reader left out may be the reason.
            report.tell(mesh.notes)
            raise
        options, store = replace(prepared.options, levels=levels or prepared.options.levels), store or Store()
        model = store.last("model", hashlib.sha256(pickle.dumps(prepared.model)).hexdigest(), lambda: prepared.model)
        mesh, properties = model.mesh, _properties(options, model)
    report.note(f"{len(mesh.points)} nodes, {mesh.element_count} elements, {model.free.size} free degrees of freedom")
    report.tell((*mesh.notes, *map(" ".join, summary(properties))))
    _tell_doubts(mesh, options, prepared.unused_material, report)
    (options, model), others = chosen_cuts(options, model, report, store)
    partly = np.setdiff1d(np.flatnonzero(model.placed.any(axis=1)), model.anchored).size
    report.tell([f"{partly} {_DRIFTING}"] * bool(partly and options.levels > 1 and not options.cuts))
    use = replace(config.use, provenance=_provenance(config, mesh, origin), properties=properties)
    # Who asks for a mass has it.
    asked = config.formulation.mass is not None or config.reduction.inertia is False
    draft = Tentative(report)
    whole = _with_mass(use, options, model, draft, store, asked)()
    body, third = _cut_if_wrong(whole, use, others, draft, report, store)
    shadow = replace(body.shadow, body=third()) if body.shadow is not None and prepared.options.certificate else None
    body = shortened(replace(body, shadow=shadow))
    _tell(config, body, report)
    return body


# A body with its shadow, and what makes one of that which knows the third order.
_Certified = tuple[ReducedBody, Callable[[], ReducedBody]]


def _cut_if_wrong(
    whole: _Certified, use: BodyUse, others: Sequence[Opened], draft: Tentative, report: Reporter, store: Store
) -> _Certified:
    """A body in one piece, or one of others that are cut if reference loads put it off, by its shadow, and them less.

    What the draft holds is said of the one that is taken.
    """
    body = whole[0]
    off = float(max(apart(body, body.shadow, first=body))) if others else 0.0
    taken, least, words = whole, max(_CLEARLY * off, min(_WRONG, _BETTER * off)), f"{100.0 * off:.2g} % in one piece"
    for options, model in others if off > _WRONG else ():
        found, third = _reduced(use, options, model, again := Tentative(report), store)[1]()
        left = float(max(apart(found, found.shadow, first=body)))
        words += f", {100.0 * left:.2g} % cut into {plural(found.frame_count, 'frame')}"
        if left < least:
            draft.release(holds=False)
            taken, least, draft = (found, third), left, again
            if left < _WRONG:
                break
    draft.release()
    choice = "it is cut (cut = [] leaves it whole)"
    if taken is whole:
        choice = 'it stays in one piece (cut = "auto" cuts it)'
    report.tell([f"supports close a loop; reference loads put the body off by {words}: {choice}"] * bool(others))
    return taken


def _with_mass(
    use: BodyUse, options: BodyOptions, model: Model, report: Reporter, store: Store, asked: bool
) -> Callable[[], _Certified]:
    """What makes the body, with the mass of its lumps (13) where it may bend far and they are fine, with its shadow.

    Default frames are doubled then, since what bends within a frame carries its lumps astray. Nothing is said of, and
    no shadow made for, what is given up.
    """
    draft = Tentative(report)
    try:
        body, certified, enough = _reduced(use, options, model, draft, store, asked)
        if asked or (enough and keeps_its_mass(body)):
            return certified
        report.note(_FAR_BENT)
        plain = options.levels == DEFAULT_FRAMES and not (options.levels_asked or options.frames or options.branches)
        finer = replace(options, far=True, levels=(1 + plain) * options.levels, stored=options.stored | {Data.INERTIA})
        heavy, other = replace(use, variant=Variant(use.variant.method, Mass.CONFIGURATION)), Tentative(draft)
        found, finer_certified, _ = _reduced(heavy, finer, model, other, store)
        if not lumps_are_fine(found):
            report.note(_COARSE)
            return certified
        draft.release(holds=False)
        other.release()
        return finer_certified
    finally:
        draft.release()


def _reduced(
    use: BodyUse, options: BodyOptions, model: Model, report: Reporter, store: Store, asked: bool = False
) -> tuple[ReducedBody, Callable[[], _Certified], bool]:
    """The body, with the polynomial of its mass where it has any; what makes it with the shadow that tells most.

    And whether its mass knows of as many coordinates as count, or cost little; one that is asked for does.
    """
    made: Joined | Reduced
    if options.cuts:
        made = reduced_parts(options, model, report, store)
        fine = made.fine
    else:
        made = reduced_whole(options, model, report, store)
        fine = [] if made.fine is None else [(made.fine, np.eye(made.body.mode_count))]
    body, enough = used_body(made.body, use), True
    lumped = made.fine if isinstance(made, Reduced) and body.mass is not Mass.CONFIGURATION else body

    def knowing(count: int) -> ReducedBody:
        found = body.polynomial
        if fine:
            with report.stage("Find how mass changes as the body bends"):
                kept, key = model.mesh.kept, ("polynomial", count, *(id(part) for part, _ in fine))
                parts = [(replace(part, mass_modes=count), turn) for part, turn in fine]
                kept[key] = kept.get(key) or (fine, mass_polynomial(parts))
                found = kept[key][1]
        falls = body.mass is Mass.POLYNOMIAL and (found is None or body.ties is not None)
        return replace(body, polynomial=found, mass_modes=count, mass=Mass.CONSTANT if falls else body.mass)

    constant = body.mass is Mass.CONSTANT or body.rigid_count or body.ties is not None
    if constant or lumped is None or lumped.inertia is None:
        body = knowing(0)
    else:
        body = knowing(mass_modes(body, lumped, body.mass is Mass.CONFIGURATION))
        # A polynomial that knows of fewer reaches further.
        if not keeps_its_mass(body):
            enough = mass_modes(body, lumped, dear=True) == inertial_modes(body)
            body = knowing(0) if enough or not asked else body
    if isinstance(made, Reduced):
        report.tell(warnings=missed_by_lines(body, made.shapes, model.bushings.readings))

    def certified() -> _Certified:
        if isinstance(made, Joined) or not options.certificate:
            return body, made.third
        found = made.certified()
        own, third, other = replace(body, shadow=found.body.shadow), found.third, found.other
        while other is not None:
            shadow = other.body.shadow
            opens = shadow is not None and shadow.body.ties is not None
            if shadow is not None and differs_more(own, shadow, opens):
                own, third = replace(body, shadow=shadow), other.third
                if opens:
                    report.note(_OPENED)
            other = other.other
        return own, third

    return body, certified, enough


def _properties(options: BodyOptions, model: Model) -> Properties:
    names, points, springs = support_places(model.mesh, options.supports)
    # A translation of the body along each axis.
    together = np.tile(np.eye(3), (len(model.fixed), 1))
    along = np.einsum("ij,ij->j", together, model.springs @ together) if model.sprung.any() else None
    return replace(
        body_properties(model.mesh), spring=along, support_names=names, support_point=points, support_spring=springs
    )


def _tell_doubts(mesh: Mesh, options: BodyOptions, unused_material: bool, report: Reporter) -> None:
    """Say what is hardly meant, and what may be wrong."""
    for text in (*implausible(mesh, options.units), *distant_points(mesh, options)):
        report.doubt(text)
    report.tell(warnings=stretch_free(mesh))
    if unused_material:
        report.warning("[material] is not used: the mesh file gives every element a material; take one of them out")


def _tell(config: BodySpec, body: ReducedBody, report: Reporter) -> None:
    """Say what the model is and why, how the body swings, and what pictures of it take."""
    first = float(body.damping_ratio[body.rigid_count])
    if first > _HEAVY_DAMPING:
        found = f"damping.ratio = {first:g} of the first mode: it hardly swings"
        report.warning(f"{found}; the ratio is a share of critical damping, 1 % is 0.01")
    asked = config.formulation.method is not None, config.frames is not None or config.frame or config.branch
    said, divided = ("body file" if one else "default" for one in asked)
    size = f"{plural(body.frame_count, 'frame')} ({divided}), {plural(body.mode_count, 'mode')}"
    report.note(f"method {chosen(body).words} ({'no frames' if config.frames == 0 else said}), {size}")
    if body.membrane is not None:
        report.note(f"membrane energy: {body.membrane.words}")
    report.note(f"first frequency {first_frequency(body.angular_frequency)}")
    if missed := missed_words(body):
        report.note(missed)
    if body.surface is not None:
        report.detail(_surface_words(body.surface))


def _surface_words(surface: Surface) -> str:
    """What pictures need of the modal file, and how to leave it out."""
    sizes = {"shapes": surface.modes, "second order": surface.second, "stress": surface.stress}
    # In single precision.
    parts = [f"{words} {part.nbytes / 2048:.0f} KiB" for words, part in sizes.items() if part is not None]
    return f"surface for pictures: {len(surface.points)} points, {', '.join(parts)} ([output] surface, stress)"


def distant_points(mesh: Mesh, options: BodyOptions) -> list[str]:
    """Say which reference points lie far from the body, or would lie among their nodes in longer units.

    Parameters
    ----------
    mesh : Mesh
    options : BodyOptions
        With node sets for places.

    Returns
    -------
    list of str
    """
    length, name = options.units.length, options.units.length_name
    found = []
    size = float(np.ptp(mesh.points, axis=0).max())
    for table in options.interfaces:
        if table.point is None:
            continue
        point = np.array(table.point)
        own = mesh.points[node_set(mesh, table.nodes, f"interface {table.name!r}")]
        longer = [other for other in UnitSystem if other.length > length]
        meant = [o.length_name for o in longer if _off(point, own) > _off(point * (o.length / length), own) == 0.0]
        away = _off(point, mesh.points)
        words = f"{away / length:.4g} {name} outside the body, which measures {size / length:.4g} {name}"
        if meant:
            words = f"off its nodes, and among them if it were in {meant[0]}"
        if meant or away > _FAR * size:
            given = ", ".join(f"{x:.6g}" for x in point / length)
            words = f"interface {table.name!r}: point = [{given}] lies {words}"
            found.append(f"{words}; points are in the mesh's units ({options.units.value})")
    return found


def _off(point: FloatArray, points: FloatArray) -> float:
    """How far a point lies outside the box of others."""
    return float(np.linalg.norm(np.clip(point, points.min(axis=0), points.max(axis=0)) - point))


def _provenance(config: BodySpec, mesh: Mesh, origin: Mapping[str, str]) -> dict[str, str]:
    """Hashes of what went in, and what made it."""
    chosen_modes = {NORMAL_MODES: " ".join(map(str, config.reduction.numbers))}
    return {
        **origin,
        "body_sha256": hashlib.sha256(config.model_dump_json(exclude={"mesh": {"file"}}).encode()).hexdigest(),
        "nodes": str(len(mesh.points)),
        "elements": str(mesh.element_count),
        "flexfmu_version": own_version(),
        **(chosen_modes if isinstance(config.reduction.modes, list) else {}),
    }
