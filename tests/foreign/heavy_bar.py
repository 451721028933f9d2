"""A clamped bar with masses at nodes of its tip; as a script, it writes heavy_bar.csv by CalculiX (ccx 2.20)."""

import csv
import subprocess
import tempfile
from pathlib import Path

from foreign.deck_bars import HERE, deck

COUNT = 6
# kg, on each node of the tip.
MASS = 1.5


def heavy_deck():
    """The model part of the bar's deck."""
    text, tip = deck("engineering")
    lines = [
        "*ELEMENT, TYPE=MASS, ELSET=WEIGHTS",
        *(f"{90000 + n}, {n}" for n in tip),
        "*MASS, ELSET=WEIGHTS",
        f"{MASS}",
    ]
    return text + "\n".join(lines) + "\n"


def main():
    """Find the frequencies and write the table."""
    rows = ["*BOUNDARY", "ROOT, 1, 3", "*STEP", "*FREQUENCY", f"{COUNT}", "*END STEP", ""]
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "bar.inp").write_text(heavy_deck() + "\n".join(rows))
        subprocess.run(["ccx", "bar"], cwd=folder, check=True, capture_output=True)
        words = [line.split() for line in (Path(folder) / "bar.dat").read_text().splitlines()]
    # Mode, eigenvalue, rad/time, cycles/time, imaginary part.
    found = [row[3] for row in words if len(row) == 5 and row[0].isdigit()][:COUNT]
    with (HERE / "heavy_bar.csv").open("w", newline="") as file:
        csv.writer(file).writerows([["frequency_hz"], *([value] for value in found)])


if __name__ == "__main__":
    main()
