"""The rear axle's ride by `flexfmu couple`, of several versions in turns: whole, and without its start.

Run from the repository's root: python -m benchmarks.ride_command CLONE [CLONE …] [--folder FOLDER]. Each clone of the
repository is at its version, with its package in .venv. FMUs and coupling files that FOLDER holds already are taken.
"""

import argparse
import os
import resource
import subprocess
import tempfile
import time
from pathlib import Path

from .records import write_records

HERE = Path(__file__).parent
MODELS = ("linear", "frames", "cut")
# End of the ride, and of one that is over as soon as it has started, s; runs of each.
STOPS, RUNS = ("0.8", "0.005"), 3
# In each clone, whose modules may lie elsewhere: FMUs of this version, and coupling files as text.
FILES = """
import json, sys
from pathlib import Path
import demo.rear_axle.road.scene as scene
try:
    from flexfmu.files.outputs import Reporter
except ImportError:
    from flexfmu.progress import Reporter

def text(x):
    if isinstance(x, dict):
        return "{" + ", ".join(f'"{k}" = {text(v)}' for k, v in x.items()) + "}"
    if isinstance(x, list):
        return "[" + ", ".join(map(text, x)) + "]"
    return json.dumps(str(x)) if isinstance(x, (str, Path)) else repr(float(x) if isinstance(x, float) else x)

folder, models = Path(sys.argv[1]), {"linear": {"axle": {"method": "linear"}}, "frames": {"axle": {"method": "frames"}}}
models["cut"] = {"axle": {"internal_step.tolerance": 1e-2}, "cut": True}
preload = scene.coil_preload(scene.build_axle(folder, Reporter()), scene.Ride())
scene.build_axle(folder, Reporter(), cut=True)
scene.build_wheel(folder)
scene.parse_coupling = lambda content, folder: content
for name, more in models.items():
    for stop in sys.argv[2:]:
        content = scene.coupling(scene.Ride(stop=float(stop), **more), preload, folder)
        lines = ["[experiment]", *(f"{k} = {text(v)}" for k, v in content["experiment"].items())]
        for kind in ("fmu", "connection", "spring"):
            for row in content[kind]:
                lines += [f"[[{kind}]]", *(f"{k} = {text(v)}" for k, v in row.items())]
        (folder / f"{name}_{stop}.toml").write_text("\\n".join(lines))
"""


def prepared(clone: Path, folder: Path) -> None:
    """Make a clone's FMUs and coupling files where they are not there yet."""
    if not (folder / f"{MODELS[-1]}_{STOPS[-1]}.toml").is_file():
        folder.mkdir(parents=True, exist_ok=True)
        command = [clone / ".venv/bin/python", "-c", FILES, folder, *STOPS]
        subprocess.run(command, check=True, cwd=clone, env=os.environ | {"PYTHONPATH": str(clone)})


def spent(clone: Path, file: Path) -> tuple[float, float]:
    """Wall and processor time of the command, s."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [clone / ".venv/bin/flexfmu", "couple", file, "--output", file.with_suffix(".csv")]
    subprocess.run(command, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.perf_counter() - begun, sum(after[:2]) - sum(before[:2])


def main(clones: list[Path], folder: Path, output: Path) -> None:
    """Measure, print and write."""
    rows = []
    for clone in clones:
        prepared(clone, folder / clone.name)
    for model in MODELS:
        runs = {(clone, stop): [] for clone in clones for stop in STOPS}
        for _ in range(RUNS):
            for (clone, stop), found in runs.items():
                found.append(spent(clone, folder / clone.name / f"{model}_{stop}.toml"))
        for clone in clones:
            asked = ["git", "rev-parse", "--short", "HEAD"]
            version = subprocess.run(asked, capture_output=True, text=True, check=True, cwd=clone).stdout.strip()
            whole, start = ([min(one) for one in zip(*runs[clone, stop], strict=True)] for stop in STOPS)
            row = {"model": model, "version": version, "wall": whole[0], "processor": whole[1]}
            row |= {"steps_wall": whole[0] - start[0], "steps_processor": whole[1] - start[1]}
            rows.append({name: f"{one:.3g}" if isinstance(one, float) else one for name, one in row.items()})
            print("  ".join(f"{name} {one}" for name, one in rows[-1].items()), flush=True)
    write_records(output, rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clones", nargs="+", type=Path)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--output", type=Path, default=HERE / "ride_command.csv")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as other:
        main([clone.resolve() for clone in options.clones], options.folder or Path(other), options.output)
