"""Records of benchmarks: one number or vector of one model of a problem, beside published and computed ones."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.records import read_records
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.model.methods import Method

COLUMNS = (
    "problem", "source", "quantity", "model", "published", "calculix", "ours", "error", "error_calculix", "cost",
    "ratio",
)  # fmt: skip


@dataclass(frozen=True)
class Record:
    """What a model says of a problem.

    Attributes
    ----------
    problem, source : str
        The source of the published value, or of the law.
    quantity : str
        With its unit.
    model : str
        Method and frames, or mass.
    ours : tuple of float
        Empty where the model has no answer.
    published, calculix : tuple of float
        Empty where there is none; CalculiX's is of the same mesh.
    cost : float
        s an equilibrium, or s of computation per simulated second; 0 where it was not measured.
    ratio : float
        Cost over that of method `linear`; 0 where it was not measured.
    """

    problem: str
    source: str
    quantity: str
    model: str
    ours: tuple[float, ...]
    published: tuple[float, ...] = ()
    calculix: tuple[float, ...] = ()
    cost: float = 0.0
    ratio: float = 0.0

    @property
    def error(self) -> float:
        """|ours − published| / |published|; |ours| where the law says 0; NaN where either is missing."""
        return _distance(self.ours, self.published)

    @property
    def error_calculix(self) -> float:
        """The same, of CalculiX's result on the same mesh."""
        return _distance(self.ours, self.calculix)

    def row(self) -> dict[str, object]:
        """Row of the file of records."""
        values = {name: getattr(self, name) for name in COLUMNS}
        return {name: " ".join(f"{x:.8g}" for x in v) if isinstance(v, tuple) else v for name, v in values.items()}


def read(path: Path) -> list[Record]:
    """Records of a file."""

    def vector(text: str) -> tuple[float, ...]:
        return tuple(float(part) for part in text.split())

    vectors = ("ours", "published", "calculix")
    return [
        Record(
            **{name: row[name] for name in ("problem", "source", "quantity", "model")},
            **{name: vector(row[name]) for name in vectors},
            cost=float(row["cost"]),
            ratio=float(row["ratio"]),
        )
        for row in read_records(path)
    ]


def _distance(found: tuple[float, ...], expected: tuple[float, ...]) -> float:
    if not found or not expected:
        return float("nan")
    size = float(np.linalg.norm(expected)) or 1.0
    return float(np.linalg.norm(np.subtract(found, expected))) / size


def label(method: Method, frames: int) -> str:
    """Name of a model."""
    if method is Method.LINEAR:
        return "linear"
    return f"{method.label}, {frames} frame{'' if frames == 1 else 's'}"


def median_time(work: Callable[[], object], repeats: int = 5) -> float:
    """Median wall time of some work, s, once it is warm."""
    work()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def linear_cost(model: FlexibleBody, loads: dict[str, list[float]]) -> float:
    """Cost of an equilibrium of the same body by method `linear`, s."""
    body = FlexibleBody(model.model, Method.LINEAR)
    return median_time(lambda: body.static(loads))


def tables(records: Sequence[Record]) -> str:
    """Tables of markdown: errors in %, a row each quantity, a table for the problems that were tried with like models.

    Errors are those to CalculiX on the same mesh where it has the result, to the published value elsewhere; of what
    is zero by law the value itself. Cost is that of the last model of one frame of
    second order, or of all where there is none.
    """
    rows: dict[tuple[str, str], list[Record]] = {}
    for record in records:
        rows.setdefault((record.problem, record.quantity), []).append(record)
    groups: dict[tuple[str, ...], list[list[Record]]] = {}
    for row in rows.values():
        groups.setdefault(tuple(record.model for record in row), []).append(row)
    parts = []
    for models, members in groups.items():
        head = ["problem", "quantity", "published", "CalculiX", *models, "cost", "over linear"]
        lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
        for row in members:
            first = row[0]
            cells = [first.problem, first.quantity, _numbers(first.published), _numbers(first.calculix)]
            cells += [_error(record) for record in row] + [_per_model(row, "cost"), _per_model(row, "ratio")]
            lines.append("| " + " | ".join(cells) + " |")
        parts.append("\n".join(lines))
    return "\n\n".join(parts)


def _numbers(values: tuple[float, ...]) -> str:
    if len(values) > 3:
        return f"{len(values)} numbers"
    size = max(map(abs, values), default=0.0)
    return " ".join(f"{0.0 if abs(x) < 1e-9 * size else x:.4g}" for x in values)


def _error(record: Record) -> str:
    if not record.ours:
        return "none"
    if record.published == (0.0,):
        return f"{record.ours[0]:.0e}"
    error = record.error_calculix if record.calculix else record.error
    return f"{100.0 * error:.2g}"


def _per_model(row: Sequence[Record], name: str) -> str:
    default = [record for record in row if record.model.startswith("second order, 1 frame")][-1:]
    values = [getattr(record, name) for record in default or row]
    if not any(values):
        return ""
    shown = [(_time(x) if name == "cost" else f"{x:.2g}") if x else "–" for x in values]
    return ", ".join(shown)


def _time(seconds: float) -> str:
    return (
        f"{1e6 * seconds:.2g} µs"
        if seconds < 1e-3
        else f"{1e3 * seconds:.2g} ms"
        if seconds < 0.1
        else f"{seconds:.2g} s"
    )
