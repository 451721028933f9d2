"""Damping from test: ratios that a decay has are found, and modes get them by their frequencies."""

import numpy as np
import pytest

import flexfmu
from flexfmu.build.choices import checked_spec
from flexfmu.files.basics import BodyFileError, SimulationError
from flexfmu.reduction.bodies import _damping


def written(path, *columns):
    rows = "\n".join(",".join(f"{x:.9g}" for x in row) for row in np.column_stack(columns))
    path.write_text(f"time [s],tip.displacement.y [mm]\n{rows}\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("seed", range(4))
def test_a_decay_of_two_vibrations_in_noise_gives_back_their_frequencies_and_ratios(tmp_path, seed):
    time, true = np.arange(600) * 1e-3, [(12.0, 0.01, 3.0), (57.0, 0.02, 1.0)]
    motion = 0.4 + 0.02 * np.random.default_rng(seed).standard_normal(time.size)
    for frequency, ratio, size in true:
        omega = 2.0 * np.pi * frequency
        motion += size * np.exp(-ratio * omega * time) * np.cos(omega * np.sqrt(1.0 - ratio**2) * time + 0.3)
    found = flexfmu.decay(written(tmp_path / "decay.csv", time, motion))
    np.testing.assert_allclose(found.frequency, [12.0, 57.0], rtol=2e-3)
    np.testing.assert_allclose(found.ratio, [0.01, 0.02], rtol=0.08)
    np.testing.assert_allclose(found.amplitude, [3e-3, 1e-3], rtol=0.05)
    assert 0.005 < found.unexplained < 0.03
    assert "[damping]" in found.words


@pytest.mark.slow
def test_a_slow_decay_in_many_rows_is_used_whole_and_a_fast_one_says_how_far(tmp_path):
    """One vibration that loses a fifth of its size in a twentieth of the rows tells little of its ratio there."""
    time, omega = np.arange(12_000) * 2.5e-3, 2.0 * np.pi * np.array([1.0, 3.0])
    noise = 0.1 * np.random.default_rng(1).standard_normal(time.size)
    slow = sum(np.exp(-0.01 * w * time) * np.cos(w * time) for w in omega) + noise
    found = flexfmu.decay(written(tmp_path / "slow.csv", time, slow))
    np.testing.assert_allclose(found.ratio, 0.01, rtol=0.03)
    np.testing.assert_allclose(found.frequency, [1.0, 3.0], rtol=2e-3)
    np.testing.assert_allclose(found.amplitude, 1e-3, rtol=0.03)
    assert found.used == found.whole == pytest.approx(30.0)
    fast = np.exp(-0.3 * time) * np.cos(2.0 * np.pi * 110.0 * time) + np.exp(-0.3 * time) * np.cos(omega[1] * time)
    found = flexfmu.decay(written(tmp_path / "fast.csv", time, fast))
    assert found.used == pytest.approx(2.5)
    assert "of the first 2.5 s of 30" in "\n".join(found.words)


def test_what_is_no_decay_is_refused(tmp_path):
    time = np.linspace(0.0, 1.0, 100)
    for columns, words in [
        ((time, np.exp(3.0 * time)), "nothing in it vibrates and dies away"),
        ((time**2, np.cos(time)), "expected 20 or more at equal steps"),
        ((time[:5], time[:5]), "5 rows"),
    ]:
        with pytest.raises(SimulationError, match=words):
            flexfmu.decay(written(tmp_path / "decay.csv", *columns))
    with pytest.raises(SimulationError, match=r"no column 'tip\.y', expected one of tip\.displacement\.y"):
        flexfmu.decay(written(tmp_path / "decay.csv", time, time), "tip.y")


def test_modes_have_the_measured_ratios_linear_between_them_and_constant_beyond():
    spec = checked_spec(
        {
            "name": "bar",
            "interface": [{"name": "tip", "nodes": "TIP"}],
            "damping": {"measured": [[0, 0.01], [10, 0.01], [30, 0.03]]},
        }
    )
    omega = 2.0 * np.pi * np.array([0.0, 5.0, 10.0, 20.0, 99.0])
    np.testing.assert_allclose(_damping(spec.use.damping, omega, 1), [0.0, 0.01, 0.01, 0.02, 0.03])
    for wrong in (
        {"measured": [[10, 2.0]]},
        {"measured": [[10, 0.1], [9, 0.1]]},
        {"measured": [[-1, 0.1], [9, 0.1]]},
        {"measured": [[9, 0.1]], "ratio": 0.1},
    ):
        with pytest.raises(BodyFileError, match="expected"):
            checked_spec({"name": "bar", "interface": [{"name": "tip", "nodes": "TIP"}], "damping": wrong})
