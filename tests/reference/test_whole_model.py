"""The whole finite element model of a scene in CalculiX: its deck, what is read back, and a run where it is installed.

`tests/calculix` keeps the deck of `bar_and_load` and what CalculiX 2.20 printed for it.
"""

import shutil
from pathlib import Path

import numpy as np
import pytest
from demo import calculix_scene as calculix

from flexfmu.build.tables import SupportTable
from flexfmu.fe.nonlinear import load_path
from flexfmu.files.basics import UnitSystem
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.decks.deck import read_deck
from flexfmu.mesh.elements import ElementType
from flexfmu.reduction.model import assemble_model
from flexfmu.study.scene.config import SceneError
from meshes import EVERY_TYPE, STEEL, body_file, box, with_sets
from scene_tools import Listening

KEPT = Path(__file__).parent / "calculix"
FACTORS = (0.4, 1.0)
needs_ccx = pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")


def bar_and_load(folder, kind=ElementType.C3D20, layers=None):
    """A slender bar, clamped at one end and on springs near the other, of two materials, under forces at its tip."""
    layers = layers or (2 if kind is ElementType.C3D20R else 1)
    soft = STEEL.__class__("SOFT", 1.0e11, 0.25, 2700.0)
    mesh = box(
        kind, (6, layers, layers), (1.2, 0.05, 0.04), materials=(STEEL, soft), material=lambda c: (c[:, 0] > 3.0) * 1
    )
    mesh = with_sets(mesh, SEAT=lambda p: p[:, 0] - 1.0)
    config = body_file(mesh, folder, interface=["TIP"])
    springs = SupportTable(nodes="SEAT", stiffness=[0.0, 4e3, 8e3])
    config = config.model_copy(update={"support": [*config.support, springs]})
    model = assemble_model(read_deck(config.mesh.file, UnitSystem.SI), config.options)
    load = np.zeros((len(model.mesh.points), 3))
    tip = model.mesh.node_sets["TIP"]
    load[tip] = np.array([3e3, 9e3, -1.5e4]) / len(tip)
    return model, load.ravel(), tip


def our_equilibria(model, load):
    return load_path(model.mesh, model.unknowns, model.spring, load, FACTORS, Reporter()).displacement


def test_the_deck_is_the_one_that_calculix_was_given(tmp_path):
    model, load, tip = bar_and_load(tmp_path)
    assert calculix.deck(model, load, FACTORS, tip, "bar") == (KEPT / "bar.inp").read_text(encoding="ascii")


def test_what_calculix_printed_is_our_own_equilibrium(tmp_path):
    model, load, tip = bar_and_load(tmp_path)
    times, found = calculix.read_displacements((KEPT / "bar.dat").read_text(encoding="ascii"), len(model.mesh.points))
    assert times == [1.0, 2.0]
    expected = our_equilibria(model, load).reshape(2, -1, 3)
    moved = found.reshape(2, -1, 3)
    assert np.linalg.norm(expected[1, tip[0]]) > 0.1
    np.testing.assert_allclose(moved[:, tip], expected[:, tip], atol=1e-6 * np.abs(expected).max())
    others = np.setdiff1d(np.arange(len(model.mesh.points)), tip)
    assert np.all(np.isnan(moved[:, others]))


@pytest.mark.parametrize("kind", EVERY_TYPE)
def test_a_deck_holds_the_mesh_its_materials_and_its_supports(tmp_path, kind):
    model, load, tip = bar_and_load(tmp_path, kind)
    text = calculix.deck(model, load, FACTORS, tip, "bar")
    # Springs are CalculiX's, and numbers have at most twenty characters each.
    start, end = text.index("*ELEMENT, TYPE=SPRING1"), text.index("*NSET, NSET=PRINTED")
    assert max(len(word) for line in text.splitlines() if line[0] in "0123456789" for word in line.split(",")) <= 20
    (tmp_path / "again.inp").write_text(text[:start] + text[end:], encoding="ascii")
    again = read_deck(tmp_path / "again.inp", UnitSystem.SI)
    np.testing.assert_allclose(again.points, model.mesh.points, rtol=1e-12)
    assert np.array_equal(again.fixed, model.fixed)
    assert np.array_equal(again.node_sets["PRINTED"], tip)
    for block, expected in zip(again.blocks, model.mesh.blocks, strict=True):
        assert block.type is kind
        order = np.argsort(block.labels)
        np.testing.assert_array_equal(block.connectivity[order], expected.connectivity)
        stiff = [
            [m.materials[i].youngs_modulus for i in b.material] for m, b in ((again, block), (model.mesh, expected))
        ]
        assert [stiff[0][k] for k in order] == stiff[1]


def test_a_run_that_fails_is_told_with_its_last_words(tmp_path, monkeypatch):
    script = tmp_path / "ccx"
    script.write_text("#!/bin/sh\necho ' *ERROR: too many cutbacks'\nexit 201\n", encoding="ascii")
    script.chmod(0o755)
    monkeypatch.setattr(calculix, "PROGRAM", str(script))
    with pytest.raises(SceneError, match=r"does not converge at the first part of the load(.|\n)*too many cutbacks"):
        calculix.run("", FACTORS, 3, Reporter())
    script.write_text("#!/bin/sh\necho ' *ERROR reading *NODE'\nexit 201\n", encoding="ascii")
    with pytest.raises(SceneError, match=r"failed \(exit code 201\)(.|\n)*reading \*NODE"):
        calculix.run("", FACTORS, 3, Reporter())


@needs_ccx
def test_calculix_prints_what_was_kept(tmp_path):
    model, load, tip = bar_and_load(tmp_path)
    count = len(model.mesh.points)
    listening = Listening()
    done = calculix.run(calculix.deck(model, load, FACTORS, tip, "bar"), FACTORS, count, listening)
    _, kept = calculix.read_displacements((KEPT / "bar.dat").read_text(encoding="ascii"), count)
    np.testing.assert_allclose(done.displacement, kept, atol=1e-7)
    assert done.increments >= 2
    assert done.iterations > done.increments
    assert sum("CalculiX" in note for note in listening.notes) == done.increments


@pytest.mark.slow
@needs_ccx
@pytest.mark.parametrize("kind", [k for k in EVERY_TYPE if k is not ElementType.C3D8])
def test_calculix_and_our_own_solve_agree_for_every_element(tmp_path, kind):
    model, load, tip = bar_and_load(tmp_path, kind)
    done = calculix.run(calculix.deck(model, load, FACTORS, tip, "bar"), FACTORS, len(model.mesh.points), Reporter())
    expected = our_equilibria(model, load).reshape(2, -1, 3)[:, tip]
    found = done.displacement.reshape(2, -1, 3)[:, tip]
    np.testing.assert_allclose(found, expected, atol=2e-6 * np.abs(expected).max())


@pytest.mark.slow
@needs_ccx
def test_single_elements_of_reduced_integration_stop_calculix_and_do_not_as_those_that_they_are_taken_as(tmp_path):
    model, load, tip = bar_and_load(tmp_path, ElementType.C3D20R, layers=1)
    deck, count = calculix.deck(model, load, FACTORS, tip, "bar"), len(model.mesh.points)
    found = calculix.run(deck, FACTORS, count, Reporter()).displacement.reshape(2, -1, 3)[:, tip]
    expected = our_equilibria(model, load).reshape(2, -1, 3)[:, tip]
    np.testing.assert_allclose(found, expected, atol=2e-6 * np.abs(expected).max())
    with pytest.raises(SceneError, match="does not converge at the first part of the load"):
        calculix.run(deck.replace("TYPE=C3D20,", "TYPE=C3D20R,"), FACTORS, count, Reporter())
