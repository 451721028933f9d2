"""Results of expensive stages kept from build to build, by content."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import flexfmu
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import InterfaceTable, SupportTable
from flexfmu.files import store as digests
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store, code_digest, content_key, default_folder, imported_modules
from flexfmu.model.modal_file import write_modal_file
from flexfmu.reduction.basis import Matrices
from flexfmu.reduction.options import Basis
from flexfmu.study.scene.reference import by_default
from references import BEAM, body_without_error

SOURCES = Path(flexfmu.__file__).parent.parent


# What follows from modes and frames, and is kept beside them.
FROM_MODES = {"material that is watched", "places at second order", "embedding"}


class Listening(Reporter):
    """Remembers what was said."""

    def __init__(self):
        self.said, self.warned = [], []

    def warning(self, text):
        self.warned.append(text)

    def note(self, text):
        self.said.append(text)

    @property
    def reused(self):
        found = [text.split(":")[0] for text in self.said if "earlier build" in text]
        return [one for one in found if one not in FROM_MODES]


def build(store, residual=False, **changes):
    """The clamped beam, and what of it came from the store."""
    return build_and_listen(store, residual, **changes)[:2]


def build_and_listen(store, residual=False, **changes):
    """The same, and the warnings."""
    config = body_without_error(BEAM / "body.toml")
    reduction = {"residual_flexibility": residual} | changes.pop("reduction", {})
    changes["reduction"] = config.reduction.model_copy(update=reduction)
    listening = Listening()
    return reduce_body(config.model_copy(update=changes), listening, store), listening.reused, listening.warned


def same(first, second):
    return all(
        np.array_equal(getattr(first, name), getattr(second, name))
        for name in ("angular_frequency", "interface_displacement", "frame_rotation")
    )


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "kept")


@pytest.mark.slow
def test_a_second_build_takes_the_modes_and_gives_the_same_body(store):
    first, reused = build(store)
    assert reused == []
    second, reused = build(store)
    assert reused == ["normal modes"]
    assert same(first, second)


@pytest.mark.slow
def test_a_second_build_needs_no_matrices_and_gives_the_same_bytes(tmp_path, store, monkeypatch):
    config = by_default(read_body_file(BEAM / "body.toml"))
    first = reduce_body(config, Reporter(), store)
    monkeypatch.setattr(Matrices, "_factorised", lambda _: pytest.fail("assembled and factorised again"))
    second = reduce_body(config, Reporter(), store)
    assert first.shadow is not None
    assert first.second is not None
    for name, body in (("first", first), ("second", second)):
        write_modal_file(body, tmp_path / f"{name}.h5")
    assert (tmp_path / "first.h5").read_bytes() == (tmp_path / "second.h5").read_bytes()


@pytest.mark.slow
def test_other_interfaces_frames_and_formulations_take_the_same_modes(store):
    build(store)
    middle = InterfaceTable(name="middle", nodes="SEG4")
    for changes in ({"interface": [middle]}, {"frames": 3}):
        body, reused = build(store, **changes)
        assert reused == ["normal modes"]
        fresh, _ = build(Store(None), **changes)
        assert same(body, fresh)


@pytest.mark.slow
def test_what_depends_on_the_interfaces_is_found_again_when_they_change(store):
    build(store, residual=True)
    assert build(store, residual=True)[1] == ["normal modes", "static response"]
    tip = InterfaceTable(name="tip", nodes="TIP", point=[1.0, 0.0, 0.02])
    assert build(store, residual=True, interface=[tip])[1] == ["normal modes"]


@pytest.mark.long
def test_another_support_material_or_number_of_modes_takes_nothing(store):
    build(store)
    hinge = SupportTable(nodes="ROOT", stiffness=[1e9, 1e9, 1e9])
    for changes in ({"support": [hinge]}, {"reduction": {"modes": 9}}, {"reduction": {"basis": Basis.CRAIG_BAMPTON}}):
        assert build(store, **changes)[1] == []
    mesh = read_body_file(BEAM / "body.toml").mesh
    softer = (BEAM / "beam.inp").read_text(encoding="utf-8").replace("7850", "7851")
    path = store.folder / "softer.inp"
    path.write_text(softer, encoding="utf-8")
    assert build(store, mesh=mesh.model_copy(update={"file": path}))[1] == []


@pytest.mark.slow
def test_geometric_stiffness_is_kept_with_its_modes_and_loads(store):
    wanted = {"reduction": {"geometric_stiffness": ["by_load", "by_mode"]}}
    first, _ = build(store, **wanted)
    second, reused = build(store, **wanted)
    assert reused == ["normal modes", "geometric stiffness by load", "geometric stiffness by mode"]
    np.testing.assert_array_equal(first.stiffness_by_load, second.stiffness_by_load)


def kept_entry(store):
    (entry,) = (one for one in store.folder.glob("*.npz") if "angular_frequency" in np.load(one).files)
    return entry


def cut_short(store):
    entry = kept_entry(store)
    entry.write_bytes(entry.read_bytes()[:1000])


def forged(store):
    """Another frequency in an archive that is whole."""
    entry = kept_entry(store)
    with np.load(entry) as content:
        arrays = dict(content)
    arrays["angular_frequency"] = 2.0 * arrays["angular_frequency"]
    with entry.open("wb") as file:
        np.savez(file, **arrays)


def of_another_body(store):
    """A sound entry under a name that is not its own."""
    entry = kept_entry(store)
    other = Store(store.folder / "other")
    build(other, support=[SupportTable(nodes="ROOT", stiffness=[1e7, 1e7, 1e7])])
    kept_entry(other).replace(entry)


@pytest.mark.slow
@pytest.mark.parametrize("harm", [cut_short, forged, of_another_body])
def test_an_entry_that_is_damaged_or_of_something_else_is_made_anew_with_a_warning(store, harm):
    first, _ = build(store)
    harm(store)
    second, reused, warned = build_and_listen(store)
    assert reused == []
    assert [text for text in warned if "damaged" in text]
    assert same(first, second)
    assert build(store)[1] == ["normal modes"]


def forget():
    """Read files and versions anew."""
    for known in (digests._read, digests._installed, digests._versions):
        known.cache_clear()


def read_anew(module):
    """The digest of a module's code as its files are now."""
    forget()
    return code_digest.__wrapped__(f"flexfmu.{module}")


@pytest.fixture
def _forgotten():
    """What was read of files that a test changes is not known to the next one."""
    yield
    forget()


@pytest.mark.slow
@pytest.mark.usefixtures("_forgotten")
def test_other_code_or_libraries_take_nothing(store, monkeypatch):
    build(store)
    assert build(store)[1] == ["normal modes"]
    known, slave = read_anew("reduction.basis"), read_anew("fmu.python_slave")
    plain = Path.read_bytes
    for change in ("mode solver", "library"):
        with monkeypatch.context() as patch:
            if change == "library":
                patch.setattr("importlib.metadata.version", lambda _: "0.0")
            else:
                patch.setattr(Path, "read_bytes", lambda p: plain(p) + b"\nANOTHER = 1" * (p.name == "modes.py"))
            # The slave does not make modes.
            assert change == "library" or read_anew("fmu.python_slave") == slave
            assert read_anew("reduction.basis") != known, change
            patch.setattr("flexfmu.files.store.code_digest", code_digest.__wrapped__)
            assert build(store)[1] == [], change


@pytest.mark.slow
@pytest.mark.parametrize(
    "module",
    [
        "build.reduce",
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("reduction.basis", "study.scene.reference", "study.chart.sweep", "study.stability")
        ),
    ],
)
def test_the_code_of_a_result_is_all_that_its_module_loads(module):
    words = "import sys, flexfmu; before = set(sys.modules); import flexfmu.{0}\n"
    words += "print(*(name for name in set(sys.modules) - before if name.startswith('flexfmu.')))"
    done = subprocess.run([sys.executable, "-c", words.format(module)], capture_output=True, text=True, check=True)
    packages = {name for name in done.stdout.split() if (SOURCES / Path(*name.split(".")) / "__init__.py").is_file()}
    loaded = set(done.stdout.split()) - packages
    assert f"flexfmu.{module}" in loaded
    assert loaded <= imported_modules(f"flexfmu.{module}")


@pytest.mark.usefixtures("_forgotten")
@pytest.mark.parametrize(
    ("file", "before", "after", "counts"),
    [
        ("modes.py", "import numpy", "# A comment.\nimport numpy", False),
        ("modes.py", '"""', '"""Another sentence. ', False),
        ("modes.py", "raise ModelError(", 'raise ModelError("Another message." + ', False),
        ("outputs.py", "class Reporter", "x = 1\n\nclass Reporter", False),
        ("modes.py", "0.5 *", "0.6 *", True),
        ("shapes.py", "(155.0 - root)", "(155.0 + root)", True),
    ],
)
def test_kept_results_hang_on_what_computes_and_on_no_sentence(file, before, after, counts, monkeypatch):
    known = code_digest("flexfmu.reduction.basis")
    plain, changed = Path.read_bytes, []

    def read(path):
        text = plain(path)
        if path.name != file:
            return text
        changed.append(text.replace(before.encode(), after.encode()) != text)
        return text.replace(before.encode(), after.encode(), 1)

    monkeypatch.setattr(Path, "read_bytes", read)
    found = read_anew("reduction.basis")
    assert True in changed
    assert (found != known) == counts


@pytest.mark.usefixtures("_forgotten")
def test_the_hash_of_code_is_kept_until_a_file_changes(tmp_path, monkeypatch):
    monkeypatch.setenv("FLEXFMU_CACHE", str(tmp_path))
    known = code_digest.__wrapped__("flexfmu.files.basics")
    found, plain = [], Path.read_bytes
    monkeypatch.setattr(digests, "_found_digest", lambda module: found.append(module) or "another")
    assert code_digest.__wrapped__("flexfmu.files.basics") == known
    assert found == []
    monkeypatch.setattr(Path, "read_bytes", lambda path: plain(path) + b"\n" * (path.name == "basics.py"))
    forget()
    assert code_digest.__wrapped__("flexfmu.files.basics") == "another"


@pytest.mark.slow
@pytest.mark.usefixtures("_forgotten")
@pytest.mark.parametrize("file", ["step_tied.c", "steps.h", "fields.def"])
def test_the_core_is_part_of_the_code_of_what_it_steps_and_of_no_other(file, monkeypatch):
    """Errors of a sweep hang on every line of C; modes do not."""
    swept, modes = (code_digest(f"flexfmu.{name}") for name in ("study.chart.sweep", "reduction.basis"))
    plain = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: plain(path) + b" " * (path.name == file))
    forget()
    assert code_digest.__wrapped__("flexfmu.study.chart.sweep") != swept
    assert code_digest.__wrapped__("flexfmu.reduction.basis") == modes


def test_a_folder_that_cannot_be_written_is_no_reason_to_fail(tmp_path):
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    body, reused = build(Store(tmp_path / "file" / "below"))
    assert body.mode_count == 10
    assert reused == []


def test_the_longest_unused_entries_make_room(tmp_path, monkeypatch):
    monkeypatch.setattr("flexfmu.files.store._LARGEST", 27_000)
    store = Store(tmp_path)
    for number in range(5):
        store.arrays(content_key("flexfmu.files.store", number), "numbers", Reporter(), lambda: {"x": np.zeros(1000)})
    assert len(list(tmp_path.glob("*.npz"))) == 3


def test_a_large_folder_is_not_looked_through_for_each_small_entry(tmp_path, monkeypatch):
    looked = []
    monkeypatch.setattr(Store, "_make_room", staticmethod(looked.append))
    store = Store(tmp_path)
    for number in range(5):
        store.arrays(content_key("flexfmu.files.store", number), "numbers", Reporter(), lambda: {"x": np.zeros(1000)})
    assert looked == [tmp_path]


def test_the_environment_names_the_folder_or_turns_it_off(monkeypatch, tmp_path):
    monkeypatch.setenv("FLEXFMU_CACHE", str(tmp_path))
    assert default_folder() == tmp_path
    monkeypatch.setenv("FLEXFMU_CACHE", "")
    assert default_folder() is None
    monkeypatch.delenv("FLEXFMU_CACHE")
    assert default_folder().name == "flexfmu"
