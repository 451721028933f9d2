"""A page of sweeps' records to look into: one HTML file with its data, drawing and script inside."""

import html
import json
import math
from collections.abc import Sequence
from dataclasses import fields
from importlib.resources import files

from ...model.methods import Method
from ..scenes.candidates import REDUCED
from . import look
from .front import QUANTITIES, tolerance
from .records import Record

_FILTERS = (
    "body",
    "solver",
    "method",
    "frames",
    "basis",
    "modes",
    "mass",
    "internal_step",
    "status",
)
_COSTS = {
    "fmu_ratio": "time of a step over that of an empty FMU",
    "fmu_ms_per_s": "ms per simulated second, through the FMU",
    "bare_ms_per_s": "ms per simulated second, from Python",
    "step_us": "time of a step from Python / µs",
    "equilibrium_ms": "one equilibrium from rest, from Python / ms",
    "memory_bytes": "memory of the running model / bytes",
    "modal_bytes": "modal file / bytes",
    "mode_count": "modes",
    "build_s": "time to build / s",
}
_ERRORS = {
    "static_displacement": "static displacement error",
    "static_rotation": "static rotation error",
    "transient_displacement": "displacement error over time, rms",
    "transient_rotation": "rotation error over time, rms",
    "share": "error over the scene's tolerance",
}
# What the data says of all rows alike.
_LEFT_OUT = ("scene",)


def page(rows: Sequence[Record], title: str) -> str:
    """Text of the page.

    Parameters
    ----------
    rows : sequence of Record
        Reduced models, and the finite element model where it was timed.
    title : str

    Returns
    -------
    str
    """
    names = [f.name for f in fields(Record) if f.init and f.name not in _LEFT_OUT]
    told = ("label", "short_label", "plainness")
    data = [{name: _plain(getattr(row, name)) for name in (*names, *told)} for row in rows]
    reduced = [row for row in data if row["solver"] == REDUCED]
    offered = {
        kind: {name: words for name, words in axes.items() if any(_drawable(row[name]) for row in reduced)}
        for kind, axes in (("costs", _COSTS), ("errors", _ERRORS))
    }
    content = {"rows": data, "columns": names, "filters": _FILTERS, "reduced": REDUCED, **offered}
    ok = [row for row in rows if row.solver == REDUCED]
    content["tolerances"] = {"share": 1.0, **{quantity: tolerance(ok, quantity) for quantity in QUANTITIES}}
    content["look"] = {
        "colours": look.COLOURS,
        "other": look.OTHER,
        "beaten": look.BEATEN,
        "beatenWords": look.BEATEN_WORDS,
        "taken": look.TAKEN,
        "takenWords": look.TAKEN_WORDS,
        "whole": look.WHOLE,
        "markers": look.MARKERS,
        "bases": look.BASES,
        "stars": look.STARS,
        "solvers": look.SOLVERS,
        "methods": {method.value: method.label for method in Method},
    }
    # Nothing in the data may end the script.
    text = json.dumps(content, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
    template = files(__package__).joinpath("page.html").read_text(encoding="utf-8")
    return template.replace("@TITLE@", html.escape(title)).replace("@DATA@", text)


def _plain(value: object) -> object:
    """JSON knows numbers that are finite."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _drawable(value: object) -> bool:
    return isinstance(value, (int, float)) and value > 0
