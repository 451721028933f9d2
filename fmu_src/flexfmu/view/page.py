"""A view as one HTML page: data, drawing and script inside, nothing fetched."""

import base64
from typing import Any

import numpy as np

from ..files.array_types import FloatArray
from ..files.plain_data import page_text
from .model import Case, View

_RAMP = 33
# Displacements are whole multiples of their largest over this: finer than any screen.
_MOST, _MOST_STRESS = 32767, 65535


def page(view: View) -> str:
    """Text of the page.

    Parameters
    ----------
    view : View

    Returns
    -------
    str
    """
    import matplotlib

    ramp = matplotlib.colormaps["viridis"](np.linspace(0.0, 1.0, _RAMP))[:, :3]
    content = {
        "title": view.title,
        "subtitle": view.subtitle,
        "points": _packed(view.points, "<f4"),
        "faces": _packed(view.faces, "<u4"),
        "regions": [
            {"title": r.title, "names": list(r.names), "number": _packed(r.number, "<i4")} for r in view.regions
        ],
        "marks": [{"kind": mark.kind.value, "name": mark.name} for mark in view.marks],
        "markPoints": _rounded(view.mark_points),
        "sets": {name: [int(i) for i in rows] for name, rows in view.sets.items()},
        "colours": list(view.colours),
        "colour": view.colour if view.colour in view.colours else next(iter(view.colours), ""),
        "ramp": np.round(ramp, 3).tolist(),
        "cases": [_case(view, case) for case in view.cases],
        "live": view.live,
    }
    return page_text(__package__, view.title, content, *(() if view.live is None else ("fmu.js", "live.js")))


def _case(view: View, case: Case) -> dict[str, Any]:
    moved = case.places - view.points
    largest = float(np.abs(moved).max())
    quantum = largest / _MOST if largest > 0.0 else 1.0
    found: dict[str, Any] = {
        "name": case.name,
        "label": case.label,
        "unit": case.unit,
        "position": [float(f"{x:.9g}") for x in case.position],
        "quantum": quantum,
        "moved": _packed(np.round(moved / quantum), "<i2"),
        "top": float(np.linalg.norm(moved, axis=2).max()),
        "low": _rounded((case.places.min(axis=(0, 1)) - view.points.min(axis=0))[None])[0],
        "high": _rounded((case.places.max(axis=(0, 1)) - view.points.max(axis=0))[None])[0],
        "marks": [_rounded(places) for places in case.marks],
        "peak": view.telling(case) / max(len(case.position) - (0 if case.cyclic else 1), 1),
        "cyclic": case.cyclic,
        "note": case.note,
        "factor": view.factor(case),
    }
    if case.stress is not None:
        top = float(case.stress.max())
        found["stressTop"] = top
        found["stress"] = _packed(np.round(case.stress * (_MOST_STRESS / top if top > 0.0 else 0.0)), "<u2")
    return found


def _packed(values: Any, kind: str) -> str:
    """Numbers as base64 of their bytes."""
    return base64.b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode()


def _rounded(places: FloatArray) -> list[list[float]]:
    return [[float(f"{x:.7g}") for x in place] for place in places]
