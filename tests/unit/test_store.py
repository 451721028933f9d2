"""Results of expensive stages kept from build to build, by content."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse

import flexfmu
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import InterfaceTable, SupportTable
from flexfmu.files import store as digests
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store, code_digest, content_key, default_folder
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


@dataclass(frozen=True)
class Holding:
    """Of it a key tells all that it holds."""

    one: object
    other: object = None


def test_a_key_tells_apart_what_holds_other_numbers_deep_within():
    long, changed = np.zeros(5000), np.zeros(5000)
    changed[2500] = 1e-300
    every = [long, changed, scipy.sparse.csr_array(np.eye(3)), scipy.sparse.csr_array(2.0 * np.eye(3)), b"a", b"b"]
    every += (
        [{"a": one} for one in every[:2]] + [(one, 1) for one in every[:2]] + [Holding((one,)) for one in every[:4]]
    )
    every += [Holding(1, (2, 3)), Holding((1, 2), 3), {"a": 1, "b": 2}, {"b": 2, "a": 1}]
    keys = [content_key("module", one) for one in every]
    assert len({*keys}) == len(every)
    assert content_key("module", Holding({"a": long.copy()})) == content_key("module", Holding({"a": long}))


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
@pytest.mark.parametrize("folder", [BEAM, BEAM.parent / "wishbone"], ids=lambda folder: folder.name)
def test_a_second_build_needs_no_matrices_and_gives_the_same_bytes(tmp_path, store, monkeypatch, folder):
    """Nor does it for a body whose supports close a loop, to see whether it is worth a cut."""
    config = by_default(read_body_file(folder / "body.toml"))
    first = reduce_body(config, Reporter(), store)
    monkeypatch.setattr(Matrices, "_factorised", lambda _: pytest.fail("assembled and factorised again"))
    second = reduce_body(config, Reporter(), Store(store.folder))
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
        assert reused == ["normal modes", "frequency spread"]
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


@pytest.fixture
def _forgotten():
    """What was read of files that a test changes is not known to the next one."""
    yield
    forget()


def forget():
    """Read files and versions anew."""
    for known in (code_digest, digests._versions):
        known.cache_clear()


@pytest.mark.usefixtures("_forgotten")
@pytest.mark.parametrize("change", ["modes.py", "step_tied.c", "steps.h", "fields.def", "library"])
def test_other_code_or_libraries_take_nothing(change, store, monkeypatch):
    build(store)
    assert build(store)[1] == ["normal modes"]
    plain = Path.read_bytes
    if change == "library":
        monkeypatch.setattr("importlib.metadata.version", lambda _: "0.0")
    else:
        monkeypatch.setattr(Path, "read_bytes", lambda p: plain(p) + b"\nANOTHER = 1" * (p.name == change))
    forget()
    assert build(store)[1] == []


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
