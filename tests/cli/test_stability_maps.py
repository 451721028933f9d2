"""The maps of stability as a user makes them: run, recorded, resumed, drawn; their truths against closed forms."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from flexfmu.files.progress import Reporter
from flexfmu.files.store import Store
from flexfmu.study import pictures
from flexfmu.study.pictures import draw_maps
from flexfmu.study.records import RUNS, RecordFile, Run, StabilityError, Verdict, verdict
from flexfmu.study.stability import coupling
from flexfmu.study.stability.equilibria import BUCKLING, ROTATION
from flexfmu.study.stability.maps import chart_stability
from flexfmu.study.stability.subject import read_subject
from scene_tools import Listening

pytestmark = pytest.mark.slow

DEMO = Path(__file__).parents[2] / "demo"
SCENE = """
[[static]]
name = "bend"
loads = { "tip.force.y" = 10e3 }

[stability]
shares = [0.05, 0.6, 1.05]
angles = [10.0, 90.0]
frames = [1, 4]
mass_ratios = [1.0]
stiffness_ratios = [0.01, 100.0]
coupling_steps_per_period = [40.0]
"""


def chart(folder, *arguments, body=DEMO / "clamped_beam" / "body.toml", scene="scene.toml"):
    """Run the command in a folder; what it prints, and its exit code."""
    code = "from flexfmu.commands.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "chart", str(body), "--scene", scene, "--stability", *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        cwd=folder,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    return done.stdout, done.stderr, done.returncode


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    """A folder with the maps of the clamped beam, a few runs each."""
    folder = tmp_path_factory.mktemp("maps")
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")
    out, err, code = chart(folder, "--records", "runs.csv", "--picture", "map.png")
    assert code == 0, err
    return folder, out, err


def found(folder, kind, panel="", **place):
    """Runs of a map by panel and place."""
    return [
        run
        for run in RUNS.read(folder / "runs.csv")
        if run.map == kind and panel in run.panel and all(getattr(run, key) == value for key, value in place.items())
    ]


def test_nothing_is_wrong_in_silence_and_every_verdict_is_there(mapped):
    folder, out, _ = mapped
    verdicts = {run.verdict for run in RUNS.read(folder / "runs.csv")}
    assert verdicts == {"right", "warned", "refused"}
    assert out.count("0 wrong in silence") == 3


def test_runs_that_are_planned_are_those_that_are_made(mapped):
    folder, _, _ = mapped
    body = DEMO / "clamped_beam" / "body.toml"
    subject = read_subject(body, folder / "scene.toml", Reporter(), Store())
    planned = [run.key for of_map in (BUCKLING, ROTATION, coupling) for run in of_map.planned(subject)]
    assert planned == [run.key for run in RUNS.read(folder / "runs.csv")]
    # Two angles of linear, and of frames and second order with one frame and with four.
    assert len(ROTATION.planned(subject)) == 10
    report = Listening()
    chart_stability(body, folder / "scene.toml", folder / "runs.csv", None, report, Store())
    assert [(title, left) for title, left, *_ in report.counts] == [
        ("Map of buckling, 1 of 3", 0),
        ("Map of rotation, 2 of 3", 0),
        ("Map of coupling, 3 of 3", 0),
    ]


def test_pictures_are_drawn_from_records_alone(mapped, tmp_path):
    folder, out, _ = mapped
    kinds = ("buckling", "rotation", "coupling")
    for kind in kinds:
        assert (folder / f"map_{kind}.png").stat().st_size > 5000
        assert f"map_{kind}.png" in out
    again = draw_maps(folder / "runs.csv", tmp_path / "again.svg")
    assert [path.name for path in again] == [f"again_{kind}.svg" for kind in kinds]


def test_cells_are_shaded_by_error_and_every_panel_has_its_axes(mapped, monkeypatch):
    folder, _, _ = mapped
    drawn = {}
    monkeypatch.setattr(pictures, "save", lambda figure, path: drawn.update({path.stem: figure}))
    draw_maps(folder / "runs.csv", folder / "m.png")
    for kind in ("buckling", "rotation", "coupling"):
        panels = [axes for axes in drawn[f"m_{kind}"].axes if axes.get_title() or axes.get_xlabel()]
        assert len(panels) == (4 if kind == "coupling" else 1)
        assert all(axes.get_xlabel() and axes.get_ylabel() for axes in panels)
        # Outside of all panels.
        assert not any(axes.get_legend() for axes in panels)
        (legend,) = drawn[f"m_{kind}"].legends
        assert legend.get_texts()
    shades = [pictures._shade(error) for error in (0.0, 1e-3, 0.01, 0.1, 1.0, 7.0)]
    np.testing.assert_allclose(shades, [0.0, 0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0, 1.0], atol=1e-12)
    for sign in (Verdict.WARNED, Verdict.REFUSED, Verdict.SILENT):
        assert pictures._sign(sign, 0.0, 0.0, 1.0, 1.0)
    assert not pictures._sign(Verdict.RIGHT, 0.0, 0.0, 1.0, 1.0)


def test_a_run_that_nothing_is_known_to_compare_with_has_no_shade_and_says_so():
    axes = Figure().add_subplot()
    runs = [Run("", "bar", "buckling", "", x, "linear", word) for x, word in (("1", "warned"), ("2", "refused"))]
    pictures._draw_runs(axes, runs, named=True)
    assert [text.get_text() for text in axes.texts] == ["–"]
    assert to_hex(axes.patches[0].get_facecolor()) == "#ffffff"


def test_runs_shared_among_processes_are_those_of_one(mapped):
    folder, _, _ = mapped
    assert chart(folder, "--records", "two.csv", "--jobs", "2")[2] == 0
    one, two = (RUNS.read(folder / name) for name in ("runs.csv", "two.csv"))
    # All but the time of each run.
    assert [repr(replace(run, seconds=0.0)) for run in one] == [repr(replace(run, seconds=0.0)) for run in two]


def test_what_is_recorded_is_not_run_again(mapped):
    folder, _, _ = mapped
    text = (folder / "runs.csv").read_text(encoding="utf-8")
    lines = text.splitlines(keepends=True)
    # Interrupted while it wrote its last line.
    (folder / "broken.csv").write_text("".join(lines[:-1]) + lines[-1][:20], encoding="utf-8")
    assert chart(folder, "--records", "broken.csv")[2] == 0
    before, after = (RUNS.read(folder / name) for name in ("runs.csv", "broken.csv"))
    assert [run.key for run in after] == [run.key for run in before]
    assert (folder / "broken.csv").read_text(encoding="utf-8").splitlines()[:-1] == text.splitlines()[:-1]


def test_records_of_another_scene_are_refused(mapped):
    folder, _, _ = mapped
    (folder / "other.toml").write_text(SCENE.replace("10e3", "9e3"), encoding="utf-8")
    _, err, code = chart(folder, "--records", "runs.csv", scene="other.toml")
    assert code == 1
    assert "another body or scene" in err


def test_runs_of_other_code_are_not_continued(mapped, monkeypatch):
    folder, _, _ = mapped
    (digest,) = {run.digest for run in RUNS.read(folder / "runs.csv")}
    monkeypatch.setattr("flexfmu.study.records.code_digest", lambda module: f"not {module}")
    with pytest.raises(StabilityError, match=r"made by other code.*now not flexfmu\.study\.stability\.maps"):
        RecordFile(RUNS, folder / "runs.csv", digest)


def test_a_linear_beam_misses_as_much_of_its_deflection_as_it_is_pressed(mapped):
    folder, _, _ = mapped
    for share in ("0.05", "0.6"):
        (run,) = found(folder, "buckling", x=share, y="linear")
        assert run.error == pytest.approx(float(share), rel=0.02)
    # The moment (3) alone buckles at 0.81 of the critical load: at 0.6 of it the deflection is far too large.
    (moment,) = found(folder, "buckling", x="0.6", y="4 × half rotation")
    assert moment.error > 0.3
    assert moment.verdict == "warned"
    assert [run.verdict for run in found(folder, "buckling", y="linear")] == ["right", "warned", "warned"]
    assert [run.verdict for run in found(folder, "buckling", y="4 × frames stiffness")][:2] == ["right", "right"]


def test_the_linear_beams_error_under_an_end_moment_is_that_against_an_arc(mapped):
    folder, _, _ = mapped
    arc = np.array([2.0 / np.pi - 1.0, 2.0 / np.pi])
    expected = np.linalg.norm(arc - [0.0, np.pi / 4.0]) / np.linalg.norm(arc)
    (run,) = found(folder, "rotation", x="90", y="linear")
    assert run.error == pytest.approx(expected, rel=0.01)
    assert run.verdict == "warned"
    assert [run.verdict for run in found(folder, "rotation", y="4 × frames")] == ["right", "right"]


def test_explicit_coupling_is_right_at_a_soft_spring_and_refused_at_a_stiff_one(mapped):
    folder, _, _ = mapped
    for scheme in ("jacobi", "gauss_seidel"):
        soft, stiff = found(folder, "coupling", scheme)
        assert soft.verdict == "right"
        assert soft.measure < 0.05
        assert stiff.verdict == "refused"
        assert stiff.measure > 10.0
        # Soon, not after thousands of internal steps.
        assert stiff.taken < 30
    mean = found(folder, "coupling", "iterated, mean")
    assert {run.verdict for run in mean} == {"right"}
    assert max(run.error for run in mean) < 0.02


@pytest.mark.parametrize(
    ("error", "warned", "refused", "expected"),
    [
        (0.05, False, False, Verdict.RIGHT),
        (0.5, False, False, Verdict.SILENT),
        (float("nan"), False, False, Verdict.SILENT),
        (0.5, True, False, Verdict.WARNED),
        (0.05, True, True, Verdict.REFUSED),
    ],
)
def test_what_is_wrong_and_not_told_is_wrong_in_silence(error, warned, refused, expected):
    assert verdict(error, warned, refused, 0.1) is expected


def test_maps_without_meaning_for_a_cut_body_are_left_out_with_the_reason(tmp_path):
    text = 'maps = ["buckling"]'
    scene = (DEMO / "rear_axle" / "stability.toml").read_text(encoding="utf-8")
    head, _, tail = scene.partition("maps = ")
    (tmp_path / "scene.toml").write_text(head + text + tail[tail.index("\n") :], encoding="utf-8")
    out, err, code = chart(tmp_path, "--records", "runs.csv", body=DEMO / "rear_axle" / "body.toml")
    assert code == 0, err
    assert out.count("left out") == 1


def test_a_scene_without_loads_is_refused_with_what_to_do(tmp_path):
    scene = '[[static]]\nname = "a"\nloads = { "body.acceleration.x" = 1.0 }\n'
    (tmp_path / "scene.toml").write_text(scene, encoding="utf-8")
    _, err, code = chart(tmp_path, "--records", "runs.csv")
    assert code == 1
    assert "add one" in err


def test_a_file_that_holds_no_runs_is_refused(tmp_path):
    (tmp_path / "runs.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    with pytest.raises(StabilityError, match="expected the columns"):
        RUNS.read(tmp_path / "runs.csv")
