"""A body cut into parts: each reduced by itself, and all joined again (docs/theory.md, section 10)."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.linalg

from ...files.basics import BodyFileError, FloatArray, IntArray, plural
from ...files.progress import Reporter
from ...files.store import Store, content_key
from ...model.reduced_body import ReducedBody, Shadow
from ..basis import Matrices
from ..interfaces import fit_interface
from ..model import Model
from ..modes import frequency_spread
from ..options import BodyOptions
from ..piece import Reduced, reduced_piece
from ..shadow import FINER, finer_shadow
from .cut import SIDES, Part, cut_parts, on_section, part_configs, section_tractions, side_set
from .joining import Weld, join_parts
from .loop_choice import opened_loops

# A part and its interface, and how far it warps in the part's coordinates and in those of its shadow.
_End = tuple[tuple[int, int], Sequence[FloatArray]]
# Unknowns beyond which the factor of the whole makes room for those of the parts, and is found again for the modes' own
# error: some 3 GB at 300 000.
_LARGE = 100_000


def reduced_parts(
    config: BodyOptions, model: Model, report: Reporter, store: Store, spanned: FloatArray | None = None
) -> tuple[ReducedBody, FloatArray, list[tuple[ReducedBody, FloatArray]]]:
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
    body : ReducedBody
        Without damping, names and properties.
    span : (m, k) float
        Its coordinates in these motions.
    fine : list of (ReducedBody, (m_p, m) float)
        Held parts on finer trees, as of `Reduced`, and their coordinates in those of the body.

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
    whole = Matrices(model, report, store) if model.fixed.size > _LARGE else whole
    pieces, bodies, ends = [], [], dict[str, _End]()
    spanned = np.zeros((model.fixed.size, 0)) if spanned is None else spanned
    for number, (part, own) in enumerate(zip(parts, configs, strict=True)):
        report.detail(
            f"part {number + 1} of {len(parts)}: {part.elements.size} elements, interfaces "
            f"{', '.join(table.name for table in own.interfaces)}"
        )
        forces = [on_section(part, side, warping[side]) for side in part.sections]
        origin = (3 * part.origin[:, None] + np.arange(3)).ravel()
        piece = reduced_piece(own, part.model, report, store, part.springs, np.hstack(forces), spanned[origin])
        pieces.append(piece)
        ends |= _ends(number, part, piece, np.cumsum([force.shape[1] for force in forces])[:-1])
        begin = f"part_{number + 1}_" if len(parts) > 1 and not own.frames else ""
        bodies.append(replace(piece.body, frame_names=tuple(f"{begin}{name}" for name in piece.body.frame_names)))
    with report.stage(f"Join {len(parts)} parts"):
        pairs = [[ends[side_set(name, side)] for side in SIDES] for name in config.cuts]
        body, turn, note = _joined(bodies, pairs, parts, [table.name for table in config.interfaces])
    first, last = body.angular_frequency[[0, -1]] / (2.0 * np.pi)
    report.detail(f"{body.mode_count} modes, {first:.4g} to {last:.4g} Hz; {note}")
    rows = np.split(turn, np.cumsum([part.mode_count for part in bodies])[:-1])
    if config.watched:
        shapes = [one.shapes @ own for one, own in zip(pieces, rows, strict=True)]
        body = replace(body, frequency_spread=_spread(whole, parts, shapes, body.angular_frequency))
    fine = [(one.fine, own) for one, own in zip(pieces, rows, strict=True) if one.fine is not None]
    return body, turn.T @ np.vstack([one.span for one in pieces]), fine


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


def _spread(
    matrices: Matrices, parts: Sequence[Part], shapes: Sequence[FloatArray], angular_frequency: FloatArray
) -> FloatArray:
    """`frequency_spread` of joined modes, by their shapes (3n_p, m) in each part: their mean on sections."""
    count = np.zeros(len(matrices.model.mesh.points))
    whole = np.zeros((count.size, 3, angular_frequency.size))
    for part, own in zip(parts, shapes, strict=True):
        np.add.at(whole, part.origin, own.reshape(-1, *whole.shape[1:]))
        np.add.at(count, part.origin, 1.0)
    whole /= np.maximum(count, 1.0)[:, None, None]
    return frequency_spread(matrices.supported, angular_frequency, whole.reshape(3 * count.size, -1))


def _warping(names: Sequence[str], parts: Sequence[Part], fields: FloatArray) -> dict[str, FloatArray]:
    """Nodal forces by which sections warp: those of its first side, on both sides."""
    found = {}
    for name in names:
        one, other = (side_set(name, side) for side in SIDES)
        part = next(part for part in parts if one in part.sections)
        found[one] = found[other] = section_tractions(part, one, fields)
    return found


def reduced_whole(config: BodyOptions, model: Model, report: Reporter, store: Store) -> Reduced:
    """Reduce a body in one piece; where loops close within it, its shadow has them opened.

    Its modes hold such a loop together linearly only, and more frames or modes do not change that.

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
    cuts: tuple[str, ...] = ()
    if config.certificate:
        with report.stage("Look for loops within the body"):
            alike = replace(config, frames=(), branches=(), levels_asked=False)
            found, opened, _ = opened_loops(alike, model)
            cuts = found.cuts
    piece = reduced_piece(replace(config, certificate=config.certificate and not cuts), model, report, store)
    if not cuts:
        return piece
    with report.stage(f"Reduce the body once more, {plural(len(cuts), 'loop')} opened, to know its error"):
        finer = finer_shadow(found, FINER * found.levels)
        other, span, _ = reduced_parts(finer, opened, Reporter(), store, piece.shapes)
    report.note(
        f"{plural(len(cuts), 'loop')} within the body: its own error is that against the opened body "
        '(cut = "auto" opens it, with constant mass)'
    )
    return replace(piece, body=replace(piece.body, shadow=Shadow(other, span)))


def _joined(
    bodies: Sequence[ReducedBody], pairs: Sequence[Sequence[_End]], parts: Sequence[Part], kept: Sequence[str]
) -> tuple[ReducedBody, FloatArray, str]:
    """The parts joined at pairs of sections, and so their shadows; the turn of coordinates; a note of the joints."""

    def welds(which: int) -> list[Weld]:
        return [Weld(first, second, one[which], other[which]) for (first, one), (second, other) in pairs]

    loose = [np.array([spring.interface is not None for spring in part.springs], dtype=bool) for part in parts]
    body, turn, note = join_parts([replace(one, shadow=None) for one in bodies], welds(0), loose, kept)
    shadows = [one.shadow for one in bodies if one.shadow is not None]
    if shadows:
        finer, finer_turn, _ = join_parts([one.body for one in shadows], welds(1), loose, kept)
        span = scipy.linalg.block_diag(*(one.embedding for one in shadows))
        body = replace(body, shadow=Shadow(finer, finer_turn.T @ span @ turn))
    return body, turn, note


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
