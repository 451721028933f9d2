"""Whether two versions of this project give the same results, to the last bit: for changes that should only move code.

    python benchmarks/same_results.py write FOLDER [--only WORDS] [--long] [--demo FOLDER]
    python benchmarks/same_results.py compare OLD NEW [--all]

`write` runs with the interpreter of one version and needs nothing but its public names, so that one copy of this file
serves both; `--demo` names the meshes, the same for both. Both run on one machine. Each case builds a body whose
choices are all written here, keeps the hash of its modal file and of each member of its FMU, and what it does: statics,
motions, FMI. `compare` says of each case which quantities differ, and by how much relative to their largest number; of
many those that differ most, without `--all`. `--long` adds the axle: minutes.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import tempfile
import tomllib
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

# Sums in one order: before the libraries are loaded.
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import h5py
import numpy as np

import flexfmu
from flexfmu.files.basics import EquilibriumError, OptionError, StepError

DEMO = Path(__file__).resolve().parent.parent / "demo"
HASHES = "hashes.json"
STEPS = 24
# Members of an FMU that differ with every compiler.
COMPILED = ("binaries/",)
CONSTANT, HEAVY = "constant", "configuration"
PLAIN = (("linear", CONSTANT), ("frames", CONSTANT), ("second_order", CONSTANT))
SOURCE = (
    ("stiffness_by_load", CONSTANT),
    ("stiffness_by_mode", CONSTANT),
    ("modal_rotation", CONSTANT),
    ("half_rotation", CONSTANT),
    ("floating_frame", CONSTANT),
    ("frames_stiffness", CONSTANT),
)
HEAVIES = (("frames", HEAVY), ("second_order", HEAVY))
STORED = {"second_order": True, "inertia": True}


@dataclass(frozen=True)
class Case:
    """A body with every choice that might have another default in another version.

    Attributes
    ----------
    file : str
        Body file below demo/.
    force : float
        N on each interface; moments are a twentieth of it in N m.
    step : float
        s.
    methods : tuple of (method, mass)
    reduction : mapping
        Changes to `[reduction]`.
    tables : mapping
        Other tables, which replace those of the body file; None takes one out.
    held : bool
        Whether it has equilibria.
    fixed : tuple of str
        Interfaces of a free body that the scene fixes.
    mesh : str
        Other mesh file.
    long : bool
        Whether it takes minutes.
    """

    file: str
    force: float
    step: float
    methods: tuple[tuple[str, str], ...] = PLAIN
    reduction: Mapping[str, Any] = field(default_factory=dict)
    tables: Mapping[str, Any] = field(default_factory=dict)
    held: bool = True
    fixed: tuple[str, ...] = ()
    mesh: str = ""
    long: bool = False


ROOT_AND_TIP = [{"name": "root", "nodes": "ROOT"}, {"name": "tip", "nodes": "TIP"}]
FOLLOWING = [{"name": "tip", "nodes": "TIP", "follows": True}]
FEET = [{"nodes": name, "fix": ["x", "y", "z"]} for name in ("FOOT_LEFT", "FOOT_RIGHT")]
PORTAL = {"support": FEET, "interface": [{"name": "corner", "nodes": "CORNER"}], "frames": 2, "cut": "auto"}
FREE = {"free": True, "support": None, "interface": ROOT_AND_TIP, "frames": 4, "input": {"acceleration": True}}
SPRINGS = [{"nodes": "ROOT", "stiffness": [2e7, 1e7, 3e7]}, {"nodes": "TIP", "stiffness": [0.0, 1e5, 0.0]}]
TURNING = {**STORED, "basis": "craig_bampton", "modes": 8}
WITH_SOURCE = {"geometric_stiffness": ["by_load", "by_mode"], "basis": "normal", "modes": 10}

CASES = {
    "beam": Case("clamped_beam/body.toml", 10e3, 1e-3, PLAIN + HEAVIES, {**STORED, "residual_flexibility": False}),
    "beam, source": Case("clamped_beam/body.toml", 3e3, 1e-3, SOURCE, {**WITH_SOURCE, "residual_flexibility": False}),
    "beam, residual": Case("clamped_beam/body.toml", 10e3, 1e-3, PLAIN, {"modes": 6, "residual_flexibility": True}),
    "beam, follower": Case(
        "clamped_beam/body.toml", 4e3, 1e-3, PLAIN + HEAVIES, dict(STORED), {"interface": FOLLOWING, "frames": 4}
    ),
    "beam, accelerated": Case(
        "clamped_beam/body.toml", 5e3, 1e-3, PLAIN, {"second_order": True}, {"input": {"acceleration": True}}
    ),
    "beam on springs": Case("clamped_beam/body.toml", 2e3, 1e-3, PLAIN, {"modes": 8}, {"support": SPRINGS}),
    "free beam": Case("clamped_beam/body.toml", 2e3, 1e-3, PLAIN + HEAVIES, TURNING, FREE, held=False),
    "free beam, normal": Case(
        "clamped_beam/body.toml", 2e3, 1e-3, PLAIN, {"modes": 8, "basis": "normal"}, FREE, held=False
    ),
    "free beam, fixed": Case("clamped_beam/body.toml", 2e3, 1e-3, PLAIN, TURNING, FREE, fixed=("root",)),
    "clamped beam": Case("clamped_clamped/body.toml", 30e3, 5e-4, (*PLAIN, HEAVIES[0]), dict(STORED)),
    "L-frame": Case("l_frame/body.toml", 1e3, 1e-3, (*PLAIN, HEAVIES[1]), {**STORED, "modes": 12}),
    "plate": Case("plate/body.toml", 100.0, 1e-3, PLAIN, {"second_order": True, "modes": 12}),
    "curved": Case("curved/body.toml", 1e3, 1e-3, PLAIN, {"second_order": True}),
    "arch": Case("shallow_arch/body.toml", 2e3, 5e-4, PLAIN, {"second_order": True}),
    "roof": Case("shallow_roof/body.toml", 300.0, 5e-4, PLAIN, {"second_order": True, "modes": 10}),
    "tube": Case("thin_tube/body.toml", 200.0, 1e-3, PLAIN, {"second_order": True}),
    "bracket": Case(
        "bracket/body.toml", 2e3, 5e-4, PLAIN, {"basis": "normal", "residual_flexibility": False}, {"frames": 3}
    ),
    "portal": Case(
        "clamped_beam/body.toml", 100.0, 2e-4, PLAIN, {"modes": 8}, {**PORTAL, "cut": []}, mesh="loops/portal.inp"
    ),
    "portal, cut": Case(
        "clamped_beam/body.toml", 100.0, 2e-4, PLAIN[1:], {"modes": 8}, PORTAL, mesh="loops/portal.inp"
    ),
    "axle": Case("rear_axle/body.toml", 1e3, 1e-3, PLAIN, long=True),
    "axle on bushings": Case("rear_axle/body_bushings.toml", 1e3, 1e-3, PLAIN[1:], long=True),
    "axle in one piece": Case("rear_axle/body_whole.toml", 1e3, 1e-3, PLAIN, long=True),
}


def built(case: Case, demo: Path) -> flexfmu.FlexibleBody:
    """Build the body of a case."""
    path = demo / case.file
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    mesh = data.pop("mesh")
    units = mesh.get("units", "m-kg-s")
    file = demo / case.mesh if case.mesh else path.parent / mesh["file"]
    plain = {"second_order": True, "residual_flexibility": False}
    data["reduction"] = {**plain, **data.get("reduction", {}), **case.reduction}
    data = {key: value for key, value in (data | case.tables).items() if value is not None}
    body = flexfmu.Body(flexfmu.read_mesh(file, units), units=units, tables=data)
    return body.build(method="frames", mass=CONSTANT)


def loads_of(body: flexfmu.FlexibleBody, force: float, turn: int = 0) -> dict[str, list[float]]:
    """Forces and moments on all interfaces, in other directions for each `turn`."""
    result = {}
    for number, name in enumerate(body.model.interface_names):
        forces = np.roll([0.2, 1.0, -0.4], number + turn) * force
        moments = np.roll([0.3, -0.5, 1.0], 2 * number + turn) * 0.05 * force
        result[name] = [float(value) for value in (*forces, *moments)]
    return result


def statics(body: flexfmu.FlexibleBody, force: float) -> Iterator[tuple[str, Any]]:
    """What a body says of equilibria under three loads, the first small."""
    for turn, part in enumerate((0.01, 0.5, 1.0)):
        loads = body.loads(loads_of(body, part * force, turn))
        inputs = loads.packed(body.model.masses is not None)
        try:
            state = body.static(loads)
        except EquilibriumError as error:
            yield f"static {turn}: refused", np.array([error.load_factor])
            continue
        yield f"static {turn}: q", state.q
        yield f"static {turn}: motion", body.motion(state)
        yield f"static {turn}: force", body.forces(state, inputs)
        yield f"static {turn}: tangent", body.tangent(state, inputs)
        yield f"static {turn}: stability", body.stability(state, inputs)[0]
        yield f"static {turn}: stiffness missed", body.stiffness_missed(inputs)
        yield f"static {turn}: rotation", body.core.rotations(state.q)
        yield f"static {turn}: compliance", body.compliance(state, inputs, 1e-3, [0])


def motion(body: flexfmu.FlexibleBody, case: Case) -> Iterator[tuple[str, Any]]:
    """Steps under a sudden load, then under one that grows and turns."""
    state, places, rates, energies, work = body.rest(), [], [], [], []
    for number in range(STEPS):
        half = number >= STEPS // 2
        start = loads_of(body, case.force * (0.3 if not half else 0.5 + number / STEPS), int(half))
        end = loads_of(body, case.force * (0.5 + (number + 1) / STEPS), 1) if half else None
        length = case.step * (1.0, 0.5, 2.0)[number % 3]
        try:
            state, cost = body.step_with_work(state, start, length, end)
        except StepError:
            yield "motion: refused at", np.array([number])
            break
        moved, moving = body.motion_and_rates(state)
        places.append(moved)
        rates.append(moving)
        energies.append(body.energies(state))
        work.append([cost.substeps, cost.iterations])
    yield "motion: places", np.array(places)
    yield "motion: rates", np.array(rates)
    yield "motion: energies", np.array(energies)
    yield "motion: work", np.array(work)
    yield "motion: q", state.q
    yield "motion: v", state.v
    yield "motion: mass", body.mass(state)


def modal_values(path: Path) -> Iterator[tuple[str, Any]]:
    """Numbers of a modal file."""
    found: dict[str, Any] = {}

    def keep(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu":
            found[f"modal file: {name}"] = item[()]

    with h5py.File(path) as file:
        file.visititems(keep)
    yield from found.items()


def digest(data: bytes) -> str:
    """Hash of bytes."""
    return hashlib.sha256(data).hexdigest()[:20]


def write_case(case: Case, demo: Path) -> tuple[dict[str, str], dict[str, Any]]:
    """Hashes and values of a case."""
    hashes: dict[str, str] = {}
    values: dict[str, Any] = {}
    body = built(case, demo)
    with tempfile.TemporaryDirectory() as name:
        file = body.save(Path(name) / "body.h5")
        hashes["modal file"] = digest(file.read_bytes())
        values.update(modal_values(file))
        fmu = body.fmu(Path(name) / "body.fmu")
        with zipfile.ZipFile(fmu) as archive:
            for member in sorted(archive.namelist()):
                if not member.startswith(COMPILED):
                    hashes[f"FMU: {member}"] = digest(archive.read(member))
    if not case.fixed:
        result = body.simulate(loads_of(body, 0.3 * case.force), step=case.step, stop=10 * case.step)
        values |= {f"FMU: {output}": result[output] for output in result.outputs}
    for method, mass in case.methods:
        try:
            run = flexfmu.FlexibleBody(body.model, method, mass, fixed=case.fixed)
        except OptionError as error:
            hashes[f"{method}, {mass}"] = str(error)
            continue
        quantities = [*(statics(run, case.force) if case.held or case.fixed else []), *motion(run, case)]
        values |= {f"{method}, {mass}: {quantity}": value for quantity, value in quantities}
    return hashes, values


def write(folder: Path, only: str, long: bool, demo: Path) -> None:
    """Write the records of all cases."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / HASHES
    hashes = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    warnings.simplefilter("ignore")
    for name, case in CASES.items():
        if only in name and (long or not case.long):
            hashes[name], values = write_case(case, demo)
            np.savez_compressed(
                folder / f"{name}.npz", **{key.replace("/", "|"): value for key, value in values.items()}
            )
            path.write_text(json.dumps(hashes, indent=1), encoding="utf-8")
            print(f"{name}: {len(values)} quantities", flush=True)


def compare(old: Path, new: Path, most: int) -> bool:
    """Print what differs between two records, `most` lines of each case; whether nothing does."""
    before, after = (json.loads((folder / HASHES).read_text(encoding="utf-8")) for folder in (old, new))
    same = True
    for name in [*before, *(name for name in after if name not in before)]:
        if name not in before or name not in after:
            print(f"{name}: only in {old if name in before else new}")
            continue
        keys = before[name] | after[name]
        altered = [key for key in keys if before[name].get(key) != after[name].get(key)]
        with np.load(old / f"{name}.npz") as a, np.load(new / f"{name}.npz") as b:
            found = [(key, *difference(key, a, b)) for key in sorted({*a.files, *b.files})]
            off = sorted((each for each in found if each[1]), key=lambda each: -each[2])
            count = len(a.files)
        same &= not (altered or off)
        print(f"{name}: of {count} quantities {len(off) or 'none'} differ; {', '.join(altered) or 'no bytes'} differ")
        for key, words, _ in off[:most]:
            print(f"    {key}: {words}")
    return same


def difference(key: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> tuple[str, float]:
    """In what a quantity differs, or nothing, and by how much."""
    if key not in old or key not in new:
        return "gone" if key in old else "new", np.inf
    a, b = old[key], new[key]
    if a.shape != b.shape:
        return f"shape {a.shape}, then {b.shape}", np.inf
    if a.tobytes() == b.tobytes():
        return "", 0.0
    largest = max(np.max(np.abs(a)), np.max(np.abs(b)))
    relative = float(np.max(np.abs(a.astype(float) - b.astype(float))) / largest) if largest > 0.0 else 0.0
    return f"{relative:.1e}", relative


def main() -> None:
    """Run as a script."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    writing = commands.add_parser("write")
    writing.add_argument("folder", type=Path)
    writing.add_argument("--only", default="", help="cases whose name holds these words")
    writing.add_argument("--long", action="store_true", help="those that take minutes, too")
    writing.add_argument("--demo", type=Path, default=DEMO, help="folder of the body files and meshes")
    comparing = commands.add_parser("compare")
    comparing.add_argument("old", type=Path)
    comparing.add_argument("new", type=Path)
    comparing.add_argument("--all", action="store_true", help="every quantity that differs")
    arguments = parser.parse_args()
    if arguments.command == "compare":
        sys.exit(0 if compare(arguments.old, arguments.new, 10**6 if arguments.all else 8) else 1)
    write(arguments.folder, arguments.only, arguments.long, arguments.demo)


if __name__ == "__main__":
    main()
