"""No broken, cut short or foreign file ends in a traceback, in a hang, or as a smaller body without a word."""

from pathlib import Path
from random import Random

import pytest

import flexfmu
from flexfmu.files.basics import FlexfmuError
from flexfmu.given.modes import read_given
from flexfmu.mesh.checks import checked
from flexfmu.mesh.formats import read_mesh

FOREIGN = Path(__file__).parent
FILES = sorted(path.name for path in FOREIGN.glob("*_bricks*") if path.suffix != ".inc")
ELEMENTS = 24
# Each of 13 files, and both of given modes, is cut short a dozen times, and has characters changed a dozen times.
CUTS, CHANGES = 12, 12
# Formats that tell how much there is to come; of the others a cut between two lines is a smaller mesh.
COUNTED = (".msh", ".vtk", ".vtu", ".xdmf", ".med", ".e", ".cdb")


def test_the_corpus_has_more_than_300_files():
    """Decks that are spoiled come on top (test_broken_decks.py)."""
    assert len(FILES) * (CUTS + CHANGES) > 300


def spoiled(data, number, numbers):
    """A file cut short, or with some bytes changed: to others of its kind, or to any."""
    if number < CUTS:
        # The last cut takes a few bytes only.
        return data[: len(data) - 30] if number == 0 else data[: numbers.randrange(len(data))]
    changed = bytearray(data)
    signs = b"0123456789 -,.+E\n" if number % 2 else bytes(range(256))
    for _ in range(1 + number % 4):
        changed[numbers.randrange(len(changed))] = numbers.choice(signs)
    return bytes(changed)


def outcome(path):
    """Elements that are read, or the refusal."""
    try:
        return checked(read_mesh(path)).element_count
    except FlexfmuError as error:
        return str(error)


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_a_spoiled_mesh_file_is_read_whole_or_refused_with_its_name(name, tmp_path):
    data = (FOREIGN / name).read_bytes()
    for other in FOREIGN.glob("*.inc"):
        (tmp_path / other.name).write_bytes(other.read_bytes())
    path = tmp_path / name
    path.write_bytes(data)
    assert outcome(path) == ELEMENTS
    numbers = Random(name)
    refused = 0
    for number in range(CUTS + CHANGES):
        path.write_bytes(spoiled(data, number, numbers))
        found = outcome(path)
        if isinstance(found, str):
            refused += 1
            assert len(found) > 20
            # What would lose a part of the model is no advice.
            assert "take it out" not in found or path.suffix == ".inp"
        elif number < CUTS and path.suffix in COUNTED:
            assert found == ELEMENTS, f"{name}, cut {number}: {found} elements"
    assert refused >= CUTS // 2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["deck_bricks.inp", "gmsh_bricks.bdf"])
def test_a_deck_that_ends_among_its_elements_is_no_smaller_body(name, tmp_path):
    """Nodes come first in a file: those that no element has got yet tell."""
    lines = (FOREIGN / name).read_text().split("\n")
    cards = [k for k, line in enumerate(lines) if line.strip().startswith(("*ELEMENT, TYPE=C3D20R", "CHEXA"))]
    first = cards[0]
    (last,) = [k for k in range(first, len(lines)) if k + 1 == len(lines) or _is_last(lines, k)][:1]
    path = tmp_path / name
    for keep in range(first + 4, last, 3):
        path.write_text("\n".join(lines[: keep + 1]) + "\n")
        found = outcome(path)
        assert isinstance(found, str), f"{keep} of {len(lines)} lines: {found} elements"


def _is_last(lines, k):
    """Whether the elements end in a line."""
    following = lines[k + 1].strip()
    return following.startswith("*") or following.startswith(("ENDDATA", "$", "MAT", "PSOLID"))


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_spoiled_modes_are_read_or_refused(suffix, tmp_path, random):
    mesh = flexfmu.read_mesh(FOREIGN / "deck_bricks.inp")
    modes = random.standard_normal((3, len(mesh.points), 3))
    path = flexfmu.GivenModes.of_mesh(mesh, mesh.labels, modes, [1.0, 2.0, 3.0]).save(tmp_path / f"modes{suffix}")
    data, refused = path.read_bytes(), 0
    numbers = Random(suffix)
    for number in range(CUTS + CHANGES):
        path.write_bytes(spoiled(data, number, numbers))
        try:
            read_given(path)
        except FlexfmuError as error:
            refused += path.name in str(error)
    assert refused >= CUTS


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("body.bdf", b"%PDF-1.7 not a mesh"),
        ("body.cdb", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n"),
        ("body.e", b"CDF\x01\x00\x00"),
        ("body.exo", b"\x89HDF\r\n\x1a\n"),
        ("body.med", b"\x00" * 64),
        ("body.dat", b"\xff\xfe" * 40),
        ("body.nas", b""),
        ("body.vtu", b"<html></html>"),
        ("body.xdmf", b'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "a">]><Xdmf/>'),
    ],
)
def test_what_is_something_else_is_refused_by_name(name, text, tmp_path):
    (tmp_path / name).write_bytes(text)
    found = outcome(tmp_path / name)
    assert isinstance(found, str)
    assert name in found
