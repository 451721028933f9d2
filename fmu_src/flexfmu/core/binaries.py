"""The compiled core of this and other platforms, as an FMU carries them."""

import atexit
import shutil
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from ..files.basics import PackagingError
from ..files.outputs import Reporter
from ..files.store import default_folder
from .building import PLATFORMS, WEB_CORE, compile_core, source_hash, this_platform, zig_compiler
from .library import SHIPPED, library_path


def core_binaries(platforms: Sequence[str] = (), report: Reporter | None = None) -> dict[str, bytes]:
    """Cores by file name, "linux64.so" for one.

    Parameters
    ----------
    platforms : sequence of str
        Names of `building.PLATFORMS`, or "all"; default: this machine's, and those that came with the installation.
    report : Reporter, optional

    Returns
    -------
    dict of str to bytes

    Raises
    ------
    PackagingError
        An unknown platform, or one for which there is no core and no compiler.
    """
    for name in platforms:
        if name not in PLATFORMS and name != "all":
            raise PackagingError(f"platform {name!r}: expected some of all, {', '.join(PLATFORMS)}")
    if not platforms:
        here = this_platform()
        cores = {here: library_path()} | {name: path for name in PLATFORMS if (path := _shipped(name)).is_file()}
    else:
        wanted = PLATFORMS if "all" in platforms else dict.fromkeys(platforms)
        cores = {name: _core_for(name, report or Reporter()) for name in wanted}
    return {f"{name}{PLATFORMS[name].ending}": path.read_bytes() for name, path in cores.items()}


def web_core() -> bytes:
    """The core as WebAssembly, for pages; PackagingError where C files have changed since."""
    core = WEB_CORE.read_bytes()
    if source_hash().encode() not in core:
        found = f"{WEB_CORE} was compiled from other C files than these; renew it"
        raise PackagingError(f"{found}: pip install ziglang (some 400 MB), python {WEB_CORE.with_name('building.py')}")
    return core


def _shipped(name: str) -> Path:
    """Where a wheel has the core of a platform."""
    return SHIPPED / f"{name}{PLATFORMS[name].ending}"


def _core_for(name: str, report: Reporter) -> Path:
    """The core of a platform as any machine of the kind runs it: shipped, or compiled by pip's zig when first asked."""
    if _shipped(name).is_file():
        return _shipped(name)
    platform = PLATFORMS[name]
    made = (default_folder() or _until_exit()) / "cores" / source_hash()[:16] / f"{name}{platform.ending}"
    if made.is_file():
        return made
    zig = zig_compiler()
    if zig is None and name == this_platform():
        found = f"the core for {name} is the one compiled for this machine"
        report.warning(f"{found}; older systems may refuse it: pip install ziglang for one that runs with glibc 2.17")
        return library_path()
    if zig is None:
        raise PackagingError(
            f"no core for {name} in this installation, and no compiler for it: pip install ziglang (some 400 MB, "
            "needed only to build; flexfmu[platforms]), or install flexfmu from a wheel that has all platforms"
        )
    made.parent.mkdir(parents=True, exist_ok=True)
    with report.stage(f"Compile the core for {name}"):
        try:
            compile_core(made, zig, platform.targets)
        except RuntimeError as error:
            raise PackagingError(f"the core for {name} does not compile: {error}") from error
    return made


@cache
def _until_exit() -> Path:
    """A folder for those who keep nothing."""
    folder = tempfile.mkdtemp(prefix="flexfmu-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)
