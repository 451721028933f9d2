"""Installation from a clone on a machine without any compiler, and what it takes.

Run from the repository's root: python -m benchmarks.bare_install [--output FILE.csv]. Clones the last commit, installs
it into a new environment with a PATH that leads to no program at all, builds a native FMU there and drives it. pip
fetches ziglang for the time of the build, some 400 MB.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from .records import write_records

ROOT = Path(__file__).parents[1]
WORDS = """
import sys, fmpy
from pathlib import Path
from flexfmu.core.building import system_compiler, zig_compiler
from flexfmu.core.library import library_path
assert system_compiler() is None and zig_compiler() is None
end = fmpy.simulate_fmu(sys.argv[1], start_values={"tip.force.y": 1e3}, stop_time=0.02, output_interval=1e-3)[-1]
assert 1e-5 < end["tip.displacement.y"] < 1.0
print(library_path().stat().st_size)
"""


def run(command: list[object], environment: dict[str, str], folder: Path) -> tuple[float, str]:
    """Seconds of a command, and what it prints."""
    start = time.monotonic()
    words = list(map(str, command))
    done = subprocess.run(words, env=environment, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(words[:4])} ended with {done.returncode}:\n{done.stdout}\n{done.stderr}")
    return time.monotonic() - start, done.stdout


def main() -> None:
    """Run as a script."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path(__file__).with_name("bare_install.csv"))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as name:
        folder = Path(name)
        clone, nothing = folder / "flexfmu", folder / "nothing"
        nothing.mkdir()
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
        subprocess.run([sys.executable, "-m", "venv", str(folder / "venv")], check=True)
        python = folder / "venv" / "bin" / "python"
        environment = {key: value for key, value in os.environ.items() if key not in ("CC", "PYTHONPATH")}
        environment |= {"PATH": str(nothing), "FLEXFMU_CACHE": str(folder / "cache")}
        installing, _ = run([python, "-m", "pip", "install", "--quiet", "."], environment, clone)
        fmu, body = folder / "beam.fmu", clone / "demo" / "clamped_beam" / "body.toml"
        building, _ = run([python.with_name("flexfmu"), "build", body, "--output", fmu], environment, folder)
        _, size = run([python, "-c", WORDS, fmu], environment, folder)
    row = {
        "install_seconds": round(installing),
        "build_seconds": round(building),
        "core_bytes": int(size.split()[-1]),
    }
    print("  ".join(f"{key} {value}" for key, value in row.items()))
    write_records(options.output, [row])


if __name__ == "__main__":
    main()
