"""What records of the shortest body file come to: errors, warnings, the certificate's word."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from benchmarks.records import numbers

Row = Mapping[str, str]
RECORDS = Path(__file__).with_name("defaults.csv")
# A point is right up to here: displacement over the largest one, rotation over the largest one.
RIGHT, TURNED_RIGHT = 0.01, 0.02
# An alarm without cause: told, though the error is below.
FINE = 0.005


def error(row: Row) -> float:
    """Error of a point as a share of what is right: displacement, or half the rotation's, whichever is larger."""
    return max(float(row["displacement_error"]), float(row["rotation_error"]) * RIGHT / TURNED_RIGHT)


def told(row: Row) -> bool:
    """Whether the FMU warned or refused."""
    return bool(row["log"])


def answered(rows: Sequence[Row]) -> list[Row]:
    """Points with a result."""
    return [row for row in rows if row["displacement_error"] != "nan"]


def summary(rows: Sequence[Row]) -> dict[str, float]:
    """Counts over points: right, silent, told, false alarms, certified (nothing told); worst silent error."""
    found = answered(rows)
    wrong = [row for row in found if error(row) > RIGHT]
    silent = [row for row in wrong if not told(row)]
    return {
        "bodies": len({row["body"] for row in rows}),
        "points": len(rows),
        "right": len(found) - len(wrong),
        "refused": len(rows) - len(found),
        "told": len(wrong) - len(silent),
        "certified": sum(not told(row) for row in found),
        "certified_right": sum(not told(row) and error(row) <= RIGHT for row in found),
        "silent": sum(error(row) <= 3.0 * RIGHT for row in silent),
        "silent_beyond_3": sum(error(row) > 3.0 * RIGHT for row in silent),
        "worst_silent": max(map(error, silent), default=0.0),
        "false_alarms": sum(told(row) and error(row) < FINE for row in found),
    }


def _sentence(rows: Sequence[Row]) -> str:
    s = summary(rows)
    share = 100.0 * s["right"] / max(s["points"], 1)
    return (
        f"{s['bodies']:.0f} bodies, {s['points']:.0f} points: right {s['right']:.0f} ({share:.0f} %), refused "
        f"{s['refused']:.0f}, wrong and told {s['told']:.0f}, silent 1-3 % {s['silent']:.0f}, silent > 3 % "
        f"{s['silent_beyond_3']:.0f}, worst silent {100.0 * s['worst_silent']:.2g} %, false alarms "
        f"{s['false_alarms']:.0f}"
    )


def certificate(rows: Sequence[Row]) -> str:
    """Estimate over truth where the error is above 0.3 %: quantiles of 10, 50 and 90 %; empty without estimates."""
    found = [row for row in answered(rows) if row["estimate"] != "nan" and float(row["displacement_error"]) > 0.003]
    if not found:
        return ""
    ratio = np.array(numbers(found, "estimate")) / np.array(numbers(found, "displacement_error"))
    return " / ".join(f"{one:.2f}" for one in np.quantile(ratio, [0.1, 0.5, 0.9]))


def report(rows: Sequence[Row]) -> str:
    """Lines of all cases, then the counts."""
    out = []
    for row in rows:
        words = "refused" if row["displacement_error"] == "nan" else (
            f"{100.0 * float(row['displacement_error']):8.3f} % {100.0 * float(row['rotation_error']):8.3f} %"
        )  # fmt: skip
        own = "" if row["estimate"] == "nan" else f" own {100.0 * float(row['estimate']):.3f} %"
        flag = " SILENT" if words != "refused" and error(row) > RIGHT and not told(row) else ""
        flag += " (told without cause)" if told(row) and words != "refused" and error(row) < FINE else ""
        out.append(f"{row['body']:16s} {row['case']:18s} {row['share']:4s}{words}{own}{flag}  {row['log'][:60]}")
    return "\n".join([*out, _sentence(rows), f"estimate over truth {certificate(rows)}"])
