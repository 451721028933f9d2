"""What pyproject.toml cannot say: the core in C is compiled into the package."""

import importlib.util
import sys
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

CORE = Path(__file__).parent / "fmu_src" / "flexfmu" / "core"


class BuildCore(build_ext):
    """The core is no Python extension: it knows nothing of Python, and any version loads it."""

    def get_ext_filename(self, fullname: str) -> str:
        """Without the tag of a version of Python."""
        return str(Path(*fullname.split("."))) + {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")

    def build_extension(self, ext: Extension) -> None:
        """Compile by the system's C compiler, or by pip's zig."""
        spec = importlib.util.spec_from_file_location("building", CORE / "building.py")
        assert spec is not None and spec.loader is not None
        building = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(building)
        output = Path(self.get_ext_fullpath(ext.name))
        output.parent.mkdir(parents=True, exist_ok=True)
        building.compile_for_this_machine(output)


setup(ext_modules=[Extension("flexfmu.core._flexcore", [])], cmdclass={"build_ext": BuildCore})
