"""What each stage of a build takes, in time and memory, of a curved arm of ten-node tetrahedra of any size.

Run from the repository's root: python -m benchmarks.large [SIZE ...] [--solver pardiso|superlu] [--folder DIR], SIZE
being unknowns (default: 50 000, 150 000, 300 000 and 1 000 000), on Linux. Every build is a process of its
own, of the default method with default keys: one support, two interfaces. Stages are told while they run. What a
build has found is kept in DIR, so that one that was ended goes on where it was (but for the factors); so are the
records of its stages. Finished builds are not made anew before DIR is removed. Prints a table of all.
"""

import argparse
import csv
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import permutations
from pathlib import Path

import numpy as np

from flexfmu.api import Body
from flexfmu.files.basics import FloatArray, IntArray
from flexfmu.files.console import ConsoleReporter
from flexfmu.files.outputs import Tell
from flexfmu.files.store import Store

SIZES = (50_000, 150_000, 300_000, 1_000_000)
# A quarter of a ring of rectangular section, m.
RADIUS, WIDTH, THICKNESS = 0.1, 0.06, 0.012
STEEL = (2.1e11, 0.3, 7850.0)
COLUMNS = ("unknowns", "solver", "stage", "seconds", "processor_seconds", "peak_gb")
# The stage that ends a build: all of it.
WHOLE = "all"
GIGA = 1e9


def arm(unknowns: int) -> tuple[FloatArray, IntArray]:
    """Points (n, 3) and ten-node tetrahedra (e, 10) of a quarter ring: unknowns once one end is held, and hardly more.

    Cells of a grid become six tetrahedra each, along the paths from corner to corner; mid-side nodes lie on the arc.
    """
    sides = np.array([0.5 * np.pi * RADIUS, WIDTH, THICKNESS])
    cell = (8.0 * sides.prod() / (unknowns / 3.0)) ** (1.0 / 3.0)
    counts = np.maximum(1, np.rint(sides / cell)).astype(np.int64)
    counts[0] = np.ceil(unknowns / (6.0 * np.prod(2 * counts[1:] + 1)))
    shape = 2 * counts + 1
    steps = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3)
    share = steps / (2.0 * counts)
    angle, radius = 0.5 * np.pi * share[:, 0], RADIUS + THICKNESS * (share[:, 2] - 0.5)
    points = np.stack([radius * np.sin(angle), WIDTH * share[:, 1], radius * np.cos(angle)], axis=1)
    start = 2 * np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 1, 3)
    paths = []
    for order in permutations(range(3)):
        corners = np.vstack(
            [np.zeros(3, dtype=np.int64), np.cumsum(2 * np.eye(3, dtype=np.int64)[list(order)], axis=0)]
        )
        if np.linalg.det((corners[1:] - corners[0]).astype(float)) < 0.0:
            corners = corners[[0, 2, 1, 3]]
        middles = [(corners[i] + corners[j]) // 2 for i, j in ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))]
        paths.append(np.vstack([corners, middles]))
    places = np.concatenate([start + path for path in paths])
    return points, np.ravel_multi_index(tuple(np.moveaxis(places, -1, 0)), tuple(shape))


def body(unknowns: int) -> Body:
    """The arm, held at one end, with interfaces at the other and on a patch outside."""
    points, tetrahedra = arm(unknowns)
    angle, radius = np.arctan2(points[:, 0], points[:, 2]), np.hypot(points[:, 0], points[:, 2])
    outside = radius > RADIUS + 0.5 * THICKNESS * (1.0 - 1e-6)
    tolerance = 1e-6
    faces = {
        "root": angle < tolerance,
        "tip": angle > 0.5 * np.pi - tolerance,
        "pad": outside & (np.abs(angle - 0.25 * np.pi) < 0.1) & (np.abs(points[:, 1] - 0.5 * WIDTH) < 0.2 * WIDTH),
    }
    numbers = {name: np.flatnonzero(inside).tolist() for name, inside in faces.items()}
    interfaces = {name: numbers[name] for name in ("tip", "pad")}
    return Body((points, {"tetra10": tetrahedra}), STEEL, [numbers["root"]], interfaces, name="arm")


class StageRecords(ConsoleReporter):
    """Tells stages, and keeps time and peak memory of each.

    Parameters
    ----------
    path : Path
        Where records are, and are kept from an earlier process.
    unknowns : int
    solver : str
    """

    def __init__(self, path: Path, unknowns: int, solver: str):
        super().__init__()
        self._path, self._what = path, (unknowns, solver)
        self._rows = {row["stage"]: row for row in records(path)}

    @contextmanager
    def stage(self, title: str) -> Iterator[None]:
        """Record a stage."""
        with self._recorded(title), super().stage(title):
            yield

    @contextmanager
    def counted(self, title: str, total: float, unit: str = "") -> Iterator[Tell]:
        """Record a counted stage."""
        with self._recorded(title), super().counted(title, total, unit) as tell:
            yield tell

    @contextmanager
    def _recorded(self, title: str) -> Iterator[None]:
        start, own = time.perf_counter(), time.process_time()
        forget_peak()
        yield
        self.add(title, time.perf_counter() - start, time.process_time() - own, peak())
        self.note(f"peak {peak():.2f} GB")

    def add(self, title: str, seconds: float, processor: float, gigabytes: float) -> None:
        """Add a record and write them all."""
        row = (*self._what, title, round(seconds, 1), round(processor, 1), round(gigabytes, 2))
        self._rows[title] = dict(zip(COLUMNS, map(str, row), strict=True))
        with self._path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(self._rows.values())

    @property
    def largest_peak(self) -> float:
        """Of all stages, GB."""
        return max(float(row["peak_gb"]) for row in self._rows.values())


def forget_peak() -> None:
    """Let the peak of the process's memory be what it has now."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def peak() -> float:
    """Largest memory of the process since then, GB."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return 1024.0 * float(next(line.split()[1] for line in lines if line.startswith("VmHWM"))) / GIGA


def build(unknowns: int, solver: str, folder: Path) -> None:
    """Build one body and write its records."""
    if solver == "superlu":
        # As if it were not installed.
        sys.modules["pypardiso"] = None  # type: ignore[assignment]
    report = StageRecords(record_file(folder, unknowns, solver), unknowns, solver)
    start, own = time.perf_counter(), time.process_time()
    with report.stage("Mesh"):
        arm_body = body(unknowns)
    built = arm_body.build(report=report, store=Store(folder / "kept"))
    with report.stage("Write the FMU"):
        built.fmu(folder / f"{unknowns}_{solver}.fmu")
    report.add(WHOLE, time.perf_counter() - start, time.process_time() - own, report.largest_peak)


def records(path: Path) -> list[dict[str, str]]:
    """Records of a build, those of an unfinished one included."""
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def record_file(folder: Path, unknowns: int, solver: str) -> Path:
    """Where the records of a build are."""
    return folder / f"{unknowns}_{solver}.csv"


def table(folder: Path) -> str:
    """All records, as a table."""
    lines = ["| degrees of freedom | solver | stage | s | s of the processor | peak GB |", "|---|---|---|---|---|---|"]
    for path in sorted(folder.glob("*.csv"), key=lambda path: int(path.stem.split("_")[0])):
        lines += ["| " + " | ".join(row[name] for name in COLUMNS) + " |" for row in records(path)]
    return "\n".join(lines)


def main() -> None:
    """Run as a script."""
    if sys.platform != "linux":
        raise SystemExit("peaks of memory are read from Linux")
    import resource

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sizes", nargs="*", type=int, metavar="SIZE")
    parser.add_argument("--solver", choices=("pardiso", "superlu"), default="pardiso")
    parser.add_argument("--folder", type=Path, default=Path("large"))
    parser.add_argument("--most", type=float, metavar="GB", help="address space that a build may have")
    parser.add_argument("--here", action="store_true", help="build in this process")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    if given.here:
        build(given.sizes[0], given.solver, given.folder)
        return
    for size in given.sizes or SIZES:
        if any(row["stage"] == WHOLE for row in records(record_file(given.folder, size, given.solver))):
            continue
        print(f"{size} degrees of freedom, {given.solver}", flush=True)
        command = [sys.executable, "-m", "benchmarks.large", str(size), "--here"]
        command += ["--solver", given.solver, "--folder", str(given.folder)]
        limit = int(given.most * GIGA) if given.most else resource.RLIM_INFINITY

        def limited(most: int = limit) -> None:
            resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))

        if subprocess.run(command, preexec_fn=limited, check=False).returncode:
            print(f"{size} degrees of freedom: not built")
    print(table(given.folder))


if __name__ == "__main__":
    main()
