"""Masses at points: of decks and bulk data, on nodes and on the reference points of couplings."""

from dataclasses import replace

import numpy as np
import pytest

import flexfmu
from decks import BODY, COUPLING, read, refuse
from flexfmu.files.basics import MeshError, UnitSystem
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.checks import checked
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.model import PointMass
from flexfmu.model.rotations import skew
from flexfmu.reduction.masses import body_properties
from flexfmu.reduction.model import free_motions
from flexfmu.reduction.rigid_fit import model_mass, point_mass_matrix
from foreign.deck_bars import HERE
from foreign.heavy_bar import COUNT, heavy_deck
from foreign.test_foreign import nastran
from meshes import box

INERTIA = np.array([[0.5, 0.02, -0.03], [0.02, 0.4, 0.01], [-0.03, 0.01, 0.3]])
POINT = np.array([1.15, 0.12, 0.02])
HUNG = "*ELEMENT, TYPE=MASS, ELSET=M\n101, {0}\n*MASS, ELSET=M\n5.\n"


def loaded(density=7850.0, mass=20.0, point=POINT):
    """A slender bar with a mass beside its tip."""
    mesh = box(ElementType.C3D20, (8, 1, 1), (1.0, 0.05, 0.08))
    (steel,) = mesh.materials
    one = PointMass("motor", np.array(point), mesh.node_sets["TIP"], mass, INERTIA)
    return replace(mesh, materials=(replace(steel, density=density),), masses=(one,))


def test_frequencies_with_masses_at_nodes_are_those_of_calculix(tmp_path):
    mesh = read(tmp_path, heavy_deck())
    body = flexfmu.Body(mesh, None, ["ROOT"], {"tip": "TIP"}).build("linear", modes=COUNT, residual_flexibility=False)
    expected = np.loadtxt(HERE / "heavy_bar.csv", skiprows=1)
    np.testing.assert_allclose(body.model.angular_frequency / (2.0 * np.pi), expected, rtol=1e-5)


def test_a_mass_beside_its_nodes_has_the_inertia_of_a_rigid_body_there():
    mesh = loaded()
    motions = free_motions(mesh.points, np.zeros((len(mesh.points), 3), dtype=bool))
    centre, size = mesh.points.mean(axis=0), np.abs(mesh.points - mesh.points.mean(axis=0)).max()
    arm = skew(POINT - centre) / size
    turned = INERTIA / size**2 + 20.0 * arm @ arm.T
    expected = np.block([[20.0 * np.eye(3), -20.0 * arm], [20.0 * arm, turned]])
    np.testing.assert_allclose(motions.T @ point_mass_matrix(mesh) @ motions, expected, atol=1e-9)


def test_a_light_bar_swings_with_its_mass_as_its_compliance_says():
    """The six modes of a rigid mass on a massless spring: the eigenvalues of C diag(m, J)."""
    mesh = loaded(density=1.0)
    tip = flexfmu.Interface("TIP", point=POINT.tolist(), weights="node")
    body = flexfmu.Body(mesh, None, ["ROOT"], {"tip": tip})
    body = body.build("linear", modes=6, residual_flexibility=True, report=Reporter())
    compliance = np.empty((6, 6))
    for k in range(6):
        response = body.response(body.static({"tip": np.eye(6)[k]}))
        compliance[:, k] = np.concatenate([response.displacement[0], response.rotation[0]])
    own = np.zeros((6, 6))
    own[:3, :3], own[3:, 3:] = 20.0 * np.eye(3), INERTIA
    expected = np.sort(np.linalg.eigvals(compliance @ own).real)[::-1] ** -0.5
    np.testing.assert_allclose(body.model.angular_frequency[:6], expected, rtol=3e-4)


@pytest.mark.parametrize("method", ["linear", "frames", "second_order"])
def test_the_weight_of_a_mass_is_a_force_at_its_centre(method):
    mesh = loaded(density=1.0)
    tip = flexfmu.Interface("TIP", point=POINT.tolist(), weights="node")
    body = flexfmu.Body(mesh, None, ["ROOT"], {"tip": tip})
    frames = 0 if method == "linear" else 2
    reduced = body.build(
        method, modes=6, frames=frames, residual_flexibility=True, acceleration=True, report=Reporter()
    )
    up = np.array([30.0, 2000.0, 500.0])
    heavy = reduced.response(reduced.static(reduced.loads({}, up)))
    pushed = reduced.response(reduced.static({"tip": -20.0 * up}))
    assert np.linalg.norm(pushed.displacement[0]) > 0.01
    np.testing.assert_allclose(heavy.displacement, pushed.displacement, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(heavy.rotation, pushed.rotation, rtol=1e-3, atol=1e-6)


def test_elastic_modes_of_a_free_body_with_a_mass_do_not_move_its_floating_frame():
    mesh = loaded()
    body = flexfmu.Body(mesh, None, [], {"tip": "TIP"}, free=True).build("frames", modes=6, frames=1).model
    assert np.sum(body.angular_frequency == 0.0) == 6
    size = np.abs(body.joint_displacement[0]).max()
    assert np.abs(body.joint_displacement[0][:, 6:]).max() < 1e-8 * size
    elements = body_properties(mesh).mass - 20.0
    centre = (elements * np.array([0.5, 0.025, 0.04]) + 20.0 * POINT) / (elements + 20.0)
    np.testing.assert_allclose(body.joint_point[0], centre, atol=1e-9)


def test_lumps_of_the_turned_body_hold_the_mass_and_its_inertia():
    mesh = loaded()
    body = flexfmu.Body(mesh, None, ["ROOT"], {"tip": "TIP"})
    inertia = body.build("frames", mass="configuration", modes=6, frames=2).model.inertia
    total = body_properties(mesh).mass
    assert inertia.mass.sum() == pytest.approx(total)
    assert total == pytest.approx(7850.0 * 0.05 * 0.08 + 20.0)
    about = inertia.point - mesh.points.mean(axis=0)
    found = inertia.turning.sum(axis=0) + sum(m * skew(r) @ skew(r).T for m, r in zip(inertia.mass, about, strict=True))
    motions = free_motions(mesh.points, np.zeros((len(mesh.points), 3), dtype=bool))[:, 3:]
    size = np.abs(mesh.points - mesh.points.mean(axis=0)).max()
    expected = size**2 * motions.T @ model_mass(mesh) @ motions
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("units", list(UnitSystem))
def test_masses_of_a_deck_hang_on_nodes_and_on_couplings(tmp_path, units):
    text = BODY.replace("2.1e11", f"{2.1e11 / units.stress!r}").replace("7850.", f"{7850.0 / units.density!r}")
    weight = units.density * units.length**3
    rotary = "*ELEMENT, TYPE=ROTARYI, ELSET=J\n102, 100\n*ROTARY INERTIA, ELSET=J\n1., 2., 3., .1, .2, .3\n"
    mesh = checked(read(tmp_path, text + COUPLING + HUNG.format(100) + rotary, units))
    (one,) = mesh.masses
    assert one.mass == pytest.approx(5.0 * weight)
    np.testing.assert_allclose(one.point, units.length * np.array([2.0, 0.5, 0.5]))
    assert mesh.labels[one.nodes].tolist() == [2, 3, 6, 7]
    matrix = np.array([[1.0, 0.1, 0.2], [0.1, 2.0, 0.3], [0.2, 0.3, 3.0]])
    np.testing.assert_allclose(one.inertia, weight * units.length**2 * matrix)
    assert any("masses at 1 nodes: node 100" in note for note in mesh.notes)
    (single,) = read(tmp_path, text + HUNG.format(7), units).masses
    assert single.nodes.tolist() == [6]
    assert body_properties(replace(mesh, masses=(single,))).mass == pytest.approx(
        weight * (5.0 + 2.0 * 7850.0 / units.density)
    )


def test_rotary_inertia_of_a_node_that_does_not_turn_is_told_of(tmp_path):
    text = BODY + "*ELEMENT, TYPE=ROTARYI, ELSET=J\n102, 7\n*ROTARY INERTIA, ELSET=J\n1., 2., 3.\n"
    mesh = read(tmp_path, text)
    assert any("node 7 of a solid does not turn: its rotary inertia does nothing" in note for note in mesh.notes)
    assert point_mass_matrix(mesh).nnz == 0 or abs(point_mass_matrix(mesh)).max() == 0.0


@pytest.mark.parametrize(
    ("text", "culprit", "words"),
    [
        (HUNG.format(7).replace("*MASS, ELSET=M", "*MASS, ELSET=Eall"), "*MASS", "for elements of type MASS"),
        (HUNG.format(7).replace("5.", "-5."), "-5.", "masses are positive"),
        (HUNG.format(7).replace("5.", "x"), "x", "finite number"),
        ("*NODE\n100, 9., 9., 9.\n" + HUNG.format(100), "*MASS", "which would carry it"),
    ],
)
def test_a_mass_that_cannot_be_placed_is_refused_at_its_line(tmp_path, text, culprit, words):
    refuse(tmp_path, BODY + text, culprit, words)


def test_masses_of_nastran_hang_on_grid_points_and_on_rigid_elements(tmp_path):
    mesh = nastran(
        tmp_path, "PARAM,WTMASS,.5", "GRID,9,,2.,2.,2.", "RBE2,4,9,123456,2,3,4", "CONM2,7,9,,10.,1.,0.,-1.",
        ",4.,.1,5.,.2,.3,6.", "CONM2,8,1,,3.",
    )  # fmt: skip
    single, beside = sorted(mesh.masses, key=lambda one: one.mass)
    assert (single.mass, beside.mass) == (1.5, 5.0)
    np.testing.assert_allclose(beside.point, [3.0, 2.0, 1.0])
    np.testing.assert_allclose(
        beside.inertia, 0.5 * np.array([[4.0, -0.1, -0.2], [-0.1, 5.0, -0.3], [-0.2, -0.3, 6.0]])
    )
    assert mesh.labels[beside.nodes].tolist() == [2, 3, 4]
    assert mesh.labels[single.nodes].tolist() == [1]
    scalar = ("GRID,9,,2.,2.,2.", "RBE2,4,9,123456,2,3,4", "PMASS,3,7.", *(f"CMASS1,{k},3,9,{k}" for k in (1, 2, 3)))
    (one,) = nastran(tmp_path, *scalar, "CMASS2,5,.4,9,5").masses
    assert (one.mass, np.diag(one.inertia).tolist()) == (7.0, [0.0, 0.4, 0.0])
    with pytest.raises(MeshError, match=r"CONM2 7 \(line \d+\) at GRID 9: supported are"):
        nastran(tmp_path, "GRID,9,,2.,2.,2.", "CONM2,7,9,,10.")
