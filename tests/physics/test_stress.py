"""Stress recovery: modal stress at element sets."""

import dataclasses

import numpy as np
import pytest

from bodies import random_body
from driven import Driven
from flexfmu.body.flexible_body import FlexibleBody, State
from flexfmu.build.tables import StressTable
from flexfmu.fe.gradients import point_stress
from flexfmu.files.basics import UnitSystem
from flexfmu.fmu.description import Runtime
from flexfmu.mesh.formats import read_mesh
from flexfmu.model.modal_file import read_modal_file, write_modal_file
from flexfmu.model.reduced_body import StressSet
from references import BEAM

SECOND_MOMENT = 0.03**4 / 12.0


@pytest.fixture(scope="module")
def beam(bodies):
    """The clamped beam with the stress of all its elements aboard."""
    reduction = bodies.config(BEAM).reduction.model_copy(update={"residual_flexibility": True})
    return bodies.beam(stress=[StressTable(name="everywhere", elements="EALL")], reduction=reduction)


def at_points(body, state):
    """Places (p, 3) and stress (p, 6) at all points."""
    part = body.model.stress_sets[0]
    return part.point, part.stress @ state.q


def test_uniform_strain_gives_hookes_stress():
    mesh = read_mesh(BEAM / "beam.inp", UnitSystem.SI)
    gradient = np.array([[1e-3, 4e-4, 0.0], [2e-4, -5e-4, 3e-4], [0.0, 1e-4, 7e-4]])
    field = (mesh.points @ gradient.T).reshape(-1, 1)
    _, stress = point_stress(mesh, np.arange(mesh.element_count), field)
    strain = 0.5 * (gradient + gradient.T)
    expected = 2e11 / 1.3 * (strain + 0.3 / 0.4 * np.trace(strain) * np.eye(3))
    voigt = [expected[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))]
    np.testing.assert_allclose(stress[:, :, 0], np.broadcast_to(voigt, (len(stress), 6)), rtol=1e-9, atol=1e-3)


def test_small_bending_stress_is_that_of_beam_theory(beam):
    state = beam.static({"tip": [0.0, 100.0, 0.0]})
    point, stress = at_points(beam, state)
    inside = (point[:, 0] > 0.1) & (point[:, 0] < 0.9)
    expected = -100.0 * (1.0 - point[inside, 0]) * point[inside, 1] / SECOND_MOMENT
    scale = np.abs(expected).max()
    assert np.max(np.abs(stress[inside, 0] - expected)) < 0.01 * scale


def test_turning_with_a_frame_makes_no_stress(beam):
    # Far bent, the stress is still that of the bending moment, on the shortened arm: no stress from turning.
    force = 10e3
    state = beam.static({"tip": [0.0, force, 0.0]})
    arm = 1.0 + beam.response(state).displacement[0, 0]
    point, stress = at_points(beam, state)
    near = (point[:, 0] > 0.05) & (point[:, 0] < 0.1)
    expected = -force * (arm - point[near, 0]) * point[near, 1] / SECOND_MOMENT
    assert arm < 0.97
    assert np.max(np.abs(stress[near, 0] - expected)) < 0.015 * np.abs(expected).max()


def test_von_mises_stress_of_tension_and_torsion(beam):
    state = beam.static({"tip": [9e3, 0.0, 0.0]})
    middle = np.abs(at_points(beam, state)[0][:, 0] - 0.5) < 0.1
    part = beam.model.stress_sets[0]
    cut = dataclasses.replace(part, point=part.point[middle], stress=part.stress[middle])
    body = FlexibleBody(dataclasses.replace(beam.model, stress_sets=(cut,)))
    assert body.von_mises(state)[0] == pytest.approx(9e3 / 0.03**2, rel=5e-3)
    twisted = beam.static({"tip": [0.0, 0.0, 0.0, 50.0, 0.0, 0.0]})
    stress = at_points(body, twisted)[1]
    shear = np.sqrt(3.0 * (stress[:, 3] ** 2 + stress[:, 5] ** 2)).max()
    assert body.von_mises(twisted)[0] == pytest.approx(shear, rel=1e-2)
    assert shear > 1e6


def test_von_mises_stress_is_that_of_the_principal_stresses(random):
    """With all components of any sign, of which each point has its own: half the squares of the differences."""
    stress = 1e6 * random.standard_normal((40, 6, 6))
    sets = (StressSet("all", random.standard_normal((40, 3)), stress),)
    body, q = FlexibleBody(random_body(1, stress_sets=sets), "linear"), random.standard_normal(6)
    xx, yy, zz, xy, yz, zx = np.moveaxis(stress @ q, 1, 0)
    tensor = np.moveaxis(np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]]), 2, 0)
    principal = np.linalg.eigvalsh(tensor)
    expected = np.sqrt(0.5 * ((principal - np.roll(principal, 1, axis=1)) ** 2).sum(axis=1))
    assert body.von_mises(State(q, q))[0] == pytest.approx(expected.max(), rel=1e-12)


@pytest.mark.parametrize("runtime", Runtime)
def test_fmu_gives_the_largest_von_mises_stress(beam, tmp_path, runtime):
    write_modal_file(beam.model, tmp_path / "modal.h5")
    read = read_modal_file(tmp_path / "modal.h5")
    np.testing.assert_array_equal(read.stress_sets[0].stress, beam.model.stress_sets[0].stress)
    driven = Driven(read, tmp_path, runtime, **{"initialization": "static", "tip.force.y": 1e3})
    assert driven.table["everywhere.von_mises"][1].unit == "Pa"
    expected = beam.von_mises(beam.static({"tip": [0.0, 1e3, 0.0]}))
    assert expected[0] > 1e8
    np.testing.assert_allclose(driven.get("everywhere.von_mises"), expected, rtol=1e-12)
