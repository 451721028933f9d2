"""Tables of pages that are made from records: errors of methods, published problems, costs."""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

from benchmarks.coverage import RECORD, table as covered
from benchmarks.defaults.frames import FRAMES, RECORDS as FRAME_RECORDS
from benchmarks.defaults.published import ALL
from benchmarks.defaults.table import RECORDS, certificate, summary
from benchmarks.field.records import Record, read, tables
from benchmarks.records import read_records
from demo.methods import table

ROOT = Path(__file__).resolve().parents[2]

# Rows of the short table of methods.
_METHODS = (
    "`linear`",
    "`stiffness_by_load`",
    "`floating_frame`",
    "`frames`, 8 frames",
    "`second_order`, 1 frame, and residual flexibility",
    "`second_order`, 2 frames, and residual flexibility",
)
_STATICS = ("linear", "second order, 1 frame", "second order, 2 frames", "second order, 4 frames", "frames, 8 frames")
_STEPS = {
    "empty native FMU": "empty",
    "linear, 4 interfaces": "`linear`",
    "stiffness_by_load, 8 frames, 4 interfaces": "`stiffness_by_load`",
    "floating_frame, 8 frames, 4 interfaces": "`floating_frame`",
    "frames, 2 frames, 4 interfaces": "`frames`, 2 frames",
    "frames, 8 frames, 4 interfaces": "`frames`, 8 frames",
    "second_order, 2 frames, 4 interfaces": "`second_order`, 2 frames, constant mass",
    "second_order, 8 frames, 4 interfaces": "`second_order`, 8 frames, constant mass",
    "second_order, 2 frames, mass polynomial, 4 interfaces": "`second_order`, 2 frames, the default mass polynomial",
    "second_order, 2 frames, mass polynomial, 1 interface": "the same with one interface",
    "second_order, 2 frames, deformed body's mass, 4 interfaces": '`second_order`, 2 frames, `mass = "configuration"`',
    "rear axle, cut, second_order, one frame a part": "rear axle, cut, one frame a part, 6 modes",
    "rear axle, cut, second_order, 86 coordinates": "rear axle, cut, 86 coordinates",
    "empty pythonfmu FMU": "empty, by pythonfmu",
    "frames, 8 frames, 4 interfaces, --runtime python": "`frames`, 8 frames, `--runtime python`",
}


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def methods_in_full() -> str:
    """Errors of every method on every demo body, at a third and at all of the load."""
    return table(read_records(ROOT / "demo" / "methods.csv"))


def methods_in_short() -> str:
    """Errors of methods on the demo bodies at the full load."""
    found = read_records(ROOT / "demo" / "methods.csv")
    last = {(row["method"], row["case"]): row for row in found}
    return table([last[method, case] for method in _METHODS for case in dict.fromkeys(row["case"] for row in found)])


def field_in_full() -> str:
    """Published problems of the field, every quantity and model."""
    return tables(read(ROOT / "benchmarks" / "field" / "field.csv"))


def field_in_short() -> str:
    """Largest error of each static problem, over its quantities, by the number of frames."""
    rows: dict[str, dict[str, list[Record]]] = {}
    for record in read(ROOT / "benchmarks" / "field" / "field.csv"):
        if record.model in _STATICS:
            rows.setdefault(record.problem, {}).setdefault(record.model, []).append(record)
    shown = [[problem, *(_worst(models.get(name, [])) for name in _STATICS)] for problem, models in rows.items()]
    return markdown(["error, %", *_STATICS], [row for row in shown if row[2]])


def _worst(records: Sequence[Record]) -> str:
    errors = [record.error_calculix if record.calculix else record.error for record in records]
    if any(not record.ours for record in records):
        return "none"
    return _two_digits(100.0 * max(errors)) if errors else ""


def _two_digits(value: float) -> str:
    """Two significant digits, without an exponent."""
    return f"{float(f'{value:.2g}'):g}"


def coverage() -> str:
    """Public files that are read, by source and class."""
    with RECORD.open(newline="", encoding="utf-8") as file:
        return covered(list(csv.DictReader(file))) + "\n"


def defaults_in_full() -> str:
    """What the shortest body file leaves, by kind of body."""
    found, rows = read_records(RECORDS), []
    kinds = {kind: {make.__name__ for make in makes} for kind, makes in ALL.items()}
    for kind, names in (kinds | {"all": set().union(*kinds.values())}).items():
        s = summary([row for row in found if row["body"] in names])
        silent, worst = s["silent"] + s["silent_beyond_3"], _two_digits(100.0 * s["worst_silent"])
        counts = (s["bodies"], s["points"], s["right"], s["told"] + s["refused"], silent)
        rows.append([kind, *(f"{count:g}" for count in counts), f"{worst} %" if silent else ""])
    return markdown(["", "bodies", "points", "right", "warned, refused", "silent", "worst silent"], rows)


def defaults_certified() -> str:
    """What bodies say of their own error, beside the truth."""
    found, rows = read_records(RECORDS), []
    blind = {kind: {make.__name__ for make in ALL[kind]} for kind in ALL if kind.endswith("blind trial")}
    groups = {kind: [row for row in found if row["body"] in names] for kind, names in blind.items()}
    groups["others"] = [row for row in found if row["body"] not in set().union(*blind.values())]
    groups["all"] = found
    for name, some in groups.items():
        s = summary(some)
        wrong = s["told"] + s["silent"] + s["silent_beyond_3"]
        shares = [(s["certified_right"], s["certified"]), (s["told"], wrong), (s["false_alarms"], s["points"])]
        cells = [f"{part:g} of {whole:g} ({100.0 * part / max(whole, 1):.1f} %)" for part, whole in shares]
        rows.append([name, *cells, f"{s['silent_beyond_3']:g}", certificate(some)])
    head = [
        "",
        "nothing said: right",
        "beyond 1 %: told",
        "false alarms",
        "silent beyond 3 %",
        "estimate / truth, 10 / 50 / 90 %",
    ]
    return markdown(head, rows)


def defaults_by_frames() -> str:
    """Errors of some of these bodies with other numbers of frames, %."""
    rows = []
    for row in read_records(FRAME_RECORDS):
        found = [_two_digits(100.0 * float(row[f"frames_{count}"])) for count in FRAMES]
        case = "" if row["case"] == "worst" else f", {row['case']}"
        rows.append([row["body"].replace("_", " ") + case, *("refused" if v == "nan" else v for v in found)])
    return markdown(["% at full load", *(f"{count} frame" + "s" * (count > 1) for count in FRAMES)], rows)


def defaults_in_short() -> str:
    """The same of all bodies, in a sentence."""
    s = summary(read_records(RECORDS))
    silent = s["silent"] + s["silent_beyond_3"]
    words = f", by {_two_digits(100.0 * s['worst_silent'])} % at most" if silent else ""
    warned, share = s["told"] + s["refused"], 100.0 * s["right"] / s["points"]
    counts = f"{s['bodies']} bodies, {s['points']} points"
    return f"{counts}: {share:.0f} % right, {warned} with a warning or refused, {silent} silent{words}."


def thin_bodies() -> str:
    """Thin bodies of shells and beams bent far, through the FMU."""
    rows = []
    for row in read_records(ROOT / "benchmarks" / "thin" / "thin.csv"):
        numbers = (_two_digits(100.0 * float(row[name])) for name in ("moved", "linear", "error", "estimate"))
        rows.append([row["body"], row["reference"], *numbers, row["word"].replace("told", "warned")])
    head = ["body", "reference", "tip moves, % of the size", "linear, %", "error, %", "its own estimate, %", ""]
    return markdown(head, rows)


def costs_of_steps() -> str:
    """Time of a step of each kind of body."""
    found = {row["what"]: row for row in read_records(ROOT / "benchmarks" / "core_step.csv")}
    rows = []
    for what, words in _STEPS.items():
        row = found[what]
        work = _two_digits(1e-3 * float(row["operations"])) if float(row["operations"]) else ""
        rows.append([words, _two_digits(1e6 * float(row["fastest"])), work])
    return markdown(["FMU", "µs a step", "kflop"], rows)


def costs_of_watches() -> str:
    """What watching adds to a step."""
    rows = []
    for row in read_records(ROOT / "benchmarks" / "watch_share.csv"):
        shares = (_two_digits(float(row[name])) for name in ("mean_with", "worst_without", "worst_with"))
        rows.append([_body_of(row), _two_digits(1e6 * float(row["mean_without"])), *shares])
    return markdown(["body", "µs a step without watches", "over it: mean with", "worst without", "worst with"], rows)


def costs_of_many() -> str:
    """A step of one instance and of each of many, and the time to make one."""
    rows = []
    for row in read_records(ROOT / "benchmarks" / "many_instances.csv"):
        one, many = float(row["one"]), float(row["many"])
        numbers = (1e6 * one, many / one, 1e3 * float(row["made"]))
        rows.append([_body_of(row), *map(_two_digits, numbers)])
    return markdown(["body", "µs a step, one instance", "each of 1000, over it", "ms to make one more"], rows)


def _body_of(row: dict[str, str]) -> str:
    """The body of a record of `benchmarks.watch_share` or `many_instances`."""
    return f"`{row['method']}`, {row['modes']} modes, {row['load']}"
