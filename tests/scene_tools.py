"""Scenes of the demo bodies, with their CalculiX results as the user would bring them."""

from contextlib import contextmanager

import numpy as np

from flexfmu.files.outputs import Reporter
from flexfmu.study.scene.scene import read_scene
from references import BEAM, calculix

AXES = "xyz"
BEND = """
[[static]]
name = "bend"
loads = { "tip.force.y" = 10e3 }
factors = [0.3, 1.0]
"""
SMALL_SWEEP = """
[sweep]
basis = ["normal"]
modes = [3, 6]
frames = [1, 2]
methods = ["linear", "frames"]
finite_elements = false
"""
FIT = """
[tolerance.static]
displacement = 0.005

[sweep]
modes = [10]
frames = [1, 2, 4, 8]
"""


class Listening(Reporter):
    """Remembers stages and what was said; of counted ones title, total, unit, and all that was told of them."""

    def __init__(self):
        self.stages, self.notes, self.warnings, self.counts = [], [], [], []

    @contextmanager
    def stage(self, title):
        self.stages.append(title)
        yield

    @contextmanager
    def counted(self, title, total, unit=""):
        told = []
        self.counts.append((title, total, unit, told))
        yield told.append

    def note(self, text):
        self.notes.append(text)

    def warning(self, text):
        self.warnings.append(text)


def scene_of(folder, text, body=BEAM / "body.toml", changes=()):
    """A scene file in a folder, with a copy of a body file beside it."""
    content = body.read_text(encoding="utf-8").replace('file = "', f'file = "{body.parent.as_posix()}/')
    for old, new in changes:
        assert old in content
        content = content.replace(old, new)
    (folder / "body.toml").write_text(content, encoding="utf-8")
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    return read_scene(folder / "scene.toml", folder / "body.toml")


def calculix_results(folder, table, peak, factors, interface="tip"):
    """A demo body's CalculiX results as a table that a scene takes."""
    rows = calculix(table)
    header = ["factor"] + [f"{interface}.{kind}.{a}" for kind in ("displacement", "rotation") for a in AXES]
    lines = ["# of CalculiX", ",".join(header)]
    for factor in factors:
        row = rows[np.argmin(np.abs(np.abs(rows["force_N"]) - factor * peak))]
        motion = [row[f"{kind}{a}_{unit}"] for kind, unit in (("u", "m"), ("r", "rad")) for a in AXES]
        lines.append(",".join(str(value) for value in (factor, *motion)))
    (folder / "results.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return 'results = "results.csv"\n'


def with_results(folder, text):
    """The bent beam with results of the user's own, so that nothing large is solved."""
    results = calculix_results(folder, BEAM / "calculix" / "static_y.csv", 10e3, (0.3, 1.0))
    return scene_of(folder, BEND + results + text)
