"""Files being written: nobody else can lay something in their way, and they appear whole with ordinary rights."""

import os
import stat
import sys
from pathlib import Path

import numpy as np
import pytest

from bodies import beam_body
from flexfmu.files.basics import OutputError
from flexfmu.files.outputs import Reporter, check_target, whole_file
from flexfmu.files.store import Store
from flexfmu.fmu.curves import plot_result
from flexfmu.fmu.package import package_fmu
from flexfmu.model.modal_file import write_modal_file


def text(path):
    with whole_file(path) as part:
        part.write_text("new", encoding="utf-8")


def picture(path):
    table = path.with_name("table.csv")
    table.write_text("time,tip.displacement.x\n0,0\n1,1\n", encoding="utf-8")
    plot_result(table, path)


WRITERS = {
    "text.csv": text,
    "picture.png": picture,
    "beam.fmu": lambda path: package_fmu(beam_body(2), path),
    "beam.h5": lambda path: write_modal_file(beam_body(2), path),
    "key.npz": lambda path: Store(path.parent).arrays("key", "it", Reporter(), lambda: {"a": np.ones(3)}),
}


@pytest.mark.skipif(os.name != "posix", reason="links and rights are those of POSIX")
@pytest.mark.parametrize("name", WRITERS)
def test_a_link_laid_beforehand_is_not_followed(name, tmp_path):
    folder, victim = tmp_path / "results", tmp_path / "victim"
    folder.mkdir()
    victim.write_text("kept", encoding="utf-8")
    # The name of a temporary file as someone would guess it who knows the target and the process.
    for guess in (f".{name}.{os.getpid()}.part", f"{name}.part", f".{name}.tmp"):
        (folder / guess).symlink_to(victim)
    (folder / name).symlink_to(victim)
    WRITERS[name](folder / name)
    assert victim.read_text(encoding="utf-8") == "kept"
    assert not (folder / name).is_symlink()
    assert (folder / name).stat().st_size > 0
    # As any new file, not for the user alone.
    expected = 0o666 & ~_umask()
    assert stat.S_IMODE((folder / name).stat().st_mode) == expected
    assert not [path for path in folder.iterdir() if path.is_dir()]


def _umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask


@pytest.mark.skipif(os.name != "posix", reason="rights are those of POSIX")
def test_a_file_is_written_where_only_its_owner_may_write(tmp_path):
    with whole_file(tmp_path / "result.csv") as part:
        assert stat.S_IMODE(part.parent.stat().st_mode) == 0o700
        assert not part.exists()
        part.touch()


def test_a_file_that_is_not_finished_leaves_the_one_before_it(tmp_path):
    target = tmp_path / "result.csv"
    target.write_text("old", encoding="utf-8")

    def fail():
        with whole_file(target) as part:
            part.write_text("half", encoding="utf-8")
            raise OSError("disk full")

    with pytest.raises(OutputError, match="cannot be written"):
        fail()
    assert [(path.name, path.read_text(encoding="utf-8")) for path in tmp_path.iterdir()] == [("result.csv", "old")]


@pytest.mark.skipif(sys.platform != "linux", reason="a folder in which nobody may make files")
def test_a_folder_that_takes_no_files_is_found_before_the_work():
    with pytest.raises(OutputError, match="the folder /proc cannot be written to"):
        check_target(Path("/proc/body.fmu"), (".fmu",))
