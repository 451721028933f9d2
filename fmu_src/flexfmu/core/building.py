"""How the core is compiled: one command a platform, by the system's C compiler or by pip's `ziglang`.

Nothing is imported from the package: setup.py runs this file before there is one.
"""

import hashlib
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

FOLDER = Path(__file__).parent
# Nobody reads errno or floating-point exceptions. Fused operations would make results hang on the processor.
FLAGS = ("-std=c99", "-O3", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=off", "-fvisibility=hidden")

# FMI's name of a platform → zig's target and the ending of its libraries.
TARGETS = {
    "linux64": ("x86_64-linux-gnu.2.17", ".so"),
    "aarch64-linux": ("aarch64-linux-gnu.2.17", ".so"),
    "win64": ("x86_64-windows-gnu", ".dll"),
    "darwin64-x86": ("x86_64-macos.11.0", ".dylib"),
    "darwin64-arm": ("aarch64-macos.11.0", ".dylib"),
}


def this_platform() -> str:
    """FMI's name of this machine's platform."""
    machine = platform.machine().lower()
    arm = machine in ("arm64", "aarch64")
    if sys.platform == "win32":
        return "win64"
    if sys.platform == "darwin":
        return "darwin64-arm" if arm else "darwin64-x86"
    return "aarch64-linux" if arm else "linux64"


def sources() -> list[Path]:
    """The core's C files."""
    return sorted(FOLDER.glob("*.c"))


def source_hash() -> str:
    """Hash of all that is compiled, and how."""
    digest = hashlib.sha256(" ".join(FLAGS).encode())
    for path in sorted([*FOLDER.glob("*.c"), *FOLDER.glob("*.h"), *FOLDER.glob("*.def")]):
        digest.update(path.name.encode() + path.read_bytes())
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


def zig_compiler(python: str = sys.executable) -> list[str] | None:
    """`ziglang` of pip as a command; None where it is not installed."""
    probe = [python, "-c", "import importlib.util, sys; sys.exit(importlib.util.find_spec('ziglang') is None)"]
    if subprocess.run(probe, check=False).returncode:
        return None
    return [python, "-m", "ziglang", "cc"]


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
    words = [*compiler, *FLAGS, *extra, "-shared", "-o", str(output), *map(str, sources())]
    if target is not None:
        # The oldest processors of the kind; the newest would be zig's own machine.
        words += ["-target", target, "-mcpu=baseline", "-s"]
    if output.suffix != ".dll":
        words += ["-fPIC", "-lm"]
    if output.suffix == ".so":
        # Its own functions are its own, whatever else the master's process has loaded under their names.
        words += ["-Wl,-Bsymbolic"]
    return words


def compile_core(output: Path, compiler: Sequence[str], target: str | None = None) -> None:
    """Compile the core into a library, which appears whole or not at all.

    Raises
    ------
    subprocess.CalledProcessError
        With the compiler's words in `stderr`.
    """
    part = output.with_name(f".{output.stem}.{os.getpid()}{output.suffix}")
    try:
        subprocess.run(command(compiler, part, target), check=True, capture_output=True, text=True)
        part.replace(output)
    finally:
        part.unlink(missing_ok=True)


def compile_for_this_machine(output: Path) -> None:
    """Compile the core for this machine, by its C compiler or by pip's zig.

    Raises
    ------
    RuntimeError
        There is no compiler, or it fails, with its words.
    """
    compiler, target = system_compiler(), None
    if compiler is None:
        compiler, target = zig_compiler(), TARGETS[this_platform()][0]
    if compiler is None:
        raise RuntimeError("no C compiler: install one, or pip install ziglang")
    try:
        compile_core(output, compiler, target)
    except subprocess.CalledProcessError as error:
        raise RuntimeError(f"{' '.join(compiler)} cannot compile the core: {error.stderr}") from error
