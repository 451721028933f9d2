"""Bodies whose parts linear equations join: reduced bodies, rigid motions, and what a tie does to constant strain."""

from dataclasses import replace

import numpy as np
import pytest
from demo.calculix_scene import deck as calculix_deck

import flexfmu
from flexfmu.fe.assembly import area_matrix, select, stiffness, unknowns
from flexfmu.fe.factorisation import Factorisation
from flexfmu.fe.gradients import point_stress
from flexfmu.files.basics import ModelError, UnitSystem
from flexfmu.mesh.checks import checked
from flexfmu.mesh.decks.deck import read_deck
from flexfmu.reduction.model import assemble_model
from foreign.deck_bars import FORCE, LARGE, SIZE
from foreign.glued_bars import HALVES, deck
from foreign.test_glued_bars import calculix
from meshes import box


def glued(folder, name):
    path = folder / "bar.inp"
    path.write_text(deck(name)[0])
    return read_deck(path, UnitSystem.SI)


def tip_error(body, factor, expected):
    found = body.response(body.static({"tip": factor * FORCE})).displacement[0]
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "frames"), [("second_order", 1), ("second_order", 2), ("frames", 4)])
def test_reduced_bodies_bend_across_a_tie_as_calculix(tmp_path, method, frames):
    body = flexfmu.Body(glued(tmp_path, "tied_bricks"), None, ["ROOT"], {"tip": "TIP"})
    reduced = body.build(method, modes=6, frames=frames, residual_flexibility=True)
    # The force is spread over the area here, and by node there.
    assert tip_error(reduced, LARGE, calculix()["tied_bricks", "large"]) < 1e-3


@pytest.mark.slow
def test_membrane_energy_sees_no_stretch_in_a_tie_that_turns(tmp_path):
    tables = {"reduction": {"membrane": True}}
    body = flexfmu.Body(glued(tmp_path, "tied_bricks"), None, ["ROOT"], {"tip": "TIP"}, tables=tables)
    reduced = body.build("second_order", modes=6, residual_flexibility=True)
    assert tip_error(reduced, LARGE, calculix()["tied_bricks", "large"]) < 1e-3


@pytest.mark.slow
def test_frames_hang_on_each_other_across_a_tie(tmp_path):
    body = flexfmu.Body(glued(tmp_path, "tied_tetrahedra"), None, ["ROOT"], {"tip": "TIP"})
    model = body.build("frames", modes=6, frames=4).model
    assert model.frame_parent.tolist() == [-1, 0, 1, 2]


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in HALVES if name != "tied_linear"])
def test_a_glued_body_without_supports_has_six_rigid_motions_and_no_seventh(tmp_path, name):
    mesh = glued(tmp_path, name)
    body = flexfmu.Body(mesh, None, [], {"tip": "TIP"}, free=True).build("linear", modes=4, residual_flexibility=False)
    frequency = body.model.angular_frequency
    assert np.all(frequency[:6] == 0.0)
    # Two halves of C3D20R are as stiff as one piece; other meshes are near.
    kind, counts = HALVES["equation"][0]
    whole = box(kind, (2 * counts[0], *counts[1:]), SIZE)
    whole = replace(whole, materials=mesh.materials)
    one = (
        flexfmu.Body(whole, None, [], {"tip": "TIP"}, free=True)
        .build("linear", modes=4, residual_flexibility=False)
        .model.angular_frequency
    )
    np.testing.assert_allclose(frequency[6:], one[6:], rtol=1e-7 if name == "equation" else 0.02)


@pytest.mark.parametrize(
    ("name", "of_displacement", "of_stress"),
    [
        ("equation", 1e-9, 1e-9),
        ("tied_bricks", 2e-4, 0.02),
        ("tied_tetrahedra", 2e-4, 0.05),
        ("tied_linear", 1e-3, 0.07),
    ],
)
def test_constant_strain_passes_a_tie_but_for_a_known_error(tmp_path, name, of_displacement, of_stress):
    """Nodes that are tied to faces keep displacements together; uniform stress is disturbed next to the interface."""
    mesh = checked(glued(tmp_path, name))
    mesh = replace(mesh, materials=tuple(replace(m, poissons_ratio=0.0) for m in mesh.materials))
    fixed = np.zeros((len(mesh.points), 3), dtype=bool)
    fixed[mesh.node_sets["ROOT"]] = True
    unknown, tip = unknowns(fixed, mesh.equations), np.sort(mesh.node_sets["TIP"])
    load = np.zeros((len(mesh.points), 3))
    load[tip, 0] = area_matrix(mesh.points, select(mesh.faces, tip, outer=True), tip).sum(axis=1)
    stiff = unknown.matrix(stiffness(mesh))
    u = unknown.whole(Factorisation(stiff, unknown.free // 3).solve(unknown.forces(load.ravel())))
    exact = mesh.points[tip, 0] / mesh.materials[0].youngs_modulus
    assert abs(u.reshape(-1, 3)[tip, 0].mean() / exact.mean() - 1.0) < of_displacement
    _, stress = point_stress(mesh, np.arange(mesh.element_count), u[:, None])
    assert np.abs(stress[:, 0] - 1.0).max() < of_stress


def test_equations_of_a_calculix_deck_are_those_of_the_model(tmp_path):
    mesh = checked(glued(tmp_path, "tied_bricks"))
    model = flexfmu.Body(mesh, None, ["ROOT"], {"tip": "TIP"})
    whole = assemble_model(mesh, model.spec.options)
    path = tmp_path / "again.inp"
    path.write_text(calculix_deck(whole, np.zeros(3 * len(mesh.points)), [1.0], np.arange(1), "again"))
    again = read_deck(path, UnitSystem.SI)
    np.testing.assert_allclose(again.equations @ whole.unknowns.transform.toarray(), 0.0, atol=1e-11)
    assert unknowns(again.fixed, again.equations).free.size == whole.free.size


def test_parts_that_too_few_equations_join_are_refused(tmp_path):
    text = deck("equation")[0]
    first = text.index("*EQUATION")
    last = text.index("*MATERIAL")
    # A single node is a ball joint.
    few = text[:first] + "\n".join(text[first:last].split("\n")[:9]) + "\n" + text[last:]
    path = tmp_path / "hinge.inp"
    path.write_text(few)
    with pytest.raises(ModelError, match=r"against each other \(\d motions with the supports\), such as node \d+"):
        flexfmu.Body(read_deck(path, UnitSystem.SI), None, ["ROOT"], {"tip": "TIP"}).build("linear", modes=2)
