"""Build the wheel that carries the core of every platform: `python .ci/build_wheel.py [FOLDER] [--no-isolation]`.

The same sources, setuptools and ziglang give the same bytes. FOLDER is dist by default. pip fetches setuptools and
ziglang (some 400 MB); with --no-isolation those of this Python are used.
"""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_FILES = ("pyproject.toml", "setup.py", "MANIFEST.in", "README.md", "LICENSE", ".ci", "fmu_src")
_LEFT_OUT = shutil.ignore_patterns("__pycache__", "*.egg-info", "_flexcore*", "binaries")
# The earliest date that wheels know, 1980-01-01.
_EPOCH = "315532800"


def build_wheel(output: Path, isolated: bool = True) -> Path:
    """Build the wheel.

    Parameters
    ----------
    output : Path
        Folder.
    isolated : bool
        Whether pip fetches setuptools and ziglang.

    Returns
    -------
    Path
    """
    with tempfile.TemporaryDirectory(prefix="flexfmu-wheel-") as folder:
        # A copy: what other builds left in the tree stays out, and all files have the same permissions.
        os.umask(0o022)
        source, made = Path(folder) / "source", Path(folder) / "made"
        for name in _FILES:
            path = ROOT / name
            if path.is_dir():
                shutil.copytree(path, source / name, ignore=_LEFT_OUT, copy_function=shutil.copyfile)
            else:
                source.mkdir(exist_ok=True)
                shutil.copyfile(path, source / name)
        command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(made), str(source)]
        if not isolated:
            command += ["--no-build-isolation"]
        environment = {"SOURCE_DATE_EPOCH": _EPOCH, **os.environ, "FLEXFMU_PLATFORMS": "all"}
        subprocess.run(command, check=True, env=environment)
        (wheel,) = made.glob("*.whl")
        output.mkdir(parents=True, exist_ok=True)
        return Path(shutil.move(wheel, output / wheel.name))


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--no-isolation"]
    wheel = build_wheel(Path(words[0]) if words else ROOT / "dist", "--no-isolation" not in sys.argv)
    print(f"{wheel}\nsha256 {hashlib.sha256(wheel.read_bytes()).hexdigest()}")
