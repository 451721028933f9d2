"""The smallest model that a scene allows."""

import io
import tomllib

import numpy as np
import pytest
from rich.console import Console

from flexfmu.build import reduce_body
from flexfmu.config import read_body_file
from flexfmu.info import describe
from flexfmu.progress import Reporter
from flexfmu.runtime.body import FlexibleBody
from flexfmu.runtime.loads import Loads
from flexfmu.runtime.reduced_body import Formulation, Kinematics, LoadPlacement, Mass, Stiffness
from flexfmu.scenes.body_text import body_text
from flexfmu.scenes.candidates import Reduction, reduction_config, with_modes
from flexfmu.scenes.config import BasisChoice
from flexfmu.scenes.fit import fit
from flexfmu.scenes.fitting.motion import contributions
from flexfmu.scenes.fitting.subspace import subset
from flexfmu.scenes.sweep import Workshop
from flexfmu.store import Store
from references import BEAM, DEMO, calculix, displacement, relative
from scene_tools import BEND, SMALL_SWEEP, Listening, calculix_results, scene_of, with_results


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return Store(tmp_path_factory.mktemp("kept"))


@pytest.fixture
def brought(tmp_path):
    """The bent beam, its results brought, and few combinations."""
    return with_results(tmp_path, SMALL_SWEEP)


def test_a_body_with_some_of_its_modes_is_the_one_that_is_reduced_to_them(bodies):
    every = {"geometric_stiffness": ["by_load", "by_mode"], "inertia": True}
    config = bodies.config(BEAM)
    many, few = (
        reduce_body(
            config.model_copy(
                update={"frames": 2, "reduction": config.reduction.model_copy(update={"modes": n, **every})}
            ),
            Reporter(),
        )
        for n in (8, 4)
    )
    kept = with_modes(many, np.arange(4))
    load = Loads(np.array([[500.0, 3e3, 1e3]]), np.zeros((1, 3)))
    for formulation in (
        Formulation(stiffness=Stiffness.BY_LOAD),
        Formulation(Kinematics.LINEAR, LoadPlacement.REFERENCE, Stiffness.BY_MODE),
        Formulation(mass=Mass.CONFIGURATION),
    ):
        models = [FlexibleBody(body, formulation) for body in (kept, few)]
        states = [model.step(model.static(load), load.scaled(0.5), 1e-3) for model in models]
        motions = [model.motion(state) for model, state in zip(models, states, strict=True)]
        np.testing.assert_allclose(*motions, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    ("basis", "residual"),
    [*((basis, []) for basis in BasisChoice), (BasisChoice.RESIDUAL, ["tip.moment.z", "tip.force.y"])],
    ids=["normal", "residual", "craig_bampton", "residual of two loads"],
)
def test_modes_chosen_in_the_body_file_make_the_body_that_many_modes_are_reduced_to(bodies, basis, residual):
    config = bodies.config(BEAM)

    def build(modes):
        reduction = reduction_config(config, Reduction(basis, 12, 2), [Formulation(stiffness=Stiffness.BY_LOAD)])
        table = reduction.reduction.model_copy(update={"modes": modes, "inertia": True})
        if residual and isinstance(modes, list):
            table = table.model_copy(update={"residual_flexibility": residual})
        return reduce_body(reduction.model_copy(update={"reduction": table}), Reporter())

    listed = build([1, 2, 5, 6])
    kept = subset(build(12), basis, np.array([0, 1, 4, 5]), residual)
    np.testing.assert_allclose(kept.angular_frequency, listed.angular_frequency, rtol=1e-7)
    assert listed.provenance["normal_modes"] == "1 2 5 6"
    loads = {"tip": [500.0, 3e3, 1e3, 20.0, 30.0, 40.0]}
    for formulation in (Formulation(stiffness=Stiffness.BY_LOAD), Formulation(mass=Mass.CONFIGURATION)):
        models = [FlexibleBody(body, formulation) for body in (kept, listed)]
        motions = [model.motion(model.step(model.static(loads), {"tip": [0.0, 1e3, 0.0]}, 1e-3)) for model in models]
        np.testing.assert_allclose(*motions, rtol=1e-7, atol=1e-10)
    if basis is BasisChoice.NORMAL:
        hertz = FlexibleBody(build(6)).model.angular_frequency[[0, 1, 4, 5]]
        np.testing.assert_allclose(listed.angular_frequency, hertz, rtol=1e-7)


def test_chosen_modes_come_from_the_store_whatever_is_chosen(tmp_path, bodies):
    config, store = bodies.config(BEAM), Store(tmp_path)

    def build(modes):
        listening = Listening()
        reduction = config.reduction.model_copy(update={"modes": modes})
        reduce_body(config.model_copy(update={"reduction": reduction}), listening, store)
        return listening

    assert not any("earlier build" in text for text in build(6).notes)
    again = build([1, 2, 5, 6])
    assert any("normal modes: taken from an earlier build" in text for text in again.notes)
    assert not again.warnings
    assert any("take both modes or none" in text for text in build([1, 6]).warnings)


def test_info_counts_modes_as_a_body_file_names_them(bodies):
    config = bodies.config(BEAM)
    reduction = config.reduction.model_copy(update={"modes": [1, 2, 5, 6]})
    body = reduce_body(config.model_copy(update={"reduction": reduction}), Reporter())
    console = Console(record=True, width=100, file=io.StringIO())
    for part in describe(body):
        console.print(part)
    shown = [line.split()[1] for line in console.export_text().splitlines() if line.startswith("│") and "0.01" in line]
    assert shown == ["1", "2", "5", "6"]


def test_modes_across_the_load_move_nothing(brought, store):
    body = Workshop(brought, Reporter(), store).reduce(Reduction(BasisChoice.NORMAL, 6, 2), [Formulation()])[0]
    part = contributions(brought, body, Formulation())
    assert part.max() > 0.9
    # The other of each pair bends across; the square section holds their axes to some digits.
    assert np.sum(part < 1e-4) == 3


def test_a_body_file_that_is_written_says_what_was_meant(tmp_path):
    config = read_body_file(DEMO / "rear_axle" / "body_bushings.toml")
    reduction = Reduction(BasisChoice.RESIDUAL, 7, 3)
    wanted = reduction_config(config, reduction, [Formulation()])
    text = body_text(wanted, tmp_path, ["A line.", "Another " + 40 * "long " + "line."], {"frames": "Why three."})
    (tmp_path / "b.toml").write_text(text, encoding="utf-8")
    assert tomllib.loads(text)["frames"] == 3
    assert "# Why three.\nframes = 3" in text
    found = read_body_file(tmp_path / "b.toml")
    assert found.mesh.file.resolve() == config.mesh.file.resolve()
    assert (found.support, found.interface, found.reduction.modes) == (wanted.support, wanted.interface, 7)
    assert found.reduction.residual_flexibility
    assert found.formulation == wanted.formulation


def static_error(body_file, force):
    """Error of a body file's model of the beam against CalculiX under a tip force (N)."""
    table = calculix(BEAM / "calculix" / "static_y.csv")
    row = table[table["force_N"] == force]
    body = FlexibleBody(reduce_body(read_body_file(body_file), Reporter()))
    found = body.response(body.static({"tip": [0.0, force, 0.0]})).displacement[0]
    return relative(found, displacement(row)[0])


FIT = """
[tolerance.static]
displacement = 0.005

[sweep]
modes = [10]
frames = [8]
"""


def test_a_large_load_is_given_frames_and_holds_where_it_was_not_looked_at(tmp_path, store):
    scene = scene_of(tmp_path, BEND + FIT)
    target = tmp_path / "fitted.toml"
    found = fit(scene, target, Reporter(), store)
    assert found.met
    assert found.measured.share <= 1.0
    assert found.measured.share == pytest.approx(found.predicted.share, rel=0.02)
    assert 2 <= found.frame_count <= 4
    assert found.mode_count < 10
    assert found.step < 2.0 * found.given_step
    for force in (2e3, 5e3, 8e3):
        assert static_error(target, force) < 0.005
    text = target.read_text(encoding="utf-8")
    assert "Linear is not enough" in text
    assert "predicted" in text
    assert tomllib.loads(text)["formulation"]["kinematics"] == "corotated"


def test_a_small_load_is_left_linear(tmp_path, store):
    scene = scene_of(tmp_path, BEND.replace("10e3", "200.0") + FIT)
    target = tmp_path / "fitted.toml"
    found = fit(scene, target, Reporter(), store)
    assert found.met
    assert found.formulation.kinematics is Kinematics.LINEAR
    assert found.plan.frames == 0
    assert "Linear is enough" in target.read_text(encoding="utf-8")


def test_what_is_out_of_reach_is_said_with_what_limits_it(tmp_path, store):
    body = DEMO / "clamped_clamped" / "body.toml"
    results = calculix_results(tmp_path, body.parent / "calculix" / "static_y.csv", 200e3, (0.5, 1.0), "middle")
    case = BEND.replace("tip", "middle").replace("10e3", "200e3").replace("0.3", "0.5") + results
    scene = scene_of(tmp_path, case + FIT.replace("[8]", "[3]"), body)
    found = fit(scene, tmp_path / "fitted.toml", Reporter(), store)
    assert not found.met
    assert "Neither more modes nor more frames help" in found.limit
    assert "membrane" in (tmp_path / "fitted.toml").read_text(encoding="utf-8")


def test_frames_are_named_where_they_are_what_is_missing(tmp_path, store):
    scene = with_results(tmp_path, FIT.replace("[8]", "[1]"))
    found = fit(scene, tmp_path / "fitted.toml", Reporter(), store)
    assert not found.met
    assert "Most is to be had from frames (2 instead of 1)" in found.limit
    assert found.formulation.kinematics is Kinematics.COROTATED
