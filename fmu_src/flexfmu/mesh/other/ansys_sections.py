"""Sections of Ansys archives: SECTYPE, SECOFFSET, SECDATA or SECBLOCK of shells of one layer and of beams."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from flexfmu.files.array_types import FloatArray
from flexfmu.mesh.beams import Beam, CrossSection, box, ellipse, i_section, l_section, pipe, rectangle

# Heights of both faces of shells over the nodes, over the thickness.
_SIDES = {"": (-0.5, 0.5), "MID": (-0.5, 0.5), "TOP": (-1.0, 0.0), "BOT": (0.0, 1.0)}
# Numbers of a beam's section, and what they make: the first axis is the element's y, the second its z.
_SHAPES: dict[str, tuple[int, Callable[[list[float]], CrossSection | None]]] = {
    "RECT": (2, lambda n: CrossSection(rectangle(*n[:2]))),
    "CSOLID": (1, lambda n: CrossSection(ellipse(2.0 * n[0], 2.0 * n[0]))),
    "CTUBE": (2, lambda n: CrossSection(pipe(n[1], n[1] - n[0]))),
    "HREC": (6, lambda n: CrossSection(box(n[0], n[1], n[2], n[4])) if n[2:6:2] == n[3:6:2] else None),
    "I": (6, lambda n: i_section(n[2], (n[0], n[1]), (n[3], n[4]), n[5])),
    "L": (4, lambda n: l_section(*n[:4])),
}
# Beams within this part of their length of the global Z have their y along Y.
_UPRIGHT = 1e-4


class ArchiveSection(NamedTuple):
    """A section: kind (four letters), shape of a beam's, offset, and its rows of numbers."""

    kind: str
    shape: str
    offset: str
    rows: list[list[float]]


def sections(text: Iterable[str]) -> dict[int, ArchiveSection]:
    """Sections of an archive by their numbers."""
    found: dict[int, ArchiveSection] = {}
    number, left = 0, 0
    for line in text:
        command, *fields = [field.strip().upper() for field in line.partition("!")[0].split(",")]
        if command == "SECTYPE" and len(fields) > 1 and fields[0].isdigit():
            number = int(fields[0])
            found[number] = ArchiveSection(fields[1][:4], fields[2] if len(fields) > 2 else "", "", [])
        elif command == "SECOFFSET" and number:
            found[number] = found[number]._replace(offset=fields[0])
        elif command == "SECBLOCK" and number:
            left = int(fields[0])
        elif (left or command == "SECDATA") and number:
            row = fields if command == "SECDATA" else [command, *fields]
            found[number].rows.append([float(one or 0) for one in row])
            left -= left > 0
    return found


def shell_section(known: ArchiveSection | None) -> tuple[float, float, int] | None:
    """Heights of a shell's faces over its nodes and the material's number, 0 for that of the element.

    None where it has several layers or an offset that is not known.
    """
    if known is None or known.kind != "SHEL" or len(known.rows) != 1 or known.offset not in _SIDES:
        return None
    (thickness, *more), (below, above) = known.rows[0], _SIDES[known.offset]
    return below * thickness, above * thickness, int(more[0]) if more else 0


def beam_of(known: ArchiveSection | None, nodes: FloatArray, length: float) -> Beam | None:
    """A beam with the nodes at its centroid; None where the section is none that is known.

    Parameters
    ----------
    known : ArchiveSection, optional
    nodes : (2, 3) or (3, 3) float
        Its ends, and its orientation node in the plane of its x and z.
    length : float
        m of the archive's unit.

    Returns
    -------
    Beam or None
    """
    if known is None or known.kind != "BEAM" or known.shape not in _SHAPES or known.offset not in ("", "CENT"):
        return None
    numbers = [one for row in known.rows for one in row]
    count, make = _SHAPES[known.shape]
    section = make(numbers) if len(numbers) >= count else None
    if section is None:
        return None
    along = nodes[1] - nodes[0]
    if len(nodes) > 2:
        first = np.cross(nodes[2] - nodes[0], along)
    elif np.hypot(*along[:2]) <= _UPRIGHT * np.linalg.norm(along):
        first = np.array([0.0, 1.0, 0.0])
    else:
        first = np.array([-along[1], along[0], 0.0])
    section = section.scaled(length)
    return Beam(section, tuple(first.tolist()), section.centroid)
