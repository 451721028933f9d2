"""What `flexfmu view` is asked for, and the view that answers it."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..body.flexible_body import FlexibleBody
from ..body.loads import Loads, load_names
from ..body.replay import body_with, replay
from ..build.config import read_body_file
from ..build.reduce import read_body_model, reduce_body
from ..files.basics import FlexfmuError, FloatArray, IntArray, nearest
from ..files.outputs import Reporter, check_target
from ..files.store import Store, default_folder
from ..files.tables import Kind, check_input, kind_of, quantity, read_table, unit_of
from ..fmu.reading import read_packaged_body
from ..model.reduced_body import ReducedBody
from ..view import motions
from ..view.mesh import mesh_view, model_view
from ..view.model import Case, View
from ..view.motions import live_view
from ..view.shown import PAGE, SUFFIXES, Shown

# Most shapes of a motion, and relative difference of motions that are the same.
MOST_SHAPES, _REPLAYED = 100, 1e-6


@dataclass(frozen=True, slots=True)
class Request:
    """What to show.

    Attributes
    ----------
    file : Path
        FMU, modal file, body file or mesh.
    output : Path or None
    table : Path or None
        Motion of interfaces over time.
    loads : tuple of str
        Loads that hold still, "tip.force.y=5kN".
    modes : int
        How many mode shapes.
    colour : str
    scale : float
        0 to choose one.
    method : str or None
    settings : mapping of str to object
        Parameters of the FMU.
    shapes : int
        Most shapes of a motion.
    live : bool
        A page whose body answers to the pointer.
    """

    file: Path
    output: Path | None
    table: Path | None = None
    loads: tuple[str, ...] = ()
    modes: int = 0
    colour: str = ""
    scale: float = 0.0
    method: str | None = None
    settings: Mapping[str, object] | None = None
    shapes: int = MOST_SHAPES
    live: bool = False


def show(request: Request, report: Reporter) -> Shown:
    """Make a view, and write it where a file is named.

    Parameters
    ----------
    request : Request
    report : Reporter

    Returns
    -------
    Shown

    Raises
    ------
    FlexfmuError
        Files that cannot be read or written, loads or colours that the body does not have.
    RuntimeBodyError
        A body that was built without its surface, or has no equilibrium.
    """
    check_target(request.output, (PAGE,) if request.live else SUFFIXES, (request.file, request.table))
    view = _view(request, report)
    shown = Shown(replace(view, colour=_colour(request, view), scale=request.scale))
    if request.output is not None:
        with report.stage(f"Write {request.output}"):
            shown.save(request.output)
    return shown


def _view(request: Request, report: Reporter) -> View:
    check_input(request.file, FlexfmuError, Kind.FMU, Kind.MODAL, Kind.BODY, Kind.MESH)
    kind = kind_of(request.file)
    moves = bool(request.loads or request.table or request.modes or request.live)
    if kind is Kind.MESH:
        if moves:
            raise FlexfmuError(f"{request.file} is a mesh, which does not move: name it in a body file and view that")
        return mesh_view(request.file)
    if kind is Kind.BODY or request.file.suffix.lower() == ".toml":
        config = read_body_file(request.file)
        if not moves:
            read = read_body_model(config, report)
            return model_view(read.options, read.model, report)
        config = config.model_copy(update={"output": config.output.model_copy(update={"surface": True})})
        model = reduce_body(config, report, Store(default_folder()))
    else:
        model = read_packaged_body(request.file)
    return view_of_model(model, request, report)


def view_of_model(model: ReducedBody, request: Request, report: Reporter) -> View:
    """View of a reduced body: under loads, over time, or its modes.

    Parameters
    ----------
    model : ReducedBody
    request : Request
    report : Reporter

    Returns
    -------
    View
    """
    body = body_with(model, dict(request.settings or {}), request.method)
    if request.live:
        return live_view(body, not (request.loads or request.table or request.modes))
    cases: list[Case] = []
    if request.loads:
        loads, words = loads_of(body, request.loads)
        cases.append(motions.static_case(body, loads, words, report))
    if request.table is not None:
        cases.append(_table_case(body, request.table, request.shapes, report))
    if request.modes or not cases:
        cases += motions.mode_cases(body, request.modes or motions.MODES)
    return motions.body_view(body, cases)


def _table_case(body: FlexibleBody, table: Path, shapes: int, report: Reporter) -> Case:
    """The motion of which a table tells that of interfaces."""
    names, values = read_table(table)
    moved = motions.motion_columns(body, names)
    if not moved:
        found = f"{table} has no column such as {body.model.interface_names[0]}.displacement.x"
        advice = "expected the results of a run; the motion under a table of loads is shown by flexfmu simulate --view"
        raise FlexfmuError(f"{found}: {advice}")
    some = _spread(len(values), shapes)
    states = motions.shapes_of_least_energy(body, moved, values[some, 1:], report)
    return motions.motion_case(body, table.name, states, [*values[some, 0]])


def _spread(count: int, most: int) -> IntArray:
    """At most so many of `count` places, evenly, the first and the last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


def show_simulation(
    fmu: Path, table: Path, result: Path, output: Path, given: Mapping[str, object], report: Reporter
) -> None:
    """Show a simulation that was run: the same loads at the same times, and the same motion to the last digits.

    Parameters
    ----------
    fmu, table, result : Path
        What was run, its loads, and its results.
    output : Path
        As of `Request`.
    given : mapping of str to object
        Parameters of the run.
    report : Reporter

    Raises
    ------
    FlexfmuError
        See `show`.
    """
    model = read_packaged_body(fmu)
    body = body_with(model, given)
    names, loads = read_table(table)
    outputs, motion = read_table(result)
    packed = np.column_stack([loads[:, :1], packed_rows(model, names, loads)])
    times, states = replay(body, packed, motion[:, 0], given, report)
    columns = motions.motion_columns(body, outputs)
    expected = motion[: len(states), [column + 1 for column in columns]]
    seen = np.array([body.core.motion(q)[list(columns.values())] for q in states])
    off = float(np.abs(seen - expected).max(initial=0.0))
    if off > _REPLAYED * max(float(np.abs(expected).max(initial=0.0)), 1e-12):
        report.warning(f"the picture's motion differs from the FMU's by up to {off:.2g}: its loads are other ones")
    some = _spread(len(times), MOST_SHAPES)
    case = motions.motion_case(body, table.name, [*states[some]], [*times[some]])
    with report.stage(f"Write {output}"):
        Shown(motions.body_view(body, [case])).save(output)


def packed_rows(model: ReducedBody, names: Sequence[str], values: FloatArray) -> FloatArray:
    """Rows of loads (rows, L), as of `Loads.packed`, of a table with time in front.

    Raises
    ------
    FlexfmuError
        A column that is no load of the body.
    """
    known = load_names(model.interface_names, model.masses is not None)
    result = np.zeros((len(values), len(known)))
    for column, name in enumerate(names, start=1):
        if name not in known:
            raise FlexfmuError(f"{name!r} is no load of body {model.name!r}; {nearest(name, known)}")
        result[:, known.index(name)] = values[:, column]
    return result


def loads_of(body: FlexibleBody, texts: Sequence[str]) -> tuple[Loads, str]:
    """Loads of texts such as "tip.force.y=5kN", and a name for them.

    Raises
    ------
    FlexfmuError
        No load of the body, or no number.
    """
    names, row = [], []
    for text in texts:
        name, sign, value = (part.strip() for part in text.partition("="))
        if not sign or not value:
            known = load_names(body.model.interface_names, False)
            raise FlexfmuError(f"--load {text}: expected NAME=VALUE, such as {known[min(1, len(known) - 1)]}=5kN")
        names.append(name)
        row.append(quantity(value, name))
    packed = packed_rows(body.model, names, np.array([[0.0, *row]]))[0]
    words = [re.sub(r"\s*=\s*([-+.\de]*\d)\s*", r" = \1 ", text).strip() for text in texts]
    words = [f"{word} {unit_of(name)}" if word[-1].isdigit() else word for word, name in zip(words, names, strict=True)]
    return Loads.unpacked(packed, body.model.interface_count), ", ".join(words)


def _colour(request: Request, view: View) -> str:
    """The colour that is asked for, by its first letters; else what the view has."""
    if not request.colour:
        return view.colour if view.colour in view.colours else next(iter(view.colours), "")
    wanted = request.colour.lower().replace("_", " ")
    found = [one for one in view.colours if one.lower().startswith(wanted)]
    if not found:
        lack = "; stress is stored with stress = true in [output]" if "mises" in wanted or "stress" in wanted else ""
        raise FlexfmuError(f"--colour {request.colour}: expected one of {', '.join(view.colours)}{lack}")
    return found[0]
