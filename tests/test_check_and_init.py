"""`flexfmu check` tells what a mesh offers; `flexfmu init` writes a body file that builds."""

import pytest
from typer.testing import CliRunner

from flexfmu.build import reduce_body
from flexfmu.cli import app
from flexfmu.config import read_body_file
from flexfmu.mesh.model import ElementType
from flexfmu.progress import Reporter
from meshes import box, write_deck
from test_deck import BODY
from test_deck_assemblies import COUPLING


@pytest.fixture
def bar(tmp_path):
    """A bar without sets, materials or supports."""
    mesh = box(ElementType.C3D20R, (4, 1, 1), (0.5, 0.05, 0.02))
    path = write_deck(mesh, tmp_path / "bar.inp", materials=False)
    path.write_text(path.read_text().split("*NSET")[0])
    return path


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_init_writes_a_body_file_of_a_bare_mesh_that_is_held_and_loaded_at_its_ends(bar):
    assert run("init", bar).exit_code == 0
    config = read_body_file(bar.with_suffix(".toml"))
    body = reduce_body(config, Reporter())
    assert body.properties.mass == pytest.approx(7850.0 * 0.5 * 0.05 * 0.02)
    assert body.interface_point[0] == pytest.approx([0.5, 0.025, 0.01])
    again = run("init", bar)
    assert again.exit_code == 1
    assert "is there already" in again.output


def test_check_lists_sets_materials_ends_and_what_a_body_file_chooses(bar):
    assert run("init", bar).exit_code == 0
    text = run("check", bar.with_suffix(".toml")).output
    for words in (
        "4 C3D20R",
        "no material",
        "plane end x_min: 8 nodes",
        "support 1: 8 nodes",
        "interface x_max: 8 nodes",
    ):
        assert words in text


def test_reference_points_of_a_deck_are_offered(tmp_path):
    deck = tmp_path / "deck.inp"
    deck.write_text(BODY + COUPLING)
    assert "node set Flange: 4 nodes, reference point (2, 0.5, 0.5) m" in run("check", deck).output
    assert run("init", deck).exit_code == 0
    assert 'nodes = "Flange"' in deck.with_suffix(".toml").read_text()
