"""What CalculiX finds for the three parts bent far: ``calculix.csv``, one row a part and share of its load.

Run from the repository's root with ``ccx`` on the PATH: ``PYTHONPATH=.:tests python tests/first_hour/run_calculix.py``.
Same mesh and supports, the interface's own spreading of its load, geometric nonlinearity (ccx 2.20).
"""

import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from demo.calculix_scene import deck, run

from first_parts import LOADS, SHARES, edited, scene, write_mesh
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store
from flexfmu.study.scene.scene import read_scene
from flexfmu.study.scene.whole_model import WholeModel, finite_motion

RESULTS = Path(__file__).with_name("calculix.csv")
MOTION = ("ux", "uy", "uz", "rx", "ry", "rz")


def rows_of(part, folder):
    """Motion of the part's interface, m and rad, at each share."""
    mesh = write_mesh(part, folder)
    subprocess.run([sys.executable, "-m", "flexfmu", "init", str(mesh)], check=True)
    body, scene_file = mesh.with_suffix(".toml"), folder / "scene.toml"
    body.write_text(edited(part, body.read_text()))
    scene_file.write_text(scene(part))
    whole = WholeModel(read_scene(scene_file, body), Reporter(), Store())
    (case,) = read_scene(scene_file, body).static
    (interface,) = whole.interfaces
    nodes = np.arange(len(whole.model.mesh.points))
    found = run(deck(whole.model, whole.load(case), SHARES, nodes, part), SHARES, len(nodes), Reporter())
    for share, displacement in zip(SHARES, found.displacement, strict=True):
        motion = finite_motion(interface, whole.model.mesh.points, displacement)
        yield {"part": part, "share": share} | {name: f"{x:.9e}" for name, x in zip(MOTION, motion, strict=True)}


def main():
    rows = []
    for part in LOADS:
        with tempfile.TemporaryDirectory() as folder:
            rows += rows_of(part, Path(folder))
            print(*rows[-1].values(), flush=True)
    with RESULTS.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
