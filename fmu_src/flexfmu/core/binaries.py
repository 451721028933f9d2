"""The compiled core of this and other platforms, as an FMU or a wheel carries them."""

import os
import struct
import subprocess
from collections.abc import Sequence
from pathlib import Path

from ..errors import PackagingError
from .building import TARGETS, compile_core, source_hash, this_platform, zig_compiler
from .library import library_path

SHIPPED = Path(__file__).parent / "binaries"
"""Where a wheel keeps the cores of other platforms."""
# Of Mach-O: a file of several architectures, and what each of them is called in its head.
_FAT_MAGIC, _FAT_ALIGNMENT = 0xCAFEBABE, 14
_MACH_HEAD = struct.Struct("<III")


def core_binaries(platforms: Sequence[str] = ()) -> dict[str, bytes]:
    """Cores by file name, "linux64.so" for one.

    Parameters
    ----------
    platforms : sequence of str
        Of `building.TARGETS`, or "all"; default: this machine's, and those that came with the installation.

    Returns
    -------
    dict of str to bytes
        Both architectures of macOS in one file.

    Raises
    ------
    PackagingError
        An unknown platform, or one for which there is no core and no compiler.
    """
    here = this_platform()
    shipped = {path.stem: path for path in sorted(SHIPPED.glob("*")) if path.stem in TARGETS}
    wanted = (
        list(TARGETS) if "all" in platforms else [*platforms] or [here, *(name for name in shipped if name != here)]
    )
    cores: dict[str, bytes] = {}
    for name in dict.fromkeys(_expanded(wanted)):
        if name == here:
            cores[name + TARGETS[name][1]] = library_path().read_bytes()
        else:
            path = shipped.get(name) or _made(name)
            cores[path.name if path.stem == name else name + TARGETS[name][1]] = path.read_bytes()
    return _joined(cores)


def _expanded(platforms: Sequence[str]) -> list[str]:
    """Names of targets; "darwin64" are both of macOS."""
    result = []
    for name in platforms:
        known = ["darwin64-x86", "darwin64-arm"] if name == "darwin64" else [name]
        for target in known:
            if target not in TARGETS:
                offered = ", ".join(["all", "darwin64", *TARGETS])
                raise PackagingError(f"platform {name!r}: expected some of {offered}")
        result += known
    return result


def _cache() -> Path:
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return folder / "flexfmu" / "cores" / source_hash()[:16]


def _made(name: str) -> Path:
    """The core for another platform, compiled by pip's zig when it is first asked for."""
    target, ending = TARGETS[name]
    path = _cache() / f"{name}{ending}"
    if path.is_file():
        return path
    zig = zig_compiler()
    if zig is None:
        raise PackagingError(
            f"no core for {name} in this installation, and no compiler for it: pip install ziglang (some 400 MB, "
            "needed only to build), or install flexfmu from a wheel"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        compile_core(path, zig, target)
    except subprocess.CalledProcessError as error:
        raise PackagingError(f"the core for {name} does not compile: {error.stderr}") from error
    return path


def _joined(cores: dict[str, bytes]) -> dict[str, bytes]:
    """Both architectures of macOS as one file."""
    parts = [name for name in cores if name.startswith("darwin64-")]
    if not parts:
        return cores
    head = struct.pack(">II", _FAT_MAGIC, len(parts))
    offset, body = 1 << _FAT_ALIGNMENT, b""
    for name in parts:
        data = cores.pop(name)
        _, kind, subkind = _MACH_HEAD.unpack_from(data)
        head += struct.pack(">IIIII", kind, subkind, offset + len(body), len(data), _FAT_ALIGNMENT)
        body += data + b"\0" * (-len(data) % (1 << _FAT_ALIGNMENT))
    cores["darwin64.dylib"] = head.ljust(1 << _FAT_ALIGNMENT, b"\0") + body
    return cores
