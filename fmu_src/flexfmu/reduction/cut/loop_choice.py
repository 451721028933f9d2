"""Whether a body whose supports close a loop is cut, where its body file does not say (docs/theory.md, section 10)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from ...fe.gradients import mean_spin
from ...files.basics import BodyFileError, FloatArray, IntArray
from ...files.progress import Reporter
from ...files.store import Store
from ...mesh.model import Mesh
from ..basis import Matrices
from ..division import distance_along
from ..fourth_order import FourthOrder, energy_shares
from ..interfaces import fit_interface
from ..model import Model
from ..options import BodyOptions
from ..subdomains import mean_rotation
from .cut import Part, cut_at, cut_parts, interface_sets, part_configs
from .loops import LoopSection, inner_sections, loop_sections, support_groups

# How much of the turning (mean square) frames of the parts have to take away: a twist-beam axle has 9 to 12, a beam
# held at both ends and an arch 5, a portal frame 1.5, a ring on two feet 1.1.
_PAYS = 3.0
# Share of stretching above which stretch stops a body before its material turns by half a radian, the most that is
# trusted within a frame: a beam held at both ends has 85, an arch 9, a twist-beam axle 0.02 to 0.4.
_STOPS = 4.0
# Of the turning, what one frame leaves at least.
_TURNS = 0.05
# A frame more than levels as deep as those of the closed body have, only where it is worth one.
_ROUNDED = 0.2
# Supports beyond which none is looked at: a cover on its bolts is no loop of slender members.
_MOST_SUPPORTS = 8


@dataclass(frozen=True, slots=True)
class _Choice:
    """Whether to cut, whether one frame keeps the loop closed better than several, and why."""

    cut: bool
    whole: bool
    reason: str


def chosen_cuts(config: BodyOptions, model: Model, report: Reporter, store: Store) -> tuple[BodyOptions, Model]:
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
    config : BodyOptions
        With a table for each section.
    model : Model
        With a node set for each.
    """
    if config.find_cuts:
        with report.stage("Look for loops to cut"):
            found, opened, notes = cut_loops(config, model)
        for text in notes:
            report.note(text)
        return found, opened
    if not (config.may_cut and _closes_loops(model)):
        return config, model
    with report.stage("Look for loops to cut"):
        found, opened, notes = cut_at(config, model, _between_supports(config, model))
    parts = _parts(found, opened)
    if not parts:
        return config, model
    choice = _decided(config, model, parts, report, store)
    report.note(choice.reason)
    if not choice.cut:
        return (replace(config, levels=1, may_cut=False) if choice.whole else config), model
    for text in notes:
        report.note(text)
    return found, opened


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
    if _within(config, model):
        return opened_loops(config, model)
    return cut_at(config, model, _between_supports(config, model))


def opened_loops(config: BodyOptions, model: Model) -> tuple[BodyOptions, Model, list[str]]:
    """Open all loops of a body that has some within it, with frames as long as before; as `cut_loops`."""
    within = _within(config, model)
    found, opened, notes = cut_at(config, model, [*within, *_between_supports(config, model)] if within else [])
    parts = _parts(found, opened)
    if not parts:
        return cut_at(config, model, [])
    if not config.levels_asked:
        before, *after = (
            float(distance_along(one.mesh, one.anchored).max()) for one in (model, *(part.model for part in parts))
        )
        found = replace(found, levels=len(parts) * ceil(config.levels * max(after) / before - _ROUNDED))
    return found, opened, notes


def _within(config: BodyOptions, model: Model) -> list[LoopSection]:
    mesh = model.mesh
    if model.rigid.shape[1] or not model.anchored.size:
        return []
    return inner_sections(mesh, model.anchored, interface_sets(config, mesh))


def _between_supports(config: BodyOptions, model: Model) -> list[LoopSection]:
    mesh = model.mesh
    return loop_sections(mesh, model.anchored, interface_sets(config, mesh))


def _closes_loops(model: Model) -> bool:
    """Whether several supports, and not too many, hold a body that cannot move."""
    if model.rigid.shape[1] or not model.anchored.size:
        return False
    return 1 <= int(support_groups(model.mesh, model.anchored).max()) < _MOST_SUPPORTS


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


def _decided(config: BodyOptions, model: Model, parts: list[Part], report: Reporter, store: Store) -> _Choice:
    """Cut where the parts turn as a whole, unless stretch stops the body before it turns far."""
    mesh = model.mesh
    nodal = [fit_interface(table, mesh, ()).nodal_loads(len(mesh.points)) for table in config.interfaces]
    forces = np.hstack([loads[:, :3] for loads in nodal])
    matrices = Matrices(model, report, store)
    fields, _ = FourthOrder(matrices).responses(forces)
    gain = turning_taken(mesh, fields, [part.elements for part in parts])
    begin = f"supports close a loop: frames of its {len(parts)} parts leave 1/{gain:.2g} of the turning of one frame"
    if gain < _PAYS:
        return _Choice(False, False, f'{begin}; the body stays in one piece (cut = "auto" cuts it)')
    if energy_shares(matrices, forces)[0] > _STOPS:
        return _Choice(False, True, f"{begin}, but stretch stops it before it turns far: one piece, one frame")
    return _Choice(True, False, f"{begin}, and it can turn far: it is cut (cut = [] leaves it in one piece)")


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
    whole = np.tensordot(weight, means, axes=1)
    left_by_one = turned - (whole**2).sum(axis=0)
    left_by_parts = turned - weight @ (means**2).sum(axis=1)
    # Where hardly anything turns about the one frame, there is nothing to gain.
    worth = left_by_one > _TURNS * turned
    return float(np.max(left_by_one[worth] / left_by_parts[worth], initial=1.0))
