"""Two halves of a beam as Craig-Bampton FMUs, joined by a stiff spring in the master, against the whole beam."""

import csv
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.fmu.package import package_fmu
from flexfmu.mesh.elements import ElementType
from meshes import body_file, box
from references import relative

LENGTH, SIDE = 1.0, 0.03
# Bends the beam by an eighth of its length.
FORCE = 5e3
BASIS = {"basis": "craig_bampton", "modes": 4}
# Heavy damping: the motion is gone when it is read.
DAMPING = {"ratio": 0.9}
COUPLING = """
[experiment]
stop = 0.3
step = 5e-3
scheme = "iterated"
[[fmu]]
name = "first"
file = "first.fmu"
[[fmu]]
name = "second"
file = "second.fmu"
start = {{ "tip.force.y" = {force} }}
[[spring]]
a = "first.tip"
b = "second.root"
stiffness = [{k}, {k}, {k}, {turning}, {turning}, {turning}]
[output]
every = 60
"""


@pytest.fixture(scope="module")
def halves(tmp_path_factory):
    """Folder with the FMUs of a clamped half and of a free one, and the tip's displacement of the whole beam."""
    folder = tmp_path_factory.mktemp("chain")

    def reduced(name, length, interfaces, frames, **tables):
        mesh = box(ElementType.C3D20R, (round(20 * length), 1, 1), (length, SIDE, SIDE))
        common = {"reduction": BASIS, "damping": DAMPING, "frames": frames}
        return body_file(mesh, folder, interface=interfaces, name=name, **(common | tables))

    whole = FlexibleBody(reduce_body(reduced("whole", LENGTH, ["TIP"], 8), Reporter()))
    first = reduce_body(reduced("first", LENGTH / 2, ["TIP"], 4), Reporter())
    free = reduced("second", LENGTH / 2, ["ROOT", "TIP"], 4, free=True).model_copy(update={"support": []})
    second = reduce_body(free, Reporter())
    package_fmu(replace(first, compliance_interfaces=("tip",)), folder / "first.fmu")
    package_fmu(replace(second, compliance_interfaces=("root",)), folder / "second.fmu")
    return folder, whole.response(whole.static({"tip": [0.0, FORCE, 0.0]})).displacement[0]


def joined(folder, stiffness):
    """Tip displacement of the two halves at rest under the force."""
    text = COUPLING.format(force=FORCE, k=stiffness, turning=1e-2 * stiffness)
    file, output = folder / f"{stiffness:g}.toml", folder / f"{stiffness:g}.csv"
    file.write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "flexfmu", "couple", str(file), "--output", str(output)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    # pythonfmu's library may crash at the interpreter's exit: what counts is the file.
    assert output.exists(), done.stdout + done.stderr
    with output.open(encoding="utf-8", newline="") as lines:
        last = list(csv.DictReader(lines))[-1]
    values = {key.split(" ")[0]: float(value) for key, value in last.items()}
    return np.array([values[f"second.tip.displacement.{axis}"] for axis in "xyz"])


@pytest.mark.slow
def test_the_chain_approaches_the_whole_as_its_joint_gets_stiffer(halves):
    folder, whole = halves
    assert whole[1] > 0.12
    errors = [relative(joined(folder, stiffness), whole) for stiffness in (1e7, 1e8, 1e9)]
    # The joint's own flexibility, first order in one over its stiffness, then what the division of the body makes.
    assert errors[0] / errors[1] == pytest.approx(10.0, rel=0.15)
    assert errors[2] < 2e-3
