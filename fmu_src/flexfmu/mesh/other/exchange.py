"""Libraries that read one format; universal files (.unv) of I-DEAS, Salome and gmsh; Exodus II, by SciPy or h5py.

Source: the datasets 15, 781, 2411 (nodes), 780, 2412 (elements) and 2417 to 2477 (groups) of the University of
Cincinnati's collection of universal file formats.
"""

import contextlib
import io
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from flexfmu.files.basics import FlexfmuError, IntArray, MeshError, listed
from flexfmu.mesh.elements import ASSUMED
from flexfmu.mesh.in_memory import Contents, Member, contents_of
from flexfmu.mesh.shapes import FACE_SHAPES


def imported(module: str, path: Path, library: str, extra: str) -> Any:
    """Import a library that a file needs.

    Parameters
    ----------
    module : str
    path : Path
        The file, for the message.
    library : str
        As package indices call it.
    extra : str
        Of this package, that installs it.

    Returns
    -------
    module

    Raises
    ------
    MeshError
        It is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        ways = f'pip install "flexfmu[{extra}]", or pip install {library}'
        raise MeshError(f"{path} needs {library} to be read ({error}): {ways}") from error


@contextlib.contextmanager
def quiet(path: Path, advice: str) -> Iterator[None]:
    """Turn whatever a library says and raises into one error that names the file.

    Parameters
    ----------
    path : Path
    advice : str
        What to do.
    """
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            yield
    except (FlexfmuError, KeyboardInterrupt, GeneratorExit):
        raise
    # Some end the interpreter where they cannot read, and all let any exception of their parsers through.
    except (Exception, SystemExit) as failure:
        reason = str(failure) if isinstance(failure, Exception) else ""
        frames = [frame.f_locals for frame, _ in traceback.walk_tb(failure.__traceback__)]
        reason += "".join(f" {cards}" for cards in [one["card_lines"] for one in frames if "card_lines" in one][-1:])
        told = " ".join(f"{said.getvalue()} {reason}".split())[-_LONGEST:] or type(failure).__name__
        raise MeshError(f"{path} cannot be read as a mesh: {told}; {advice}") from failure


# Characters of a library's own words that are passed on: the last ones name the reason.
_LONGEST = 600


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
                _add_cells(lines, dataset, kinds, refused)
            elif dataset in _GROUPS:
                groups += _groups(lines, _GROUPS[dataset])
        if refused:
            parts = "; ".join(f"descriptor {kind}: elements {listed(them)}" for kind, them in refused.items())
            raise MeshError(f"{path} holds elements that are not known: {parts}; mesh these parts with tetrahedra, "
                            "wedges or bricks, and export again")  # fmt: skip
        given = np.array(list(points), dtype=np.int64), np.array(list(points.values()))
        node_sets = {name: nodes for name, nodes, _ in groups if nodes}
        cell_sets = {name: members for name, nodes, members in groups if members and not nodes}
        return contents_of(given, kinds, {}, f"{path}: an element names node", node_sets, cell_sets)


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
    pairs = zip(lines[::2], (place.upper().replace("D", "E") for place in lines[1::2]), strict=True)
    return {int(head.split()[0]): [float(one) for one in place.split()] for head, place in pairs}


def _add_cells(lines: Sequence[str], dataset: int, kinds: dict[str, list[Member]], other: dict[int, list[int]]) -> None:
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
            other.setdefault(kind, []).append(number)


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


# Shapes by the first three letters and the number of nodes.
_SOLIDS = [kind.shape for kind in ASSUMED.values()]
_SHAPES = {(shape.polytope.exodus, len(shape.nodes)): shape for shape in (*_SOLIDS, *FACE_SHAPES.values())}
_SHAPES |= {("SHE", count): FACE_SHAPES[count] for count in (4, 8, 9)}
_EDGES = {("BAR", 2): "line", ("BAR", 3): "line3"}
# Where the faces of solids stand in Exodus' order of sides.
_SIDES = {"TET": (1, 2, 3, 0), "WED": (2, 3, 4, 0, 1), "HEX": (2, 3, 4, 5, 0, 1)}
_HDF5 = b"\x89HDF"


def read_exodus(path: Path) -> Contents:
    """Read element blocks, node sets and side sets, by their names or as "block n", "node set n", "side set n".

    Parameters
    ----------
    path : Path

    Returns
    -------
    Contents

    Raises
    ------
    MeshError
        The file cannot be read, or has blocks of unknown kinds.
    """
    with quiet(path, "check the file; expected Exodus II"), path.open("rb") as start:
        if start.read(4) == _HDF5:
            import h5py

            with h5py.File(path) as file:
                return _contents(_variables(file, lambda value: value.attrs.get("elem_type")), path)
        from scipy.io import netcdf_file

        with netcdf_file(path, mmap=False) as file:
            return _contents(_variables(file.variables, lambda value: getattr(value, "elem_type", None)), path)


def _contents(variables: Mapping[str, Any], path: Path) -> Contents:
    if "coord" in variables:
        points = np.asarray(variables["coord"]["data"], dtype=float).T
    else:
        points = np.stack([np.asarray(variables[f"coord{axis}"]["data"], dtype=float) for axis in "xyz"], axis=1)
    cells = []
    blocks = _titles(variables, "connect", "eb_names", "block")
    for number in range(1, len(blocks) + 1):
        given = variables[f"connect{number}"]
        rows = np.asarray(given["data"], dtype=np.int64) - 1
        title = given["elem_type"].upper()
        key = title[:3], rows.shape[1]
        if key not in _SHAPES and key not in _EDGES:
            found = f"{path}: block {number} is of the kind {title} with {rows.shape[1]} nodes"
            raise MeshError(f"{found}, expected TET, WEDGE or HEX of first or second order")
        cells.append((_SHAPES[key].name, rows[:, _SHAPES[key].layered]) if key in _SHAPES else (_EDGES[key], rows))
    none = np.zeros(0, int)
    sets = {name: [np.arange(len(rows)) if k == place else none for k, (_, rows) in enumerate(cells)]
            for place, name in enumerate(blocks)}  # fmt: skip
    point_sets = {
        name: np.asarray(variables[f"node_ns{number}"]["data"], dtype=np.int64) - 1
        for number, name in enumerate(_titles(variables, "node_ns", "ns_names", "node set"), start=1)
    }
    for number, name in enumerate(_titles(variables, "elem_ss", "ss_names", "side set"), start=1):
        elements = np.asarray(variables[f"elem_ss{number}"]["data"], dtype=np.int64) - 1
        nodes = _side_nodes(cells, elements, np.asarray(variables[f"side_ss{number}"]["data"], dtype=np.int64) - 1)
        point_sets[name] = np.union1d(point_sets.get(name, nodes), nodes)
    labels = variables.get("node_num_map")
    mesh = meshio.Mesh(points, cells, point_sets=point_sets, cell_sets=sets)
    return Contents(mesh, None if labels is None else np.asarray(labels["data"], dtype=np.int64))


def _side_nodes(cells: list[tuple[str, IntArray]], elements: IntArray, sides: IntArray) -> IntArray:
    """Nodes of sides of solids, mid-side nodes too; sides of other elements are all of their nodes."""
    found, start = [], 0
    for kind, rows in cells:
        inside = (elements >= start) & (elements < start + len(rows))
        for side in np.unique(sides[inside]).tolist():
            chosen = rows[elements[inside & (sides == side)] - start]
            if kind in ASSUMED:
                shape = ASSUMED[kind].shape
                chosen = chosen[:, shape.faces[_SIDES[shape.polytope.exodus][side]]]
            found.append(chosen.ravel())
        start += len(rows)
    return np.unique(np.concatenate(found)) if found else np.zeros(0, dtype=np.int64)


def _titles(variables: Mapping[str, Any], key: str, names: str, kind: str) -> list[str]:
    """Names of the blocks or sets with a variable each, called after their kind and number where they have none."""
    rows = np.asarray(variables[names]["data"]) if names in variables else ()
    given = [b"".join(row.tolist()).split(b"\0")[0].decode("latin-1").strip() for row in rows]
    count = sum(name.startswith(key) for name in variables)
    return [name or f"{kind} {number}" for number, name in enumerate([*given, *[""] * count][:count], start=1)]


def _variables(file: Any, kind: Callable[[Any], Any]) -> dict[str, dict[str, Any]]:
    """Each variable's data, and the kind of elements of which it is, "" for none."""
    kinds = {key: kind(value) or "" for key, value in file.items()}
    texts = {key: one.decode("latin-1") if isinstance(one, bytes) else str(one) for key, one in kinds.items()}
    return {key: {"data": value[()], "elem_type": texts[key]} for key, value in file.items()}
