"""Universal files (.unv) of I-DEAS, Salome and gmsh: nodes, elements and groups.

Source: the datasets 15, 781, 2411 (nodes), 780, 2412 (elements) and 2417 to 2477 (groups) of the University of
Cincinnati's collection of universal file formats.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import meshio
import numpy as np

from flexfmu.files.basics import MeshError, listed
from flexfmu.mesh.in_memory import Contents, Member, cells_of
from flexfmu.mesh.other.extras import quiet

# Around a polygon mid-side nodes stand between its corners; solids have such rings, and nodes between them.
_TRIANGLE = ("triangle", (0, 1, 2)), ("triangle6", (0, 2, 4, 1, 3, 5))
_QUAD = ("quad", (0, 1, 2, 3)), ("quad8", (0, 2, 4, 6, 1, 3, 5, 7))
_KINDS = {
    111: ("tetra", tuple(range(4))),
    112: ("wedge", tuple(range(6))),
    113: ("wedge15", (0, 2, 4, 9, 11, 13, 1, 3, 5, 10, 12, 14, 6, 7, 8)),
    115: ("hexahedron", tuple(range(8))),
    116: ("hexahedron20", (0, 2, 4, 6, 12, 14, 16, 18, 1, 3, 5, 7, 13, 15, 17, 19, 8, 9, 10, 11)),
    118: ("tetra10", (0, 2, 4, 9, 1, 3, 5, 6, 7, 8)),
    **dict.fromkeys((41, 51, 61, 74, 81, 91), _TRIANGLE[0]),
    **dict.fromkeys((42, 52, 62, 72, 82, 92), _TRIANGLE[1]),
    **dict.fromkeys((44, 54, 64, 71, 84, 94), _QUAD[0]),
    **dict.fromkeys((45, 55, 65, 75, 85, 95), _QUAD[1]),
    **dict.fromkeys((11, 21, 22), ("line", (0, 1))),
    **dict.fromkeys((23, 24), ("line3", (0, 2, 1))),
}
# Their nodes come after a line of their own.
_BEAMS = (11, 21, 22, 23, 24)
# Numbers for each member of a group, by dataset.
_GROUPS = {**dict.fromkeys((2417, 2429, 2430, 2432), 2), **dict.fromkeys((2435, 2452, 2467, 2477), 4)}
_NODE, _ELEMENT = 7, 8


def read_universal(path: Path) -> Contents:
    """Read a universal file: groups are sets; it has no materials.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Contents

    Raises
    ------
    MeshError
        The file is cut short, or holds elements that are not known.
    """
    with quiet(path, "check the file; expected a universal file with datasets 2411 and 2412"):
        points: dict[int, list[float]] = {}
        kinds: dict[str, list[Member]] = {}
        refused: dict[int, list[int]] = {}
        groups: list[tuple[str, list[int], list[int]]] = []
        for dataset, lines in _datasets(path):
            if dataset in (15, 781, 2411):
                points |= _nodes(lines, dataset)
            elif dataset in (780, 2412):
                _add_elements(lines, dataset, kinds, refused)
            elif dataset in _GROUPS:
                groups += _groups(lines, _GROUPS[dataset])
        if refused:
            parts = "; ".join(f"descriptor {kind}: elements {listed(them)}" for kind, them in refused.items())
            raise MeshError(f"{path} holds elements that are not known: {parts}; mesh these parts with tetrahedra, "
                            "wedges or bricks, and export again")  # fmt: skip
        row = {label: place for place, label in enumerate(points)}
        cells, labels, material = cells_of(kinds, row, {}, f"{path}: an element names node")
        mesh = meshio.Mesh(
            np.array(list(points.values())).reshape(-1, 3),
            cells,
            point_sets={name: np.array([row[n] for n in nodes if n in row]) for name, nodes, _ in groups if nodes},
            cell_sets={
                name: [np.flatnonzero(np.isin(own, members)) for own in labels]
                for name, nodes, members in groups
                if members and not nodes
            },
        )
        return Contents(mesh, np.array(list(points), dtype=np.int64), labels, (), material)


def _datasets(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Numbers and lines of the datasets, each between two lines of −1."""
    text = path.read_text(encoding="latin-1").splitlines()
    bounds = [place for place, line in enumerate(text) if line.strip() == "-1"]
    if len(bounds) % 2 or not bounds:
        raise MeshError(f"{path} has {len(bounds)} lines of -1 about its datasets, expected pairs: cut short? "
                        "export it again")  # fmt: skip
    for first, last in zip(bounds[::2], bounds[1::2], strict=True):
        if last > first + 1 and (number := text[first + 1].split()[0]).isdigit():
            yield int(number), text[first + 2 : last]


def _nodes(lines: Sequence[str], dataset: int) -> dict[int, list[float]]:
    if dataset == 15:
        return {int((part := line.split())[0]): [float(one) for one in part[4:7]] for line in lines}
    pairs = zip(lines[::2], lines[1::2], strict=True)
    return {int(head.split()[0]): [float(one) for one in _exponents(place).split()] for head, place in pairs}


def _exponents(line: str) -> str:
    return line.upper().replace("D", "E")


def _add_elements(
    lines: Sequence[str], dataset: int, kinds: dict[str, list[Member]], refused: dict[int, list[int]]
) -> None:
    """Add a dataset's elements by meshio's names, and those of no known name by their number."""
    rest = iter(lines)
    for line in rest:
        head = [int(one) for one in line.split()]
        number, kind, count = head[0], head[1], head[7 if dataset == 780 else 5]
        if kind in _BEAMS:
            next(rest)
        nodes: list[int] = []
        while len(nodes) < count:
            nodes += [int(one) for one in next(rest).split()]
        # Salome has quadratic edges as tapered beams.
        name, order = _KINDS.get(24 if kind == 22 and count == 3 else kind, ("", ()))
        if len(order) == count:
            kinds.setdefault(name, []).append(Member(number, [nodes[k] for k in order], 0))
        else:
            refused.setdefault(kind, []).append(number)


def _groups(lines: Sequence[str], width: int) -> Iterator[tuple[str, list[int], list[int]]]:
    """Name, nodes and elements of each group."""
    # An empty group has an empty line.
    rest = iter([line for line in lines if line.strip()])
    for line in rest:
        count = int(line.split()[7])
        name = next(rest).strip()
        found: list[int] = []
        while len(found) < count * width:
            found += [int(one) for one in next(rest).split()]
        members = list(zip(found[::width], found[1::width], strict=True))
        nodes, elements = ([tag for kind, tag in members if kind == wanted] for wanted in (_NODE, _ELEMENT))
        yield name, nodes, elements
