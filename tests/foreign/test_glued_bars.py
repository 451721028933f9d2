"""Two meshes joined by linear constraints, against CalculiX on the same decks (tests/foreign/glued_bars.py)."""

import csv

import numpy as np
import pytest

from flexfmu.fe.assembly import stiffness, unknowns
from flexfmu.fe.factorisation import Factorisation
from flexfmu.fe.nonlinear import load_path
from flexfmu.files.basics import UnitSystem
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.checks import checked
from flexfmu.mesh.decks.deck import read_deck
from foreign.deck_bars import FORCE, HERE, LARGE
from foreign.glued_bars import HALVES, deck


def calculix():
    with (HERE / "glued_bars.csv").open() as file:
        return {(r["bar"], r["load"]): np.array([float(r[f"u{a}_m"]) for a in "xyz"]) for r in csv.DictReader(file)}


def glued(folder, name, extra=""):
    """Mesh of a bar, its unknowns, and nodal forces."""
    path = folder / "bar.inp"
    path.write_text(deck(name, extra)[0])
    mesh = checked(read_deck(path, UnitSystem.SI))
    fixed = np.zeros((len(mesh.points), 3), dtype=bool)
    fixed[mesh.node_sets["ROOT"]] = True
    load = np.zeros((len(mesh.points), 3))
    load[mesh.node_sets["TIP"]] = FORCE / len(mesh.node_sets["TIP"])
    return mesh, unknowns(fixed, mesh.equations), load.ravel()


def tip_of(mesh, u):
    return u.reshape(-1, 3)[mesh.node_sets["TIP"]].mean(axis=0)


@pytest.mark.parametrize("name", HALVES)
def test_linear_deflections_of_glued_bars_are_those_of_calculix(name, tmp_path):
    mesh, unknown, load = glued(tmp_path, name)
    stiff = unknown.matrix(stiffness(mesh))
    u = unknown.whole(Factorisation(stiff, unknown.free // 3).solve(unknown.forces(load)))
    expected = calculix()[name, "linear"]
    assert np.linalg.norm(tip_of(mesh, u) - expected) < 1e-5 * np.linalg.norm(expected)
    np.testing.assert_allclose(mesh.equations @ u, 0.0, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("name", HALVES)
def test_large_deflections_of_glued_bars_are_those_of_calculix(name, tmp_path):
    mesh, unknown, load = glued(tmp_path, name)
    path = load_path(mesh, unknown, np.zeros((len(mesh.points), 3)), LARGE * load, [1.0], Reporter())
    expected, straight = (calculix()[name, which] for which in ("large", "linear"))
    assert np.linalg.norm(expected - LARGE * straight) > 0.02 * np.linalg.norm(expected)
    assert np.linalg.norm(tip_of(mesh, path.displacement[-1]) - expected) < 1e-3 * np.linalg.norm(expected)
