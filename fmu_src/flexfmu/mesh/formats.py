"""Mesh files of any kind: which reader takes which.

What meshio's reader of MED files lacks is added: families without groups, and bricks with nodes in their faces.
"""

import hashlib
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import replace
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any, cast

import meshio
from meshio.med import _med

from flexfmu.files.basics import MeshError, UnitSystem, unit_system
from flexfmu.files.tables import Kind, check_input
from flexfmu.files.workers import Worker, WorkerError
from flexfmu.mesh.decks.deck import read_deck
from flexfmu.mesh.in_memory import Contents, from_contents
from flexfmu.mesh.model import Mesh
from flexfmu.mesh.nastran.bulk_data import read_nastran
from flexfmu.mesh.nastran.node_cards import placed
from flexfmu.mesh.other.ansys import read_ansys
from flexfmu.mesh.other.exchange import quiet, read_exodus, read_universal

_KINDS = {"H27": "hexahedron27", "QU9": "quad9", "TR7": "triangle7"}


@contextmanager
def completed() -> Iterator[None]:
    """Let meshio read what gmsh writes without physical groups, and 27-node bricks."""
    families, kinds = _med._read_families, _med.med_to_meshio_type

    def with_groups(given: Any) -> Any:
        return families({name: one for name, one in given.items() if "GRO" in one})

    _med._read_families, _med.med_to_meshio_type = with_groups, {**kinds, **_KINDS}
    try:
        yield
    finally:
        _med._read_families, _med.med_to_meshio_type = families, kinds


# Suffixes of files that have a reader of their own; all others are meshio's.
DECK_SUFFIX = ".inp"
NASTRAN_SUFFIXES = (".bdf", ".nas", ".fem")
ANSYS_SUFFIXES = (".cdb",)
EXODUS_SUFFIXES = (".e", ".exo", ".ex2", ".exii", ".g", ".gen")
UNIVERSAL_SUFFIX = ".unv"
# Programs write input files under these; the first lines tell whose they are.
_SHARED_SUFFIXES = (".dat", ".inp")
# cgx writes parts of decks under this one of gmsh's.
_SHARED_BY_CGX = ".msh"
_LINES, _WORD = 2000, 20
# s that a library may take to read a file: some, and s for each byte. A busy machine reads bulk data at 0.5 MB/s.
_LEAST, _EACH = 60.0, 1e-5
# What gmsh makes a mesh of.
_GEOMETRIES = (".step", ".stp", ".iges", ".igs", ".brep")


def read_mesh(
    path: Path | str,
    units: UnitSystem | str = UnitSystem.SI,
    shells: Mapping[str, float | tuple[float, float]] | None = None,
    timeout: float | None = None,
) -> Mesh:
    """Read a body's mesh: an Abaqus or CalculiX deck, or any other file of docs/file-formats.md; see `from_contents`.

    Parameters
    ----------
    path : path
    units : UnitSystem or str
        What the file's numbers are in.
    shells : mapping of str to float or tuple of float, optional
        Thickness of triangles and quads by cell set, "" for all; or with it the middle over the nodes, over the
        thickness. Decks and bulk data have sections for that.
    timeout : float, optional
        s that the library of a format of other programs may take, in a process of its own; default: 60 and 10 for each
        MB of the file.

    Returns
    -------
    Mesh
        SI units. Formats without sets give a mesh without sets.

    Raises
    ------
    MeshError
        The file cannot be read or its reader crashes or does not end, or it holds volume cells of a kind that is not
        supported, or none.
    DeckError
        A deck's line cannot be honoured.

    Examples
    --------
    >>> mesh = flexfmu.read_mesh("arm.inp")
    >>> sorted(mesh.node_sets)
    ['ROOT', 'TIP']
    """
    path, units = Path(path), unit_system(units)
    check_input(path, MeshError, Kind.MESH)
    suffix = path.suffix.lower()
    if suffix in _SHARED_SUFFIXES:
        suffix = _told_apart(path)
    if suffix == _SHARED_BY_CGX and path.read_bytes()[:_WORD].lstrip().startswith(b"*"):
        suffix = DECK_SUFFIX
    if shells and suffix == DECK_SUFFIX:
        raise MeshError(f"{path}: shells of decks have their thickness by *SHELL SECTION; write it into the file")
    if suffix == DECK_SUFFIX:
        return read_deck(path, units)
    if suffix in _GEOMETRIES:
        what = "a geometry without elements; mesh it first, by gmsh for example"
        raise MeshError(f"{path}: {what}: gmsh {path.name} -3 -order 2 -format msh41 -o {path.stem}.msh")
    contents = _read_elsewhere(path, suffix, units, timeout or _LEAST + _EACH * path.stat().st_size)
    if shells:
        contents = replace(contents, shells={**contents.shells, **{name: _faces(one) for name, one in shells.items()}})
    with placed(path) if suffix in NASTRAN_SUFFIXES else nullcontext():
        return from_contents(contents, str(path), units)


def _faces(shell: float | tuple[float, float]) -> tuple[float, float]:
    """Heights of both faces over the nodes, by the thickness and where the middle is."""
    thickness, offset = shell if isinstance(shell, tuple) else (shell, 0.0)
    return (offset - 0.5) * thickness, (offset + 0.5) * thickness


def _told_apart(path: Path) -> str:
    """Suffix of whose input file it is, by its first commands."""
    with path.open(encoding="latin-1") as file:
        for line in islice(file, _LINES):
            start = line.strip().upper()
            if start.startswith("*") and not start.startswith(("**", "*IF", "*ELSE", "*ENDIF", "*SET", "*DIM", "*GET")):
                return DECK_SUFFIX
            if start.startswith(("/PREP7", "/COM,ANSYS", "NBLOCK", "/BATCH")):
                return ANSYS_SUFFIXES[0]
            if start.startswith(("BEGIN BULK", "SOL ", "CEND", "GRID")):
                return NASTRAN_SUFFIXES[0]
    return DECK_SUFFIX


def file_origin(path: Path) -> dict[str, str]:
    """Where a mesh file's contents are from, for a body's provenance: name and hash."""
    return {"mesh_file": path.name, "mesh_sha256": hashlib.sha256(path.read_bytes()).hexdigest()}


def _read_elsewhere(path: Path, suffix: str, units: UnitSystem, timeout: float) -> Contents:
    """Have a library read a file in a process of its own, which may crash or never return."""
    # A library that is slow to import is so once: the copy of this process has it, too.
    with suppress(ImportError):
        import_module("pyNastran.bdf.bdf" if suffix in NASTRAN_SUFFIXES else "meshio")
    worker = Worker(f"{__name__}:_reader", fork=True, memory=_most_memory())
    try:
        found = worker.ask((path, suffix, units), timeout)
    except WorkerError as error:
        if error.ending:
            what, advice = f"the library that read it ended with {error.ending}", "is it damaged? Write it again"
        else:
            what = f"the library that reads it gave no answer within {timeout:.3g} s"
            advice = "is it damaged? Write it again, or give it longer by timeout of [mesh] or read_mesh"
        raise MeshError(f"{path} cannot be read as a mesh: {what}; {advice}") from None
    finally:
        worker.close()
    if isinstance(found, Exception):
        raise found
    return cast("Contents", found)


def _most_memory() -> int:
    """Bytes that a reader may take: half of the machine's memory; 0 where it is not known."""
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2 if hasattr(os, "sysconf") else 0


def _reader(*_ends: int) -> Callable[[tuple[Path, str, UnitSystem]], Contents | Exception]:
    """What reads a file there: its contents, or why there are none."""

    def answer(request: tuple[Path, str, UnitSystem]) -> Contents | Exception:
        path, suffix, units = request
        try:
            if suffix in NASTRAN_SUFFIXES:
                return read_nastran(path, units)
            if suffix in ANSYS_SUFFIXES:
                return read_ansys(path, units)
            if suffix in EXODUS_SUFFIXES:
                return read_exodus(path)
            if suffix == UNIVERSAL_SUFFIX:
                return read_universal(path)
            with quiet(path, "check the file and its suffix"), completed():
                return Contents(meshio.read(path))
        except Exception as error:  # for the one who asked
            return error

    return answer
