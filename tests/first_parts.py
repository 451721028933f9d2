"""The parts of `first_hour`: geometry, decks, what a user changes in the files that `flexfmu init` writes, scenes."""

import gzip
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent / "first_hour"
SHARES = (0.3, 1.0)
# Loads of each part's interface, N: they move it by 10 to 20 % of the part's size.
LOADS = {
    "wishbone": ("bore_1", {"x": -4000.0, "z": 5000.0}),
    "clip": ("tip", {"x": 150.0, "y": -1200.0}),
    "pedal": ("pad", {"x": -500.0, "y": 800.0, "z": 700.0}),
}
# Longest edge of an element, mm.
SIZES = {"wishbone": 9.0, "clip": 3.2, "pedal": 8.0, "lever": 14.0}
# What the program `gmsh` of the Python module does.
_GMSH = "import sys, gmsh; gmsh.initialize(sys.argv, run=True)"
_HUB = "nodes = { cylinder = [[0.0, 0.0, -15.0], [0.0, 0.0, 15.0]], radius = 8.0 }"
_PAD = "nodes = { plane = [215.313697, -94.012456, 0.0], normal = [0.644826528, -0.764328937, 0.0] }"


def write_mesh(part, folder):
    """Deck of a part, as gmsh wrote it."""
    path = folder / f"{part}.inp"
    path.write_bytes(gzip.decompress((FOLDER / f"{part}.inp.gz").read_bytes()))
    return path


def meshed(part, folder):
    """Mesh of a part's STEP file, by gmsh's command line."""
    (folder / f"{part}.step").write_bytes(gzip.decompress((FOLDER / f"{part}.step.gz").read_bytes()))
    words = [f"{part}.step", "-3", "-order", "2", "-format", "msh41", "-o", f"{part}.msh", "-clcurv", "8"]
    words += ["-clmax", str(SIZES[part])]
    subprocess.run([sys.executable, "-c", _GMSH, *words], cwd=folder, timeout=60, check=True, capture_output=True)
    return folder / f"{part}.msh"


def edited(part, text):
    """A body file as its user wants it: the clip's interface named, the pedal held at its hub and trodden on."""
    if part == "clip":
        text = text.replace('"x_max"', '"tip"')
    if part == "pedal":
        head = text[: text.index("[[support]]")]
        text = f'{head}[[support]]\n{_HUB}\nfix = ["x", "y", "z"]\n\n[[interface]]\nname = "pad"\n{_PAD}\n'
    return f"{text}\n[damping]\nratio = 0.02\n"


def scene(part):
    """Scene file of a part: its load, and a third of it at once."""
    interface, load = LOADS[part]
    whole, third = (
        ", ".join(f'"{interface}.force.{axis}" = {size * share:.6g}' for axis, size in load.items())
        for share in (1.0, 1.0 / 3.0)
    )
    return f"""read = ["{interface}"]

[[static]]
name = "bent"
loads = {{ {whole} }}
factors = {list(SHARES)}

[[transient]]
name = "sudden"
loads = {{ {third} }}
duration = 0.02
step = 5e-4

[tolerance.static]
displacement = 0.01
rotation = 0.02

[tolerance.transient]
displacement = 0.03

[sweep]
modes = [5]
frames = [1, 2]
methods = ["linear", "second_order"]
internal_step = ["single"]
"""
