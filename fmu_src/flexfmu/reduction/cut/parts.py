"""Whether a body is cut; its parts, each reduced by itself, and all joined again (docs/theory.md, section 10)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import ceil

import numpy as np
import scipy.linalg

from ...fe.gradients import mean_spin
from ...files.basics import BodyFileError, FloatArray, IntArray, plural
from ...files.outputs import Reporter
from ...files.store import Store, content_key
from ...mesh.checks import node_groups
from ...mesh.model import Mesh
from ...model.reduced_body import ReducedBody, Shadow
from ..basis import Matrices
from ..bodies import FINER, finer_shadow, fit_interface
from ..division import distance_along
from ..fourth_order import FourthOrder, energy_shares
from ..model import Model
from ..modes import frequency_spread
from ..options import BodyOptions
from ..piece import Reduced, reduced_piece
from ..subdomains import mean_rotation
from .cut import SIDES, Part, cut_at, cut_parts, interface_sets, on_section, part_configs, section_tractions, side_set
from .joining import Weld, join_parts, joined_membrane
from .loops import LoopSection, inner_sections, loop_sections

# How much of the turning (mean square) frames of the parts have to take away to cut at once: a twist-beam axle has 9 to
# 12, a beam held at both ends and an arch 5, three curved arms at a hub 6.4. Of others the error in one piece decides.
_PAYS = 3.0
# Share of stretching above which stretch stops a body before its material turns by half a radian, the most that is
# trusted within a frame: a beam held at both ends has 85, an arch 9, a twist-beam axle 0.02 to 0.4.
_STOPS = 4.0
# Of the turning, what one frame leaves at least.
_TURNS = 0.05
# A frame more than levels as deep as those of the closed body have, only where it is worth one.
_ROUNDED = 0.2
AGAINST_OPENED = 'its own error is that against the opened body (cut = "auto" opens it, with constant mass)'
# Supports beyond which none is looked at: a cover on its bolts is no loop of slender members.
_MOST_SUPPORTS = 8


# A body that is cut: options with a table for each section, and the model with a node set for each.
Opened = tuple[BodyOptions, Model]


def chosen_cuts(config: BodyOptions, model: Model, report: Reporter, store: Store) -> tuple[Opened, list[Opened]]:
    """Find the sections of `cut = "auto"`; cut a body that nothing is said of where its supports' loop turns far.

    Parameters
    ----------
    config : BodyOptions
    model : Model
        In one piece.
    report : Reporter
        Is told what was found, and why.
    store : Store

    Returns
    -------
    chosen : BodyOptions and Model
    others : list of BodyOptions and Model
        What to try where that is wrong at reference loads, with more and more frames.
    """
    if config.find_cuts:
        with report.stage("Look for loops to cut"):
            found, opened, notes = cut_loops(config, model)
        report.tell(notes)
        return (found, opened), []
    if not (config.may_cut and _closes_loops(model)):
        return (config, model), []
    if _rolls(model):
        # Cut bodies are no good in motion there, and frames that hang on sliding places alone are all astray.
        return (config if model.fixed.all(axis=1).any() else replace(config, levels=1), model), []
    with report.stage("Look for loops to cut"):
        found, opened, notes = cut_at(config, model, _between_supports(config, model))
    parts = _parts(found, opened)
    if not parts:
        return (config, model), []
    cut, reason = _decided(config, Matrices(model, report, store), parts)
    if cut is None:
        tried = {one.levels: one for one in (found, _as_long(config, model, found, parts))}
        return (replace(config, certificate=True), model), [
            (replace(one, certificate=True), opened) for one in tried.values()
        ]
    report.tell([reason, *(notes if cut else ())])
    return ((found, opened) if cut else (replace(config, levels=1, may_cut=False), model)), []


def cut_loops(config: BodyOptions, model: Model) -> tuple[BodyOptions, Model, list[str]]:
    """Cut a body's loops from support to support; where there are none, those within it.

    Parameters
    ----------
    config : BodyOptions
    model : Model
        In one piece.

    Returns
    -------
    config, model, notes
        As of `cut_at`.
    """
    if within := _within(config, model):
        return _opened(config, model, within)
    return cut_at(config, model, _between_supports(config, model))


def _opened(config: BodyOptions, model: Model, within: list[LoopSection]) -> tuple[BodyOptions, Model, list[str]]:
    """Open all loops of a body, those within it at these sections, with frames as long as before; as `cut_loops`."""
    found, opened, notes = cut_at(config, model, within + _between_supports(config, model))
    parts = _parts(found, opened)
    if not parts:
        return cut_at(config, model, [])
    return found if config.levels_asked else _as_long(config, model, found, parts), opened, notes


def _as_long(config: BodyOptions, model: Model, found: BodyOptions, parts: Sequence[Part]) -> BodyOptions:
    """Options of a body that is cut, with frames as long as before."""
    before, *after = (float(distance_along(m.mesh, m.anchored).max()) for m in (model, *(p.model for p in parts)))
    return replace(found, levels=len(parts) * ceil(config.levels * max(after) / before - _ROUNDED))


def _within(config: BodyOptions, model: Model) -> list[LoopSection]:
    moves = model.rigid.shape[1] or not model.anchored.size
    return [] if moves else inner_sections(model.mesh, model.anchored, interface_sets(config, model.mesh))


def _between_supports(config: BodyOptions, model: Model) -> list[LoopSection]:
    """Sections that open loops from support to support; of three arms at a hub all but one, which holds the hub."""
    kept: list[LoopSection] = []
    for one in loop_sections(model.mesh, model.held, interface_sets(config, model.mesh)):
        if _parts(*cut_at(config, model, [*kept, one])[:2]):
            kept.append(one)
    return kept


def _rolls(model: Model) -> bool:
    """Whether some supports hold nodes in some directions only."""
    return not model.rigid.shape[1] and not model.fixed[model.held].all() and not model.sprung.any()


def _closes_loops(model: Model) -> bool:
    """Whether several supports, and not too many, hold a body that cannot move."""
    return not model.rigid.shape[1] and 1 <= node_groups(model.mesh, model.held).max(initial=0) < _MOST_SUPPORTS


def _parts(config: BodyOptions, model: Model) -> list[Part]:
    """Parts of the body cut at the sections that were found; none where it cannot be cut there."""
    if not config.cuts:
        return []
    try:
        opened, parts = cut_parts(model, config.cuts, config.supports)
        part_configs(config, opened, parts)
    except BodyFileError:
        return []
    return parts


def _decided(config: BodyOptions, matrices: Matrices, parts: list[Part]) -> tuple[bool | None, str]:
    """Whether to cut, or else to have one frame, which keeps the loop closed better than several, and why.

    A body is cut where the parts turn as a whole, unless stretch stops it before it turns far; None where they do not.
    """
    mesh = matrices.model.mesh
    nodal = [fit_interface(table, mesh, ()).nodal_loads(len(mesh.points))[:, :3] for table in config.interfaces]
    forces = np.hstack(nodal)
    elements = [part.elements for part in parts]
    key = content_key(__name__, matrices.key, forces, *elements)
    find = FourthOrder(matrices).responses
    gain = matrices.kept(key, "worth of cuts", lambda: np.array(turning_taken(mesh, find(forces)[0], elements)))
    begin = f"supports close a loop: frames of its {len(parts)} parts leave 1/{gain:.2g} of the turning of one frame"
    if gain < _PAYS:
        return None, ""
    if energy_shares(matrices, forces)[0] > _STOPS:
        return False, f"{begin}, but stretch stops it before it turns far: one piece, one frame"
    return True, f"{begin}, and it can turn far: it is cut (cut = [] leaves it in one piece)"


def turning_taken(mesh: Mesh, fields: FloatArray, parts: Sequence[IntArray]) -> float:
    """By how much frames of the parts take away the turning of the material that one frame leaves.

    Parameters
    ----------
    mesh : Mesh
    fields : (3n, k) float
        Motions that turn the material by one radian (rms).
    parts : sequence of (e,) int
        Elements of each part.

    Returns
    -------
    float
        Mean square of the rotation about the mean of the whole, over that about the mean of each part: the largest of
        all motions, 1 where parts turn alike.
    """
    if not fields.shape[1]:
        return 1.0
    turned = np.diag(mean_spin(mesh, fields))
    volume = mesh.volumes
    weight = np.array([volume[elements].sum() for elements in parts]) / volume.sum()
    means = np.array([mean_rotation(mesh, elements).of(fields) for elements in parts])
    left_by_one = turned - (np.tensordot(weight, means, axes=1) ** 2).sum(axis=0)
    left_by_parts = turned - weight @ (means**2).sum(axis=1)
    # Where hardly anything turns about the one frame, there is nothing to gain.
    worth = left_by_one > _TURNS * turned
    return float(np.max(left_by_one[worth] / left_by_parts[worth], initial=1.0))


# A part and its interface, and how far it warps in the part's coordinates and in those of its shadow.
_End = tuple[tuple[int, int], Sequence[FloatArray]]


@dataclass(frozen=True, slots=True)
class Joined:
    """Parts of a body, each reduced by itself and joined again.

    Attributes
    ----------
    body : ReducedBody
        Without damping, names and properties.
    span : (m, k) float
        Its coordinates in the motions of another basis.
    fine : list of (ReducedBody, (m_p, m) float)
        Held parts on finer trees, as of `Reduced`, and their coordinates in those of the body.
    third : callable
        As of `Reduced`.
    """

    body: ReducedBody
    span: FloatArray
    fine: list[tuple[ReducedBody, FloatArray]]
    third: Callable[[], ReducedBody]


def reduced_parts(
    config: BodyOptions, model: Model, report: Reporter, store: Store, spanned: FloatArray | None = None
) -> Joined:
    """Reduce the parts of a body each by itself and join them again.

    Parameters
    ----------
    config : BodyOptions
        With cuts.
    model : Model
    report : Reporter
    store : Store
    spanned : (3n, k) float, optional
        Motions of the body in one piece.

    Returns
    -------
    Joined

    Raises
    ------
    BodyFileError
        A section without a frame.
    """
    with report.stage("Cut into parts"):
        opened, parts = cut_parts(model, config.cuts, config.supports)
        configs = part_configs(config, opened, parts)
    whole = Matrices(model, report, store)
    warping = _warping(config.cuts, parts, _unit_responses(config, whole))
    pieces, bodies, ends = [], [], dict[str, _End]()
    spanned = np.zeros((model.fixed.size, 0)) if spanned is None else spanned
    for number, (part, own) in enumerate(zip(parts, configs, strict=True)):
        found = f"part {number + 1} of {len(parts)}: {part.elements.size} elements"
        report.detail(f"{found}, interfaces {', '.join(table.name for table in own.interfaces)}")
        forces = [on_section(part, side, warping[side]) for side in part.sections]
        origin = (3 * part.origin[:, None] + np.arange(3)).ravel()
        piece = reduced_piece(own, part.model, report, store, part.springs, np.hstack(forces), spanned[origin])
        piece = piece.certified() if own.certificate else piece
        pieces.append(piece)
        ends |= _ends(number, part, piece, np.cumsum([force.shape[1] for force in forces])[:-1])
        begin = f"part_{number + 1}_" if len(parts) > 1 and not own.frames else ""
        bodies.append(replace(piece.body, frame_names=tuple(f"{begin}{name}" for name in piece.body.frame_names)))
    with report.stage(f"Join {len(parts)} parts"):
        pairs = [[ends[side_set(name, side)] for side in SIDES] for name in config.cuts]
        body, turn, finer, note = _joined(bodies, pairs, parts, [table.name for table in config.interfaces])
    first, last = body.angular_frequency[[0, -1]] / (2.0 * np.pi)
    report.detail(f"{body.mode_count} modes, {first:.4g} to {last:.4g} Hz; {note}")
    rows = np.split(turn, np.cumsum([part.mode_count for part in bodies])[:-1])
    if config.watched:
        shapes = [one.shapes @ own for one, own in zip(pieces, rows, strict=True)]
        body = replace(body, frequency_spread=_spread(whole, parts, shapes, body.angular_frequency))
    fine = [(one.fine, own) for one, own in zip(pieces, rows, strict=True) if one.fine is not None]
    shadow = body.shadow.body if body.shadow is not None else body

    def third() -> ReducedBody:
        return replace(shadow, membrane=joined_membrane([one.third() for one in pieces], finer))

    return Joined(body, turn.T @ np.vstack([one.span for one in pieces]), fine, third)


def _ends(number: int, part: Part, piece: Reduced, widths: IntArray) -> dict[str, _End]:
    """Sections of a part by name: its number, their place among its interfaces, and their warping's work."""
    found: dict[str, _End] = {}
    works = (np.split(work, widths) for work in (piece.warping_work, piece.shadow_work))
    for side, *work in zip(part.sections, *works, strict=True):
        place = piece.body.interface_names.index(side)
        if piece.body.interface_frame[place] < 0:
            raise BodyFileError(f"[[cut]] {side}: no [[frame]] holds nodes of the section, expected one")
        found[side] = (number, place), work
    return found


def _spread(matrices: Matrices, parts: Sequence[Part], shapes: Sequence[FloatArray], omega: FloatArray) -> FloatArray:
    """`frequency_spread` of joined modes, by their shapes (3n_p, m) in each part: their mean on sections."""
    count = np.zeros(len(matrices.model.mesh.points))
    whole = np.zeros((count.size, 3, omega.size))
    for part, own in zip(parts, shapes, strict=True):
        np.add.at(whole, part.origin, own.reshape(-1, *whole.shape[1:]))
        np.add.at(count, part.origin, 1.0)
    whole /= np.maximum(count, 1.0)[:, None, None]
    return frequency_spread(matrices.supported, omega, whole.reshape(3 * count.size, -1))


def _warping(names: Sequence[str], parts: Sequence[Part], fields: FloatArray) -> dict[str, FloatArray]:
    """Nodal forces by which sections warp: those of its first side, on both sides."""
    found = {}
    for name in names:
        one, other = (side_set(name, side) for side in SIDES)
        part = next(part for part in parts if one in part.sections)
        found[one] = found[other] = section_tractions(part, one, fields)
    return found


def reduced_whole(config: BodyOptions, model: Model, report: Reporter, store: Store) -> Reduced:
    """Reduce a body in one piece, without its shadow yet; where loops close within it, that has them opened.

    Its modes hold such a loop together linearly only, and more frames or modes do not change that. Several frames of a
    loop through supports may turn apart where they meet: such a body gets another shadow, with that loop opened, unless
    sections flatten, of which parts know less than the whole.

    Parameters
    ----------
    config : BodyOptions
    model : Model
    report : Reporter
    store : Store

    Returns
    -------
    Reduced
    """
    piece = reduced_piece(config, model, report, store)
    return replace(piece, certified=partial(_certified, piece, config, model, report, store))


def _certified(piece: Reduced, config: BodyOptions, model: Model, report: Reporter, store: Store) -> Reduced:
    """A body in one piece with its shadow, and another one where loops through supports are opened."""
    found, opened = replace(config, frames=(), branches=(), levels_asked=False, cuts=()), model
    flattens = piece.body.membrane is not None and bool(np.any(piece.body.membrane.sign < 0.0))
    with report.stage("Look for loops that stay closed"):
        within = _within(found, model)
        if within or (_closes_loops(model) and (_rolls(model) or (config.levels > 1 and not flattens))):
            found, opened, _ = _opened(found, model, within)
    cuts = found.cuts
    if not (cuts and within):
        piece = piece.certified()
    if not cuts:
        return piece
    with report.stage(f"Reduce the body once more, {plural(len(cuts), 'loop')} opened, to know its error"):
        # Of so many frames as a body has that bends far, more tell nothing.
        finer = replace(finer_shadow(found, (1 if config.far else FINER) * found.levels), levels_asked=False)
        other = reduced_parts(finer, opened, Reporter(), store, piece.shapes)
    another = replace(piece, body=replace(piece.body, shadow=Shadow(other.body, other.span)), third=other.third)
    if not within:
        return replace(piece, other=another)
    report.note(f"{plural(len(cuts), 'loop')} within the body: {AGAINST_OPENED}")
    return another


def _joined(
    bodies: Sequence[ReducedBody], pairs: Sequence[Sequence[_End]], parts: Sequence[Part], kept: Sequence[str]
) -> tuple[ReducedBody, FloatArray, FloatArray, str]:
    """The parts joined at pairs of sections, and so their shadows; turns of both coordinates; a note of the joints."""

    def welds(which: int) -> list[Weld]:
        return [Weld(first, second, one[which], other[which]) for (first, one), (second, other) in pairs]

    loose = [np.array([spring.interface is not None for spring in part.springs], dtype=bool) for part in parts]
    body, turn, note = join_parts([replace(one, shadow=None) for one in bodies], welds(0), loose, kept)
    finer_turn = turn
    shadows = [one.shadow for one in bodies if one.shadow is not None]
    if shadows:
        finer, finer_turn, _ = join_parts([one.body for one in shadows], welds(1), loose, kept)
        span = scipy.linalg.block_diag(*(one.embedding for one in shadows))
        body = replace(body, shadow=Shadow(finer, finer_turn.T @ span @ turn))
    return body, turn, finer_turn, note


def _unit_responses(config: BodyOptions, matrices: Matrices) -> FloatArray:
    """Static displacements (3n, l) of the body in one piece under its interfaces' unit loads, of unit work."""
    mesh = matrices.model.mesh
    loads = np.hstack([fit_interface(table, mesh, ()).nodal_loads(len(mesh.points)) for table in config.interfaces])

    def make() -> FloatArray:
        whole = matrices.supported
        with matrices.report.stage(f"Find the static response to {loads.shape[1]} unit loads in one piece"):
            return whole.whole(whole.static(whole.forces(loads)))

    found = matrices.kept(content_key(__name__, "fields", matrices.key, loads), "static response", make)
    work = np.einsum("ij,ij->j", loads, found)
    # Loads on a support do nothing.
    return found[:, work > 0.0] / np.sqrt(work[work > 0.0])
