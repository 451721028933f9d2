"""Modal bases: normal modes, Craig-Bampton, and residual flexibility with either."""

import numpy as np
import pytest
from scipy.linalg import null_space

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import InterfaceTable
from flexfmu.files.basics import OptionError
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.model import Material
from flexfmu.model.methods import Method
from flexfmu.model.variants import _remaining_modes
from flexfmu.reduction.options import Basis
from meshes import bars, body_file, box, with_sets
from references import BEAM, calculix, displacement, relative


@pytest.fixture(scope="module")
def beam(bodies):
    """The clamped beam by basis."""

    def make(basis=Basis.NORMAL, modes=10, residual=False, frames=8):
        reduction = {"basis": basis, "modes": modes, "residual_flexibility": residual}
        config = bodies.config(BEAM).reduction.model_copy(update=reduction)
        return bodies.beam(reduction=config, frames=frames)

    return make


def linear_error(body):
    """Relative error of the linear static tip displacement against CalculiX's finite element model."""
    linear = FlexibleBody(body.model, Method.LINEAR)
    found = linear.response(linear.static({"tip": [0.0, 1e3, 0.0]})).displacement[0]
    return relative(found, displacement(calculix(BEAM / "calculix" / "linear_y.csv")))


@pytest.mark.slow
@pytest.mark.parametrize("modes", [2, 6, 10])
def test_residual_flexibility_makes_few_modes_statically_exact(beam, modes):
    assert linear_error(beam(modes=modes)) > 5e-4
    assert linear_error(beam(modes=modes, residual=True)) < 1e-6


@pytest.mark.slow
def test_residual_flexibility_of_one_load_is_exact_for_that_load_alone(beam):
    one = beam(modes=2, residual=["tip.force.y"])
    assert one.model.mode_count == 3
    assert linear_error(one) < 1e-6
    assert linear_error(beam(modes=2, residual=["tip.force.z"])) > 5e-4


@pytest.mark.slow
@pytest.mark.parametrize("modes", [2, 10])
def test_craig_bampton_is_statically_exact(beam, modes):
    assert linear_error(beam(Basis.CRAIG_BAMPTON, modes)) < 1e-6


@pytest.mark.slow
def test_craig_bampton_frequencies_come_down_to_those_of_the_body(beam):
    expected = calculix(BEAM / "calculix" / "frequencies.csv")["frequency_Hz"][:6]
    errors = []
    for modes in (4, 8, 16):
        found = beam(Basis.CRAIG_BAMPTON, modes).model.angular_frequency[:6] / (2.0 * np.pi)
        # A smaller space can only be stiffer.
        assert np.all(found > expected * (1.0 - 1e-6))
        errors.append(np.max(found / expected - 1.0))
    assert errors[2] < errors[1] < errors[0]
    assert errors[1] < 1e-3


@pytest.mark.slow
def test_craig_bampton_and_normal_modes_agree_when_the_beam_bends_far(beam):
    loads = {"tip": [-2e3, 10e3, 3e3, 50.0, -200.0, 300.0]}
    normal, craig_bampton = beam(modes=40), beam(Basis.CRAIG_BAMPTON, 12)
    found = [body.response(body.static(loads)) for body in (normal, craig_bampton)]
    assert np.linalg.norm(found[0].displacement) > 0.2
    assert relative(found[1].displacement, found[0].displacement) < 5e-4
    assert relative(found[1].rotation, found[0].rotation) < 5e-3


@pytest.mark.slow
def test_residual_flexibility_takes_truncation_out_of_large_deflections(beam):
    table = calculix(BEAM / "calculix" / "static_y.csv")
    expected = displacement(table[table["force_N"] == 10e3][0])
    errors = {}
    for residual in (False, True):
        body = beam(modes=10, residual=residual, frames=16)
        errors[residual] = relative(body.response(body.static({"tip": [0.0, 10e3, 0.0]})).displacement[0], expected)
    assert errors[False] > 6e-4
    assert errors[True] < 3e-4


@pytest.mark.slow
@pytest.mark.parametrize("basis", list(Basis))
def test_interface_modes_are_orthonormal_and_come_last(beam, basis):
    model = beam(basis, 6, residual=True).model
    # Six normal modes and what the interface's six loads add.
    assert model.mode_count == 12
    assert np.all(np.diff(model.angular_frequency) >= 0.0)
    assert model.angular_frequency[-1] > 5.0 * beam(modes=6).model.angular_frequency[-1]


def test_modes_of_high_frequency_do_not_spoil_the_motion(beam):
    # Interface modes are far above the communication step's reach: propagation stays exact and stable.
    table = calculix(BEAM / "calculix" / "sudden_load.csv")
    times = table["time_s"][::2]
    body = FlexibleBody(beam(modes=10, residual=True).model, damping_scale=0.0)
    state, found, energies = body.rest(), [np.zeros(3)], []
    for step in np.diff(times):
        state = body.step(state, {"tip": [0.0, 5e3, 0.0]}, step)
        found.append(body.response(state).displacement[0])
        energies.append(sum(body.energies(state)) - 5e3 * found[-1][1])
    assert relative(found, displacement(table)[::2]) < 0.025
    assert np.max(np.abs(energies)) < 1e-8 * 5e3 * 0.25


@pytest.mark.slow
def test_a_free_body_s_constraint_modes_hold_the_response_to_every_load_in_balance(bodies):
    """As normal modes with residual flexibility do: both are exact, forces and moments of any size together."""
    ends = [InterfaceTable(name="root", nodes="ROOT"), InterfaceTable(name="tip", nodes="TIP")]
    found = []
    for basis in Basis:
        update = {"basis": basis, "modes": 2, "residual_flexibility": basis is Basis.NORMAL}
        reduction = bodies.config(BEAM).reduction.model_copy(update=update)
        model = bodies.beam(free=True, support=[], interface=ends, reduction=reduction, frames=1).model
        rows = np.concatenate([model.interface_displacement, model.interface_rotation]).reshape(12, -1)
        found.append((rows[:, :6], rows[:, 6:] / model.angular_frequency[6:]))
    balanced = null_space(found[0][0].T)
    assert balanced.shape == (12, 6)
    first, second = (balanced.T @ rows @ rows.T @ balanced for _, rows in found)
    np.testing.assert_allclose(first, second, atol=1e-6 * np.abs(first).max())
    assert np.linalg.matrix_rank(first / np.sqrt(np.outer(np.diag(first), np.diag(first)))) == 6


def compliance(body):
    """Displacements (i, 6) of interfaces along their own unit loads, in the basis."""
    motion = np.concatenate([body.interface_displacement, body.interface_rotation], axis=1)
    elastic = body.angular_frequency > 0.0
    return ((motion[:, :, elastic] / body.angular_frequency[elastic]) ** 2).sum(axis=2)


@pytest.mark.slow
def test_by_default_every_load_misses_little_with_few_static_shapes(tmp_path):
    mesh = bars(
        ElementType.C3D20,
        [((0, 0, 0), (9, 0, 0)), ((0, 5, 0), (9, 5, 0)), ((4, 0, 0), (4, 5, 0)), ((9, 0, 0), (9, 5, 0))],
    )
    faces = {"A": lambda p: p[:, 0] - 10.0, "B": lambda p: p[:, 1] - 6.0}
    config = body_file(with_sets(mesh, ROOT=lambda p: p[:, 0], **faces), tmp_path, interface=list(faces), frames=1)

    def made(**reduction):
        table = config.reduction.model_copy(update={"second_order": False, **reduction})
        return reduce_body(config.model_copy(update={"reduction": table}), Reporter())

    few, every, none = made(), made(residual_flexibility=True), made(residual_flexibility=False)
    missed = 1.0 - compliance(few) / compliance(every)
    assert 1e-4 < missed.max() < 5e-3
    assert (1.0 - compliance(none) / compliance(every)).max() > 0.1
    assert none.mode_count < few.mode_count < every.mode_count - 2


@pytest.mark.slow
def test_steel_between_blocks_that_are_ten_thousand_times_stiffer_has_orthonormal_modes(tmp_path):
    stiff = Material("BLOCK", 2.0e15, 0.3, 7850.0)
    steel = Material("STEEL", 2.0e11, 0.3, 7850.0)
    mesh = box(
        ElementType.C3D20, (12, 1, 1), (1.0, 0.02, 0.03), materials=(steel, stiff),
        material=lambda c: ((c[:, 0] > 9) | (np.abs(c[:, 0] - 5) < 1.1)).astype(int),
    )  # fmt: skip
    notes = []
    report = Reporter()
    report.note = notes.append
    config = body_file(mesh, tmp_path, interface=["TIP"], reduction={"residual_flexibility": True})
    body = reduce_body(config, report)
    said = next(note for note in notes if "|ΦᵀMΦ − I|" in note)
    assert float(said.split("I| = ")[1].split(",")[0]) < 3e-15
    normal = config.reduction.model_copy(update={"residual_flexibility": False})
    expected = reduce_body(config.model_copy(update={"reduction": normal}), Reporter()).angular_frequency
    np.testing.assert_allclose(body.angular_frequency[:8], expected, rtol=2e-5)


def test_which_motions_can_be_fixed_together_does_not_depend_on_their_units():
    """A row in metres beside one in radians may be far smaller: each counts by its direction alone."""
    rows, squares = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]), np.array([1.0, 2.0, 3.0])
    for size in (1.0, 1e-12):
        turn, left = _remaining_modes(rows * [[size], [1.0]], np.sqrt(squares))
        np.testing.assert_allclose(np.abs(turn[:, 0]), [0.0, 0.0, 1.0], atol=1e-12)
        assert left == pytest.approx([3.0])
    with pytest.raises(OptionError, match="depend on each other"):
        _remaining_modes(rows[[0, 0]] * [[1e-12], [1.0]], np.sqrt(squares))
