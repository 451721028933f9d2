"""What pyproject.toml cannot say: the core in C is compiled into the package.

As it comes, for this machine. With FLEXFMU_PLATFORMS=all in the environment a wheel carries the core of every platform
(.ci/build_wheel.py).
"""

import importlib.util
import os
import shutil
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext

_FILE = Path(__file__).parent / "fmu_src" / "flexfmu" / "core" / "building.py"
_spec = importlib.util.spec_from_file_location("building", _FILE)
assert _spec is not None
assert _spec.loader is not None
building = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(building)

EVERYWHERE = os.environ.get("FLEXFMU_PLATFORMS") == "all"
# One wheel serves them all; on any other platform pip compiles.
TAG = "manylinux_2_17_x86_64.manylinux_2_17_aarch64.macosx_11_0_universal2.win_amd64"


class BuildCore(build_ext):
    """The core is no Python extension: it knows nothing of Python, and any version loads it."""

    def get_ext_filename(self, fullname: str) -> str:
        """Without the tag of a version of Python."""
        return str(Path(*fullname.split("."))) + building.PLATFORMS[building.this_platform()].ending

    def build_extension(self, ext: Extension) -> None:
        """Compile by the system's C compiler or by pip's zig; for all platforms always by zig."""
        output = Path(self.get_ext_fullpath(ext.name))
        shipped = output.parent / "binaries"
        if not self.inplace:
            # What an earlier build left would go into the wheel.
            shutil.rmtree(shipped, ignore_errors=True)
            output.unlink(missing_ok=True)
        if self.inplace or self.editable_mode or not EVERYWHERE:
            output.parent.mkdir(parents=True, exist_ok=True)
            building.compile_for_this_machine(output)
            return
        zig = building.zig_compiler()
        if zig is None:
            raise RuntimeError("FLEXFMU_PLATFORMS=all needs zig: pip install ziglang")
        shipped.mkdir(parents=True)
        for name, platform in building.PLATFORMS.items():
            building.compile_core(shipped / f"{name}{platform.ending}", zig, platform.targets)


class CoreWheel(bdist_wheel):
    """A wheel for any Python 3."""

    def get_tag(self) -> tuple[str, str, str]:
        """By platform only."""
        return "py3", "none", TAG if EVERYWHERE else super().get_tag()[2]


setup(
    ext_modules=[Extension("flexfmu.core._flexcore", [])],
    cmdclass={"build_ext": BuildCore, "bdist_wheel": CoreWheel},
)
