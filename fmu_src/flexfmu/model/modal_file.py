"""The modal file: a `ReducedBody` in HDF5. Its datasets are those of `arrays` (docs/reference/modal-file.md)."""

import hashlib
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np
from h5py import h5a, h5d, h5p, h5s, h5t

from ..files.basics import ModalFileError
from ..files.outputs import whole_file
from .arrays import ARRAYS, Entry, triangles, whole
from .methods import Mass, Method
from .reduced_body import GROUPS, ReducedBody, Shadow, StressSet

FORMAT = "flexfmu modal file"
SCHEMA_VERSION = 9
# In front of HDF5's own bytes, which its library may read for ever once they are damaged.
_BLOCK = 512
_SEAL = b"flexfmu modal file, SHA-256 of all behind these 512 bytes: "
# Groups of a shadow that `Shadow` holds in single precision.
_SINGLE = ("second/", "membrane/")
# How HDF5 keeps texts, and how they are given; datasets whose groups are made on the way.
_KEPT_TEXT, _GIVEN_TEXT = (h5t.py_create(h5py.string_dtype(), logical=kept) for kept in (True, False))
_LINKS = h5p.create(h5p.LINK_CREATE)
_LINKS.set_create_intermediate_group(True)
FRAME_CONVENTION = "global Cartesian frame of the finite element model; rotation vectors about its axes"


# How the body is used, by its attributes, which are the file's: what reads each.
_KEPT: dict[str, Callable[[Any], Any]] = {"method": Method, "mass": Mass, "velocity_outputs": bool}
_KEPT |= dict.fromkeys(
    ("compliance_interfaces", "following_interfaces"), lambda text: tuple(filter(None, text.split(",")))
)
_KEPT |= {"root_interface": int, "floating": bool, "tolerance": float, "mass_modes": int}


def _datasets(body: ReducedBody) -> Iterator[tuple[str, Entry, Any]]:
    """Path, table's row and value of everything that a body holds, in a fixed order."""
    for holder, entries in [(body, ARRAYS["body"]), *((getattr(body, part), ARRAYS[part]) for part in GROUPS)]:
        for entry in entries if holder is not None else ():
            value = getattr(holder, entry.name)
            if value is not None:
                yield entry.path, entry, value
    if body.shadow is not None:
        for entry in ARRAYS["shadow"]:
            yield entry.path, entry, getattr(body.shadow, entry.name)
        for path, entry, value in _datasets(body.shadow.body):
            single = entry.single or (path.startswith(_SINGLE) and entry.kind is float)
            yield f"shadow/{path}", replace(entry, single=single), value
    for number, stresses in enumerate(body.stress_sets):
        for entry in ARRAYS["stress"]:
            yield f"stress/{number:03d}_{stresses.name}/{entry.path}", entry, getattr(stresses, entry.name)


def _attributes(body: ReducedBody) -> dict[str, Any]:
    """Attributes of the file, but for its checksum."""
    head = {"format": FORMAT, "schema_version": SCHEMA_VERSION, "name": body.name, "frame_convention": FRAME_CONVENTION}
    used = {key: getattr(body, key) for key in _KEPT}
    for key, value in used.items():
        if value is not None:
            head[key] = ",".join(value) if isinstance(value, tuple) else getattr(value, "value", value)
    return head


def _checksum(body: ReducedBody) -> str:
    """SHA-256 of everything that the file holds."""
    digest = hashlib.sha256()
    texts = [f"{key}={value}" for key, value in _attributes(body).items()]
    texts += [f"{key}={body.provenance[key]}" for key in sorted(body.provenance)]
    digest.update("\0".join(texts).encode())
    for path, entry, value in _datasets(body):
        digest.update(f"\0{path}\0{np.shape(value)}\0".encode())
        stored = _stored(entry, value)
        digest.update(stored.astype(stored.dtype.newbyteorder("<")).tobytes())
    return digest.hexdigest()


def modal_bytes(body: ReducedBody) -> bytes:
    """The modal file of a body; the same body gives the same bytes."""
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as folder:
        path = Path(folder) / "modal.h5"
        with h5py.File(path, "w", libver=("v110", "v110"), userblock_size=_BLOCK) as file:
            file.attrs.update(_attributes(body) | {"sha256": _checksum(body)})
            for place, entry, value in _datasets(body):
                _write(file, place, entry, value)
            file.create_group("provenance").attrs.update(sorted(body.provenance.items()))
        data = path.read_bytes()[_BLOCK:]
    return (_SEAL + _digest(data) + b"\n").ljust(_BLOCK, b"\0") + data


def write_modal_file(body: ReducedBody, path: Path) -> None:
    """Write a body; the file appears whole or not at all.

    Parameters
    ----------
    body : ReducedBody
    path : Path

    Raises
    ------
    OutputError
        The folder cannot be written to.
    """
    data = modal_bytes(body)
    with whole_file(path) as part:
        part.write_bytes(data)


def _digest(data: bytes) -> bytes:
    """SHA-256 of all that follows the seal, in hexadecimal digits."""
    return hashlib.sha256(data).hexdigest().encode()


def _check_seal(source: str | Path | BinaryIO, name: str) -> None:
    """Refuse a damaged file before HDF5 looks at it; files that are no modal files have no seal."""
    if isinstance(source, str | Path):
        with Path(source).open("rb") as file:
            _check_seal(file, name)
        return
    source.seek(0)
    seal = source.read(_BLOCK)
    if seal.startswith(_SEAL) and seal[len(_SEAL) :].split(b"\n")[0] != _digest(source.read()):
        raise ModalFileError(f"{name}: damaged or altered: its bytes are not those that were written; build it again")
    source.seek(0)


def _stored(entry: Entry, value: Any) -> Any:
    """What the file holds of a value: names in bytes, of symmetric matrices (…, m, m) their triangles."""
    if entry.kind is str:
        # Of a fixed length: HDF5 keeps them in the same bytes every time.
        return np.array([name.encode() for name in value] or [b""], dtype="S")[: len(value)]
    data = triangles(value) if entry.symmetric else value
    return data.astype("<f4") if entry.single else data


def _write(file: Any, path: str, entry: Entry, value: Any) -> None:
    data = _stored(entry, value)
    # Their shuffled bytes are smaller in an FMU, which is packed as a whole.
    shuffled = entry.symmetric and data.size > 0
    if shuffled:
        dataset = file.create_dataset(path, data=data, chunks=data.shape, track_times=False, shuffle=True).id
    else:
        # The same bytes as so, in half the time.
        data, how = np.asarray(data, order="C"), h5p.create(h5p.DATASET_CREATE)
        how.set_obj_track_times(False)
        how.set_fill_time(h5d.FILL_TIME_IFSET)
        shape = h5s.create_simple(data.shape) if data.ndim else h5s.create(h5s.SCALAR)
        dataset = h5d.create(file.id, path.encode(), h5t.py_create(data.dtype, logical=True), shape, how, _LINKS)
        if data.size:
            dataset.write(h5s.ALL, h5s.ALL, data)
    for name, text in ((b"unit", entry.unit), (b"description", entry.description)):
        h5a.create(dataset, name, _KEPT_TEXT, h5s.create(h5s.SCALAR)).write(np.array(text, dtype=object), _GIVEN_TEXT)


def read_modal_file(source: str | Path | BinaryIO) -> ReducedBody:
    """Read and check a modal file.

    Parameters
    ----------
    source : path or binary file object

    Returns
    -------
    ReducedBody

    Raises
    ------
    ModalFileError
        The file is missing, damaged, altered, foreign, or of a schema version that is not read here.
    """
    name = str(source) if isinstance(source, str | Path) else "modal file"
    try:
        _check_seal(source, name)
        with h5py.File(source, "r") as file:
            return _read(file, name)
    except FileNotFoundError as error:
        raise ModalFileError(f"{name}: no such file") from error
    except (OSError, LookupError, ValueError, UnicodeDecodeError, RuntimeError, TypeError, AttributeError) as error:
        raise ModalFileError(f"{name}: not a readable modal file ({error}); build it again") from error


def _read(file: Any, name: str) -> ReducedBody:
    found = file.attrs.get("format")
    if found != FORMAT:
        raise ModalFileError(f"{name}: an HDF5 file, but not a flexfmu modal file (format is {found!r})")
    version = int(file.attrs["schema_version"])
    if version != SCHEMA_VERSION:
        expected = f"this flexfmu reads version {SCHEMA_VERSION}; build the body again"
        raise ModalFileError(f"{name}: schema version {version}, {expected}")
    body = replace(
        _read_body(file, file.attrs),
        **{key: kind(file.attrs[key]) for key, kind in _KEPT.items() if key in file.attrs},
        provenance={key: str(value) for key, value in file["provenance"].attrs.items()},
        stress_sets=tuple(
            StressSet(key.partition("_")[2], **_read_entries(group, ARRAYS["stress"]))
            for key, group in sorted(file.get("stress", {}).items())
        ),
    )
    if _checksum(body) != file.attrs["sha256"]:
        raise ModalFileError(f"{name}: contents do not match their checksum: the file was altered; build it again")
    return body


def _read_body(group: Any, attributes: Any) -> ReducedBody:
    """The arrays of a body, and of the shadow in its group, which is used as the body is."""
    contents = _read_entries(group, ARRAYS["body"])
    contents |= {one: kind(**_read_entries(group, ARRAYS[one])) for one, kind in GROUPS.items() if one in group}
    if "shadow" in group:
        contents["shadow"] = Shadow(_read_body(group["shadow"], attributes), **_read_entries(group, ARRAYS["shadow"]))
    kept = {key: _KEPT[key](attributes[key]) for key in ("root_interface", "floating")}
    return ReducedBody(name=str(attributes["name"]), **contents, **kept)


def _read_entries(group: Any, entries: tuple[Entry, ...]) -> dict[str, Any]:
    """Values by attribute; what is optional and not there is left out."""
    found: dict[str, Any] = {}
    for entry in entries:
        if entry.optional and entry.path not in group:
            continue
        value = group[entry.path][()]
        if entry.kind is str:
            if np.ndim(value) != 1:
                raise ValueError(f"{entry.path} has shape {np.shape(value)}, expected a list of names")
            value = tuple(text.decode() for text in value)
        elif entry.symmetric:
            value = whole(value)
        found[entry.name] = value
    return found
