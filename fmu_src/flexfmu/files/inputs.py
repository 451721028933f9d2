"""Files that a job reads: what they are, and what is said where one is given for another."""

import tomllib
import zipfile
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any

from .basics import FlexfmuError

_HDF5 = b"\x89HDF\r\n\x1a\n"
# Where HDF5's own bytes begin in files of others, and in ours, behind their seal.
_BEGINNINGS = (0, 512)
_MESHES = (".inp", ".msh", ".vtk", ".vtu", ".bdf", ".nas", ".fem", ".dat", ".cdb", ".unv", ".med", ".xdmf", ".stl",
           ".e", ".exo", ".ex2", ".exii")  # fmt: skip


# Bytes that an archive may unpack to, and how many times its own size beyond them.
_UNPACKED, _RATIO = 2**30, 20


class Kind(Enum):
    """What a file is, in words."""

    BODY = "a body file"
    SCENE = "a scene file"
    COUPLING = "a coupling file"
    MESH = "a mesh"
    FMU = "an FMU"
    MODAL = "a modal file"
    TABLE = "a table"

    @property
    def use(self) -> str:
        """What a file of this kind is for."""
        return _USES[self]


_USES = {
    Kind.BODY: "`flexfmu build` makes an FMU of it",
    Kind.SCENE: "it goes to `flexfmu chart` and `fit` as --scene",
    Kind.COUPLING: "`flexfmu couple` runs it",
    Kind.MESH: 'name it in a body file, file = "…" in [mesh], and build that',
    Kind.FMU: "it goes to `flexfmu info` and `simulate`, or into a coupling file",
    Kind.MODAL: "`flexfmu info` shows it; the FMU of the same build has it inside",
    Kind.TABLE: "it goes to `flexfmu simulate` as --input",
}
# Top-level keys by which TOML files are told from each other.
_KEYS = {
    Kind.BODY: {"mesh", "interface", "support"},
    Kind.SCENE: {"static", "transient", "sweep"},
    Kind.COUPLING: {"experiment", "fmu", "connection", "spring"},
}


def toml_kind(data: Mapping[str, Any]) -> Kind | None:
    """Kind of a TOML file by its top-level keys; None where they are nobody's or several kinds'."""
    found = [kind for kind, keys in _KEYS.items() if keys & set(data)]
    return found[0] if len(found) == 1 else None


def kind_of(path: Path) -> Kind | None:
    """Kind of an existing file, by its ending or contents; None if that is not plain."""
    suffix = path.suffix.lower()
    if suffix in _MESHES:
        return Kind.MESH
    if suffix == ".csv":
        return Kind.TABLE
    if suffix == ".toml":
        try:
            return toml_kind(tomllib.loads(path.read_text(encoding="utf-8")))
        except (OSError, ValueError):
            return None
    if zipfile.is_zipfile(path):
        try:
            with zipfile.ZipFile(path) as archive:
                return Kind.FMU if "modelDescription.xml" in archive.namelist() else None
        except zipfile.BadZipFile:
            return None
    with path.open("rb") as file:
        head = file.read(_BEGINNINGS[-1] + len(_HDF5))
    return Kind.MODAL if any(head[place:].startswith(_HDF5) for place in _BEGINNINGS) else None


def check_input(path: Path, error_type: type[FlexfmuError], *wanted: Kind) -> None:
    """Refuse what cannot be read, or is plainly another kind of file than the one that is wanted.

    Parameters
    ----------
    path : Path
    error_type : type of FlexfmuError
        What is raised.
    *wanted : Kind
        Kinds that will do.
    """
    expected = f"expected {' or '.join(kind.value for kind in wanted)}"
    if path.is_dir():
        raise error_type(f"{path} cannot be read: it is a folder, {expected}")
    if path.exists() and not path.is_file():
        raise error_type(f"{path} cannot be read: it is a pipe or a device, which may never end, {expected} on disk")
    if not path.exists():
        raise error_type(f"{path}: no such file, {expected}; correct the path")
    try:
        with path.open("rb") as file:
            head = file.read(4)
        if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
            raise error_type(f"{path} is text in UTF-16, {expected} in UTF-8; save it anew in that encoding")
        if head == b"PK\x03\x04" and wanted == (Kind.TABLE,):
            raise error_type(f"{path} is a workbook or an archive, {expected}; save it as CSV text")
        found = kind_of(path)
    except OSError as error:
        raise error_type(f"{path} cannot be read ({error}), {expected}") from error
    if found is not None and found not in wanted:
        raise error_type(f"{path} is {found.value}, {expected}: {found.use}")


def check_unpacked(path: Path) -> None:
    """Refuse an archive that unpacks to far more than it is.

    Parameters
    ----------
    path : Path
        FMU.

    Raises
    ------
    FlexfmuError
    """
    with zipfile.ZipFile(path) as archive:
        unpacked = sum(entry.file_size for entry in archive.infolist())
    packed = path.stat().st_size
    if unpacked > max(_UNPACKED, _RATIO * packed):
        raise FlexfmuError(
            f"{path}: {packed / 1e6:.3g} MB unpack to {unpacked / 1e6:.3g} MB, expected at most "
            f"{max(_UNPACKED, _RATIO * packed) / 1e6:.3g}: take large files out of the archive"
        )
