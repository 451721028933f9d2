"""Elements and materials of decks against CalculiX on the same meshes (tests/foreign/deck_bars.py)."""

import csv

import numpy as np
import pytest

import flexfmu
from flexfmu.fe.assembly import stiffness, unknowns
from flexfmu.fe.factorisation import Factorisation
from flexfmu.fe.nonlinear import load_path
from flexfmu.files.basics import UnitSystem
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.checks import checked
from flexfmu.mesh.decks.deck import read_deck
from foreign.deck_bars import BARS, FORCE, HERE, LARGE, LOCKING, STEEL, deck


def calculix():
    with (HERE / "deck_bars.csv").open() as file:
        return {(r["bar"], r["load"]): [float(r[f"u{a}_m"]) for a in "xyz"] for r in csv.DictReader(file)}


def loaded(folder, name):
    """Mesh of a bar, its unknowns, and nodal forces."""
    path = folder / "bar.inp"
    path.write_text(deck(name)[0])
    mesh = checked(read_deck(path, UnitSystem.SI))
    fixed = np.zeros((len(mesh.points), 3), dtype=bool)
    fixed[mesh.node_sets["ROOT"]] = True
    tip = mesh.node_sets["TIP"]
    load = np.zeros((len(mesh.points), 3))
    load[tip] = FORCE / len(tip)
    return mesh, unknowns(fixed, mesh.equations), load.ravel()


@pytest.mark.parametrize("name", BARS)
def test_linear_deflections_of_decks_are_those_of_calculix(name, tmp_path):
    mesh, unknown, load = loaded(tmp_path, name)
    stiff = unknown.matrix(stiffness(mesh))
    u = unknown.whole(Factorisation(stiff, unknown.free // 3).solve(unknown.forces(load)))
    tip = u.reshape(-1, 3)[mesh.node_sets["TIP"]].mean(axis=0)
    expected = np.array(calculix()[name, "linear"])
    assert np.linalg.norm(tip - expected) < 1e-5 * np.linalg.norm(expected)


@pytest.mark.slow
@pytest.mark.parametrize("name", BARS)
def test_large_deflections_of_decks_are_those_of_calculix(name, tmp_path):
    mesh, unknown, load = loaded(tmp_path, name)
    factor = LOCKING.get(name, LARGE)
    path = load_path(mesh, unknown, np.zeros((len(mesh.points), 3)), factor * load, [1.0], Reporter())
    tip = path.displacement[-1].reshape(-1, 3)[mesh.node_sets["TIP"]].mean(axis=0)
    expected, straight = (np.array(calculix()[name, which]) for which in ("large", "linear"))
    assert np.linalg.norm(expected - factor * straight) > 0.02 * np.linalg.norm(expected)
    assert np.linalg.norm(tip - expected) < 1e-5 * np.linalg.norm(expected)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the mesh is too stiff")
@pytest.mark.parametrize("name", BARS)
def test_bars_of_every_element_and_material_bend_far_by_the_default_method_as_in_calculix(name, tmp_path):
    """Steel by 5 to 11 % of its length, the plies by half of it."""
    steel = BARS[name][1] is STEEL
    path = tmp_path / "bar.inp"
    path.write_text(deck(name)[0])
    tip = flexfmu.Interface("TIP", weights="node")
    body = flexfmu.Body(read_deck(path, UnitSystem.SI), None, ["ROOT"], {"tip": tip})
    body = body.build(frames=1 if steel else 2, modes=10, residual_flexibility=True, surface=False)
    found = body.response(body.static({"tip": LOCKING.get(name, LARGE) * FORCE})).displacement[0]
    expected = np.array(calculix()[name, "large"])
    assert np.linalg.norm(found - expected) < (1e-3 if steel else 4e-3) * np.linalg.norm(expected)
