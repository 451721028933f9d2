"""Linear bodies of condensed matrices, and of SID_FEM, the text format of bodies in a floating frame, also written.

Matrices have six degrees of freedom an interface, and modal ones behind them.

Source: O. Wallrapp, Standard Input Data of Flexible Members in Multibody Systems, 1993; R. Schwertassek, O. Wallrapp,
Dynamik flexibler Mehrkörpersysteme, 1999. With R the undeformed place from the reference frame's origin, u = Φq and
a~ b = a × b, integrals over the mass:

    mdCM = ∫ R + u            J = −∫ (R + u)~ (R + u)~ (to first order)     Ct = ∫ Φᵀ      Cr = (∫ (R + u)~ Φ)ᵀ
    Me = ∫ ΦᵀΦ               Gr_i = −2 ∫ (R + u)~ φ~_i       Ge_i = −2 ∫ Φᵀ φ~_i
    Oe (ωx², ωy², ωz², ωx ωy, ωy ωz, ωx ωz) = ∫ Φᵀ ω~ω~ (R + u)

Each array is a Taylor series in q: m0(row, column) and m1(row, q, column).
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.linalg
import scipy.sparse as sp

from ..files.basics import FlexfmuError, FloatArray
from ..files.outputs import whole_file
from ..fmu.built_body import BuiltBody
from ..model.arrays import whole
from ..model.reduced_body import ReducedBody
from ..model.rotations import skew
from ..reduction.bodies import linear_use, made_body, motion_of_interfaces
from ..reduction.rigid_fit import by_node, modal_fit
from .modes import GivenModes, GivenModesError, checked_modes

# Relative size of what is not symmetric, and of a smallest eigenvalue that is round-off.
_ASYMMETRIC, _ROUND_OFF = 1e-6, 1e-10
_EACH = 6
# Of a substructure's text.
_CARD = re.compile(r"^\*MATRIX *, *TYPE *= *(\w+)[^\n]*\n", re.IGNORECASE | re.MULTILINE)


class MatrixError(FlexfmuError):
    """Matrices that are those of no held body."""


def linear_body(
    stiffness: Any, mass: Any, points: Mapping[str, Sequence[float]], *, damping: float = 0.0, name: str = "body"
) -> BuiltBody:
    """Linear body of condensed matrices, in SI units.

    Matrices tell no displacements inside the body, and so no frame's rotation: no other method goes with them.

    Parameters
    ----------
    stiffness, mass : (k, k) array, sparse, or path
        Of a Matrix Market file, or of the text that *SUBSTRUCTURE MATRIX OUTPUT of Abaqus writes.
        Rows: x, y, z and rotations about x, y, z of each interface in turn (k ≥ 6 I), then modal coordinates.
    points : mapping of str to 3 float
        Places of the interfaces by name, in the rows' order, m.
    damping : float
        Modal damping ratio.
    name : str

    Returns
    -------
    BuiltBody

    Raises
    ------
    MatrixError
        Matrices that are not square, symmetric and positive, or a body that is not held.

    Examples
    --------
    >>> stiffness, mass = np.diag([4e6, 4e6, 4e6, 1e5, 1e5, 1e5]), np.diag([10.0, 10.0, 10.0, 0.1, 0.1, 0.1])
    >>> mount = flexfmu.linear_body(stiffness, mass, {"seat": (0.0, 0.0, 0.0)})
    >>> mount.response(mount.static({"seat": [0.0, 400.0, 0.0]})).displacement.round(9)  # 400 / 4e6 m
    array([[0.    , 0.0001, 0.    ]])
    """
    k, m = _matrix(stiffness, "stiffness"), _matrix(mass, "mass")
    if k.shape != m.shape or len(k) < _EACH * len(points) or not points:
        found = f"stiffness has shape {k.shape} and mass {m.shape}, expected the same of both"
        raise MatrixError(f"{found}, with at least {_EACH * len(points)} rows for {len(points)} interfaces")
    try:
        squares, shapes = scipy.linalg.eigh(k, m)
    except np.linalg.LinAlgError as error:
        raise MatrixError(f"mass is not positive definite ({error}): take out rows without mass") from error
    if squares[0] <= _ROUND_OFF * squares[-1]:
        raise MatrixError("stiffness is not positive definite: the body is free, or rows are zero; hold it")
    moved = shapes[: _EACH * len(points)].reshape(len(points), _EACH, -1)
    use = linear_use(name, damping, {"matrices": f"{len(k)} rows"})
    return BuiltBody(made_body(use, **motion_of_interfaces(np.sqrt(squares), points, moved)))


def _matrix(given: Any, title: str) -> FloatArray:
    """A matrix as an array, symmetric."""
    if isinstance(given, str | Path):
        given = _read(Path(given), title)
    value = np.asarray(given.toarray() if sp.issparse(given) else given, dtype=float)
    if value.ndim != 2 or value.shape[0] != value.shape[1] or not value.size or not np.isfinite(value).all():
        raise MatrixError(f"{title} has shape {value.shape}, expected a square matrix of finite numbers")
    if np.abs(value - value.T).max() > _ASYMMETRIC * np.abs(value).max():
        raise MatrixError(f"{title} is not symmetric: one triangle alone? give both, or a symmetric Matrix Market file")
    return np.asarray(0.5 * (value + value.T))


def _read(path: Path, title: str) -> Any:
    """A matrix of a file."""
    try:
        if cards := _CARD.split(path.read_text(encoding="utf-8", errors="replace"))[1:]:
            return _lower_triangle(dict(zip((kind.lower() for kind in cards[::2]), cards[1::2], strict=True)), title)
        return scipy.io.mmread(path)
    # SciPy's reader raises whatever the text leads it to.
    except Exception as error:
        expected = f"a Matrix Market file, nor as text with *MATRIX, TYPE={title.upper()}"
        raise MatrixError(f"{path} cannot be read as {expected} ({error})") from error


def _lower_triangle(texts: Mapping[str, str], title: str) -> FloatArray:
    """The matrix of a substructure: its lower triangle row by row, after the card that names it."""
    if title not in texts:
        raise ValueError(f"it holds {', '.join(texts)}, no {title}")
    return whole(np.array(texts[title].partition("*")[0].replace(",", " ").split(), dtype=float))


SUFFIX = ".sid_fem"
# Structures: symmetric, given by one triangle, and the unit matrix.
_SYMMETRIC, _UNIT = 2, 4
# Entries of an array that are still read.
_MOST = 10_000_000
# Entries below this share of an array's largest are left out.
_SMALL = 1e-14
_NUMBER = r"([-+]?\d*\.?\d+(?:[DdEe][-+]?\d+)?)"
_ENTRY = re.compile(rf"m([01])\s*\(\s*(\d+)\s*,\s*(\d+)\s*(?:,\s*(\d+)\s*)?\)\s*=\s*{_NUMBER}")
_SIZE = re.compile(r"(nrow|ncol|nqn?|order|structure)\s*=\s*(\d+)")
# ω~ω~ = Σ_k W_k ω_k with ω = (ωx², ωy², ωz², ωx ωy, ωy ωz, ωx ωz).
_FIRST, _SECOND = [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]
_ONE_BY_ONE = skew(np.eye(3))[_FIRST] @ skew(np.eye(3))[_SECOND]
_SQUARES = np.repeat([0.5, 1.0], 3)[:, None, None] * (_ONE_BY_ONE + _ONE_BY_ONE.swapaxes(1, 2))


class SidError(FlexfmuError):
    """A SID_FEM file that cannot be read."""


@dataclass(frozen=True, slots=True)
class Series:
    """A matrix as a Taylor series in q.

    Attributes
    ----------
    zero : (rows, columns) float
    first : (rows, q, columns) float, optional
    """

    zero: FloatArray
    first: FloatArray | None = None


def mass_integrals(given: GivenModes) -> tuple[float, dict[str, Series]]:
    """Mass and the integrals of a body whose reference frame is the global one.

    Parameters
    ----------
    given : GivenModes
        Checked, without rigid motions.

    Returns
    -------
    mass : float
        kg.
    integrals : dict of str to Series
        By the format's names, SI units.
    """
    number = len(given.modes)
    # One, the place's components, those of each mode: R is the first of the vectors a^x.
    fields = np.concatenate([given.nodes[:, None], given.modes.swapaxes(0, 1)], axis=1).reshape(len(given.nodes), -1)
    scalars = np.hstack([np.ones((len(given.nodes), 1)), fields])
    mass = given.mass
    if sp.issparse(mass):
        weighted = (mass if mass.shape[0] == len(scalars) else mass[::3][:, ::3]) @ scalars
    else:
        weighted = mass[:, None] * scalars
    products = scalars.T @ weighted
    first = products[0, 1:].reshape(1 + number, 3)
    # ∫ a^x_i a^y_j
    pair = products[1:, 1:].reshape(1 + number, 3, 1 + number, 3).swapaxes(1, 2)
    trace = np.einsum("xyaa->xy", pair)
    turned = np.einsum("abi,xyab->xyi", np.cross(np.eye(3)[:, None], np.eye(3)[None]), pair)
    # −a~ b~ = (a·b) I − b aᵀ
    twice = trace[..., None, None] * np.eye(3) - pair.swapaxes(-1, -2)
    squares = np.einsum("kab,xyab->xyk", _SQUARES, pair)
    rate = 2.0 * np.pi * given.frequency
    damping = np.zeros(number) if given.damping is None else given.damping
    return float(products[0, 0]), {
        "mdCM": Series(first[0][:, None], first[1:].T[:, :, None]),
        "J": Series(twice[0, 0], (twice[0, 1:] + twice[1:, 0]).swapaxes(0, 1)),
        "Ct": Series(first[1:]),
        "Cr": Series(turned[0, 1:], turned[1:, 1:].swapaxes(0, 1)),
        "Me": Series(trace[1:, 1:]),
        "Gr": Series(2.0 * np.hstack(list(twice[0, 1:]))),
        "Ge": Series(2.0 * np.hstack(list(turned[1:, 1:]))),
        "Oe": Series(squares[1:, 0], squares[1:, 1:]),
        "ksigma": Series(np.zeros((number, 1))),
        "Ke": Series(np.diag(rate**2)),
        "De": Series(np.diag(2.0 * damping * rate)),
    }


def write_sid(modes: GivenModes, interfaces: Mapping[str, str], path: str | Path) -> Path:
    """Write a body as SID_FEM, in SI units; interfaces are its nodes, in their order, numbered from one.

    Parameters
    ----------
    modes : GivenModes
        Those of a held body: the reference frame is the frame that its coordinates are in.
    interfaces : mapping of str to str
        Node sets by the interfaces' names; nodes weigh the same.
    path : path

    Returns
    -------
    Path

    Raises
    ------
    GivenModesError
        Modes that cannot be true, a free body's, or a set that is not there.

    Examples
    --------
    >>> flexfmu.write_sid(flexfmu.read_given("modes.npz"), {"tip": "TIP"}, "arm.SID_FEM").name
    'arm.SID_FEM'
    """
    given, _, _ = checked_modes(modes)
    if given.frequency[0] == 0.0:
        raise GivenModesError("SID_FEM has rigid motions by itself: give modes of a body that is held")
    mass, integrals = mass_integrals(given)
    number = len(given.modes)
    lines = [f"{len(interfaces)} {number}", "part", "  new modal", "    refmod", f"      mass = {_text(mass)}"]
    lines += [f"      nelastq = {number}"]
    lines += [f"      ielastq( {k}) = Eigen Mode {k} : {_text(f)} Hz" for k, f in enumerate(given.frequency, 1)]
    lines += ["    end refmod", "    frame"]
    for place, (name, chosen) in enumerate(interfaces.items(), start=1):
        if chosen not in given.sets or not given.sets[chosen].size:
            raise GivenModesError(f"interface {name!r}: no node set {chosen!r}; there are {', '.join(given.sets)}")
        nodes = by_node(given.sets[chosen])
        point = nodes.centre(given.nodes)
        moved, turned, _ = modal_fit(given.nodes, given.shapes, nodes, point)
        tilt = skew(turned.T).swapaxes(0, 1)
        lines += [f"      new node = {place}", "        rframe = body ref"]
        for key, series in (
            ("origin", Series(point[:, None], moved[:, :, None])),
            ("phi", Series(moved)),
            ("psi", Series(turned)),
            ("AP", Series(np.eye(3), tilt)),
        ):
            lines += _block(key, series, number, "        ")
        lines.append("      end node")
    lines.append("    end frame")
    for key, series in integrals.items():
        lines += _block(key, series, number, "    ")
    lines += ["  end modal", "end part", ""]
    with whole_file(Path(path)) as part:
        part.write_text("\n".join(lines), encoding="ascii")
    return Path(path)


def _text(value: float) -> str:
    return f"{value:.16E}".replace("E", "D")


def _block(key: str, series: Series, number: int, indent: str) -> Iterator[str]:
    """Lines of an array; entries that are zero are left out."""
    rows, columns = series.zero.shape
    yield f"{indent}{key}"
    for name, value in (
        ("order", int(series.first is not None)), ("nrow", rows), ("ncol", columns), ("nq", number), ("nqn", 0),
        ("structure", 3 if np.any(series.zero) or series.first is not None else 0),
    ):  # fmt: skip
        yield f"{indent}  {name:9} = {value}"
    for order, array in (("m0", series.zero), ("m1", series.first)):
        if array is None:
            continue
        least = _SMALL * float(np.abs(array).max(initial=0.0))
        for index in np.argwhere(np.abs(array) > least):
            place = ", ".join(str(k + 1) for k in index)
            yield f"{indent}  {order}( {place}) = {_text(float(array[tuple(index)]))}"
    yield f"{indent}end {key}"


def read_sid(path: str | Path, name: str | None = None) -> ReducedBody:
    """Read SID_FEM as a linear body that is held at its reference frame; its nodes are interfaces "node_1" and so on.

    Parameters
    ----------
    path : path
    name : str, optional
        Default: the file's, as far as it is a name.

    Returns
    -------
    ReducedBody

    Raises
    ------
    SidError
        The file cannot be read, or lacks something.

    Examples
    --------
    >>> flexfmu.read_sid("given.SID_FEM").interface_names
    ('node_1',)
    """
    source = Path(path)
    try:
        text = source.read_text(encoding="latin-1")
    except OSError as error:
        raise SidError(f"{source} cannot be read ({error}), expected SID_FEM") from error
    nodes = re.findall(r"new node\s*=\s*(\S+)(.*?)end node", text, re.DOTALL)
    try:
        stiffness, mass, damping = (_array(text, key).zero for key in ("Ke", "Me", "De"))
        ends = [(_array(body, "origin").zero, _array(body, "phi").zero, _array(body, "psi").zero) for _, body in nodes]
        squares, vectors = scipy.linalg.eigh(stiffness, mass)
        modal = np.diagonal(vectors.T @ damping @ vectors)
    except (SidError, ValueError, np.linalg.LinAlgError) as error:
        raise SidError(f"{source}: {error}; expected SID_FEM with Ke, Me, De, and origin, phi, psi of nodes") from error
    if not nodes or squares[0] <= 0.0:
        raise SidError(f"{source}: {len(nodes)} nodes and a smallest ω² of {squares[0]:.3g}, expected nodes and ω² > 0")
    rate = np.sqrt(squares)
    points = {f"node_{number}": point[:, 0] for (number, _), (point, _, _) in zip(nodes, ends, strict=True)}
    moved = np.array([np.concatenate([moved @ vectors, turned @ vectors]) for _, moved, turned in ends])
    ratio = np.maximum(modal / (2.0 * rate), 0.0)
    use = linear_use(name or re.sub(r"\W", "_", source.stem), ratio, {"sid_fem": source.name})
    return made_body(use, **motion_of_interfaces(rate, points, moved))


def _array(text: str, key: str) -> Series:
    """An array of the file by its name."""
    found = re.search(rf"^\s*{key}\s*$(.*?)^\s*end {key}\b", text, re.DOTALL | re.MULTILINE)
    if found is None:
        raise SidError(f"it has no {key}")
    size = {name: int(value) for name, value in _SIZE.findall(found[1])}
    if not {"nrow", "ncol"} <= set(size):
        raise SidError(f"{key} lacks nrow or ncol")
    if size["nrow"] * size["ncol"] > _MOST:
        raise SidError(f"{key} has {size['nrow']} rows and {size['ncol']} columns, expected at most {_MOST} entries")
    zero = np.zeros((size["nrow"], size["ncol"]))
    if size.get("structure") == _UNIT:
        np.fill_diagonal(zero, 1.0)
    for order, row, column, last, value in _ENTRY.findall(found[1]):
        if order == "0" and not last:
            if not (1 <= int(row) <= size["nrow"] and 1 <= int(column) <= size["ncol"]):
                raise SidError(f"{key} has an entry m0({row}, {column}) beyond its size")
            zero[int(row) - 1, int(column) - 1] = float(value.upper().replace("D", "E"))
            if size.get("structure") == _SYMMETRIC:
                zero[int(column) - 1, int(row) - 1] = zero[int(row) - 1, int(column) - 1]
    return Series(zero)
