"""Kept results of Exudyn's geometrically exact beam; `benchmarks.field.exudyn_beams` makes them."""

from __future__ import annotations

import csv
from collections.abc import Iterator

from benchmarks.field.bodies import FOLDER

# Published lags and stretch of the spin-up, m.
SPUN = {
    "lag at 5 s, m": -0.462,
    "lag at 7.5 s, m": -0.559,
    "lag at 10 s, m": -0.362,
    "lag at 12.5 s, m": -0.111,
    "steady stretch, m": 5.13e-4,
}


def kept(problem: str) -> Iterator[tuple[str, str, tuple[float, ...], float]]:
    """Quantity, model, values and cost (s) of Exudyn, the values of one quantity together."""
    with (FOLDER / "exudyn.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["problem"] == problem]
    for elements in dict.fromkeys(row["elements"] for row in rows):
        own = [row for row in rows if row["elements"] == elements]
        model = f"Exudyn {own[0]['version']}, {elements} elements"
        if problem in ("sudden", "flight", "pendulum", "crank"):
            yield "", model, tuple(float(row["value"]) for row in own), float(own[0]["cost_s"])
        elif problem == "spin_up":
            yield from ((row["quantity"], model, (float(row["value"]),), float(row["cost_s"])) for row in own)
        else:
            for along, across in zip(own[::2], own[1::2], strict=True):
                values = float(along["value"]), float(across["value"])
                yield along["quantity"].removeprefix("along, "), model, values, float(along["cost_s"])
