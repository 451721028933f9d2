"""Springs of decks against CalculiX on the same decks (tests/foreign/spring_bars.py), and what is refused of them."""

import csv
import re
import warnings
from contextlib import nullcontext
from functools import partial

import numpy as np
import pytest

import flexfmu
from flexfmu.body.reference_loads import reference_loads
from flexfmu.fe.nonlinear import load_path
from flexfmu.files.basics import DeckError, UnitSystem
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.checks import checked
from flexfmu.mesh.decks.deck import read_deck
from flexfmu.reduction.basis import Matrices
from flexfmu.reduction.bushings import resisted
from flexfmu.reduction.model import assemble_model
from foreign.deck_bars import FORCE, HERE, LARGE
from foreign.spring_bars import SPRINGS, deck


@pytest.fixture(scope="module")
def calculix():
    with (HERE / "spring_bars.csv").open() as file:
        return {(r["bar"], r["load"]): np.array([float(r[f"u{a}_m"]) for a in "xyz"]) for r in csv.DictReader(file)}


def body_of(folder, name, change=("", "")):
    path = folder / "bar.inp"
    path.write_text(deck(name)[0].replace(*change))
    tip = flexfmu.Interface("TIP", weights="node")
    return flexfmu.Body(read_deck(path, UnitSystem.SI), None, ["ROOT"], {"tip": tip})


@pytest.mark.slow
@pytest.mark.parametrize("name", SPRINGS)
def test_bars_on_springs_deflect_as_in_calculix_little_and_far(name, tmp_path, calculix):
    body = body_of(tmp_path, name)
    model = assemble_model(checked(body.mesh), body.spec.options)
    tip, load = model.mesh.node_sets["TIP"], np.zeros((len(model.mesh.points), 3))
    load[tip] = FORCE / len(tip)
    found = Matrices(model, Reporter()).supported
    u = found.whole(found.static(found.forces(load.reshape(-1, 1))))[:, 0]
    path = load_path(
        model.mesh,
        model.unknowns,
        model.spring,
        LARGE * load.ravel(),
        [1.0],
        Reporter(),
        partial(resisted, model.bushings.readings),
    )
    for which, motion in (("linear", u), ("large", path.displacement[-1])):
        expected = calculix[name, which]
        error = np.linalg.norm(motion.reshape(-1, 3)[tip].mean(axis=0) - expected)
        assert error < 2e-5 * np.linalg.norm(expected), which


@pytest.mark.slow
@pytest.mark.parametrize("name", SPRINGS)
def test_bodies_with_springs_bend_far_by_the_default_method_as_in_calculix(name, tmp_path, calculix):
    # Loads by which a build tells its error are five times as large: under those, lines to the ground put the body off.
    lines = name in ("line to the ground", "node of equations")
    with pytest.warns(UserWarning, match="springs along a line") if lines else nullcontext():
        body = body_of(tmp_path, name).build(surface=False)
    found = body.response(body.static({"tip": LARGE * FORCE})).displacement[0]
    expected = calculix[name, "large"]
    straight = LARGE * calculix[name, "linear"]
    assert np.linalg.norm(straight - expected) > 0.01 * np.linalg.norm(expected)
    assert np.linalg.norm(found - expected) < 5e-3 * np.linalg.norm(expected)


@pytest.mark.parametrize(("stiffness", "length"), [(1e5, 0.15), (2e6, 0.2), (1e6, 0.36), (1e2, 0.15), (1e6, 2.0)])
def test_a_line_spring_whose_end_moves_far_against_its_length_is_warned_of_by_what_it_puts_the_bar_off(
    stiffness, length, tmp_path
):
    """Beside the finite element model, under the load that the build names."""
    place = deck("line to the ground")[0].split("9001, ")[1].split("\n")[0]
    x, *across = map(float, place.split(","))
    near = x + length, across[0] + 0.3, across[1] - 0.2
    path = tmp_path / "bar.inp"
    path.write_text(
        deck("line to the ground")[0].replace(place, ", ".join(map(repr, near))).replace("1000000.0", f"{stiffness!r}")
    )
    mesh = read_deck(path, UnitSystem.SI)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        body = flexfmu.Body(mesh, None, ["ROOT"], {"tip": flexfmu.Interface("TIP", weights="node")})
        built = body.build(surface=False)
    said = [str(one.message) for one in caught if "springs along a line (SPRINGA 9001)" in str(one.message)]
    model, off = assemble_model(checked(body.mesh), body.spec.options), {}
    tip = model.mesh.node_sets["TIP"]
    for _, _, force, state in reference_loads(built):
        load = np.zeros((len(model.mesh.points), 3))
        load[tip] = force / len(tip)
        how = model.mesh, model.unknowns, model.spring, load.ravel(), [1.0], Reporter()
        u = load_path(*how, partial(resisted, model.bushings.readings)).displacement[-1]
        moved = u.reshape(-1, 3)[tip].mean(axis=0)
        error = np.linalg.norm(built.response(state).displacement[0] - moved) / np.linalg.norm(moved)
        off[f"{np.linalg.norm(force):.3g}"] = max(error, off.get(f"{np.linalg.norm(force):.3g}", 0.0))
    assert len(said) == (max(off.values()) > 0.01)
    for share, newton in re.findall(r"up to (\S+) % under (\S+) N", "".join(said)):
        assert 0.8 * max(off.values()) < off[newton]
        assert 0.01 * float(share) == pytest.approx(off[newton], rel=0.5)


REFUSED = {
    "nonlinear": (("*SPRING, ", "*SPRING, NONLINEAR, "), "are linear"),
    "over frequency": (("1000000.0", "1000000.0, 1.\n2000000.0, 5."), "none of a linear body"),
    "another element": (("TYPE=SPRINGA", "TYPE=MASS"), "has 2 nodes"),
    "no card": (("*SPRING, ELSET=S\n\n1000000.0\n", ""), "no *SPRING"),
    "nothing carries it": (("9001, 1, 3", "9001, 1, 2"), "nothing carries it"),
    "negative": (("1000000.0", "-5."), "not negative"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_springs_that_cannot_be_taken_are_refused_with_their_line(what, tmp_path):
    change, words = REFUSED[what]
    with pytest.raises(DeckError, match=r"bar\.inp, line \d+") as found:
        body_of(tmp_path, "line to the ground", change)
    assert words in str(found.value)


def test_axes_of_nodes_turn_no_spring_and_a_note_says_so(tmp_path):
    assert any("*TRANSFORM turns no springs" in note for note in body_of(tmp_path, "node with axes").mesh.notes)


def test_dashpots_of_a_deck_are_dampers_along_their_line(tmp_path):
    body = body_of(tmp_path, "line to the ground", ("SPRING", "DASHPOT"))
    model = assemble_model(checked(body.mesh), body.spec.options)
    line = np.array([0.0, 0.3, -0.2]) / np.linalg.norm([0.3, 0.2])
    rows = model.bushings.dampers.toarray()
    np.testing.assert_allclose(np.abs(rows[np.abs(rows) > 0.0]), 1e3 * np.abs(line[1:]), rtol=1e-12)
    assert model.bushings.rows.nnz == 0
