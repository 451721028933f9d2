"""The compiled step against the one in NumPy: the same physics, the same numbers."""

import shutil

import numpy as np
import pytest
from flexfmu.runtime import kernel

from bodies import Beam, beam_body, random_body, with_second_order
from flexfmu.body import FlexibleBody, StepLimits
from flexfmu.model.errors import OptionError, StepError
from flexfmu.model.reduced_body import Formulation, Kinematics, LoadPlacement, Masses, Stiffness

pytestmark = pytest.mark.skipif(kernel._library() is None, reason="built without a C compiler")

LOADS = {"port_0": (300.0, -200.0, 500.0, 3.0, -2.0, 5.0), "port_1": (-400.0, 100.0, 300.0)}
LATER = {"port_0": (100.0, 300.0, 200.0), "port_2": (10.0, -50.0, 70.0, 0.0, 4.0, 1.0)}


def formulations():
    for kinematics in Kinematics:
        for placement in LoadPlacement:
            for stiffness in Stiffness:
                try:
                    yield Formulation(kinematics, placement, stiffness)
                except OptionError:
                    continue


def body_of_everything(random):
    """A random tree with masses and geometric stiffness small enough to be stable."""
    modes, interfaces, frames = 6, 3, 5
    masses = Masses(
        random.uniform(0.5, 2.0, frames), random.standard_normal((frames, 3)),
        0.1 * random.standard_normal((frames, 3, modes)), np.arange(frames),
    )  # fmt: skip
    by_load = random.standard_normal((6 * interfaces + 3, modes, modes))
    by_mode = 30.0 * random.standard_normal((modes, modes, modes))
    body = random_body(
        masses=masses,
        stiffness_by_load=by_load + by_load.transpose(0, 2, 1),
        stiffness_by_mode=by_mode + by_mode.transpose(0, 2, 1),
    )
    return with_second_order(body)


def pair(model, formulation, limits=None):
    """The body with compiled code and without."""
    made = [FlexibleBody(model, formulation, limits=limits, use_compiled=use) for use in (True, False)]
    assert made[0]._stepper.kernel is not None
    assert made[1]._stepper.kernel is None
    return made


@pytest.mark.parametrize("ramp", [False, True])
@pytest.mark.parametrize(
    "formulation", list(formulations()), ids=lambda f: "-".join(c.value for c in (f.kinematics, f.loads, f.stiffness))
)
def test_compiled_steps_and_outputs_are_those_of_numpy(formulation, ramp, random):
    bodies = pair(body_of_everything(random), formulation, StepLimits(2e-3, 1e-3))
    states = [body.rest() for body in bodies]
    for step in (1e-3, 5e-3, 5e-3, 2e-3):
        results = []
        for body, state in zip(bodies, states, strict=True):
            start = body.loads(LOADS, [1.0, -2.0, 3.0])
            end = body.loads(LATER, [-1.0, 0.0, 2.0]) if ramp else None
            results.append(body.step_with_work(state, start, step, end))
        (states, works) = zip(*results, strict=True)
        assert works[0].substeps == works[1].substeps
        assert works[0].iterations == works[1].iterations
        assert works[0].error == pytest.approx(works[1].error, rel=1e-6, abs=1e-12)
        scale = np.linalg.norm(states[1].q), np.linalg.norm(states[1].v)
        np.testing.assert_allclose(states[0].q, states[1].q, rtol=0.0, atol=1e-11 * scale[0])
        np.testing.assert_allclose(states[0].v, states[1].v, rtol=0.0, atol=1e-11 * scale[1])
        motions = [np.array(body.motion_and_rates(states[1])) for body in bodies]
        for found, expected in zip(*motions, strict=True):
            np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())
        np.testing.assert_array_equal(bodies[0].motion(states[1]), motions[0][0])
    assert scale[0] > 0.0


@pytest.mark.parametrize("size", [1e-9, 0.3, 2.0, 3.14159, 5.0])
def test_compiled_rotation_vectors_are_right_for_any_angle(size, random):
    model = random_body()
    both = pair(model, Formulation())
    state = both[0].rest()
    q = random.standard_normal(state.q.size)
    q *= size / np.abs(model.frame_rotation @ q).max()
    state = type(state)(q, state.v)
    np.testing.assert_allclose(both[0].motion(state), both[1].motion(state), rtol=0.0, atol=1e-11)


def test_where_a_fixed_point_does_not_settle_the_step_is_divided():
    beam = Beam()
    bodies = pair(beam_body(3, modes=3, planes="y"), Formulation(), StepLimits(0.0, 1e300))
    # A compressed beam bent far, in steps much longer than its period.
    loads = {"tip": (-0.7 * beam.bending_stiffness, 0.8 * beam.bending_stiffness, 0.0)}
    states, worked = [body.rest() for body in bodies], 0
    for _ in range(20):
        results = [body.step_with_work(s, loads, 0.03) for body, s in zip(bodies, states, strict=True)]
        states = [state for state, _ in results]
        worked = max(worked, results[0][1].substeps)
        assert results[0][1].substeps == results[1][1].substeps
        np.testing.assert_allclose(states[0].q, states[1].q, rtol=0.0, atol=1e-8 * np.abs(states[1].q).max())
    assert worked > 1


def test_huge_loads_are_refused_and_leave_no_trace():
    body = FlexibleBody(random_body(), Formulation())
    start = body.step(body.rest(), LOADS, 1e-3)
    with pytest.raises(StepError):
        body.step(start, {"port_0": (1e300, 1e300, 1e300)}, 1e-3)
    again = FlexibleBody(random_body(), Formulation())
    expected = again.step(again.step(again.rest(), LOADS, 1e-3), LATER, 1e-3)
    found = body.step(start, LATER, 1e-3)
    assert found.q.tobytes() == expected.q.tobytes()


def test_a_library_of_another_version_or_no_library_at_all_is_passed_over(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel, "_VERSION", 99)
    assert kernel._library.__wrapped__() is None
    monkeypatch.undo()
    broken = tmp_path / "kernel.py"
    shutil.copy(kernel.__file__, broken)
    (tmp_path / "_kernel.broken.so").write_bytes(b"no library")
    monkeypatch.setattr(kernel, "__file__", str(broken))
    assert kernel._library.__wrapped__() is None
