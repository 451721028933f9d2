"""The modal file: what comes back, what is refused."""

import io
import os
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from bodies import LINEAR, beam_body, random_body, unsealed, with_second_order
from flexfmu.files.basics import ModalFileError
from flexfmu.model.arrays import ARRAYS, SECOND_BITS, is_single, short
from flexfmu.model.methods import Mass, Method
from flexfmu.model.modal_file import SCHEMA_VERSION, read_modal_file, write_modal_file
from flexfmu.model.reduced_body import GROUND, GROUPS, ReducedBody, SecondOrder, StressSet, Surface
from flexfmu.program.compile import compile_program


def with_surface(body):
    rng = np.random.default_rng(9)
    surface = Surface(
        points=rng.standard_normal((5, 3)),
        faces=np.array([[0, 1, 2, 3], [1, 2, 4, 4]]),
        modes=rng.standard_normal((5, 3, body.mode_count)),
        frame=np.array([0, 0, 1, 2, GROUND]),
    )
    return replace(body, surface=surface)


BODIES = {
    "tree": random_body(method=LINEAR, velocity_outputs=True, provenance={"mesh": "ä.inp", "flexfmu": "1"}),
    "without frames": beam_body(0),
    "with a surface": with_surface(random_body()),
    "of second order": with_second_order(random_body()),
}


def assert_same(a, b):
    for field in fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if isinstance(x, np.ndarray):
            assert x.dtype == y.dtype, field.name
            np.testing.assert_array_equal(x, y, err_msg=field.name)
        elif isinstance(x, Surface | SecondOrder):
            assert_same(x, y)
        else:
            assert x == y, field.name


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "body.h5"
    write_modal_file(BODIES["with a surface"], path)
    return path


def datasets(path):
    """All datasets by path."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item.dtype}) if isinstance(item, h5py.Dataset) else None)
    return found


@pytest.mark.parametrize("kind", BODIES)
def test_a_body_comes_back_bit_by_bit(tmp_path, kind):
    path = tmp_path / "body.h5"
    write_modal_file(BODIES[kind], path)
    assert_same(BODIES[kind], read_modal_file(path))
    assert_same(BODIES[kind], read_modal_file(io.BytesIO(path.read_bytes())))


@pytest.mark.parametrize("kind", BODIES)
def test_the_same_body_gives_the_same_bytes(tmp_path, kind):
    for name in ("a.h5", "b.h5"):
        write_modal_file(BODIES[kind], tmp_path / name)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_another_body_gives_other_bytes(tmp_path):
    write_modal_file(BODIES["tree"], tmp_path / "a.h5")
    changed = np.array(BODIES["tree"].damping_ratio)
    changed[2] = np.nextafter(changed[2], 1.0)
    write_modal_file(replace(BODIES["tree"], damping_ratio=changed), tmp_path / "b.h5")
    assert (tmp_path / "a.h5").read_bytes() != (tmp_path / "b.h5").read_bytes()


def test_symmetric_matrices_are_kept_as_triangles(tmp_path):
    body = with_second_order(random_body())
    write_modal_file(body, tmp_path / "body.h5")
    m = body.mode_count
    with h5py.File(tmp_path / "body.h5", "r+") as content:
        kept = content["second/rotation"]
        assert kept.shape == (*body.second.rotation.shape[:2], m * (m + 1) // 2)
        np.testing.assert_array_equal(kept[..., m * (m + 1) // 2 - m :], body.second.rotation[..., -1, :])
        del content["second/rotation"]
        content["second/rotation"] = np.zeros((*body.second.rotation.shape[:2], m * (m + 1) // 2 + 1))
    with unsealed(tmp_path / "body.h5"):
        pass
    with pytest.raises(ModalFileError, match="no triangle"):
        read_modal_file(tmp_path / "body.h5")


def test_every_dataset_states_its_unit_and_its_meaning(file):
    names = datasets(file)
    assert len(names) >= 17
    with h5py.File(file) as content:
        for name in names:
            assert content[name].attrs["unit"], name
            assert content[name].attrs["description"].startswith("("), name
        assert content["modes/angular_frequency"].attrs["unit"] == "rad/s"
        assert content.attrs["schema_version"] == SCHEMA_VERSION
        assert "global" in content.attrs["frame_convention"]


def test_arrays_that_were_read_cannot_be_written_to(file):
    with pytest.raises(ValueError, match="read-only"):
        read_modal_file(file).angular_frequency[0] = 1.0


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ModalFileError, match=r"nothing\.h5: no such file"):
        read_modal_file(tmp_path / "nothing.h5")


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_truncated_file_is_refused(file, share):
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ModalFileError, match=r"body\.h5"):
        read_modal_file(file)


def test_a_file_that_is_no_hdf5_is_refused(file):
    file.write_text("time,force\n0,1\n")
    with pytest.raises(ModalFileError, match=r"not a readable modal file.*build it again"):
        read_modal_file(file)


def test_a_foreign_hdf5_file_is_refused(tmp_path):
    path = tmp_path / "foreign.h5"
    with h5py.File(path, "w") as file:
        file["mass"] = np.eye(3)
    with pytest.raises(ModalFileError, match="not a flexfmu modal file"):
        read_modal_file(path)


@pytest.mark.parametrize("version", [0, SCHEMA_VERSION - 1, SCHEMA_VERSION + 1, 99])
def test_an_unknown_schema_version_is_refused_by_number(file, version):
    with unsealed(file) as content:
        content.attrs["schema_version"] = version
    with pytest.raises(ModalFileError, match=f"schema version {version}.*reads version {SCHEMA_VERSION}"):
        read_modal_file(file)


def test_an_altered_value_is_refused_whichever_dataset_it_stands_in(file):
    whole = file.read_bytes()
    changed = 0
    for name, dtype in datasets(file).items():
        file.write_bytes(whole)
        with unsealed(file) as content:
            values = content[name][()]
            flat = values.reshape(-1)
            if dtype.kind == "S":
                flat[0] = b"x" + flat[0][1:]
            elif dtype.kind == "f":
                flat[0] = np.nextafter(flat[0], np.inf)
            else:
                flat[0] = flat[0] + 1 if flat[0] < 0 else 0 if flat[0] else 1
            content[name][...] = values
        with pytest.raises(ModalFileError):
            read_modal_file(file)
        changed += 1
    assert changed >= 17
    file.write_bytes(whole)
    read_modal_file(file)


@pytest.mark.parametrize(
    ("attribute", "value"),
    [
        ("name", "other"),
        ("method", "linear"),
        ("velocity_outputs", True),
        ("method", "magic"),
        ("mass", "configuration"),
        ("mass", "lumped"),
        ("compliance_interfaces", np.array([1.0, 2.0])),
    ],
)
def test_an_altered_attribute_is_refused(file, attribute, value):
    with unsealed(file) as content:
        content.attrs[attribute] = value
    with pytest.raises(ModalFileError):
        read_modal_file(file)


def test_an_altered_origin_is_refused(file):
    with unsealed(file) as content:
        content["provenance"].attrs["seed"] = "another"
    with pytest.raises(ModalFileError, match="checksum"):
        read_modal_file(file)


@pytest.mark.parametrize("name", ["modes/angular_frequency", "interfaces/name", "frames/rotation", "provenance"])
def test_a_file_that_lacks_a_part_is_refused(file, name):
    with unsealed(file) as content:
        del content[name]
    with pytest.raises(ModalFileError, match="not a readable modal file"):
        read_modal_file(file)


def test_damage_is_refused_before_hdf5_looks_at_it(file, monkeypatch):
    """Its library reads some damaged files for ever."""
    whole = file.read_bytes()
    monkeypatch.setattr(h5py, "File", None)
    for place in range(512, len(whole), 401):
        damaged = bytearray(whole)
        damaged[place] ^= 1
        with pytest.raises(ModalFileError, match="its bytes are not those that were written"):
            read_modal_file(io.BytesIO(bytes(damaged)))


def test_any_flipped_byte_is_refused_or_changes_nothing(file):
    # Some bytes are padding; what matters is that no other body is ever read, and no other kind of error seen.
    whole, original = file.read_bytes(), read_modal_file(file)
    rng = np.random.default_rng(10)
    refused = 0
    for position in rng.integers(0, len(whole), 150):
        damaged = bytearray(whole)
        damaged[position] ^= 0xFF
        try:
            body = read_modal_file(io.BytesIO(bytes(damaged)))
        except ModalFileError:
            refused += 1
        else:
            assert_same(original, body)
    assert refused > 20


def test_a_write_that_fails_leaves_no_file(tmp_path, monkeypatch):
    def fail(*_args, **_keywords):
        raise OSError("disk full")

    monkeypatch.setattr("flexfmu.model.modal_file._write", fail)
    with pytest.raises(OSError, match="disk full"):
        write_modal_file(BODIES["tree"], tmp_path / "body.h5")
    assert list(tmp_path.iterdir()) == []


def test_a_write_that_fails_keeps_the_file_that_was_there(file, monkeypatch):
    before = file.read_bytes()

    def fail(*_args, **_keywords):
        raise OSError("disk full")

    monkeypatch.setattr("flexfmu.model.modal_file._write", fail)
    with pytest.raises(OSError, match="disk full"):
        write_modal_file(BODIES["tree"], file)
    assert file.read_bytes() == before
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_size_grows_with_modes_interfaces_and_frames_alone(tmp_path):
    def size(body):
        write_modal_file(body, tmp_path / "size.h5")
        return (tmp_path / "size.h5").stat().st_size

    def numbers(body):
        m, i, s = body.mode_count, body.interface_count, body.frame_count
        return 2 * m + i * (4 + 6 * m) + s * (4 + 9 * m)

    small, large = random_body(modes=6), random_body(modes=200)
    per_number = (size(large) - size(small)) / (numbers(large) - numbers(small))
    assert per_number == pytest.approx(8.0, rel=0.02)
    # What HDF5 itself takes.
    assert size(small) - 8 * numbers(small) < 40_000


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"angular_frequency": np.array([3.0, 2.0, 4.0, 5.0, 6.0, 7.0])}, "ascending"),
        ({"angular_frequency": np.array([-1.0, 2.0, 4.0, 5.0, 6.0, 7.0])}, "not negative"),
        ({"angular_frequency": np.zeros(6)}, "rigid motions only"),
        ({"angular_frequency": np.array([1e-310, 2.0, 4.0, 5.0, 6.0, 7.0])}, "is 1e-310 to 7 rad/s, expected"),
        ({"angular_frequency": np.array([1.0, 2.0, 4.0, 5.0, 6.0, 1e200])}, "is 1 to 1e.200 rad/s, expected"),
        ({"angular_frequency": np.array([np.nan, 2.0, 4.0, 5.0, 6.0, 7.0])}, "angular_frequency.*not finite"),
        ({"damping_ratio": np.full(6, -0.1)}, "damping_ratio"),
        ({"damping_ratio": np.zeros(5)}, r"damping_ratio has shape \(5,\), expected \(6,\)"),
        ({"interface_names": ("a", "a", "b")}, "differ"),
        ({"frame_parent": np.array([-1, 1, 0, 0, 0])}, "earlier frame"),
        ({"frame_parent": np.array([-2, 0, 0, 0, 0])}, "earlier frame"),
        ({"interface_frame": np.array([0, 1, 5])}, "interface_frame"),
        ({"frame_rotation": np.zeros((5, 3, 4))}, "frame_rotation has shape"),
    ],
)
def test_a_body_against_physics_is_refused(change, words):
    with pytest.raises(ModalFileError, match=words):
        random_body(**change)


def test_a_body_without_modes_is_refused():
    empty = np.zeros(0)
    with pytest.raises(ModalFileError, match="no modes"):
        ReducedBody(
            "b", empty, empty, ("tip",), np.zeros((1, 3)), np.zeros((1, 3, 0)), np.zeros((1, 3, 0)), np.array([-1])
        )


def with_parts():
    """A body that holds every part there is, of random numbers."""
    rng = np.random.default_rng(11)
    body = random_body()
    m, i, s = body.mode_count, body.interface_count, body.frame_count
    sizes = {
        "m": m,
        # Pairs of two slow coordinates, and these as well.
        "p": 3,
        "t": 5,
        "I": i,
        "S": s,
        "L": 6 * i + 3,
        "K": s + i + 2 + 2 * 4,
        "P": 2,
        "T": 4,
        "k": 3,
        "Q": 5,
        "B": 2,
    }
    sizes |= {"w": 3, "v": 2, "n": 5, "g": 2, "f": 2, "r": 4, "R": 3, "d": 6, "b": 6, "G": 3, "N": 8}

    def made(entry):
        shape = [int(token) if token.isdigit() else sizes[token] for token in entry.shape.split()]
        if entry.kind is str:
            return tuple(f"name_{k}" for k in range(shape[0]))
        return rng.integers(0, s, shape) if entry.kind is int else np.abs(rng.standard_normal(shape))

    # Two groups, and one of no stretches.
    given = {"membrane": {"extent": np.array([1, 2, 3]), "rows": np.array([2, 0, 1])}}
    parts = {
        part: kind(**{e.name: made(e) for e in ARRAYS[part]} | given.get(part, {})) for part, kind in GROUPS.items()
    }
    optional = {entry.name: made(entry) for entry in ARRAYS["body"] if entry.optional}
    stresses = tuple(StressSet(name, *(made(entry) for entry in ARRAYS["stress"])) for name in ("a", "b"))
    return replace(body, stress_sets=stresses, method=Method.FRAMES, mass=Mass.CONFIGURATION, **parts, **optional)


def test_every_part_comes_back_bit_by_bit_and_cannot_be_written_to(tmp_path):
    body = with_parts()
    write_modal_file(body, tmp_path / "body.h5")
    again = read_modal_file(tmp_path / "body.h5")
    assert (again.method, again.mass) == (Method.FRAMES, Mass.CONFIGURATION)
    for part in GROUPS:
        for entry in ARRAYS[part]:
            before, after = (getattr(getattr(one, part), entry.name) for one in (body, again))
            np.testing.assert_array_equal(before, after, err_msg=entry.path)
            if entry.kind is not str:
                assert not after.flags.writeable, entry.path
    for before, after in zip(body.stress_sets, again.stress_sets, strict=True):
        assert before.name == after.name
        np.testing.assert_array_equal(before.stress, after.stress)
    found = datasets(tmp_path / "body.h5")
    listed = [entry.path for entry in ARRAYS["body"]] + [entry.path for part in GROUPS for entry in ARRAYS[part]]
    assert set(found) == {*listed, *(f"stress/00{k}_{'ab'[k]}/{e.path}" for k in range(2) for e in ARRAYS["stress"])}


@pytest.mark.parametrize("part", GROUPS)
def test_a_part_of_another_body_is_refused_by_its_array(part):
    body = with_parts()
    refused = 0
    for entry in ARRAYS[part]:
        value = getattr(getattr(body, part), entry.name)
        for axis, token in enumerate(entry.shape.split()):
            if entry.kind is not str and token not in ("P", "T", "n", "f", "k"):
                # One too many along an axis whose size others tell.
                longer = np.concatenate([value, value.take([-1], axis)], axis)
                with pytest.raises(ModalFileError, match=f"{part}: .* has shape"):
                    replace(body, **{part: replace(getattr(body, part), **{entry.name: longer})})
                refused += 1
    assert refused > 0


@pytest.mark.parametrize("part", GROUPS)
def test_numbers_that_are_not_finite_are_refused_in_every_part(part):
    body = with_parts()
    for entry in ARRAYS[part]:
        if entry.kind is float:
            value = np.array(getattr(getattr(body, part), entry.name))
            value.flat[-1] = np.nan
            with pytest.raises(ModalFileError, match=f"{part}: {entry.name} holds values that are not finite"):
                replace(body, **{part: replace(getattr(body, part), **{entry.name: value})})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "first", "count"),
    [
        ("truncation", 20000, 300),
        ("flip", 0, 150),
        ("forged", 0, 8),
        pytest.param("forged", 8, 22, marks=pytest.mark.slow),
    ],
)
def test_files_that_were_cut_altered_or_forged_are_refused_or_harmless(kind, first, count):
    """Forged ones have a right checksum, and what is read of them is stepped. More: benchmarks/altered_files."""
    script = Path(__file__).parents[1] / "modal_fuzzer.py"
    command = [sys.executable, str(script), kind, str(first), str(count)]
    variables = os.environ | {"PYTHONPATH": str(script.parent)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=variables)
    assert done.returncode == 0, "\n".join(done.stderr.splitlines()[-30:])
    refused, worked = (int(word) for word in done.stdout.splitlines()[-1].split())
    assert refused + worked == count
    # What is damaged behind the seal is refused; a seal that is none leaves the file to the other checks.
    assert (worked > 0 and refused > count // 4) if kind == "forged" else refused > 0.9 * count


@pytest.mark.parametrize("name", ["interfaces/name", "frames/name"])
def test_names_that_are_no_list_are_refused(file, name):
    with unsealed(file) as content:
        names = content[name][()]
        del content[name]
        content[name] = names[None]
    with pytest.raises(ModalFileError, match=f"{name} has shape .* expected a list of names"):
        read_modal_file(file)


def test_numbers_that_overflow_in_a_method_are_refused_when_its_program_is_made():
    body = with_second_order(random_body())
    displacement = body.joint_displacement.copy()
    displacement[1, 0, 0] = 1e308
    body = replace(body, joint_displacement=displacement)
    with np.errstate(all="ignore"), pytest.raises(ModalFileError, match="beyond the arithmetic in method"):
        compile_program(body, Method.SECOND_ORDER)


def test_numbers_of_second_order_pack_well_and_are_off_by_their_last_bit_at_most():
    """What stiff modes have counts by their motions of unit energy; round-off of what is none goes."""
    rng, omega = np.random.default_rng(5), np.array([0.0, 0.0, 1e3, 3e3, 2e4, 9e5, 4e6])
    unit = np.maximum(omega, 1e3)
    exact = rng.standard_normal((4, 3, 7, 7)) * np.outer(unit, unit) / np.outer(unit, unit)[2, 2]
    exact[0], exact[1, :, 4:] = 0.0, 1e-14 * exact[1, :, 4:]
    exact = exact + exact.swapaxes(-1, -2)
    for bits in SECOND_BITS:
        found = short(exact, omega, bits)
        by_energy, off = (np.abs(one) / np.outer(unit, unit) for one in (exact, found - exact))
        # Scales are powers of two.
        assert np.all(off <= 4.0 * 2.0**-bits * by_energy.max(axis=(-2, -1), keepdims=True))
        assert off.max() > 0.0
        np.testing.assert_array_equal(found, found.swapaxes(-1, -2))
        assert not np.any(found[1, :, 4:, 4:])
        np.testing.assert_array_equal(found[0], 0.0)
    assert is_single(short(exact, omega, SECOND_BITS[True]))
