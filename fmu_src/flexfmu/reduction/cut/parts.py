"""A body cut into parts: each reduced by itself, and all joined again (docs/theory.md, section 10)."""

from dataclasses import replace

import numpy as np

from ...files.array_types import FloatArray
from ...files.errors import BodyFileError
from ...files.progress import Reporter
from ...files.store import Store, content_key
from ...model.reduced_body import ReducedBody
from ..basis import Matrices
from ..interfaces import fit_interface
from ..model import Model
from ..options import BodyOptions
from ..piece import reduced_piece
from .cut import SIDES, cut_parts, on_section, part_configs, section_tractions, side_set
from .joining import Weld, join_parts


def reduced_parts(config: BodyOptions, model: Model, report: Reporter, store: Store) -> ReducedBody:
    """Reduce the parts of a body each by itself and join them again.

    Parameters
    ----------
    config : BodyOptions
        With cuts.
    model : Model
        In one piece.
    report : Reporter
    store : Store

    Returns
    -------
    ReducedBody
        Without damping, names and properties.

    Raises
    ------
    BodyFileError
        A section without a frame.
    """
    names = config.cuts
    with report.stage("Cut into parts"):
        opened, parts = cut_parts(model, names, config.supports)
        configs = part_configs(config, opened, parts)
    fields = _unit_responses(config, model, report, store)
    # The shapes of a section's warping are those of its first side, on both sides.
    warping = {}
    for name in names:
        one, other = (side_set(name, side) for side in SIDES)
        part = next(part for part in parts if one in part.sections)
        warping[one] = warping[other] = section_tractions(part, one, fields)
    bodies, ends = [], {}
    for number, (part, own) in enumerate(zip(parts, configs, strict=True)):
        report.note(
            f"part {number + 1} of {len(parts)}: {part.elements.size} elements, interfaces "
            f"{', '.join(table.name for table in own.interfaces)}"
        )
        forces = [on_section(part, side, warping[side]) for side in part.sections]
        piece = reduced_piece(own, part.model, report, store, part.springs, np.hstack(forces))
        widths = np.cumsum([force.shape[1] for force in forces])[:-1]
        for side, work in zip(part.sections, np.split(piece.warping_work, widths), strict=True):
            place = piece.body.interface_names.index(side)
            if piece.body.interface_frame[place] < 0:
                raise BodyFileError(f"[[cut]] {side}: no [[frame]] holds nodes of the section, expected one")
            ends[side] = (number, place), work
        frames = piece.body.frame_names
        if not own.frames and len(parts) > 1:
            frames = tuple(f"part_{number + 1}_{name}" for name in frames)
        bodies.append(replace(piece.body, frame_names=frames))
    pairs = [[ends[side_set(name, side)] for side in SIDES] for name in names]
    welds = [Weld(first, second, first_work, second_work) for (first, first_work), (second, second_work) in pairs]
    loose = [np.array([spring.interface is not None for spring in part.springs], dtype=bool) for part in parts]
    with report.stage(f"Join {len(parts)} parts"):
        body, note = join_parts(bodies, welds, loose, [table.name for table in config.interfaces])
    hertz = body.angular_frequency / (2.0 * np.pi)
    report.note(f"{hertz.size} modes, {hertz[0]:.4g} to {hertz[-1]:.4g} Hz; {note}")
    return body


def _unit_responses(config: BodyOptions, model: Model, report: Reporter, store: Store) -> FloatArray:
    """Static displacements (3n, l) of the body in one piece under its interfaces' unit loads, of unit work."""
    mesh = model.mesh
    faces = mesh.faces
    loads = np.hstack(
        [fit_interface(table, mesh, faces, ()).nodal_loads(len(mesh.points)) for table in config.interfaces]
    )
    matrices = Matrices(model, mesh.volume_matrices, report)

    def make() -> dict[str, FloatArray]:
        whole = matrices.supported
        with report.stage(f"Find the static response to {loads.shape[1]} unit loads in one piece"):
            return {"fields": whole.whole(whole.static(whole.forces(loads)))}

    found = store.arrays(content_key(__name__, "fields", matrices.key, loads), "static response", report, make)[
        "fields"
    ]
    work = np.einsum("ij,ij->j", loads, found)
    # Loads on a support do nothing.
    fields: FloatArray = found[:, work > 0.0] / np.sqrt(work[work > 0.0])
    return fields
