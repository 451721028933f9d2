"""What the FMU watches for, how inputs are taken over a step, and the compliance of an interface."""

from dataclasses import replace

import numpy as np
import pytest
from flexfmu.runtime.slave import MODAL_FILE, BodySlave

from bodies import Beam, beam_body, random_body
from flexfmu.body import FlexibleBody
from flexfmu.fmu.variables import variable_table
from flexfmu.model.errors import RuntimeBodyError
from flexfmu.model.modal_file import write_modal_file

BEAM = Beam()
# Turns the tip by half a radian.
BENDING = 1.2 * BEAM.bending_stiffness
STEP = 1e-3
MISSED = "watch.stiffness_missed.limit"


class Driven:
    """A slave with variables by name."""

    def __init__(self, folder, model=None, **start):
        model = model or replace(beam_body(3, modes=4, damping=0.05), compliance_interfaces=("tip",))
        write_modal_file(model, folder / MODAL_FILE)
        self.model = model
        self.slave = BodySlave(instance_name="beam", resources=str(folder))
        self.table = {v.name: (number, v) for number, v in enumerate(variable_table(model))}
        self.set(**start)
        self.slave.enter_initialization_mode()
        self.slave.exit_initialization_mode()

    def set(self, **values):
        for name, value in values.items():
            number, variable = self.table[name]
            {"Real": self.slave.set_real, "String": self.slave.set_string}[variable.type]([number], [value])

    def get(self, *names):
        calls = {"Real": self.slave.get_real, "Integer": self.slave.get_integer}
        return [calls[self.table[name][1].type]([self.table[name][0]])[0] for name in names]

    def step(self, size=STEP):
        return self.slave.do_step(0.0, size)

    def tip(self):
        return self.get(*(f"tip.displacement.{axis}" for axis in "xyz"))

    @property
    def log(self):
        return [(message.status, message.msg) for message in self.slave._get_log_queue()]


def bent(folder, on_limit, **more):
    """A beam on which a force is about to turn the tip too far, and its state before."""
    driven = Driven(folder, **{"watch.rotation.limit": 0.05, "watch.rotation.on_limit": on_limit} | more)
    driven.set(**{"tip.force.y": BENDING})
    return driven


def test_rotation_beyond_the_limit_warns_once_and_goes_on(tmp_path):
    driven = bent(tmp_path, "warn")
    turned = []
    for _ in range(15):
        assert driven.step()
        turned += driven.get("diagnostics.rotation_within_frame")
    assert turned[-1] > 0.05
    assert driven.get("status.code") == [2]
    ((status, text),) = driven.log
    assert status == 1
    assert "beyond the limit of 2.86°" in text
    assert "more frames" in text
    assert "frame" in text.split("within")[1]


def test_rotation_beyond_the_limit_discards_the_step_and_keeps_the_state(tmp_path):
    driven = bent(tmp_path, "discard")
    while driven.step():
        before = driven.tip(), driven.slave._get_fmu_state()
    assert driven.get("status.code") == [1]
    assert driven.get("diagnostics.rotation_within_frame")[0] <= 0.05
    # Behind identity and checksum only the status code differs.
    after = [np.frombuffer(block)[6:] for block in (driven.slave._get_fmu_state(), before[1])]
    assert np.sum(after[0] != after[1]) == 1
    driven.set(**{"tip.force.y": 0.0})
    assert driven.step()
    assert driven.get("status.code") == [1]


def test_rotation_beyond_the_limit_ends_the_simulation(tmp_path):
    driven = bent(tmp_path, "terminate")
    with pytest.raises(RuntimeBodyError, match="beyond the limit"):
        list(iter(driven.step, False))
    assert driven.log[-1][0] == 3


def test_a_limit_of_zero_is_none(tmp_path):
    driven = Driven(tmp_path, **dict.fromkeys(("watch.rotation.limit", "watch.stability.limit", MISSED), 0.0))
    driven.set(**{"tip.force.y": BENDING, "tip.force.x": -2.0 * BEAM.critical_load})
    for _ in range(40):
        assert driven.step()
    assert driven.get("status.code") == [0]
    assert driven.log == []


def press(driven, share, steps=100):
    """Press the beam axially, slowly growing to a share of the critical load; whether every step was taken."""
    taken = []
    for k in range(steps):
        driven.set(**{"tip.force.x": -share * BEAM.critical_load * (k + 1) / steps})
        taken.append(driven.step())
    return taken


def test_stability_falls_with_the_axial_load_as_eulers_formula_says(tmp_path):
    driven = Driven(tmp_path, **{"watch.stability.limit": 0.0})
    assert driven.get("diagnostics.stability")[0] == pytest.approx(1.0)
    press(driven, 0.5)
    # Three frames overestimate the critical load by 3 %.
    assert driven.get("diagnostics.stability")[0] == pytest.approx(0.5, abs=0.05)
    press(driven, 1.2)
    assert driven.get("diagnostics.stability")[0] < 0.0


@pytest.mark.parametrize("share", [0.9, 1.2])
def test_a_load_near_or_past_the_critical_one_is_named_before_numbers_are_wrong(tmp_path, share):
    driven = Driven(tmp_path, **{"watch.stability.limit": 0.2, "watch.rotation.limit": 0.0, MISSED: 0.0})
    driven.set(**{"tip.force.y": 1e-3, "tip.moment.x": 1e-6})
    assert all(press(driven, share))
    ((status, text),) = driven.log
    assert status == 1
    assert "near the critical load" in text
    assert "tip.force.x = -" in text
    # Bending modes about both axes have the lowest frequency.
    hertz = driven.model.angular_frequency[0] / (2.0 * np.pi)
    assert f"({hertz:.4g} Hz)" in text
    found = float(text.split("tip.force.x = ")[1].split()[0])
    assert 0.75 * BEAM.critical_load < -found < 0.93 * BEAM.critical_load
    assert driven.get("status.code") == [2]


def test_a_load_past_the_critical_one_is_refused_on_request(tmp_path):
    driven = Driven(tmp_path, **{"watch.stability.limit": 0.02, "watch.stability.on_limit": "discard", MISSED: 0.0})
    taken = press(driven, 1.3)
    refused = taken.index(False)
    assert not any(taken[refused:])
    # Three frames overestimate the critical load by 3 %; loads are looked at in steps of 5 %.
    assert 0.93 < 1.3 * (refused + 1) / 100 < 1.1
    assert "critical load" in driven.log[0][1]


def test_a_stiffening_pull_warns_of_nothing(tmp_path):
    driven = Driven(tmp_path)
    assert all(press(driven, -3.0))
    assert driven.get("diagnostics.stability")[0] >= 1.0 - 1e-9
    assert driven.log == []


def test_a_step_without_result_ends_the_simulation_on_request(tmp_path):
    driven = Driven(tmp_path, **{"watch.step.on_limit": "terminate"})
    driven.set(**{"tip.force.x": -1e12, "tip.force.y": 1e9})
    with pytest.raises(RuntimeBodyError, match="lower the load"):
        driven.step(0.1)


@pytest.mark.parametrize("kind", ["constant", "linear", "ramp"])
def test_inputs_are_taken_over_a_step_as_asked(tmp_path, kind):
    driven = Driven(tmp_path, **{"input.interpolation": kind})
    body = FlexibleBody(driven.model)
    forces, sizes, state = [0.0, 300.0, 500.0, 900.0], [STEP, 2 * STEP, 0.5 * STEP], body.rest()
    for k, size in enumerate(sizes):
        before, now = forces[k], forces[k + 1]
        driven.set(**{"tip.force.y": now})
        assert driven.step(size)
        start, end = {
            "constant": (now, now),
            "ramp": (before, now),
            # Nothing is known of how it grew before the first step.
            "linear": (now, now + (now - before) * size / sizes[k - 1] if k else now),
        }[kind]
        state, _ = body.step_with_work(state, {"tip": [0.0, start, 0.0]}, size, {"tip": [0.0, end, 0.0]})
        np.testing.assert_allclose(driven.tip(), body.response(state).displacement[0], rtol=1e-10, atol=1e-15)
    assert abs(driven.tip()[1]) > 1e-6


@pytest.mark.parametrize("kind", ["linear", "ramp"])
def test_a_replay_is_bit_exact_with_what_was_seen_and_set_before(tmp_path, kind):
    driven = Driven(tmp_path, **{"input.interpolation": kind, "watch.rotation.limit": 0.05})

    def tail():
        found = []
        for k in range(20):
            driven.set(**{"tip.force.y": 0.1 * k * BENDING, "tip.force.x": -0.1 * k * BEAM.critical_load})
            found += [driven.step(), *driven.tip(), *driven.get("status.code", "diagnostics.stability")]
        return found

    tail()
    kept, lines = driven.slave._get_fmu_state(), len(driven.log)
    first = tail()
    said = driven.log[lines:]
    driven.slave._set_fmu_state(kept)
    lines = len(driven.log)
    assert tail() == first
    assert driven.log[lines:] == said


def test_compliance_is_the_change_of_motion_by_a_load_held_over_the_step(tmp_path):
    driven = Driven(tmp_path)
    driven.set(**{"tip.force.y": 0.4 * BEAM.bending_stiffness, "tip.force.z": 900.0})
    for _ in range(8):
        driven.step()
    kept = driven.slave._get_fmu_state()

    def end(**more):
        driven.slave._set_fmu_state(kept)
        for name, value in more.items():
            driven.set(**{name: driven.get(name)[0] + value})
        driven.step()
        return np.array(driven.tip() + driven.get(*(f"tip.rotation.{axis}" for axis in "xyz")))

    rows, columns = [f"{k}{axis}" for k in "ur" for axis in "xyz"], [f"{k}{axis}" for k in "fm" for axis in "xyz"]
    end()
    found = np.array([driven.get(*(f"tip.compliance.{row}.{column}" for column in columns)) for row in rows])
    change = 1e-3 * BEAM.bending_stiffness
    for column, name in enumerate(f"tip.{kind}.{axis}" for kind in ("force", "moment") for axis in "xyz"):
        expected = (end(**{name: change}) - end(**{name: -change})) / (2.0 * change)
        # Of the tip's rotation vector, which the tip's spin follows while rotations are small.
        np.testing.assert_allclose(found[:3, column], expected[:3], atol=2e-2 * np.abs(found[:3]).max())
    assert found[1, 1] > 0.0
    np.testing.assert_allclose(found, found.T, atol=2e-2 * np.abs(found).max())


def test_compliance_of_two_interfaces_tells_how_each_moves_the_other(tmp_path):
    model = replace(random_body(), compliance_interfaces=("port_0", "port_2"))
    driven = Driven(tmp_path, model)
    driven.set(**{"port_0.force.x": 50.0, "port_2.force.z": -40.0})
    for _ in range(3):
        driven.step()
    kept = driven.slave._get_fmu_state()
    driven.step()
    rows = [f"{k}{axis}" for k in "ur" for axis in "xyz"]
    found = np.array(driven.get(*(f"port_0.compliance.port_2.{row}.fy" for row in rows)))
    back = np.array(driven.get(*(f"port_2.compliance.port_0.uy.f{axis}" for axis in "xyz")))

    def end(force):
        driven.slave._set_fmu_state(kept)
        driven.set(**{"port_2.force.y": force})
        driven.step()
        return np.array(driven.get(*(f"port_0.displacement.{axis}" for axis in "xyz")))

    expected = (end(0.01) - end(-0.01)) / 0.02
    np.testing.assert_allclose(found[:3], expected, atol=2e-2 * np.abs(expected).max())
    # Maxwell and Betti: what one does to the other, the other does to it.
    np.testing.assert_allclose(back, found[:3], atol=1e-2 * np.abs(found[:3]).max())
