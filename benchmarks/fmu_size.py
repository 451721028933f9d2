"""What an FMU holds, in bytes of its archive: the clamped beam with two frames and four interfaces, of many modes.

Run from the repository's root: python -m benchmarks.fmu_size [--output FILE.csv]. The body of `benchmarks.watch_share`
with the core of this machine alone. The same body gives the same bytes: no figure changes from run to run.
"""

from __future__ import annotations

import argparse
import tempfile
import zipfile
from pathlib import Path

from flexfmu.fmu.package import package_fmu

from .core_step import INTERFACES, beam
from .records import write_records

MODES = (20, 80, 160)
PARTS = {"modal file": ".h5", "shadow": "shadow.prog", "other programs": ".prog", "core": ".so"}


def sizes(path: Path) -> dict[str, int]:
    """Bytes of an FMU, and of each part of it as it lies in the archive."""
    found = {"whole": path.stat().st_size} | dict.fromkeys(PARTS, 0)
    with zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            part = next((name for name, end in PARTS.items() if entry.filename.endswith(end)), "")
            if part:
                found[part] += entry.compress_size
    return found


def measure(output: Path) -> None:
    """Build, print a table, write the records."""
    rows: list[dict[str, object]] = []
    print(f"| modes | MB | {' | '.join(PARTS)} |", f"|---|---|{'---|' * len(PARTS)}", sep="\n")
    with tempfile.TemporaryDirectory() as name:
        for modes in MODES:
            fmu = Path(name) / f"beam_{modes}.fmu"
            package_fmu(beam(INTERFACES, 2, modes=modes), fmu)
            found = sizes(fmu)
            rows.append({"modes": modes} | found)
            print(f"| {modes} | {' | '.join(f'{1e-6 * size:.2f}' for size in found.values())} |", flush=True)
    write_records(output, rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("fmu_size.csv"))
    measure(parser.parse_args().output)
