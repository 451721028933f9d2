"""Five small bodies of every kind for the fuzzers, and their FMUs: `python tests/fuzzed.py FOLDER` writes them all."""

import sys
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from bodies import random_body
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.fmu.description import Runtime
from flexfmu.fmu.package import package_fmu
from flexfmu.mesh.elements import ElementType
from flexfmu.model.methods import Mass, Method
from flexfmu.model.reduced_body import GROUND, Masses, ReducedBody, StressSet, Ties
from meshes import body_file, box

KINDS = ("plain", "free", "cut", "masses", "stress")


def _synthetic(seed: int, **changes: object) -> ReducedBody:
    modes = 3
    return random_body(seed, (GROUND, 0), (0, 1), modes=modes, velocity_outputs=True, **changes)


@cache
def _of_mesh(free: bool, **reduction: object) -> ReducedBody:
    with tempfile.TemporaryDirectory() as folder:
        mesh = box(ElementType.C3D20, (4, 1, 1), np.array([0.3, 0.1, 0.04]))
        tables = {"frames": 2, "free": free, "reduction": {"modes": 4} | reduction}
        tables |= {"output": {"velocities": True}, "input": {"acceleration": not free}}
        config = body_file(mesh, Path(folder), interface=["ROOT", "TIP"] if free else ["TIP"], support="ROOT", **tables)
        if free:
            config = config.model_copy(update={"support": []})
        return reduce_body(config, Reporter())


def fuzzed_body(kind: str, seed: int = 1) -> ReducedBody:
    """A small body of a kind; of another seed another body with states of the same size."""
    rng = np.random.default_rng(seed)
    if kind == "free":
        return _scaled(_of_mesh(True, basis="craig_bampton"), seed)
    if kind == "masses":
        body = _of_mesh(False, inertia=True)
        return _scaled(replace(body, method=Method.FRAMES, mass=Mass.CONFIGURATION), seed)
    if kind == "cut":
        levers = np.array([[[0, 1]]]).reshape(1, 2)
        ties = Ties(
            levers,
            rng.uniform(-1.0, 1.0, (1, 2, 3)),
            0.1 * rng.standard_normal((1, 2, 3, 3)),
            0.1 * rng.standard_normal((1, 2, 3, 3)),
            np.full((1, 3), 4000.0),
            0.1 * np.eye(3)[None],
        )
        return random_body(seed, (GROUND, GROUND), (0, 1), modes=3, velocity_outputs=True, ties=ties)
    if kind == "stress":
        part = StressSet("root", rng.uniform(-1.0, 1.0, (4, 3)), 1e9 * rng.standard_normal((4, 6, 3)))
        return _synthetic(seed, stress_sets=(part,), compliance_interfaces=("port_0",))
    masses = Masses(
        rng.uniform(0.1, 1.0, 2), rng.uniform(-1.0, 1.0, (2, 3)), 0.1 * rng.standard_normal((2, 3, 3)), np.array([0, 1])
    )
    return _synthetic(seed, masses=masses)


def _scaled(body: ReducedBody, seed: int) -> ReducedBody:
    return replace(body, damping_ratio=body.damping_ratio + 1e-3 * (seed - 1))


def write(folder: Path, runtime: Runtime, fmi: int = 2) -> None:
    """FMUs of all kinds, each with a twin."""
    for kind in KINDS:
        for name, seed in ((kind, 1), (f"{kind}_twin", 2)):
            package_fmu(fuzzed_body(kind, seed), folder / f"{name}.fmu", runtime, fmi=fmi)


if __name__ == "__main__":
    write(Path(sys.argv[1]), Runtime(sys.argv[2]) if len(sys.argv) > 2 else Runtime.NATIVE, *map(int, sys.argv[3:]))
