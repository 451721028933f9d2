"""How the core is compiled: one command a platform, by the system's C compiler or by pip's `ziglang`.

Nothing is imported from the package: setup.py runs this file before there is one. Run as a script, it renews the core
of pages, `web.wasm`, which goes with the sources.
"""

import hashlib
import os
import platform
import re
import shutil
import struct
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

FOLDER = Path(__file__).parent
# Nobody reads errno or floating-point exceptions. Fused operations would make results hang on the processor.
FLAGS = ("-std=c99", "-O3", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off", "-fvisibility=hidden")

# What other files see: functions and constants that headers declare, and those of FMI.
_GLOBAL = re.compile(r"^(?:(?!static|typedef|#)[A-Za-z_][\w *]*[ *]|FMI_EXPORT .*?)(\w+)(?:\(|\[\w*\];)", re.MULTILINE)
# Those of FMI 3.0, some of which a macro defines.
_CALLS_3 = re.compile(r"\bfmi3(?:Get|Set|Enter|Exit|Evaluate|Update|Completed|Activate)\w+")

# Of Mach-O: a file of several architectures, where each begins, and where a library says what it is for.
_FAT_MAGIC, _FAT_ALIGNMENT, _MACH_HEAD = 0xCAFEBABE, 14, struct.Struct("<III")


class Platform(NamedTuple):
    """What libraries of a platform are made of."""

    targets: tuple[str, ...]
    """Of zig; several come into one file."""
    ending: str


# By the folder's name in an FMU of FMI 2.0, which names the first three; the last is FMI 3.0's name.
PLATFORMS = {
    "linux64": Platform(("x86_64-linux-gnu.2.17",), ".so"),
    "win64": Platform(("x86_64-windows-gnu",), ".dll"),
    "darwin64": Platform(("x86_64-macos.11.0", "aarch64-macos.11.0"), ".dylib"),
    "aarch64-linux": Platform(("aarch64-linux-gnu.2.17",), ".so"),
}
# The core in a page: no platform of FMUs.
WEB = Platform(("wasm32-wasi",), ".wasm")
WEB_CORE = FOLDER / "web.wasm"


def folders_3(name: str) -> list[str]:
    """Names of FMI 3.0 for a platform: one for each kind of processor."""
    words = [target.replace("macos", "darwin").split("-") for target in PLATFORMS[name].targets]
    return [f"{processor}-{system.split('.')[0]}" for processor, system, *_ in words]


def this_platform() -> str:
    """Name of this machine's platform, whatever its processor is on macOS."""
    if sys.platform in ("win32", "darwin"):
        return {"win32": "win64", "darwin": "darwin64"}[sys.platform]
    return "aarch64-linux" if platform.machine().lower() in ("arm64", "aarch64") else "linux64"


def sources() -> list[Path]:
    """The core's C files."""
    return sorted(FOLDER.glob("*.c"))


def source_files() -> list[Path]:
    """All that is compiled: C files, what they include, and the table of fields."""
    return sorted([*sources(), *FOLDER.glob("*.h"), *FOLDER.glob("*.def")])


def prefix_header() -> str:
    """C that puts FMI2_FUNCTION_PREFIX, or FMI3's, before all names of the core that a linker sees."""
    found = {"body_prog", "body_prog_len"}
    for path in (*FOLDER.glob("*.h"), *FOLDER.glob("fmi*.c")):
        found |= set(_GLOBAL.findall(path.read_text("utf-8")))
        found |= set(_CALLS_3.findall(path.read_text("utf-8")))
    lines = [f"#define {name} FLEX_JOIN(FMI2_FUNCTION_PREFIX, {name})" for name in sorted(found)]
    paste = ["#define FLEX_PASTE(a, b) a##b", "#define FLEX_JOIN(a, b) FLEX_PASTE(a, b)"]
    of_3 = ["#ifdef FMI3_FUNCTION_PREFIX", "#define FMI2_FUNCTION_PREFIX FMI3_FUNCTION_PREFIX", "#endif"]
    return "\n".join([*of_3, "#ifdef FMI2_FUNCTION_PREFIX", *paste, *lines, "#endif", ""])


def source_hash() -> str:
    """Hash of all that is compiled, and how."""
    digest = hashlib.sha256()
    for path in (*source_files(), Path(__file__)):
        # The same on Windows, where git may end lines otherwise.
        digest.update(path.name.encode() + path.read_bytes().replace(b"\r\n", b"\n"))
    return digest.hexdigest()


def system_compiler() -> list[str] | None:
    """The system's C compiler, as a command; None where there is none."""
    chosen = os.environ.get("CC")
    if chosen:
        return chosen.split()
    for name in ("cc", "gcc", "clang"):
        found = shutil.which(name)
        if found:
            return [found]
    return None


def zig_compiler() -> list[str] | None:
    """`ziglang` of pip as a command; None where it is not installed."""
    probe = [sys.executable, "-c", "import importlib.util, sys; sys.exit(importlib.util.find_spec('ziglang') is None)"]
    return None if subprocess.run(probe, check=False).returncode else [sys.executable, "-m", "ziglang", "cc"]


def command(compiler: Sequence[str], output: Path, target: str | None = None, extra: Sequence[str] = ()) -> list[str]:
    """Command that compiles the core.

    Parameters
    ----------
    compiler : sequence of str
    output : Path
        The library.
    target : str, optional
        Of zig.
    extra : sequence of str
        More flags.

    Returns
    -------
    list of str
    """
    words = [*compiler, *FLAGS, f'-DFLEX_SOURCES="{source_hash()}"', *extra, "-o", str(output), *map(str, sources())]
    if output.suffix == ".wasm":
        # A library of functions that asks nothing of the page but where to write its log.
        return [*words, "-target", str(target), "-mexec-model=reactor", "-msimd128", "-Wl,--export-dynamic", "-s"]
    words.append("-shared")
    if target is not None:
        # The oldest processors of the kind; the newest would be zig's own machine.
        words += ["-target", target, "-mcpu=baseline", "-s"]
    if output.suffix != ".dll":
        words += ["-fPIC", "-lm"]
    if output.suffix == ".dylib":
        # Else the library contains the path under which it was made.
        words += ["-Wl,-install_name,@rpath/flexcore.dylib"]
    if output.suffix == ".so":
        # Its own functions are its own, whatever else the master's process has loaded under their names.
        words += ["-Wl,-Bsymbolic"]
    return words


def compile_core(output: Path, compiler: Sequence[str], targets: Sequence[str] = ()) -> None:
    """Compile the core into a library, which appears whole or not at all; the same sources give the same bytes.

    Parameters
    ----------
    output : Path
    compiler : sequence of str
        Command.
    targets : sequence of str
        Of zig; several come into one file. Default: what the compiler takes this machine for.

    Raises
    ------
    RuntimeError
        The compiler is not there, or it fails, with its words.
    """
    with tempfile.TemporaryDirectory(prefix=".core-", dir=output.parent) as folder:
        # A library of Windows contains the name under which it was made.
        part = Path(folder) / f"flexcore{output.suffix}"
        made = []
        kinds: list[str | None] = [*targets]
        for target in kinds or [None]:
            words = command(compiler, part, target)
            try:
                subprocess.run(words, check=True, capture_output=True, text=True, errors="replace")
            except OSError as error:
                raise RuntimeError(f"C compiler {' '.join(compiler)!r} does not run: {error}; set CC") from error
            except subprocess.CalledProcessError as error:
                raise RuntimeError(f"{' '.join(compiler)} cannot compile the core: {error.stderr}") from error
            made.append(part.read_bytes())
        if len(made) > 1:
            part.write_bytes(fat_file(made))
        part.replace(output)


def fat_file(parts: Sequence[bytes]) -> bytes:
    """Libraries of macOS for several processors as one file.

    Parameters
    ----------
    parts : sequence of bytes
        Mach-O, 64 bit.

    Returns
    -------
    bytes
    """
    head = struct.pack(">II", _FAT_MAGIC, len(parts))
    page = 1 << _FAT_ALIGNMENT
    body = b""
    for part in parts:
        _, processor, kind = _MACH_HEAD.unpack_from(part)
        head += struct.pack(">IIIII", processor, kind, page + len(body), len(part), _FAT_ALIGNMENT)
        body += part + bytes(-len(part) % page)
    return head.ljust(page, b"\0") + body


def compile_for_this_machine(output: Path) -> None:
    """Compile the core for this machine, by its C compiler or by pip's zig.

    Raises
    ------
    RuntimeError
        There is no compiler, or it fails, with its words.
    """
    compiler = system_compiler()
    if compiler is not None:
        compile_core(output, compiler)
        return
    zig = zig_compiler()
    if zig is None:
        raise RuntimeError("no C compiler: install one, or pip install ziglang")
    compile_core(output, zig, PLATFORMS[this_platform()].targets)


if __name__ == "__main__":
    compile_core(WEB_CORE, [sys.executable, "-m", "ziglang", "cc"], WEB.targets)
