"""All arrays of a reduced body, listed in arrays.def, and what checks them.

Shapes are words: m modes, I interfaces, S frames, L unit loads (6I, and three accelerations of a body
with masses), K nodes of the tree (frames, interfaces, centres of mass, ends a of all ties, ends b). Any other letter is
a number of the part's own, told by the first array that has it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from math import isqrt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..files.basics import ModalFileError


@dataclass(frozen=True, slots=True)
class Entry:
    """An array, or a list of names.

    Attributes
    ----------
    name : str
        Attribute of the class that holds it.
    path : str
        Dataset of the file.
    shape : str
        Sizes, as above.
    unit : str
        SI unit, "1" for none.
    words : str
    kind : type
        float, int, or str.
    optional : bool
        Whether it may be absent.
    single : bool
        Whether it is kept in single precision.
    """

    name: str
    path: str
    shape: str
    unit: str
    words: str
    kind: type = float
    optional: bool = False
    single: bool = False

    @property
    def symmetric(self) -> bool:
        """Whether it is of symmetric matrices, as all but geometric stiffness: the file has the lower triangles."""
        return self.shape.endswith(" m m") and not self.path.startswith("stiffness/")

    @property
    def description(self) -> str:
        """Shape and meaning, as the file tells them."""
        sizes = {"L": "6I or 6I + 3"}
        shape, triangles = (self.shape[:-4], ["m (m + 1) / 2: lower triangles"]) if self.symmetric else (self.shape, [])
        listed = [sizes.get(token, token) for token in shape.split()] + triangles
        return f"({', '.join(listed)}{',' if len(listed) == 1 else ''}) {self.words}"


def _table() -> dict[str, tuple[Entry, ...]]:
    """Entries of each part in the order of the table."""
    found: dict[str, list[Entry]] = {}
    for line in Path(__file__).with_name("arrays.def").read_text("utf-8").splitlines():
        if line.startswith("["):
            entries = found[line.strip("[]")] = []
        elif line and not line.startswith("#"):
            name, path, shape, unit, kind, words = (cell.strip() for cell in line.split("|"))
            flags = {"optional": "optional" in kind, "single": "single" in kind}
            entries.append(Entry(name, path, shape, unit, words, _KINDS[kind.split()[0]], **flags))
    return {part: tuple(entries) for part, entries in found.items()}


_KINDS: dict[str, type] = {"float": float, "int": int, "str": str}
ARRAYS = _table()
"""By what they are of: an attribute of `ReducedBody`, "body" or "stress"."""
# With 17 bits of a shadow rounding makes it asymmetric, which grows into a direction that nothing else finds.
SECOND_BITS = 33, 20
"""Bits of what is of second order in a body, and in a shadow: estimates of 1e-5 differ by less than 1e-3 of them."""


def triangles(matrices: NDArray[Any]) -> NDArray[Any]:
    """Lower triangles (…, n) of symmetric matrices (…, m, m)."""
    return matrices[..., *np.tril_indices(matrices.shape[-1])]


def whole(numbers: NDArray[Any]) -> NDArray[Any]:
    """Symmetric matrices (…, m, m) from their lower triangles."""
    rows, columns = np.tril_indices(isqrt(2 * numbers.shape[-1]))
    if rows.size != numbers.shape[-1]:
        raise ValueError(f"{numbers.shape[-1]} numbers are no triangle of a matrix")
    m = isqrt(2 * rows.size)
    found = np.empty((*numbers.shape[:-1], m, m), numbers.dtype)
    found[..., rows, columns] = found[..., columns, rows] = numbers
    return found


def short(values: NDArray[Any], omega: NDArray[Any], bits: int) -> NDArray[Any]:
    """Matrices (…, m, m), of modes of frequencies (m,), to so many bits of the largest number of each: these pack well.

    Numbers count by what they are in motions of unit energy; rigid motions go as the slowest elastic one.
    """
    scale = np.ldexp(1.0, np.frexp(np.maximum(omega, omega[omega > 0.0].min()))[1])
    largest = np.abs(values / np.outer(scale, scale)).max(axis=(-2, -1), keepdims=True)
    step = np.ldexp(np.outer(scale, scale), np.frexp(largest)[1] - bits)
    return np.rint(values / step) * step + 0.0


def is_single(values: NDArray[Any]) -> bool:
    """Whether numbers are rounded to single precision."""
    return np.array_equal(values, values.astype(np.float32))


def in_single(holder: Any) -> Any:
    """A data class of arrays, or None, with its numbers rounded to single precision."""
    held = {f.name: getattr(holder, f.name) for f in fields(holder)} if holder else {}
    single = {name: array.astype(np.float32) for name, array in held.items() if array.dtype == np.float64}
    return replace(holder, **single) if holder else None


def turned(holder: Any, entries: Iterable[Entry], turn: NDArray[Any]) -> dict[str, Any]:
    """Arrays with modal axes, their last ones, in other coordinates.

    Parameters
    ----------
    holder : object
    entries : iterable of Entry
    turn : (m, k) float
        Their modes in those of the holder.

    Returns
    -------
    dict of str to array
        What the holder has of these, by name.
    """
    found = {}
    for entry in entries:
        array, axes = getattr(holder, entry.name), entry.shape.split().count("m")
        if array is not None and axes == 1:
            found[entry.name] = array @ turn
        elif array is not None and axes == 2:
            found[entry.name] = turn.T @ array @ turn
        elif array is not None and axes == 3:
            found[entry.name] = np.einsum("abc,ai,bj,ck->ijk", array, turn, turn, turn, optimize=True)
    return found


def settle(holder: object, entries: tuple[Entry, ...], sizes: Mapping[str, int], title: str = "") -> None:
    """Bring the arrays of a data class into their types, read-only, and check shapes and finiteness.

    Parameters
    ----------
    holder : object
        Frozen data class; its attributes are set.
    entries : tuple of Entry
    sizes : mapping of str to int
        Of the letters that are known.
    title : str
        What the arrays are of, for messages.

    Raises
    ------
    ModalFileError
        Naming the first array that is wrong, and how.
    """
    known = dict(sizes)
    for entry in entries:
        given, label = getattr(holder, entry.name), f"{title}: {entry.name}" if title else entry.name
        if given is None and entry.optional:
            continue
        if entry.kind is str:
            value: Any = tuple(given)
            found: tuple[int, ...] = (len(value),)
        else:
            value = np.asarray(given, dtype=np.int64 if entry.kind is int else np.float64)
            found = value.shape
        tokens = entry.shape.split()
        if len(found) == len(tokens):
            for token, size in zip(tokens, found, strict=True):
                known.setdefault(token, int(token) if token.isdigit() else size)
        expected = tuple(known.get(token, int(token) if token.isdigit() else -1) for token in tokens)
        # Empty arrays of any shape will do where nothing is expected.
        if found != expected and not (0 in found and 0 in expected and entry.kind is not str):
            wanted = expected if -1 not in expected else f"({entry.shape.replace(' ', ', ')})"
            raise ModalFileError(f"{label} has shape {found}, expected {wanted}")
        if entry.kind is not str:
            if not np.all(np.isfinite(value)):
                raise ModalFileError(f"{label} holds values that are not finite")
            value = value.reshape(expected)
            if value.flags.writeable or (isinstance(value.base, np.ndarray) and value.base.flags.writeable):
                # The caller's array stays the caller's.
                value = 0.5 * value + 0.5 * value.swapaxes(-1, -2) if entry.symmetric else value.copy()
            if entry.single:
                value = value.astype(np.float32).astype(np.float64)
            value.flags.writeable = False
        object.__setattr__(holder, entry.name, value)
