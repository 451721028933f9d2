"""The master without running FMUs: the coupling file, what is refused and how, springs, acceleration, results."""

import h5py
import numpy as np
import pytest

from bodies import random_body
from coupling_core import (
    Secants,
    backward_rates,
    base_inputs,
    coupled_inputs,
    energy,
    grown,
    loads,
    losses,
    noise,
    quasi_newton_update,
    relative_motion,
    resolved,
    tangent,
)
from flexfmu.files.basics import OutputError, SimulationError
from flexfmu.files.outputs import Reporter
from flexfmu.files.tables import read_table
from flexfmu.fmu.package import package_fmu
from flexfmu.master import Result, couple, read_coupling_file, run, write_result
from flexfmu.master.config import Held, Scheme
from flexfmu.master.layout import Springs
from flexfmu.master.wiring import wire
from turns import exponential, rotation_vector

LEAST = """
[experiment]
stop = 1.0
step = 0.01
{experiment}
[[fmu]]
name = "arm"
file = "tree.fmu"
{arm}
[[fmu]]
name = "leg"
file = "tree.fmu"
{rest}
"""
LINK = '[[connection]]\nfrom = "{source}"\nto = "{target}"\n{more}\n'
SPRING = '[[spring]]\na = "{a}"\nb = "{b}"\nstiffness = {k}\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two FMUs, of which one offers velocities."""
    path = tmp_path_factory.mktemp("master")
    package_fmu(random_body(), path / "tree.fmu")
    package_fmu(random_body(velocity_outputs=True), path / "fast.fmu")
    return path


def content(experiment="", arm="", rest=""):
    return LEAST.format(experiment=experiment, arm=arm, rest=rest)


def link(source, target, more=""):
    return LINK.format(source=source, target=target, more=more)


def read(folder, text):
    path = folder / "coupling.toml"
    path.write_text(text, encoding="utf-8")
    return read_coupling_file(path)


def refused(folder, text):
    """The message with which a coupling is refused, before anything runs."""
    with pytest.raises(SimulationError) as caught:
        wire(read(folder, text))
    return str(caught.value)


# The file.


def test_defaults_are_those_of_the_documentation(folder):
    coupling = read(folder, content())
    settings = coupling.experiment
    assert (settings.scheme, settings.tolerance, settings.max_iterations) == (Scheme.JACOBI, 1e-6, 20)
    assert (settings.relaxation, settings.reuse, settings.held) == (0.1, 4, Held.END)
    assert settings.steps == 100
    assert [fmu.file for fmu in coupling.fmu] == [folder / "tree.fmu"] * 2
    assert (coupling.connection, coupling.spring) == ([], [])
    assert (coupling.output.variables, coupling.output.every) == (None, 1)


def test_without_a_choice_all_real_outputs_are_recorded_with_their_units(folder):
    recorded = wire(read(folder, content())).recorded
    assert len(recorded) == 2 * 18
    assert [r.unit for r in recorded[:6]] == ["m"] * 3 + ["rad"] * 3
    assert recorded[0].name == "arm.port_0.displacement.x"
    assert recorded[18].name == "leg.port_0.displacement.x"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (content('scheme = "jakobi"'), ["experiment.scheme: found 'jakobi'", "'jacobi'", "'iterated'"]),
        (content("tolerence = 1e-6"), ["experiment.tolerence: unknown key", "did you mean 'tolerance'"]),
        (content("tolerance = true"), ["experiment.tolerance: found True", "valid number"]),
        (content(arm="start = { x = [1] }"), ["fmu[1].start.x: found [1]"]),
        (
            content(rest=SPRING.format(a="arm.x", b="leg.y", k=[1.0, 2.0])),
            ["spring[1].stiffness", "expected 6 values, there are 2"],
        ),
        (content(rest=SPRING.format(a="arm.x", b="leg.y", k=[-1.0] * 6)), ["spring[1].stiffness[1]: found -1.0"]),
        (content(rest=SPRING.format(a="arm.x", b="arm.x", k=[1.0] * 6)), ["spring[1]: both ends are 'arm.x'"]),
        (content().replace('"leg"', '"arm"'), ["two [[fmu]] tables have the name 'arm'"]),
        (content().replace('name = "leg"', ""), ["fmu[2].name: missing"]),
        (content().replace("stop = 1.0", "stop = 1.004"), ["100.4 steps of 0.01 s", "take stop = 1 or", "0.01004"]),
        (
            content().replace("stop = 1.0", "stop = 1e9"),
            ["stop = 1e+09 s are 1e+11 steps of 0.01 s", "at most 1e+08", "take stop = 1e+06 s"],
        ),
        (content().replace("[experiment]", "[experiment"), ["not valid TOML"]),
    ],
)
def test_a_wrong_file_is_refused_with_the_key_and_what_would_do(folder, text, words):
    message = refused(folder, text)
    assert str(folder / "coupling.toml") in message
    for word in words:
        assert word in message


def test_results_that_cannot_be_kept_are_refused_before_anything_runs(folder):
    text = content(rest='[output]\nvariables = ["arm.port_0.displacement.x"]').replace("stop = 1.0", "stop = 200000.0")
    with pytest.raises(SimulationError, match=r"2e\+07 rows of 4 values .* take output\.every = 2"):
        couple(read(folder, text))


def test_more_differences_than_can_be_kept_are_refused_before_anything_runs(folder):
    text = content('scheme = "iterated"\nmax_iterations = 100000000')
    with pytest.raises(
        SimulationError, match="max_iterations = 100000000 with reuse = 4 are more differences than can"
    ):
        couple(read(folder, text))


def test_every_wrong_key_is_told_at_once(folder):
    text = content("tolerance = -1.0\nmax_iterations = 0")
    message = refused(folder, text)
    assert "experiment.tolerance" in message
    assert "experiment.max_iterations" in message


def test_a_file_that_is_not_there_is_named(folder):
    with pytest.raises(SimulationError, match=r"nowhere\.toml: no such file"):
        read_coupling_file(folder / "nowhere.toml")


# Names, types and units.


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (content().replace('"tree.fmu"', '"three.fmu"'), ["fmu 'arm'", "three.fmu: no such file"]),
        (content().replace('"tree.fmu"', '"coupling.toml"', 1), ["fmu 'arm'", "is a coupling file, expected an FMU"]),
        (content(arm='start = { "damping.scal" = 2.0 }'), ["fmu 'arm', start", "did you mean 'damping.scale'"]),
        (content(arm='start = { "damping.scale" = "two" }'), ["'damping.scale' is 'two'", "type Real"]),
        (content(arm="start = { initialization = 1 }"), ["'initialization' is 1", "type String"]),
        (content(arm='start = { "port_0.rotation.x" = 1.0 }'), ["'port_0.rotation.x'", "cannot be set"]),
        (
            content(rest=link("arm.port_0.displacment.x", "leg.port_1.force.x")),
            ["connection 1, from", "'arm' (tree.fmu) has no variable", "did you mean 'port_0.displacement.x'"],
        ),
        (
            content(rest=link("arms.port_0.displacement.x", "leg.port_1.force.x")),
            ["connection 1, from", "names no [[fmu]]", "did you mean 'arm'"],
        ),
        (content(rest=link("port_0", "leg.port_1.force.x")), ['expected "FMU.NAME" with one of arm, leg']),
        (
            content(rest=link("arm.port_0.displacement.x", "leg.port_1.force.x")),
            ["connection 1", "port_0.displacement.x is in m", "port_1.force.x in N", "give the factor"],
        ),
        (
            content(rest=link("arm.status.code", "leg.port_1.force.x", "factor = 1.0")),
            ["arm.status.code is of type Integer", "only Real"],
        ),
        (
            content(rest=link("arm.port_0.force.x", "leg.port_1.force.x")),
            ["arm.port_0.force.x is of causality input, expected an output"],
        ),
        (
            content(rest=link("arm.port_0.displacement.x", "leg.port_1.displacement.x")),
            ["leg.port_1.displacement.x is of causality output, expected an input"],
        ),
        (
            content(rest=SPRING.format(a="arm.port_0", b="leg.port_9", k=[1.0] * 6)),
            ["spring 1, b", "'leg' (tree.fmu) has no variable 'port_9.displacement.x'", "did you mean"],
        ),
        (
            content(rest=SPRING.format(a="arm.prt_0", b="leg.port_1", k=[1.0, 1.0, 1.0, 0.0, 0.0, 0.0])),
            ["spring 1, a", "'prt_0.displacement.x'", "did you mean 'port_0.displacement.x'"],
        ),
        (
            content(rest='[output]\nvariables = ["arm.port_0.displacement"]'),
            ["output.variables", "'port_0.displacement'", "did you mean"],
        ),
        (content(rest='[output]\nvariables = ["arm.initialization"]'), ["is of type String, expected a number"]),
    ],
)
def test_what_the_fmus_do_not_have_is_refused_with_what_they_have(folder, text, words):
    message = refused(folder, text)
    for word in words:
        assert word in message


def test_a_factor_turns_one_unit_into_another(folder):
    text = content(rest=link("arm.port_0.displacement.x", "leg.port_1.force.x", "factor = -100.0"))
    wiring = wire(read(folder, text))
    assert wiring.matrix.tolist() == [[-100.0]]


def test_an_input_fed_by_a_table_and_a_connection_is_refused(folder):
    (folder / "loads.csv").write_text("time,port_1.force.x\n0,1\n", encoding="utf-8")
    text = content(
        arm='input = "loads.csv"', rest=link("leg.port_0.displacement.x", "arm.port_1.force.x", "factor = 1.0")
    )
    message = refused(folder, text)
    assert "arm.port_1.force.x is also a column of" in message
    assert "remove one of them" in message


def test_a_table_of_what_is_no_input_is_refused(folder):
    (folder / "loads.csv").write_text("time,port_1.forces.x\n0,1\n", encoding="utf-8")
    message = refused(folder, content(arm='input = "loads.csv"'))
    assert "'port_1.forces.x' is no Real input of fmu 'arm'" in message
    assert "did you mean 'port_1.force.x'" in message


def test_a_result_of_another_kind_or_over_an_input_is_refused_before_the_run(folder):
    read(folder, content())
    path = folder / "coupling.toml"
    with pytest.raises(OutputError, match=r"\.csv or \.h5 or \.hdf5"):
        run(path, folder / "motion.txt", Reporter())
    (folder / "loads.csv").write_text("time,port_1.force.x\n0,1\n", encoding="utf-8")
    read(folder, content(arm='input = "loads.csv"'))
    with pytest.raises(OutputError, match="what the job reads"):
        run(path, folder / "loads.csv", Reporter())


# Inputs.


@pytest.mark.slow
def test_connections_to_one_input_add_up_and_replace_its_start_value(folder):
    start = 'start = { "port_0.force.y" = 7.0, "port_1.force.y" = 9.0 }'
    first = link("leg.port_0.displacement.x", "arm.port_0.force.y", "factor = 2.0")
    second = link("leg.port_1.displacement.x", "arm.port_0.force.y", "factor = 3.0")
    wiring = wire(read(folder, content(arm=start, rest=first + second)))
    assert wiring.input_names == ("arm.port_0.force.y",)
    assert wiring.base.tolist() == [0.0]
    assert coupled_inputs(wiring, np.array([1.0, 10.0]), np.zeros(2), 0.01).tolist() == [32.0]


@pytest.mark.slow
def test_springs_add_to_start_values_and_tables(folder):
    (folder / "loads.csv").write_text("time,port_0.force.x\n0,1\n1,3\n", encoding="utf-8")
    arm = 'input = "loads.csv"\nstart = { "port_0.force.y" = 7.0 }'
    wiring = wire(read(folder, content(arm=arm, rest=SPRING.format(a="arm.port_0", b="leg.port_1", k=[100.0] * 6))))
    base = dict(zip(wiring.input_names, base_inputs(wiring, 0.5, 0.01), strict=True))
    assert base["arm.port_0.force.x"] == pytest.approx(2.0, abs=1e-9)
    assert base["arm.port_0.force.y"] == 7.0
    assert base["leg.port_1.force.y"] == 0.0
    signals = np.zeros(wiring.matrix.shape[1])
    signals[0] = 0.01
    asked = dict(zip(wiring.input_names, coupled_inputs(wiring, signals, signals, 0.01), strict=True))
    assert asked["arm.port_0.force.x"] == pytest.approx(-1.0)
    assert asked["leg.port_1.force.x"] == pytest.approx(1.0)


def test_a_jump_in_a_table_has_two_sides(folder):
    (folder / "loads.csv").write_text("time,port_0.force.x\n0.1,0\n0.3,2\n0.3,5\n0.5,5\n", encoding="utf-8")
    wiring = wire(read(folder, content(arm='input = "loads.csv"')))
    # 3 · 0.1 is above 0.3 by round-off, 0.3 is not.
    for moment in (0.3, 3 * 0.1):
        assert base_inputs(wiring, moment, 0.1)[0] == 5.0
        assert base_inputs(wiring, moment, 0.1, before=True)[0] == pytest.approx(2.0, abs=1e-6)
    assert base_inputs(wiring, 0.0, 0.1)[0] == 0.0
    assert base_inputs(wiring, 0.2, 0.1)[0] == pytest.approx(1.0, abs=1e-6)
    assert base_inputs(wiring, 9.0, 0.1)[0] == 5.0


def test_velocities_come_from_outputs_where_there_are_some_and_from_differences_elsewhere(folder):
    text = content(rest=SPRING.format(a="arm.port_0", b="leg.port_1", k=[0.0] * 6) + f"damping = {[10.0] * 6}")
    plain = wire(read(folder, text))
    assert np.all(plain.ends.rates == -1)
    before, now = np.zeros(plain.matrix.shape[1]), np.zeros(plain.matrix.shape[1])
    now[0] = 1e-3
    asked = dict(zip(plain.input_names, coupled_inputs(plain, now, before, 0.01), strict=True))
    assert asked["arm.port_0.force.x"] == pytest.approx(-1.0)
    fast = wire(read(folder, text.replace("tree.fmu", "fast.fmu", 1)))
    assert np.all(fast.ends.rates[0] >= 0)
    assert np.all(fast.ends.rates[1] == -1)
    signals = np.zeros(fast.matrix.shape[1])
    signals[fast.ends.rates[0, 1]] = 0.2
    asked = dict(zip(fast.input_names, coupled_inputs(fast, signals, signals, 0.01), strict=True))
    assert asked["arm.port_0.force.y"] == pytest.approx(-2.0)
    assert asked["leg.port_1.force.y"] == pytest.approx(2.0)


def test_springs_alone_hold_what_they_do_without_any_damper(folder):
    joint = SPRING.format(a="arm.port_0", b="leg.port_1", k=[100.0] * 6)
    plain, damped = (wire(read(folder, content(rest=joint + more))) for more in ("", f"damping = {[1.0] * 6}"))
    before, now = np.zeros(plain.matrix.shape[1]), np.zeros(plain.matrix.shape[1])
    now[0] = 1e-3
    expected = coupled_inputs(plain, now, before, 0.01)
    assert np.abs(expected).max() == pytest.approx(0.1)
    assert np.abs(coupled_inputs(damped, now, before, 0.01) - expected).max() == pytest.approx(0.1)
    none = 2
    np.testing.assert_array_equal(coupled_inputs(damped, now, before, 0.01, none), expected)


# Doubts.


def shaken(folder, *motions):
    """What is told of steps in which signals of two ends move: end, signal of its six, and values (steps,)."""
    wiring = wire(read(folder, content(rest=SPRING.format(a="arm.port_0", b="leg.port_1", k=[100.0] * 6))))
    signals = np.zeros((len(motions[0][2]), wiring.matrix.shape[1]))
    for end, signal, values in motions:
        signals[:, wiring.ends.motion[end, signal]] = values
    return resolved(wiring, signals, 0.01)


def test_the_end_that_steps_do_not_resolve_is_told_with_its_period_however_slowly_others_move(folder):
    steps = np.arange(200.0)
    slow, fast = np.sin(0.02 * steps), 0.01 * np.sin(0.7 * steps)
    assert shaken(folder, (0, 1, slow), (1, 1, slow))[0] == -1
    for signal in (1, 4):
        step, (end, period, lag) = shaken(folder, (0, 5 - signal, slow), (1, 5 - signal, slow), (1, signal, fast))
        assert step == 23
        assert end == 1
        assert period == pytest.approx(2.0 * np.pi / (2.0 * np.sin(0.35)), rel=0.02)
        assert lag == pytest.approx(24.0 * (2.0 * np.sin(0.35)) ** 3 / 12.0, rel=0.1)


def test_a_vibration_lags_as_long_as_it_lasts(folder):
    steps = np.arange(300.0)
    begun = np.maximum(steps - 40.0, 0.0)
    lasting, dying = np.sin(0.3 * begun), np.sin(0.3 * begun) * np.exp(-begun / 8.0)
    # Each step by the cube of 0.3 over 12; from 0.2 rad on it is told.
    assert shaken(folder, (0, 1, lasting))[0] - 40 == pytest.approx(0.2 / (0.3**3 / 12.0), rel=0.1)
    assert shaken(folder, (0, 1, dying))[0] == -1


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_a_coupling_that_diverges_is_stopped_after_six_steps_of_such_growth_whatever_it_moves(size):
    stored = size * 5.0 ** np.arange(12)
    energies = np.column_stack([0.5 * stored, stored, stored, stored])
    assert grown(energies) == 7
    energies[:, 3] = size * 3.0 ** np.arange(12)
    assert grown(energies) > 7


# Springs.


def moving(random, ends=3, size=0.7):
    return random.uniform(-size, size, (ends, 6))


@pytest.fixture
def springs(random):
    """Three springs between three ends and the ground, stiff in different ways along axes of their own."""
    index, axes = np.array([0, 1, 2]), exponential(random.uniform(-2.0, 2.0, (3, 3)))
    stiffness, damping = random.uniform(10.0, 500.0, (3, 6)), random.uniform(0.1, 9.0, (3, 6))
    return Springs(index, np.array([1, 2, 3]), stiffness, damping, axes)


def turned(motion, turn, about=0.0):
    """The motion with a rigid turn of everything on top, about a point seen from the ends' common place."""
    result = motion.copy()
    result[:, :3] = (motion[:, :3] - about) @ turn.T + about
    result[:, 3:] = rotation_vector(turn @ exponential(motion[:, 3:]))
    return result


def test_a_large_common_turn_strains_no_spring(springs):
    turn = np.array([0.0, np.pi / 6, 0.0])
    both = np.tile(np.concatenate([[0.3, -0.2, 0.1], turn]), (3, 1))
    pair = Springs(springs.a[:2], springs.b[:2], 1e9 * springs.stiffness[:2], springs.damping[:2], springs.axes[:2])
    assert np.max(np.abs(relative_motion(both[0], both[1])[0])) < 1e-15
    np.testing.assert_allclose(loads(pair, both, np.zeros((3, 6))), 0.0, atol=1e-4)
    # A small relative turn on top of it comes out as it is, along the axes that turned.
    small = np.array([1e-3, -2e-3, 3e-3])
    both[0, 3:] = rotation_vector(exponential(turn) @ exponential(small))
    np.testing.assert_allclose(relative_motion(both[0], both[1])[0][3:], small, rtol=1e-12)


def test_a_spring_pulls_along_its_own_axes():
    """Compliance F = Aᵀ K A u of a small motion, and the same of turns and dampers."""
    axes = exponential(np.array([0.5, -0.8, 0.3]))
    stiffness, damping = np.array([[1e3, 5e3, 9e3, 2.0, 7.0, 4.0]]), np.array([[30.0, 2.0, 8.0, 0.1, 0.5, 0.9]])
    spring, motion, rates = (
        Springs(np.array([0]), np.array([1]), stiffness, damping, axes[None]),
        np.zeros((1, 6)),
        np.zeros((1, 6)),
    )
    motion[0], rates[0] = 1e-7 * np.array([2.0, -1.0, 3.0, 1.0, 4.0, -2.0]), [0.1, 0.3, -0.2, 0.5, 0.1, -0.4]
    found = loads(spring, motion, rates)[0]
    for place in (slice(0, 3), slice(3, 6)):
        own = [axes.T @ np.diag(k[0, place]) @ axes for k in (stiffness, damping)]
        np.testing.assert_allclose(found[place], -own[0] @ motion[0, place] - own[1] @ rates[0, place], rtol=1e-5)


def test_the_axes_of_the_stiffness_turn_with_b_and_those_of_the_ground_stay():
    stiffness = np.array([[1000.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    quarter = np.array([0.0, 0.0, np.pi / 2])
    motion = np.zeros((2, 6))
    motion[:, 3:] = quarter
    motion[0, :3] = [0.0, 0.01, 0.0]
    between = Springs(np.array([0]), np.array([1]), stiffness, 0.0 * stiffness, np.eye(3)[None])
    np.testing.assert_allclose(loads(between, motion, 0.0 * motion)[0, :3], [0.0, -10.0, 0.0], atol=1e-12)
    grounded = Springs(np.array([0]), np.array([2]), stiffness, 0.0 * stiffness, np.eye(3)[None])
    np.testing.assert_allclose(loads(grounded, motion, 0.0 * motion), 0.0, atol=1e-12)


def test_loads_between_bodies_balance_about_any_point(springs, random):
    motion, rates = moving(random), moving(random)
    inner = Springs(springs.a[:2], springs.b[:2], springs.stiffness[:2], springs.damping[:2], springs.axes[:2])
    found = loads(inner, motion, rates)
    assert np.max(np.abs(found)) > 1.0
    np.testing.assert_allclose(np.sum(found[:, :3], axis=0), 0.0, atol=1e-11)
    moment = found[:, 3:] + np.cross(motion[:, :3] - np.array([0.4, -3.0, 2.0]), found[:, :3])
    np.testing.assert_allclose(np.sum(moment, axis=0), 0.0, atol=1e-10)


def test_loads_turn_with_a_rigid_turn_of_everything(springs, random):
    motion, turn = moving(random), exponential(np.array([0.5, -1.2, 0.8]))
    inner = Springs(springs.a[:2], springs.b[:2], springs.stiffness[:2], springs.damping[:2], springs.axes[:2])
    still = np.zeros((3, 6))
    expected = (loads(inner, motion, still).reshape(3, 2, 3) @ turn.T).reshape(3, 6)
    np.testing.assert_allclose(loads(inner, turned(motion, turn, 0.3), still), expected, atol=1e-10)
    assert energy(inner, turned(motion, turn, 0.3)) == pytest.approx(energy(inner, motion), rel=1e-12)


def spun(motion, change):
    """The motion after small displacements and turns."""
    result = motion + change
    result[:, 3:] = rotation_vector(exponential(change[:, 3:]) @ exponential(motion[:, 3:]))
    return result


def test_loads_are_minus_the_gradient_of_the_energy(springs, random):
    motion, size = moving(random), 1e-6
    gradient = np.empty((3, 6))
    for place in np.ndindex(3, 6):
        change_ = np.zeros((3, 6))
        change_[place] = size
        gradient[place] = (energy(springs, spun(motion, change_)) - energy(springs, spun(motion, -change_))) / (
            2 * size
        )
    np.testing.assert_allclose(loads(springs, motion, np.zeros((3, 6))), -gradient, rtol=1e-6, atol=1e-5)


def test_dampers_take_energy_and_only_from_relative_motion(springs, random):
    motion = moving(random)
    dampers = Springs(springs.a, springs.b, 0.0 * springs.stiffness, springs.damping, springs.axes)
    for _ in range(20):
        rates = moving(random)
        assert np.sum(loads(dampers, motion, rates) * rates) < 0.0
    # A rigid motion of all: ω, and v = ω × x.
    inner = Springs(springs.a[:2], springs.b[:2], 0.0 * springs.stiffness[:2], springs.damping[:2], springs.axes[:2])
    spin = np.array([0.4, 2.0, -1.0])
    rigid = np.concatenate([np.cross(spin, motion[:, :3]) + 5.0, np.tile(spin, (3, 1))], axis=1)
    np.testing.assert_allclose(loads(inner, motion, rigid), 0.0, atol=1e-12)


@pytest.mark.parametrize("turning", [False, True])
def test_what_dampers_take_over_a_step_is_the_work_against_them(random, turning):
    """Over straight ways at an even speed force times way, over even turns about one axis moment times angle."""
    index, step, motion = np.array([0, 1, 2]), 0.02, np.zeros((3, 6))
    if turning:
        motion[:, 3:] = np.outer(random.uniform(-0.5, 0.5, 3), [0.0, 0.6, 0.8])
    else:
        motion[:, :3] = random.uniform(-0.1, 0.1, (3, 3))
    rates, axes = np.tile([[3.0], [5.0], [7.0]], (1, 6)), np.tile(np.eye(3), (3, 1, 1))
    dampers = Springs(index, index + 1, np.zeros((3, 6)), rates, axes)
    work = -np.sum(loads(dampers, 0.5 * motion, motion / step) * motion)
    assert work > 0.0
    assert losses(dampers, motion, np.zeros((3, 6)), step) == pytest.approx(work, rel=1e-10)


def test_rates_are_those_of_the_relative_motion(random):
    a, b, size = moving(random, 1)[0], moving(random, 1)[0], 1e-6
    rate = moving(random, 2)
    ends = np.stack([a, b])
    ahead, behind = spun(ends, size * rate), spun(ends, -size * rate)
    _, matrix = relative_motion(a, b)
    expected = (relative_motion(*ahead)[0] - relative_motion(*behind)[0]) / (2 * size)
    np.testing.assert_allclose(matrix.T @ rate.ravel(), expected, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(backward_rates(ahead, ends, size), rate, rtol=1e-5, atol=1e-8)


def test_the_tangent_is_the_derivative_of_the_loads_of_slightly_strained_springs(springs, random):
    motion = np.tile(moving(random, 1), (3, 1))
    grounded = springs.b == 3
    still = Springs(
        springs.a[~grounded],
        springs.b[~grounded],
        springs.stiffness[~grounded],
        springs.damping[~grounded],
        springs.axes[~grounded],
    )
    found = tangent(still, motion, np.zeros(3))
    size = 1e-7
    for column in range(18):
        change_ = np.zeros(18)
        change_[column] = size
        ahead, behind = (loads(still, spun(motion, s * change_.reshape(3, 6)), np.zeros((3, 6))) for s in (1, -1))
        np.testing.assert_allclose(found[:, column], (ahead - behind).ravel() / (2 * size), atol=1e-4)
    damped = tangent(springs, motion, np.full(3, 100.0)) - tangent(springs, motion, np.zeros(3))
    expected = tangent(
        Springs(springs.a, springs.b, 100.0 * springs.damping, springs.damping, springs.axes), motion, np.zeros(3)
    )
    np.testing.assert_allclose(damped, expected, rtol=1e-10, atol=1e-8)


# Acceleration.


def settle(slope, shift, known=(), tolerance=1e-10, rounds=60, secants=None):
    """Number of evaluations of g(x) = slope x + shift until x settles, its error, and the differences."""
    size = len(shift)
    x, past, scale = np.zeros(size), None, np.ones(size)
    found = Secants(np.zeros((size, 0)), np.zeros((size, 0)))
    answer = np.linalg.solve(np.eye(size) - slope, shift)
    for count in range(1, rounds + 1):
        residual = slope @ x + shift - x
        if past is not None:
            found = Secants((residual - past[1])[:, None], (x - past[0])[:, None]).before(found)
        past = x, residual
        every = found if secants is None else found.before(secants)
        delta, error = quasi_newton_update(residual, every, scale, 0.1, *known)
        if np.max(np.abs(error)) < tolerance:
            return count, np.max(np.abs(x - answer)), found
        x = x + delta
    return rounds + 1, np.max(np.abs(x - answer)), found


def stiff(random, size=6, steepest=1e4):
    basis = np.linalg.qr(random.standard_normal((size, size)))[0]
    return -basis @ np.diag(np.geomspace(0.1, steepest, size)) @ basis.T


def test_an_affine_coupling_of_n_directions_is_solved_by_n_differences():
    """V = −(1 − G)W, so n independent differences are the inverse: n + 1 evaluations find them, one more the answer."""
    for seed in range(100):
        random = np.random.default_rng(seed)
        slope = stiff(random, steepest=10.0)
        count, error, found = settle(slope, random.standard_normal(6), tolerance=1e-8)
        assert (count, found.inputs.shape[1]) == (6 + 2, 6 + 1)
        assert error < 1e-11
        # The differences still tell all of it for another right-hand side.
        count, error, _ = settle(slope, random.standard_normal(6), secants=found, tolerance=1e-8)
        assert count == 2
        assert error < 1e-11


def test_round_off_costs_a_stiff_coupling_one_difference_and_one_refinement():
    """Of κ = 1e4.

    The step back from the first one repeats the stiffest direction to less than 1e-6 and is left out. What the others
    say is off by ρ = εκ/1e-6 = 2e-6 at most, so that a second evaluation of the answer leaves ρ² = 5e-12.
    """
    for seed in range(100):
        random = np.random.default_rng(seed)
        slope = stiff(random)
        count, error, found = settle(slope, random.standard_normal(6), tolerance=1e-8)
        assert 6 + 2 <= count <= 6 + 2 + 2
        assert error < 1e-7
        # For another right-hand side ρ is left of the first change, and ρ² of the second.
        count, error, _ = settle(slope, random.standard_normal(6), secants=found, tolerance=1e-8)
        assert count <= 3
        assert error < 1e-7


def test_a_slope_that_is_known_settles_at_once(random):
    slope, shift = stiff(random), random.standard_normal(6)
    count, error, _ = settle(slope, shift, (slope, np.ones(6)))
    assert count == 2
    assert error < 1e-12


def test_a_slope_that_is_known_in_part_helps(random):
    slope, shift = np.zeros((8, 8)), random.standard_normal(8)
    slope[:6, :6], slope[6:, 6:] = stiff(random), [[-3.0, 1.0], [0.0, -2.0]]
    slope[0, 7] = 0.5
    partly = slope.copy()
    partly[6:] = partly[:, 6:] = 0.0
    count, error, _ = settle(slope, shift, (partly, np.arange(8) < 6), tolerance=1e-9)
    plain, _, _ = settle(slope, shift, tolerance=1e-9)
    assert error < 1e-7
    assert count < plain


def test_differences_that_say_nothing_new_do_no_harm(random):
    column = random.standard_normal((4, 1))
    doubled = Secants(np.hstack([column, column, 0.0 * column]), np.hstack([column, column, 0.0 * column]))
    delta, _ = quasi_newton_update(-column[:, 0], doubled, np.ones(4), 0.1)
    np.testing.assert_allclose(delta, column[:, 0], atol=1e-12)


def test_the_balance_of_loads_survives_the_acceleration(random):
    # What g always keeps, the changes keep: here the sum of the first two inputs.
    slope = random.standard_normal((4, 4))
    slope[1] = -slope[0]
    shift = np.array([1.0, -1.0, 2.0, 3.0])
    x, past, found = np.zeros(4), None, Secants(np.zeros((4, 0)), np.zeros((4, 0)))
    for _ in range(6):
        residual = slope @ x + shift - x
        if past is not None:
            found = Secants((residual - past[1])[:, None], (x - past[0])[:, None]).before(found)
        past = x, residual
        x = x + quasi_newton_update(residual, found, np.ones(4), 0.1)[0]
        assert abs(x[0] + x[1]) < 1e-9 * np.max(np.abs(x))


def test_round_off_of_a_stiff_joint_is_no_residual(folder):
    wiring = wire(read(folder, content(rest=SPRING.format(a="arm.port_0", b="leg.port_1", k=[1e9] * 6))))
    signals = np.full(wiring.matrix.shape[1], 0.01)
    expected = coupled_inputs(wiring, signals, signals, 0.01)
    moved = coupled_inputs(wiring, np.nextafter(signals, 1.0), signals, 0.01)
    assert np.max(np.abs(moved - expected)) > 0.0 or np.all(moved == 0.0)
    assert np.all(np.abs(moved - expected) < noise(wiring, signals, 0.01))
    assert np.max(noise(wiring, signals, 0.01)) < 1e-4


# Results.


@pytest.fixture
def result():
    """Two rows of two columns."""
    values = np.array([[1.5, 0.0], [2.25, 3.0]])
    return Result(("arm.tip.displacement.x", "master.iterations"), ("m", None), np.array([0.0, 0.1]), values)


def test_a_csv_has_units_in_its_header(tmp_path, result):
    write_result(tmp_path / "motion.csv", result)
    names, values = read_table(tmp_path / "motion.csv")
    header = (tmp_path / "motion.csv").read_text().splitlines()[0]
    assert header == "time [s],arm.tip.displacement.x [m],master.iterations"
    assert names == ["arm.tip.displacement.x", "master.iterations"]
    np.testing.assert_array_equal(values, [[0.0, 1.5, 0.0], [0.1, 2.25, 3.0]])


def test_an_hdf5_file_has_units_as_attributes_and_the_same_bytes_each_time(tmp_path, result):
    for name in ("one.h5", "two.h5"):
        write_result(tmp_path / name, result)
    with h5py.File(tmp_path / "one.h5") as file:
        assert sorted(file) == ["arm.tip.displacement.x", "master.iterations", "time"]
        assert file["arm.tip.displacement.x"].attrs["unit"] == "m"
        assert file["time"].attrs["unit"] == "s"
        np.testing.assert_array_equal(file["arm.tip.displacement.x"][:], [1.5, 2.25])
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "two.h5").read_bytes()


def test_a_result_is_read_by_name_and_cannot_be_changed(result):
    np.testing.assert_array_equal(result["master.iterations"], [0.0, 3.0])
    with pytest.raises(ValueError, match="read-only"):
        result.values[0, 0] = 1.0
