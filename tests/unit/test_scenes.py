"""Scenes: what a file may say, references, and what counts as an error."""

import math

import numpy as np
import pytest

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Method, Variant
from flexfmu.reduction.rigid_fit import rigid_motions
from flexfmu.study.candidates import Reduction
from flexfmu.study.scene.config import BasisChoice, SceneError
from flexfmu.study.scene.reference import equilibria_errors, errors, references, within
from flexfmu.study.scene.scene import read_scene
from flexfmu.study.scene.whole_model import TurningLoad, finite_motion
from flexfmu.study.workshop import Workshop
from references import BEAM, calculix, displacement, relative
from scene_tools import BEND, Listening, scene_of, with_results
from turns import exponential, rotation_vector

# --- what a scene file may say


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"nothing happens in the scene: give a \[\[static\]\]"),
        (BEND.replace("factors", "factor"), r"static\[1\].factor: unknown key, did you mean 'factors'\?"),
        (BEND.replace("0.3, 1.0", "1.0, 0.3"), r"static\[1\].factors: is \[1.0, 0.3\], expected ascending"),
        (BEND.replace("10e3", "0.0"), "all loads are zero"),
        (
            BEND.replace("10e3", '"10e3"'),
            r"static\[1\].loads.tip.force.y: found '10e3'; should be a number without quotes",
        ),
        (BEND.replace("tip.force.y", "tip.force"), r"'tip.force' is no input of the body.*\"tip.force.y\""),
        (BEND.replace("tip.force", "top.force"), "'top.force.y' is no input of the body.*its interfaces: tip"),
        (BEND.replace("tip.force.y", "body.acceleration.z"), r"needs acceleration = true in \[input\]"),
        (BEND + BEND, "two cases have the name 'bend'"),
        ('read = ["top"]\n' + BEND, "read names 'top', and the body has tip"),
        ("loaded = []\n" + BEND, "loads act on tip, which loaded leaves out"),
        ('[[transient]]\nname = "a"\nstep = 1e-3\nloads = { "tip.force.y" = 1.0 }', "needs a duration"),
        (
            '[[transient]]\nname = "a"\nstep = 1e-3\nduration = 1.0\nfrequencies = [0.0, 900.0]\n'
            'loads = { "tip.force.y" = 1.0 }',
            "take steps of 0.000444 s or less",
        ),
        (
            '[[transient]]\nname = "a"\nstep = 1e-3\nduration = 1e9\nloads = { "tip.force.y" = 1.0 }',
            r"has 1e\+12 steps of 0.001 s, expected at most 1e\+06",
        ),
        (
            BEND + "[sweep]\nmodes = [1_000_000_000]",
            r"sweep.modes\[1\]: found 1000000000; .*less than or equal to 1000",
        ),
        (BEND + "[sweep]\nframes = [1_000_000_000]", r"sweep.frames\[1\]: found .*less than or equal to 1000"),
        (BEND + "[reference]\nmodes = 1_000_000_000", r"reference.modes: found .*less than or equal to 1000"),
        (BEND + "[stability]\nperiods = 8.0", "stability.periods: unknown key"),
        (BEND + '[sweep]\nbasis = ["modal"]', r"sweep.basis\[1\]: found 'modal'; should be 'normal'"),
    ],
)
def test_a_wrong_scene_is_refused_with_what_would_do(tmp_path, text, message):
    with pytest.raises(SceneError, match=message):
        scene_of(tmp_path, text)


def test_a_table_of_loads_with_more_steps_than_a_scene_can_have_is_refused_before_they_are_made(tmp_path):
    (tmp_path / "loads.csv").write_text("time,tip.force.y\n0,1\n1e9,1\n", encoding="utf-8")
    with pytest.raises(SceneError, match=r"loads.csv: a duration of 1e\+09 s has 1e\+12 steps"):
        scene_of(tmp_path, '[[transient]]\nname = "a"\nstep = 1e-3\nloads = "loads.csv"\n')


def test_a_damping_ratio_for_each_mode_has_no_meaning_in_a_sweep(tmp_path):
    with pytest.raises(SceneError, match="give one number"):
        scene_of(tmp_path, BEND, changes=[("ratio = 0.01", f"ratio = {[0.01] * 10}")])


def test_interfaces_that_the_scene_does_not_need_are_left_out(tmp_path):
    more = '[[interface]]\nname = "middle"\nnodes = "SEG4"\n\n[reduction]'
    scene = scene_of(tmp_path, 'read = ["tip"]\n' + BEND, changes=[("[reduction]", more)])
    assert scene.names == ("tip",)
    assert len(scene.given.interface) == 2


def test_a_table_of_loads_is_linear_between_rows_and_jumps_where_a_time_comes_twice(tmp_path):
    (tmp_path / "loads.csv").write_text("time,tip.force.y\n0,0\n0.2,2\n0.2,5\n0.4,5\n", encoding="utf-8")
    scene = scene_of(tmp_path, '[[transient]]\nname = "a"\nstep = 0.1\nloads = "loads.csv"\n')
    (case,) = scene.transient
    assert [one.force[0, 1] for one in case.start_loads] == pytest.approx([0.0, 1.0, 5.0, 5.0])
    assert [one.force[0, 1] for one in case.end_loads] == pytest.approx([1.0, 2.0, 5.0, 5.0])


# --- references


@pytest.fixture(scope="module")
def bent(tmp_path_factory, store):
    """The bent beam with its reference by the whole finite element model."""
    scene = scene_of(tmp_path_factory.mktemp("bent"), BEND)
    return scene, references(scene, Reporter(), store)["bend"]


@pytest.mark.slow
def test_the_static_reference_is_what_calculix_finds(bent):
    _, reference = bent
    table = calculix(BEAM / "calculix" / "static_y.csv")
    rows = table[np.isin(table["force_N"], (3e3, 10e3))]
    for found, expected, row in zip(reference.motion[:, 0], displacement(rows), rows, strict=True):
        assert relative(found[:3], expected) < 1e-6
        # Theirs is fitted with equal weights.
        assert found[5] == pytest.approx(row["rz_rad"], rel=1e-3)


def test_the_static_reference_is_kept_by_content(bent, store):
    scene, reference = bent
    listening = Listening()
    again = references(scene, listening, store)["bend"]
    assert any("earlier build" in text for text in listening.notes)
    np.testing.assert_array_equal(again.motion, reference.motion)


def test_the_static_reference_of_a_moment_is_an_arc(tmp_path):
    scene = scene_of(tmp_path, BEND.replace("force.y", "moment.z"))
    found = references(scene, Reporter())["bend"].motion[:, 0]
    turn = found[:, 5]
    assert turn[1] > 0.7
    assert turn[0] == pytest.approx(0.3 * turn[1], rel=1e-3)
    np.testing.assert_allclose(found[:, 0], np.sin(turn) / turn - 1.0, rtol=2e-3)
    np.testing.assert_allclose(found[:, 1], (1.0 - np.cos(turn)) / turn, rtol=2e-3)


def test_a_free_body_is_refused_with_what_to_do(tmp_path):
    scene = scene_of(
        tmp_path,
        BEND,
        changes=[("frames = 8", "free = true"), ('[[support]]\nnodes = "ROOT"\nfix = ["x", "y", "z"]', "")],
    )
    with pytest.raises(SceneError, match=r"free to move.*bring results: results = \"bend.csv\""):
        references(scene, Reporter())


class Section:
    """Unequal weights about a point that is not the centre."""

    nodes = np.arange(9)
    point = np.array([0.3, 0.2, -0.4])

    def __init__(self, random):
        self.points = random.normal(size=(9, 3))
        self.arm = self.points - self.point
        rigid = rigid_motions(self.arm).reshape(-1, 6)
        weight = np.repeat(random.uniform(0.5, 2.0, 9), 3)[:, None]
        self.operator = np.linalg.solve(rigid.T @ (weight * rigid), (weight * rigid).T)


def test_loads_on_a_section_that_turns_far_work_on_its_motion(random):
    section, load = Section(random), random.normal(size=(2, 3))
    turned = TurningLoad(section, section.points, load)
    moved = section.arm @ exponential(np.array([0.9, -1.3, 0.7])).T + 0.1 * random.normal(size=(9, 3))
    there, way = (moved - section.arm).ravel(), 1e-5 * random.normal(size=27)
    (first, _), (_, slope), (last, _) = (turned.force(there + part * way, 2.0) for part in (-1.0, 0.0, 1.0))
    ends = [finite_motion(section, section.points, there + part * way) for part in (-1.0, 1.0)]
    turn = rotation_vector(exponential(ends[1][3:]) @ exponential(ends[0][3:]).T)
    work = load[0] @ (ends[1][:3] - ends[0][:3]) + load[1] @ turn
    assert -(first + last) @ way == pytest.approx(2.0 * work, rel=1e-6)
    np.testing.assert_allclose(slope @ (2.0 * way), last - first, atol=1e-6 * np.abs(last - first).max())


@pytest.mark.slow
def test_a_force_beside_its_nodes_centre_turns_the_section_about_it_as_it_moves(tmp_path):
    """Sixty millimetres beside the beam a force along it bends it by its lever, which the turn takes away again."""
    beside = [('name = "tip"', 'name = "tip"\npoint = [1.0, 0.0, 0.06]')]
    scene = scene_of(tmp_path, BEND.replace("force.y", "force.x").replace("10e3", "60e3"), changes=beside)
    found = references(scene, Reporter())["bend"].motion[:, 0]
    expected = references(scene, Reporter(), solve=False)["bend"].motion[:, 0]
    assert np.abs(found[1, 4]) > 0.05
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(found).max())


def test_the_motion_of_a_section_that_turns_far_is_that_of_its_best_rigid_motion(random):
    section, turn, shift = Section(random), np.array([0.9, -1.3, 0.7]), np.array([3.0, -1.0, 2.0])
    moved = section.point + shift + section.arm @ exponential(turn).T
    found = finite_motion(section, section.points, (moved - section.points).ravel())
    np.testing.assert_allclose(found, np.concatenate([shift, turn]), atol=1e-9)
    assert np.linalg.norm(rotation_vector(exponential(turn)) - turn) < 1e-12


def test_results_of_the_user_s_own_must_give_every_factor(bent_beam, tmp_path):
    known = references(bent_beam, Reporter())["bend"]
    assert known.motion.shape == (2, 1, 6)
    lines = (tmp_path / "results.csv").read_text(encoding="utf-8").splitlines()
    (tmp_path / "results.csv").write_text("\n".join(lines[:-1]) + "\n", encoding="utf-8")
    with pytest.raises(SceneError, match=r"no row for the factor 1\.0 of bend"):
        references(read_scene(tmp_path / "scene.toml", tmp_path / "body.toml"), Reporter())


TRANSIENT = """
[[transient]]
name = "sudden"
loads = { "tip.force.y" = 1e3 }
duration = 0.02
step = 1e-3

[reference]
modes = 6
frames = 4
"""


@pytest.mark.slow
def test_the_reference_over_time_is_closer_to_a_model_of_its_kind_than_to_a_linear_one(tmp_path, store):
    scene = scene_of(tmp_path, TRANSIENT)
    known = references(scene, Reporter(), store)
    body = (
        Workshop(scene, Reporter(), store).build(Reduction(BasisChoice.RESIDUAL, 6, 4), [Variant(Method.FRAMES)]).body
    )
    near = errors(scene, known, FlexibleBody(body))
    far = errors(scene, known, FlexibleBody(body, Method.LINEAR))
    assert near.transient_displacement < 0.3 * far.transient_displacement
    assert math.isnan(near.static_displacement)


def test_only_what_lies_in_the_range_of_frequencies_counts():
    time = np.arange(400) * 1e-3
    slow, fast = np.sin(2 * np.pi * 10.0 * time), np.sin(2 * np.pi * 200.0 * time)
    left = within(slow + fast, (0.0, 50.0), 1e-3)
    assert np.abs(left - slow)[50:-50].max() < 0.01
    assert np.abs(within(slow + fast, (100.0, 300.0), 1e-3) - fast)[50:-50].max() < 0.02


@pytest.mark.parametrize(("absolute", "share"), [(0.0, 2.0), (0.5, 2.0), (4.0, 0.5)])
def test_a_scene_accepts_a_part_of_the_motion_or_a_length_whichever_is_more(tmp_path, absolute, share):
    """Motions 2 % too large where 1 % is accepted, or as a length `absolute` per cent of the largest one."""
    table = calculix(BEAM / "calculix" / "static_y.csv")
    largest = np.linalg.norm(displacement(table[table["force_N"] == 10e3][0]))
    accepted = f"\n[tolerance.static]\ndisplacement = 0.01\ndisplacement_absolute = {0.01 * absolute * largest}\n"
    scene = with_results(tmp_path, accepted)
    known = references(scene, Reporter())["bend"]
    found = equilibria_errors(scene, scene.static[0], 1.02 * known.motion, known)
    assert found.share == pytest.approx(share, rel=1e-6)
    assert found.limited_by.startswith("displacement")
