"""The demos run and print what their pages claim."""

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from demo import pictures
from demo.methods import measure
from matplotlib.figure import Figure

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]


def run(module, folder):
    """Run a demo in a process of its own, since FMUs end up in it; what it prints."""
    command = [sys.executable, "-m", module, "--output", str(folder)]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert "FMUs and figures are in" in result.stdout, result.stderr
    return result.stdout


def errors(printed, model):
    """Errors (%) of a model in the demo's tables, in order."""
    rows = [line for line in printed.splitlines() if line.strip().startswith(model) and line.endswith("%")]
    return [float(line.split()[-2]) for line in rows]


def test_clamped_beam_demo_prints_errors_and_draws_figures(tmp_path):
    printed = run("demo.clamped_beam.run", tmp_path)
    assert errors(printed, "linear modes")[:3] == pytest.approx([2.96, 7.45, 15.24], abs=0.02)
    assert all(error < 0.1 for error in errors(printed, "8 frames")[:3])
    assert {path.name for path in tmp_path.glob("*.png")} == {"tip_x.png", "tip_y.png", "sudden_load.png", "shape.png"}
    assert all(error < 0.1 for error in errors(printed, "2 frames, second order")[:3])
    assert len(list(tmp_path.glob("*.fmu"))) == 3


@pytest.mark.long
def test_l_frame_demo_prints_errors_and_draws_figures(tmp_path):
    printed = run("demo.l_frame.run", tmp_path)
    assert all(error < 0.1 for error in errors(printed, "8 frames"))
    assert all(error < 0.1 for error in errors(printed, "2 frames, second order"))
    assert all(error > 4.0 for error in errors(printed, "linear modes"))
    assert len(list(tmp_path.glob("*.png"))) == 5


def test_modes_by_formula_bend_as_the_beam_does(tmp_path):
    command = [sys.executable, "-m", "demo.given_modes", str(tmp_path / "beam.npz")]
    printed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    # 10 N at the tip, F L³ / 3 E I; three modes leave 1 %.
    assert float(printed.split()[-1]) == pytest.approx(10.0 / (3.0 * 2.1e11 * 0.02**4 / 12.0), rel=0.01)


@pytest.fixture(scope="module")
def table():
    """Errors by method and case at the full load; None where there is no equilibrium."""
    records = measure()
    return {(r["method"], r["case"]): float(r["relative_error"] or "nan") for r in records}


@pytest.mark.long
@pytest.mark.parametrize("case", ["clamped beam", "L-frame, out of plane", "L-frame, in plane"])
def test_tree_is_right_where_bodies_hang_on_one_support(table, case):
    assert table["`frames`, 8 frames", case] < 0.001
    assert table["`linear`", case] > 0.08


@pytest.mark.long
@pytest.mark.parametrize("case", ["beam clamped at both ends", "plate, twisted"])
def test_second_order_alone_knows_membrane_stiffening(table, case):
    methods = {method for method, _ in table}
    others = {method for method in methods if "second_order" not in method}
    assert len(others) == 12
    assert all(table[method, case] > 0.7 for method in others)
    assert all(table[method, case] < 0.02 for method in methods - others)


@pytest.mark.long
def test_second_order_with_residual_flexibility_is_right_to_a_per_cent_on_every_body(table):
    cases = {case for _, case in table}
    assert len(cases) == 9
    for frames in ("1 frame", "2 frames"):
        assert max(table[f"`second_order`, {frames}, and residual flexibility", case] for case in cases) < 0.01


@pytest.mark.long
def test_stiffness_by_load_helps_the_arch_but_not_enough(table):
    assert table["`stiffness_by_load`", "shallow arch"] < 0.75 * table["`linear`", "shallow arch"]
    assert table["`stiffness_by_load`", "shallow arch"] > 0.2


@pytest.mark.long
def test_bent_plate_is_beam_like_to_two_percent(table):
    assert table["`frames`, 4 frames", "plate, bent"] < 0.02
    # Not for want of frames: twice as many gain little.
    assert table["`frames`, 8 frames", "plate, bent"] > 0.8 * table["`frames`, 4 frames", "plate, bent"]


@pytest.mark.long
def test_frames_that_do_not_carry_each_other_lose_what_the_tree_gains(table):
    separate, tree, one = "`modal_rotation`, 4 frames", "`frames`, 4 frames", "`floating_frame`"
    assert table[separate, "clamped beam"] > 10.0 * table[tree, "clamped beam"]
    assert table[tree, "clamped beam"] < 0.1 * table[one, "clamped beam"]


@pytest.mark.long
def test_every_method_finds_an_equilibrium_at_every_load_but_for_one(table):
    """The stress of the roof's modes takes their stiffness away."""
    assert {key for key, error in table.items() if math.isnan(error)} == {("`stiffness_by_mode`", "shallow roof")}


def test_picture_of_the_beam_shows_the_errors_of_its_page():
    panel = Figure().add_subplot()
    linear, bent = pictures.draw(pictures.SCENES[0], panel)
    assert linear == pytest.approx(32.3, abs=0.1)
    assert bent == pytest.approx(0.13, abs=0.01)
    assert f"{bent:.2g} %" in panel.get_title()
    # CalculiX's edges on the near side are those of the green beam.
    green, edges = panel.collections[-2:]
    seen = np.concatenate([path.vertices for path in green.get_paths()])
    ends = np.concatenate(edges.get_segments())
    apart = np.abs(ends[:, None] - seen).max(axis=2).min(axis=1)
    assert np.mean(apart < 2e-3) > 0.9
    assert apart.max() < 0.01
