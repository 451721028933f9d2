"""The map of stability as a user makes it: run, recorded, resumed, drawn; its truths against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.commands.cli import app
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store
from flexfmu.study import pictures
from flexfmu.study.pictures import draw_map
from flexfmu.study.records import RUNS, RecordFile, Run, verdict
from flexfmu.study.scene.config import SceneError
from flexfmu.study.scene.reference import by_default
from flexfmu.study.scene.whole_model import WholeModel
from flexfmu.study.stability import ESTIMATE, map_stability, mapped_models, planned
from flexfmu.study.workshop import Crew
from scene_tools import Listening, scene_of

pytestmark = pytest.mark.slow

# N, of the clamped beam; N m that turn its end by 90° in linear theory.
CRITICAL, QUARTER_TURN = 33.36e3, 21.24e3
SCENE = f"""
[[static]]
name = "axial"
loads = {{ "tip.force.x" = {-CRITICAL}, "tip.force.y" = 41.0 }}

[[static]]
name = "moment"
loads = {{ "tip.moment.z" = {QUARTER_TURN} }}

[sweep]
frames = [1, 4]
methods = ["linear", "frames"]

[stability]
factors = [0.05, 0.6, 1.0]
"""


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    """A scene with the map of the clamped beam, a few runs, and what was told of it."""
    folder = tmp_path_factory.mktemp("map")
    scene = scene_of(folder, SCENE)
    told = map_stability(scene, folder / "runs.csv", Reporter(), Store())
    draw_map(folder / "runs.csv", folder / "map.png")
    return folder, scene, told


def found(folder, case, factor, model):
    """A run by its place."""
    (run,) = [run for run in RUNS.read(folder / "runs.csv") if run.key == (case, factor, model)]
    return run


def test_nothing_is_wrong_in_silence_and_the_picture_is_drawn(mapped):
    folder, _, told = mapped
    assert told.endswith(" 0 wrong in silence")
    assert (folder / "map.png").stat().st_size > 5000
    assert {run.verdict for run in RUNS.read(folder / "runs.csv")} >= {"right", "warned"}


def test_runs_that_are_planned_are_those_that_are_made_and_they_are_not_made_again(mapped):
    folder, scene, _ = mapped
    wanted = [run.key for model in mapped_models(scene) for run in planned(scene, model)]
    # Linear, frames with one and with four, and the default with its own estimate, at three factors of two cases.
    assert len(wanted) == 30
    assert wanted == [run.key for run in RUNS.read(folder / "runs.csv")]
    report = Listening()
    map_stability(scene, folder / "runs.csv", report, Store())
    assert [(title, left) for title, left, *_ in report.counts] == [("Map of stability", 0)]


def test_what_an_interrupted_run_left_is_continued_by_other_processes_too(mapped):
    folder, scene, _ = mapped
    text = (folder / "runs.csv").read_text(encoding="utf-8")
    lines = text.splitlines(keepends=True)
    (folder / "broken.csv").write_text("".join(lines[:-1]) + lines[-1][:20], encoding="utf-8")
    with Crew(2) as crew:
        map_stability(scene, folder / "broken.csv", Reporter(), Store(), crew)
    one, two = ([replace(run, seconds=0.0) for run in RUNS.read(folder / name)] for name in ("runs.csv", "broken.csv"))
    assert repr(one) == repr(two)
    assert (folder / "broken.csv").read_text(encoding="utf-8").splitlines()[:-1] == text.splitlines()[:-1]


def test_records_of_another_scene_or_of_other_code_are_refused(mapped, monkeypatch):
    folder, scene, _ = mapped
    other = replace(scene, digest="other")
    with pytest.raises(SceneError, match="records of another scene"):
        map_stability(other, folder / "runs.csv", Reporter(), Store())
    owner = RUNS.read(folder / "runs.csv")[0].scene
    monkeypatch.setattr("flexfmu.study.records.code_digest", lambda: "another")
    with pytest.raises(SceneError, match=r"made by other code.*now another"):
        RecordFile(RUNS, folder / "runs.csv", owner)


def test_a_linear_beam_misses_as_much_of_its_deflection_as_it_is_pressed(mapped):
    folder, _, _ = mapped
    for factor in ("0.05", "0.6"):
        assert found(folder, "axial", factor, "linear").error == pytest.approx(float(factor), rel=0.03)
    assert found(folder, "axial", "0.6", "linear").verdict == "warned"
    near = found(folder, "axial", "0.6", "4 × frames")
    assert near.error == pytest.approx(0.019, rel=0.1)
    assert near.verdict == "warned"
    assert found(folder, "axial", "0.05", "4 × frames").verdict == "right"


def test_the_linear_beams_error_under_an_end_moment_is_that_against_an_arc(mapped):
    folder, _, _ = mapped
    turn = 0.6 * 0.5 * np.pi
    arc = np.array([np.sin(turn) / turn - 1.0, (1.0 - np.cos(turn)) / turn])
    expected = np.linalg.norm(arc - [0.0, 0.5 * turn]) / np.linalg.norm(arc)
    run = found(folder, "moment", "0.6", "linear")
    assert run.error == pytest.approx(expected, rel=0.02)
    assert run.verdict == "warned"
    # Material would turn by more than 90°.
    assert found(folder, "moment", "1", "linear").verdict == "refused"
    assert found(folder, "moment", "1", "4 × frames").error < 0.01
    assert found(folder, "moment", "0.6", "4 × frames").verdict == "right"


def test_the_default_beam_knows_its_error_and_says_so_at_its_critical_load(mapped):
    folder, _, _ = mapped
    for case, factor in (("axial", "0.05"), ("axial", "0.6"), ("moment", "0.05")):
        run, told = (found(folder, case, factor, model) for model in ("default", ESTIMATE))
        assert run.error == pytest.approx(told.error, abs=2e-4 if factor == "0.6" else 5e-5)
        assert (run.verdict, told.verdict) == ("right", "right")
    assert found(folder, "axial", "1", ESTIMATE).error > 0.01
    assert found(folder, "axial", "1", ESTIMATE).verdict == "warned"


def test_the_default_beam_tells_by_how_much_a_moment_bends_it_otherwise_than_its_mesh(mapped):
    """The finest model, which the map compares with, misses at third order what the default does."""
    folder, scene, _ = mapped
    (case,) = (one for one in scene.static if one.name == "moment")
    whole = WholeModel(scene, Reporter(), Store()).equilibria(case.model_copy(update={"factors": [0.6, 1.0]}))
    model = FlexibleBody(reduce_body(by_default(scene.config), Reporter(), Store()))
    for factor, expected in zip((0.6, 1.0), whole.motion[:, 0, :3], strict=True):
        moved = model.motion(model.static(case.peak.scaled(factor))).reshape(-1, 6)[0, :3]
        error = np.linalg.norm(moved - expected) / np.linalg.norm(expected)
        told = found(folder, "moment", f"{factor:g}", ESTIMATE)
        assert error > 2e-4
        assert told.error == pytest.approx(error, rel=0.05 if factor == 0.6 else 0.1)
        assert told.verdict == "right"


def test_cells_are_shaded_by_error_and_framed_by_verdict():
    errors = {"0.1": (1e-3, "right"), "0.2": (0.5, "warned"), "0.3": (math.nan, "silent"), "0.4": (0.5, "refused")}
    runs = [Run("", "bar", "bend", x, "linear", word, error) for x, (error, word) in errors.items()]
    panel = Figure().add_subplot()
    pictures._draw_case(panel, runs)
    assert [text.get_text() for text in panel.texts] == ["0.1", "50", "–"]
    light, dark, unknown, refused = (patch.get_facecolor() for patch in panel.patches)
    assert sum(dark[:3]) < sum(light[:3]) < sum(unknown[:3])
    assert panel.patches[3].get_hatch()
    assert refused[0] == refused[1] == refused[2]
    assert len({patch.get_edgecolor() for patch in panel.patches[:3]}) == 3


@pytest.mark.parametrize(
    ("error", "warned", "refused", "expected"),
    [
        (0.05, False, False, "right"),
        (0.5, False, False, "silent"),
        (float("nan"), False, False, "silent"),
        (0.5, True, False, "warned"),
        (0.05, True, True, "refused"),
    ],
)
def test_what_is_wrong_and_not_told_is_wrong_in_silence(error, warned, refused, expected):
    assert verdict(error, warned, refused, 0.1) == expected


def test_a_scene_without_loads_that_hold_still_is_refused_with_what_to_do(tmp_path):
    text = '[[transient]]\nname = "a"\nstep = 1e-3\nduration = 0.1\nloads = { "tip.force.y" = 1.0 }\n'
    with pytest.raises(SceneError, match=r"\[\[static\]\] cases.*add one"):
        map_stability(scene_of(tmp_path, text), tmp_path / "runs.csv", Reporter(), Store())


def test_the_command_draws_records_and_refuses_files_that_hold_none(mapped, tmp_path):
    folder, _, _ = mapped
    arguments = [
        "chart",
        "--stability",
        "--records",
        str(folder / "runs.csv"),
        "--picture",
        str(tmp_path / "again.svg"),
    ]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert (tmp_path / "again.svg").stat().st_size > 5000
    (tmp_path / "runs.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    with pytest.raises(SceneError, match="not records of this version"):
        draw_map(tmp_path / "runs.csv", tmp_path / "again.svg")
