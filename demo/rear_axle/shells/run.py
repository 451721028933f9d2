"""The rear axle of shells and solids: mesh, build, and displacement, toe and camber of the wheels against CalculiX.

Run from the root: ``python -m demo.rear_axle.shells.run [--longest M] [--output FOLDER]``. Prints the stages
of the build and a Markdown table for each load case. The references are those of the coarse axle; at 15 mm the nodes
are theirs.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from demo.rear_axle.full_size import StageRecorder, print_build
from demo.rear_axle.run import print_table, read_reference, solve
from demo.rear_axle.shells import make_mesh

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import MeshTable
from flexfmu.fmu.package import package_fmu
from flexfmu.model.methods import Method

HERE = Path(__file__).parent
# Direction of the force that the files call only force_N.
CASES = {"left": "z", "side": "y"}
METHODS = (Method.LINEAR, Method.FRAMES, Method.SECOND_ORDER)


def main(longest: float, folder: Path) -> None:
    """Run all of it."""
    report = StageRecorder()
    deck = folder / "rear_axle_shells.inp"
    with report.stage("Mesh and write the deck"):
        make_mesh.write(deck, make_mesh.build(longest))
    config = read_body_file(HERE / "body.toml").model_copy(update={"mesh": MeshTable(file=deck)})
    reduced = reduce_body(config, report)
    with report.stage("Write the FMU"):
        package_fmu(reduced, folder / "rear_axle_shells.fmu")
    print(f"{report.notes[0]}\n\n| | s | of the processor, s | peak until then, GiB |\n|---|---|---|---|")
    print_build("build", report)
    for case, axis in CASES.items():
        reference = read_reference(HERE / "calculix" / f"coarse_{case}.csv", axis)
        print_table(reference, {method.value: solve(FlexibleBody(reduced, method), reference) for method in METHODS})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--longest", type=float, default=make_mesh.SIZES["coarse"], help="longest edge of a shell, m")
    parser.add_argument("--output", type=Path, default=Path("output/rear_axle_shells"), help="folder for deck and FMU")
    choice = parser.parse_args()
    main(choice.longest, choice.output)
