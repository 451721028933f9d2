"""Four scenes with a tolerance each, and what CalculiX says of the models that `flexfmu fit` finds for them.

The search compares with fine reduced models; it never sees the CalculiX results.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from demo.rear_axle.alignment import LEFT, RIGHT, alignment
from numpy.typing import NDArray

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store
from flexfmu.model.reduced_body import ReducedBody
from flexfmu.study.fit import fit
from flexfmu.study.fitted import Fit
from flexfmu.study.scene.reference import SceneErrors, errors, references
from flexfmu.study.scene.scene import AXES, Scene, read_scene

HERE = Path(__file__).parent
DEMO = HERE.parent
KINDS = (("displacement", "u", "m"), ("rotation", "r", "rad"))


@dataclass(frozen=True, slots=True)
class Demonstration:
    """A scene, the body file of a careful user, and CalculiX results.

    Attributes
    ----------
    title : str
    body, scene : Path
        The body file has the modes and frames that one would take without looking: the demo's own.
    calculix : mapping of str to Path
        Table of each case.
    column : mapping of str to str
        Column of each static case that holds its load, N.
    """

    title: str
    body: Path
    scene: Path
    calculix: Mapping[str, Path]
    column: Mapping[str, str]


DEMONSTRATIONS = {
    "small_load": Demonstration(
        "small load: clamped beam, 1 kN",
        DEMO / "clamped_beam" / "body.toml",
        HERE / "small_load.toml",
        {"bend": DEMO / "clamped_beam" / "calculix" / "static_y.csv"},
        {"bend": "force_N"},
    ),
    "large_load": Demonstration(
        "large load: L-frame, 2 kN out of its plane, 3 kN in it",
        DEMO / "l_frame" / "body.toml",
        HERE / "large_load.toml",
        {
            "out_of_plane": DEMO / "l_frame" / "calculix" / "static_z.csv",
            "in_plane": DEMO / "l_frame" / "calculix" / "static_x.csv",
        },
        {"out_of_plane": "force_N", "in_plane": "force_N"},
    ),
    "sudden_load": Demonstration(
        "sudden load: clamped beam, 5 kN, up to 100 Hz",
        HERE / "beam_undamped.toml",
        HERE / "sudden_load.toml",
        {"sudden": DEMO / "clamped_beam" / "calculix" / "sudden_load.csv"},
        {},
    ),
    "torsion": Demonstration(
        "torsion: rear axle, ±2.4 kN at its wheels",
        DEMO / "rear_axle" / "body.toml",
        HERE / "torsion.toml",
        {"opposite": DEMO / "rear_axle" / "calculix" / "opposite.csv"},
        {"opposite": "wheel_left_fz_N"},
    ),
}


@dataclass(frozen=True, slots=True)
class Outcome:
    """What was found, and what CalculiX says of it.

    Attributes
    ----------
    fit : Fit
    calculix, given : SceneErrors
        Of the model found and of the body as given, against CalculiX at all its load levels up to the scene's.
    toe, given_toe : float
        Largest error of the wheels' toe, degrees; not a number without wheels.
    """

    fit: Fit
    calculix: SceneErrors
    given: SceneErrors
    toe: float
    given_toe: float


def run(
    name: str, folder: Path, report: Reporter, store: Store | None = None, fmu: bool = True
) -> tuple[Outcome, Path]:
    """Fit a model to one of the scenes and judge what was written.

    Parameters
    ----------
    name : str
        One of `DEMONSTRATIONS`.
    folder : Path
        Where body file and FMU go.
    report : Reporter
    store : Store, optional
    fmu : bool
        Whether to write the FMU too.

    Returns
    -------
    outcome : Outcome
    target : Path
        The body file.
    """
    demonstration = DEMONSTRATIONS[name]
    scene = read_scene(demonstration.scene, demonstration.body)
    target = folder / f"{name}.toml"
    found = fit(scene, target, report, store, target.with_suffix(".fmu") if fmu else None)
    judge = judging_scene(demonstration, scene, folder)
    fitted, given = (reduce_body(read_body_file(path), Reporter(), store) for path in (target, demonstration.body))
    outcome = Outcome(
        found, judged(judge, fitted), judged(judge, given), toe_error(judge, fitted), toe_error(judge, given)
    )
    return outcome, target


def judging_scene(demonstration: Demonstration, scene: Scene, folder: Path) -> Scene:
    """The scene with CalculiX's results as reference, at every level of CalculiX up to the scene's largest.

    Parameters
    ----------
    demonstration : Demonstration
    scene : Scene
    folder : Path
        Where the results go, as a scene takes them.

    Returns
    -------
    Scene
    """
    static = []
    for case in scene.static:
        table = np.genfromtxt(demonstration.calculix[case.name], delimiter=",", names=True)
        load = table[demonstration.column[case.name]]
        peak = float(np.max(np.abs(case.peak.force)))
        rows = table[(load > 0.0) & (load <= peak * case.factors[-1] * (1.0 + 1e-9))]
        factors = rows[demonstration.column[case.name]] / peak
        path = _written(folder / f"{case.name}_calculix.csv", "factor", factors, rows, scene.read)
        static.append(case.model_copy(update={"factors": [float(f) for f in factors], "results": path}))
    transient = []
    for motion in scene.transient:
        table = np.genfromtxt(demonstration.calculix[motion.name], delimiter=",", names=True)
        path = _written(folder / f"{motion.name}_calculix.csv", "time", table["time_s"], table, scene.read)
        transient.append(motion.model_copy(update={"results": path}))
    return replace(scene, static=tuple(static), transient=tuple(transient))


def _written(path: Path, first: str, key: NDArray[np.float64], rows: NDArray[np.void], names: tuple[str, ...]) -> Path:
    """Write CalculiX's motion of some interfaces as a scene takes it."""
    columns = {first: key}
    for name in names:
        prefix = f"{name}_" if f"{name}_ux_m" in (rows.dtype.names or ()) else ""
        for kind, letter, unit in KINDS:
            columns |= {f"{name}.{kind}.{axis}": rows[f"{prefix}{letter}{axis}_{unit}"] for axis in AXES}
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.12g")
    return path


def judged(judge: Scene, body: ReducedBody) -> SceneErrors:
    """Error of a body in a scene, with its own method."""
    return errors(judge, references(judge, Reporter()), FlexibleBody(body))


def toe_error(judge: Scene, body: ReducedBody) -> float:
    """Largest error of the wheels' toe in a scene's static cases, degrees."""
    if judge.read != ("wheel_left", "wheel_right"):
        return float("nan")
    known, model, worst = references(judge, Reporter()), FlexibleBody(body), 0.0
    for case in judge.static:
        found = np.array(
            [model.motion(model.static(case.peak.scaled(factor))).reshape(-1, 6) for factor in case.factors]
        )
        for wheel, side in enumerate((LEFT, RIGHT)):
            own, expected = (
                alignment(motion[:, wheel, :3], motion[:, wheel, 3:], side).toe
                for motion in (found, known[case.name].motion)
            )
            worst = max(worst, float(np.max(np.abs(own - expected))))
    return worst
