"""The FMU as masters see it: validity, isolation, equality with the body, statuses, states; of both exports."""

import ast
import hashlib
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodies import LINEAR, Beam, beam_body, random_body
from flexfmu.body.flexible_body import FlexibleBody, StepLimits
from flexfmu.core.interface import VERSION
from flexfmu.files.basics import ContentsError, PackagingError
from flexfmu.fmu import python_slave
from flexfmu.fmu.description import Runtime
from flexfmu.fmu.package import core_binaries, package_fmu
from flexfmu.fmu.reading import read_packaged_body
from flexfmu.model.modal_file import write_modal_file
from flexfmu.study.stability import BodyPrograms
from masters import description, entries, master, motion
from turns import exponential

STEP = 1e-3
PUSH = {"tip.force.x": -2e3, "tip.force.y": 8e3, "tip.moment.z": 300.0}
OK, DISCARD, ERROR, FATAL = 0, 2, 3, 4
# Of a call that is not honoured: pythonfmu's library knows nothing between discarding and giving up.
REFUSED = {Runtime.NATIVE: ERROR, Runtime.PYTHON: FATAL}


@pytest.fixture(scope="module", params=list(Runtime), ids=lambda runtime: runtime.value)
def runtime(request):
    """Each export."""
    return request.param


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmus")


@pytest.fixture(scope="module")
def tree(folder, runtime):
    """Body and FMU of the random tree, with velocities."""
    model = random_body(velocity_outputs=True)
    path = folder / f"tree_{runtime.value}.fmu"
    package_fmu(model, path, runtime)
    return model, str(path)


@pytest.fixture(scope="module")
def beam(folder, runtime):
    """Body and FMU of the beam."""
    model = beam_body(3, modes=3)
    path = folder / f"beam_{runtime.value}.fmu"
    package_fmu(model, path, runtime)
    return model, str(path)


def package_name(path, runtime):
    """Name of the Python package inside; of a native export there is none to be mixed up."""
    return entries(path)["resources/slavemodule.txt"].decode() if runtime is Runtime.PYTHON else object()


# The archive.


def test_the_validator_finds_no_problem(beam, tree):
    assert [master("validate", one[1]) for one in (beam, tree)] == [[], []]


def test_the_same_body_gives_the_same_bytes(tmp_path, beam, runtime):
    package_fmu(beam_body(3, modes=3), tmp_path / "again.fmu", runtime)
    assert (tmp_path / "again.fmu").read_bytes() == Path(beam[1]).read_bytes()


def test_another_body_gives_another_package_name_and_guid(tmp_path, beam, runtime):
    changed = np.array(beam[0].damping_ratio)
    changed[0] = np.nextafter(changed[0], 1.0)
    package_fmu(replace(beam[0], damping_ratio=changed), tmp_path / "other.fmu", runtime)
    assert package_name(tmp_path / "other.fmu", runtime) != package_name(beam[1], runtime)
    assert description(tmp_path / "other.fmu").get("guid") != description(beam[1]).get("guid")


def test_another_core_gives_another_package_name_and_guid(tmp_path, beam, runtime, monkeypatch):
    def altered(platforms, _report):
        return {name: data + b"\0" for name, data in core_binaries(platforms).items()}

    monkeypatch.setattr("flexfmu.fmu.package.core_binaries", altered)
    package_fmu(beam[0], tmp_path / "other.fmu", runtime)
    assert package_name(tmp_path / "other.fmu", runtime) != package_name(beam[1], runtime)
    assert description(tmp_path / "other.fmu").get("guid") != description(beam[1]).get("guid")


@pytest.mark.parametrize(("name", "words"), [("beam.zip", "ends in .fmu"), ("nowhere/beam.fmu", "does not exist")])
def test_a_wrong_ending_or_folder_is_refused_and_leaves_nothing(tmp_path, beam, name, words):
    with pytest.raises(PackagingError, match=words):
        package_fmu(beam[0], tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_an_fmu_that_cannot_be_written_leaves_nothing(tmp_path, beam, monkeypatch):
    def fail(part, data):
        with part.open("wb") as file:
            file.write(data[: len(data) // 2])
        raise OSError("disk full")

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(PackagingError, match="disk full"):
        package_fmu(beam[0], tmp_path / "beam.fmu")
    assert list(tmp_path.iterdir()) == []


def test_the_body_can_be_read_back_out_of_its_fmu(tmp_path, tree):
    read = read_packaged_body(Path(tree[1]))
    np.testing.assert_array_equal(read.frame_rotation, tree[0].frame_rotation)
    assert read.interface_names == tree[0].interface_names
    write_modal_file(tree[0], tmp_path / "tree.h5")
    assert read_packaged_body(tmp_path / "tree.h5").frame_names == read.frame_names


def test_archives_that_are_no_such_fmu_are_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "other.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", "<x/>")
    with pytest.raises(PackagingError, match="made by flexfmu"):
        read_packaged_body(tmp_path / "other.fmu")
    with pytest.raises(PackagingError, match="no such file"):
        read_packaged_body(tmp_path / "nothing.fmu")


@pytest.mark.parametrize("name", ["resources/modal.h5", "resources/body.prog", "modelDescription.xml"])
def test_an_fmu_with_a_file_of_another_one_is_not_read(tmp_path, beam, runtime, name):
    other = replace(beam[0], damping_ratio=2.0 * beam[0].damping_ratio + 0.01)
    package_fmu(other, tmp_path / "other.fmu", runtime)
    mixed = entries(beam[1]) | {name: entries(tmp_path / "other.fmu")[name]}
    with zipfile.ZipFile(tmp_path / "mixed.fmu", "w") as archive:
        for entry, data in mixed.items():
            archive.writestr(entry, data)
    with pytest.raises(ContentsError, match=r"mixed\.fmu: .* of two FMUs are mixed"):
        read_packaged_body(tmp_path / "mixed.fmu")


def test_an_fmu_of_another_version_is_not_taken_for_mixed_files(tmp_path, beam):
    files = entries(beam[1])
    name = "resources/body.prog"
    assert int.from_bytes(files[name][8:16], "little") == VERSION
    files[name] = files[name][:8] + (VERSION - 1).to_bytes(8, "little") + files[name][16:]
    with zipfile.ZipFile(tmp_path / "older.fmu", "w") as archive:
        for entry, data in files.items():
            archive.writestr(entry, data)
    with pytest.raises(ContentsError, match=r"older\.fmu: its programs were built by another version .*build it again"):
        read_packaged_body(tmp_path / "older.fmu")


def test_travelling_code_imports_the_standard_library_alone():
    found = set()
    for node in ast.walk(ast.parse(Path(python_slave.__file__).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {name.name.split(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            found.add(node.module.split(".")[0])
    assert "ctypes" in found
    assert found <= sys.stdlib_module_names


def test_a_native_fmu_holds_neither_python_nor_anything_for_it(beam, runtime):
    endings = {Path(name).suffix for name in entries(beam[1])}
    assert {".xml", ".h5", ".prog"} <= endings
    assert (".py" in endings) == (runtime is Runtime.PYTHON)


# The model description.


def test_every_quantity_has_its_si_unit(tree):
    root = description(tree[1])
    units = {unit.get("name"): unit.find("BaseUnit").attrib for unit in root.find("UnitDefinitions")}
    assert units["N"] == {"kg": "1", "m": "1", "s": "-2"}
    assert units["N.m"] == {"kg": "1", "m": "2", "s": "-2"}
    assert units["rad/s"] == {"rad": "1", "s": "-1"}
    expected = {
        "force": "N",
        "moment": "N.m",
        "displacement": "m",
        "rotation": "rad",
        "velocity": "m/s",
        "angular_velocity": "rad/s",
    }
    seen = set()
    for variable in root.find("ModelVariables"):
        seen_by_master = variable.get("causality") in ("input", "output")
        quantity = variable.get("name").split(".")[1] if seen_by_master else None
        if quantity in expected:
            assert variable.find("Real").get("unit") == expected[quantity]
            seen.add(quantity)
        if variable.find("Real") is not None and variable.find("Real").get("unit"):
            assert variable.find("Real").get("unit") in units
    assert seen == set(expected)


def test_outputs_do_not_depend_on_inputs_within_a_step(tree):
    unknowns = list(description(tree[1]).find("ModelStructure/Outputs"))
    assert len(unknowns) == 3 * 12
    assert all(unknown.get("dependencies") == "" for unknown in unknowns)


def test_inputs_start_at_zero_and_outputs_are_calculated(tree):
    variables = description(tree[1]).find("ModelVariables")
    inputs = [v for v in variables if v.get("causality") == "input"]
    outputs = [v for v in variables if v.get("causality") == "output"]
    assert len(inputs) == 18
    assert all(v.find("Real").get("start") == "0.0" for v in inputs)
    assert all(v.get("initial") == "calculated" and v[0].get("start") is None for v in outputs)
    assert [v.get("valueReference") for v in variables] == [str(k) for k in range(len(variables))]


def test_velocities_are_offered_only_when_asked_for(tree, beam):
    names = [[v.get("name") for v in description(path).find("ModelVariables")] for _, path in (tree, beam)]
    assert "port_0.velocity.x" in names[0]
    assert "port_2.angular_velocity.z" in names[0]
    assert not [name for name in names[1] if "velocity" in name]


# Motion.


def test_outputs_are_those_of_the_body(beam):
    found = master("trajectory", beam[1], PUSH, STEP, 30)
    flexible = FlexibleBody(beam[0])
    loads, state = (
        flexible.loads({"tip": tuple(PUSH.get(f"tip.{q}.{a}", 0.0) for q in ("force", "moment") for a in "xyz")}),
        flexible.rest(),
    )
    rows = [motion(flexible, state)]
    for _ in range(30):
        state, work = flexible.step_with_work(state, loads, STEP)
        rows.append(motion(flexible, state))
    np.testing.assert_allclose(found["rows"], rows, rtol=0, atol=1e-14)
    assert np.max(np.abs(rows)) > 0.1
    np.testing.assert_allclose(found["energies"], flexible.energies(state), rtol=1e-12)
    assert found["integers"] == [0, work.substeps, work.iterations]
    assert found["frame"] == [pytest.approx(flexible.largest_rotation(state), rel=1e-12)]


def test_an_fmu_runs_from_any_working_directory(beam, tmp_path):
    here = master("trajectory", beam[1], PUSH, STEP, 3)
    assert master("trajectory", beam[1], PUSH, STEP, 3, folder=tmp_path) == here
    assert master("trajectory", beam[1], PUSH, STEP, 3, folder="/") == here


@pytest.mark.slow
def test_velocities_are_the_rates_of_displacements_and_rotations(tree):
    step = 1e-5
    loads = {"port_0.force.x": 400.0, "port_1.force.y": -300.0, "port_2.moment.z": 200.0}
    found = master("trajectory", tree[1], loads, step, 3000)
    names, rows = found["names"], np.array(found["rows"])

    def signal(quantity):
        return rows[:, [names.index(f"port_{k}.{quantity}.{a}") for k in range(3) for a in "xyz"]]

    velocity = (signal("displacement")[2:] - signal("displacement")[:-2]) / (2.0 * step)
    size = np.max(np.abs(signal("velocity")))
    np.testing.assert_allclose(signal("velocity")[1:-1], velocity, atol=2e-5 * size)
    # Ṙ Rᵀ at the middle of each pair of steps.
    turns = exponential(signal("rotation").reshape(-1, 3, 3))
    rate = (turns[2:] - turns[:-2]) / (2.0 * step) @ np.swapaxes(turns[1:-1], -1, -2)
    angular = np.stack([rate[..., 2, 1], rate[..., 0, 2], rate[..., 1, 0]], axis=-1).reshape(-1, 9)
    size = np.max(np.abs(signal("angular_velocity")))
    np.testing.assert_allclose(signal("angular_velocity")[1:-1], angular, atol=2e-5 * size)
    assert np.max(np.abs(signal("rotation"))) > 0.1


def test_loads_set_before_the_start_give_a_static_start_when_asked_for(beam):
    loads = {"tip.force.x": -2e3, "tip.force.y": 8e3}
    found = master("trajectory", beam[1], loads, STEP, 20, {"initialization": "static"})
    flexible = FlexibleBody(beam[0])
    expected = motion(flexible, flexible.static({"tip": (-2e3, 8e3, 0.0)}))
    rows = np.array(found["rows"])
    np.testing.assert_allclose(rows[0], expected, rtol=0, atol=1e-14)
    # In equilibrium it stays.
    np.testing.assert_allclose(rows, np.broadcast_to(expected, rows.shape), atol=1e-9)
    assert np.linalg.norm(expected) > 0.1
    np.testing.assert_array_equal(master("trajectory", beam[1], loads, STEP, 1)["rows"][0], 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "body"),
    [
        ({"method": "linear"}, lambda m: FlexibleBody(m, LINEAR)),
        ({"method": "half_rotation"}, lambda m: FlexibleBody(m, "half_rotation")),
        ({"damping.scale": 4.0}, lambda m: FlexibleBody(m, damping_scale=4.0)),
        ({"internal_step.limit": 1e-4}, lambda m: FlexibleBody(m, limits=StepLimits(1e-4))),
        ({"internal_step.tolerance": 1e-8}, lambda m: FlexibleBody(m, limits=StepLimits(0.0, 1e-8))),
    ],
    ids=["linear", "half rotation", "damping", "step limit", "tolerance"],
)
def test_parameters_do_what_they_say(tree, settings, body):
    loads = {"port_0.force.x": 300.0, "port_1.force.y": -200.0}
    usual = {"watch.steps_missed.limit": 0.0}
    found = np.array(master("trajectory", tree[1], loads, 5e-3, 8, usual | settings)["rows"])[:, :18]
    flexible = body(tree[0])
    plain = FlexibleBody(tree[0])
    ends = []
    for one in (flexible, plain):
        state, forces = one.rest(), one.loads({"port_0": (300.0, 0, 0), "port_1": (0, -200.0, 0)})
        for _ in range(8):
            state = one.step(state, forces, 5e-3)
        ends.append(motion(one, state))
    np.testing.assert_allclose(found[-1], ends[0], rtol=0, atol=1e-13)
    assert np.max(np.abs(ends[0] - ends[1])) > 1e-7


# Several at once.


def test_instances_side_by_side_have_states_of_their_own(beam):
    other = {"tip.force.z": 3e3}
    ends = master("side_by_side", [[beam[1], PUSH], [beam[1], other], [beam[1], PUSH]], STEP, 10)
    alone = [master("trajectory", beam[1], loads, STEP, 10)["rows"][-1] for loads in (PUSH, other)]
    assert ends == [alone[0], alone[1], alone[0]]


@pytest.mark.slow
def test_different_bodies_in_one_process_do_not_mix(beam, tree):
    jobs = [[beam[1], PUSH], [tree[1], {"port_1.force.x": 50.0}]]
    alone = [master("trajectory", path, loads, STEP, 10)["rows"][-1] for path, loads in jobs]
    assert master("side_by_side", jobs, STEP, 10) == alone
    assert master("side_by_side", jobs[::-1], STEP, 10) == alone[::-1]


def renamed_copy(path, copy, edit):
    """The FMU with other travelling code, under the name that its contents give it."""
    package = package_name(path, Runtime.PYTHON).removesuffix("_slave")
    changed = "flexfmu_" + hashlib.sha256(package.encode()).hexdigest()[:16]
    with zipfile.ZipFile(copy, "w") as archive:
        for name, data in entries(path).items():
            if name.endswith((".py", ".txt")):
                text = data.decode()
                if name.endswith(f"{package}/python_slave.py"):
                    text, before = edit(text), text
                    assert text != before
                data = text.replace(package, changed).encode()
            archive.writestr(name.replace(package, changed), data)


def test_fmus_with_different_versions_of_the_code_in_one_process_do_not_mix(tmp_path):
    # The copy's code gives values times ten.
    path, copy = tmp_path / "beam.fmu", tmp_path / "copy.fmu"
    package_fmu(beam_body(3, modes=3), path, Runtime.PYTHON)
    plain = 'partialmethod(_get, "Real", ctypes.c_double, float)'
    tenfold = plain.replace("float", "lambda value: 10.0 * value")
    renamed_copy(path, copy, lambda text: text.replace(plain, tenfold))
    jobs = [[str(one), PUSH] for one in (path, copy, path)]
    first, second, third = (np.array(end) for end in master("side_by_side", jobs, STEP, 10))
    np.testing.assert_allclose(second, 10.0 * first, rtol=1e-15)
    np.testing.assert_array_equal(third, first)
    assert np.linalg.norm(first[:3]) > 1e-3


# Failures.


def test_a_wrong_value_of_a_parameter_fails_the_call_and_says_what_is_offered(beam, runtime):
    found = master("wrong_start", beam[1], {"method": "100% magic", "damping.scale": 2.0})
    assert found["failed"] == [["method", REFUSED[runtime]]]
    status, category, text = found["log"][0]
    assert (status, category) == (3, "logStatusError")
    # Whole, although masters take log lines for printf formats.
    assert "'100% magic'" in text
    assert "method" in text
    assert "'frames'" in text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"damping.scale": -1.0}, "damping.scale is -1, expected a finite number of at least 0"),
        ({"internal_step.tolerance": 0.0}, "tolerance is 0, expected a finite number of at least 1e-14"),
        ({"internal_step.most": 0.5}, "internal_step.most is 0.5, expected a finite number of at least 1"),
        ({"initialization": "static", "tip.force.x": -1e300}, "no stable equilibrium"),
        ({"initialization": "static", "tip.force.x": -100.0 * Beam().critical_load}, "no stable equilibrium"),
    ],
)
def test_a_start_that_cannot_be_fails_the_call_and_says_why(beam, runtime, settings, words):
    found = master("wrong_start", beam[1], settings)
    assert found["failed"] == [["start", REFUSED[runtime]]]
    assert words in found["log"][0][2]
    assert found["log"][0][1] == "logStatusError"


def test_after_a_failed_call_an_instance_can_still_be_asked_and_freed(beam):
    # The library would use freed memory here, and end the master's process, if the slave did not see to it.
    found = master("wrong_start", beam[1], {"method": "magic", "initialization": "magic"})
    assert [name for name, _ in found["failed"]] == ["method", "initialization"]
    # Values that were refused have changed nothing.
    assert found["status"] == 0
    assert found["freed"]


@pytest.mark.parametrize(
    ("name", "value", "kept"),
    [("damping.scale", 9.0, 1.0), ("initialization", "static", "rest"), ("method", "linear", "frames")],
)
def test_a_parameter_set_too_late_keeps_its_value_and_warns(beam, name, value, kept):
    found = master("late_parameter", beam[1], name, value)
    assert found["value"] == kept
    assert found["log"] == [
        [1, "logStatusWarning", f"{name} is fixed once initialisation has ended; it keeps its value"]
    ]


@pytest.mark.parametrize("wrong", ["nan", "inf", "-inf"])
def test_an_input_that_is_not_finite_discards_the_step_and_the_next_one_recovers(beam, wrong):
    found = master("wrong_input", beam[1], "tip.force.y", wrong, 4000.0, STEP)
    assert found["status"] == DISCARD
    assert found["unchanged"]
    assert found["code"] == 1
    (line,) = found["log"]
    assert line[:2] == [DISCARD, "logStatusDiscard"]
    assert line[2].startswith(f"input tip.force.y is {wrong}")
    assert found["recovered"]
    assert found["moves"]
    # The status stays, for masters that overlook a discarded step.
    assert found["codes"] == [1, 0]
    assert found["beyond"] == DISCARD
    assert found["sound"]


def test_without_logging_refusals_alone_are_told_until_the_master_switches_them_off(beam, runtime):
    # pythonfmu's library tells none; tests/fmi/test_plain_fmpy.py has what the slave does instead.
    told = [[DISCARD, "logStatusDiscard"]] if runtime is Runtime.NATIVE else []
    assert master("quiet", beam[1], "tip.force.y") == [[DISCARD, told], [DISCARD, []]]


def test_wrong_steps_are_discarded_and_a_step_of_no_length_does_nothing(beam):
    found = master("wrong_step", beam[1], ["nan", "inf", "-1e-3", "0"])
    assert found == {"statuses": [DISCARD, DISCARD, DISCARD, OK], "unchanged": True}


# States.


@pytest.mark.parametrize("which", ["beam", "tree"])
def test_a_state_replays_bit_by_bit_also_from_bytes_and_in_another_instance(which, beam, tree):
    path, loads = {"beam": (beam[1], PUSH), "tree": (tree[1], {"port_0.force.x": 300.0, "port_1.force.y": -200.0})}[
        which
    ]
    found = master("replay", path, loads, 4e-3, 20)
    first, *others = found["ends"]
    assert all(end == first for end in others)
    assert found["back"]
    assert found["same_bytes"]
    assert first[: len(found["here"])] != found["here"]
    assert first[-7:-4] == [3.0, 1e-6, "half_rotation"]


def test_going_back_to_a_state_takes_the_status_back_too(beam):
    assert master("status_in_state", beam[1]) == [1, 0, 1]


def test_a_state_of_another_fmu_is_refused(beam, tree, runtime):
    found = master("foreign_state", beam[1], tree[1])
    assert found["status"] == REFUSED[runtime]
    assert "of another FMU" in found["log"][0][2]
    assert found["unchanged"]


def test_a_reset_instance_starts_anew(beam):
    found = master("resets", beam[1], PUSH, STEP)
    assert found["second"] == found["first"]
    assert found["bare"] == [0.0] * 6
    assert np.linalg.norm(found["first"]) > 1e-3


# Both exports.


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "start"),
    [({}, {}), ({"method": "linear"}, {}), ({"method": "modal_rotation"}, {}), ({}, {"initialization": "static"})],
    ids=["frames", "linear", "modal rotation", "static"],
)
def test_both_exports_give_the_same_to_the_last_bit(tmp_path, settings, start):
    found = []
    for runtime in Runtime:
        path = tmp_path / f"{runtime.value}.fmu"
        package_fmu(beam_body(3, modes=3, damping=0.01, velocity_outputs=True), path, runtime)
        found.append(master("trajectory", str(path), PUSH, STEP, 30, settings | start))
    assert found[0] == found[1]
    assert np.max(np.abs(found[0]["rows"])) > 0.1


def test_the_slave_takes_a_value_for_each_reference_and_no_integers():
    with BodyPrograms(random_body(1)) as programs:
        slave = programs.start()
        with pytest.raises(python_slave.SlaveError, match=r"fmi2SetReal: 1 values for 2 references"):
            slave.set_real([0, 1], [1.0])
        with pytest.raises(python_slave.SlaveError, match="fmi2SetInteger"):
            slave.set_integer([programs.variables["status.code"][0]], [1])
