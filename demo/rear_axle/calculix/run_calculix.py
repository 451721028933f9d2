"""Reference results of the rear axle with CalculiX (decks and CSV files beside this file).

Two variants of support; in both, soft coil springs, 20 kN/m a side, hold the spring trays in z:

- *hinged*: the node in the middle of each bushing is held, a ball joint: rubber hardly resists tilting, and a held line
  of nodes would clamp the roll of the arms, which makes the axle under opposite forces four times as stiff;
- *bushings*: all nodes on the bushing's lateral axis stand on springs to the ground.

Springs are CalculiX's SPRING1: linear, in a fixed direction also under NLGEOM, here shared equally by the nodes of the
set. Forces act at the wheels' centres in fixed directions, spread as flexfmu spreads the loads of an interface.

- ``linear_left``, ``linear_side``, ``linear_opposite``: linear statics, 1 kN, 7 kN, ± 1 kN.
- ``left``: vertical force at the left wheel until its arm has turned by 15 degrees.
- ``side``: side force at the left wheel up to 7 kN, inboard.
- ``opposite``: vertical forces, up at the left wheel and down at the right, until the arms have turned by 15 degrees.
- ``left_bushings``, ``linear_left_bushings``, ``opposite_bushings``: the same on bushings.
- ``opposite_fine``: ``opposite`` in four times as many increments, of which every fourth is kept.

Run from the repository's root, with ``ccx`` on the PATH, for all cases or those named:
``python -m demo.rear_axle.calculix.run_calculix [--model FILE --folder FOLDER --increments N] [case ...]``. The CSV
files are laid out as `demo.references` says.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from demo.calculix_results import read_displacements
from demo.calculix_tools import FORCE_TOLERANCE, ccx_version, find_ccx
from demo.rear_axle import make_mesh
from demo.rear_axle.alignment import arm_angle
from demo.rear_axle.wheels import FLANGES, Wheel, wheels
from demo.tip_face import MOTION_COLUMNS

from flexfmu.files.basics import UnitSystem
from flexfmu.mesh.formats import read_mesh

HERE = Path(__file__).parent

SEAT_STIFFNESS = 20e3  # N/m, vertical, each side
BUSHING_STIFFNESS = (5e6, 2e6, 5e6)  # N/m along x, y, z, each side

# Springs are numbered from here, beyond the elements of any size of the mesh.
FIRST_SPRING = 1_000_001

UP, INBOARD = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])  # at the left wheel


@dataclass(frozen=True, slots=True)
class Case:
    """A load case.

    Attributes
    ----------
    title : str
    forces : dict of str to ndarray, shape (3,)
        Force at each loaded wheel, N, at the end.
    increments : int
        Equal increments; 0: linear statics.
    bushings : bool
        Whether the bushings are springs.
    keep : int
        Every so many-th increment is kept.
    tolerance : float
        Force out of balance over the mean force, up to which CalculiX iterates.
    iterations : int
        Up to which residuals may grow; 0: CalculiX's own limit.
    """

    title: str
    forces: dict[str, np.ndarray]
    increments: int = 0
    bushings: bool = False
    keep: int = 1
    tolerance: float = FORCE_TOLERANCE
    iterations: int = 0


LEFT_FORCE = 1800.0  # N, vertical
OPPOSITE_FORCE = 2400.0
SIDE_FORCE = 7000.0

CASES = {
    "linear_left": Case("vertical force at the left wheel", {"wheel_left": 1e3 * UP}),
    "linear_side": Case("side force at the left wheel", {"wheel_left": SIDE_FORCE * INBOARD}),
    "linear_opposite": Case("opposite vertical forces", {"wheel_left": 1e3 * UP, "wheel_right": -1e3 * UP}),
    "left": Case("vertical force at the left wheel", {"wheel_left": LEFT_FORCE * UP}, 9),
    "side": Case("side force at the left wheel", {"wheel_left": SIDE_FORCE * INBOARD}, 5),
    "opposite": Case(
        "opposite vertical forces", {"wheel_left": OPPOSITE_FORCE * UP, "wheel_right": -OPPOSITE_FORCE * UP}, 8
    ),
    "linear_left_bushings": Case("vertical force at the left wheel", {"wheel_left": 1e3 * UP}, bushings=True),
    "left_bushings": Case("vertical force at the left wheel", {"wheel_left": LEFT_FORCE * UP}, 9, bushings=True),
    "opposite_bushings": Case(
        "opposite vertical forces",
        {"wheel_left": OPPOSITE_FORCE * UP, "wheel_right": -OPPOSITE_FORCE * UP},
        8,
        bushings=True,
    ),
    "opposite_fine": Case(
        "opposite vertical forces",
        {"wheel_left": OPPOSITE_FORCE * UP, "wheel_right": -OPPOSITE_FORCE * UP},
        32,
        keep=4,
    ),
}


def deck(model: Path, case: Case, fitted: dict[str, Wheel], sets: dict[str, np.ndarray]) -> str:
    """Deck of a case; it includes the model deck from one folder above. Node sets hold indices."""
    lines = [f"** {_title(case)}", f"*INCLUDE, INPUT=../{model.name}"]
    springs = [(f"SEAT_{side}", 3, SEAT_STIFFNESS) for side in "LR"]
    if case.bushings:
        springs += [(f"BUSH_{side}", axis + 1, k) for side in "LR" for axis, k in enumerate(BUSHING_STIFFNESS)]
    else:
        lines += ["*BOUNDARY", "PIVOT_L, 1, 3", "PIVOT_R, 1, 3"]
    number = FIRST_SPRING
    for node_set, direction, total in springs:
        nodes = sets[node_set]
        name = f"SPRING_{node_set}_{direction}"
        lines.append(f"*ELEMENT, TYPE=SPRING1, ELSET={name}")
        lines += [f"{number + i}, {node + 1}" for i, node in enumerate(nodes)]
        lines += [f"*SPRING, ELSET={name}", f"{direction}", f"{total / len(nodes):.12g}"]
        number += len(nodes)
    if case.increments:
        lines += [f"*STEP, NLGEOM, INC={case.increments + 1}", "*STATIC, DIRECT", f"{1 / case.increments:.9g}, 1."]
        lines += ["*CONTROLS, PARAMETERS=FIELD", f"{case.tolerance:.9g}"]
        if case.iterations:
            limits = f"{case.iterations}, {case.iterations + 1}, 9, {2 * case.iterations}, 10, 4, , 5, , "
            lines += ["*CONTROLS, PARAMETERS=TIME INCREMENTATION", limits]
    else:
        lines += ["*STEP", "*STATIC"]
    lines.append("*CLOAD")
    for name, force in case.forces.items():
        wheel = fitted[name]
        lines += [
            f"{node}, {axis + 1}, {value:.9e}"
            for node, values in zip(wheel.numbers, wheel.nodal_forces(force), strict=True)
            for axis, value in enumerate(values)
            if abs(value) > 1e-12 * np.linalg.norm(force)
        ]
    for node_set in FLANGES.values():
        lines += [f"*NODE PRINT, NSET={node_set}", "U"]
    return "\n".join([*lines, "*END STEP"]) + "\n"


def run(
    name: str, case: Case, model: Path, folder: Path, fitted: dict[str, Wheel], sets: dict[str, np.ndarray]
) -> None:
    """Write the deck of a case, run it and keep the wheels' motion."""
    text = deck(model, case, fitted, sets)
    (folder / f"{name}.inp").write_text(text, encoding="ascii")
    with tempfile.TemporaryDirectory() as top:
        work = Path(top) / "run"
        work.mkdir()
        shutil.copy(model, top)
        (work / f"{name}.inp").write_text(text, encoding="ascii")
        start, spent = time.perf_counter(), _processor()
        done = subprocess.run(
            [find_ccx(), "-i", name],
            cwd=work,
            env=os.environ | {"OMP_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
        seconds = time.perf_counter() - start, _processor() - spent
        if done.returncode != 0 or "*ERROR" in done.stdout or "Job finished" not in done.stdout:
            raise RuntimeError(f"ccx failed on {name}:\n{done.stdout[-2000:]}{done.stderr[-500:]}")
        printed = (work / f"{name}.dat").read_text()
        iterations = len(re.findall(r"^ *iteration +\d+", done.stdout, flags=re.MULTILINE))
    columns = []
    for wheel, node_set in FLANGES.items():
        _, displacements = read_displacements(printed, node_set)
        fit = fitted[wheel]
        columns.append(fit.motion(displacements) if case.increments else fit.linear_motion(displacements))
    motion = np.hstack(columns)
    parts = np.ones(1)
    if case.increments:
        if len(motion) != case.increments:
            raise RuntimeError(f"{name}: {len(motion)} increments printed, {case.increments} expected")
        motion = np.vstack([np.zeros(motion.shape[1]), motion])
        parts = np.arange(case.increments + 1) / case.increments
    _write(folder / f"{name}.csv", case, parts[:: case.keep], motion[:: case.keep], seconds, iterations)


def _processor() -> float:
    """Seconds of the processor that commands which have ended have taken."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _title(case: Case) -> str:
    kind = "Nonlinear" if case.increments else "Linear"
    return f"{kind} statics, {case.title}, {'bushings' if case.bushings else 'hinged'}"


def _write(
    path: Path, case: Case, parts: np.ndarray, motion: np.ndarray, seconds: tuple[float, float], iterations: int
) -> None:
    names = [
        f"{wheel}_f{axis}_N" for wheel, force in case.forces.items() for axis, f in zip("xyz", force, strict=True) if f
    ]
    # Adding zero makes a negative zero positive.
    loads = np.outer(parts, [f for force in case.forces.values() for f in force if f]) + 0.0
    names = ["force_N"] if len(names) == 1 else names
    names += [f"{wheel}_{column}" for wheel in FLANGES for column in MOTION_COLUMNS]
    rotation = "finite, by polar decomposition" if case.increments else "small, by the linear fit"
    effort = f"; {case.increments} equal increments, {iterations} iterations" if case.increments else ""
    spent = f"{seconds[0]:.3g} s wall time on one core, {seconds[1]:.3g} of the processor"
    notes = [
        _title(case),
        f"CalculiX {ccx_version()}; {spent}{effort}",
        "u: mean displacement of each wheel's flange over its area, work conjugate of the force",
        f"r: rotation vector of the flange, {rotation}, weighted by area",
    ]
    lines = [",".join(names), *(f"# {note}" for note in notes)]
    lines += [",".join(f"{value:.8g}" for value in row) for row in np.hstack([loads, motion])]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    angles = [f"{arm_angle(motion[-1:, 6 * i + 3 : 6 * i + 6])[0]:.3f}" for i in range(len(FLANGES))]
    print(f"{path}: {len(parts)} rows, {spent}, {iterations} iterations; arms at {', '.join(angles)} degrees")


def main() -> None:
    """Run the cases named on the command line, or all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("case", nargs="*", help=f"any of {', '.join(CASES)} (default: all)")
    parser.add_argument("--model", type=Path, default=make_mesh.MODEL_FILE, help="model deck (default: the coarse one)")
    parser.add_argument("--folder", type=Path, default=HERE, help="where decks and results go")
    parser.add_argument("--increments", type=int, help="equal increments of the nonlinear cases, all kept")
    choice = parser.parse_args()
    names = choice.case or list(CASES)
    unknown = sorted(set(names) - set(CASES))
    if unknown:
        parser.error(f"unknown case {', '.join(unknown)}: choose from {', '.join(CASES)}")
    choice.folder.mkdir(parents=True, exist_ok=True)
    fitted, sets = wheels(choice.model), read_mesh(choice.model, UnitSystem.SI).node_sets
    for name in names:
        case = CASES[name]
        if choice.increments and case.increments:
            case = replace(case, increments=choice.increments, keep=1)
        run(name, case, choice.model, choice.folder, fitted, sets)


if __name__ == "__main__":
    main()
