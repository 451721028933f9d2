"""What `flexfmu view` is asked for, and the view that answers it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..body import FlexibleBody
from ..build import reduce_body
from ..config import read_body_file
from ..errors import FlexfmuError
from ..fmu.package import read_packaged_body
from ..fmu.simulation import read_table
from ..fmu.variables import ACCELERATION, METHOD
from ..inputs import Kind, check_input, kind_of
from ..loads import Loads
from ..model.reduced_body import FloatArray, ReducedBody
from ..names import nearest
from ..progress import Reporter
from ..quantities import number
from ..store import Store, default_folder
from ..targets import PICTURE_SUFFIXES, check_target, whole_file
from .mesh import body_file_view, mesh_view
from .model import DISPLACEMENT, Case, View
from .motions import body_view, equilibria_case, mode_cases, static_case
from .page import page
from .paraview import write_pvd, write_vtu
from .picture import write_picture

PAGE, SHAPE, SERIES = ".html", ".vtu", ".pvd"
SUFFIXES = (PAGE, SHAPE, SERIES, *PICTURE_SUFFIXES)
_AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True)
class Request:
    """What to show.

    Attributes
    ----------
    file : Path
        FMU, modal file, body file or mesh.
    output : Path
    table : Path or None
        Loads over time.
    loads : tuple of str
        Loads that hold still, "tip.force.y=5kN".
    static : bool
        Whether each row of the table is an equilibrium.
    modes : int
        How many mode shapes.
    colour : str
    scale : float
        0 to choose one.
    method : str or None
    settings : mapping of str to object
        Parameters of the FMU.
    step, stop : float or None
        s.
    shapes : int
        Most shapes of a motion.
    """

    file: Path
    output: Path
    table: Path | None = None
    loads: tuple[str, ...] = ()
    static: bool = False
    modes: int = 0
    colour: str = ""
    scale: float = 0.0
    method: str | None = None
    settings: Mapping[str, object] | None = None
    step: float | None = None
    stop: float | None = None
    shapes: int = 100


def show(request: Request, report: Reporter) -> View:
    """Make a view and write it.

    Parameters
    ----------
    request : Request
    report : Reporter

    Returns
    -------
    View

    Raises
    ------
    FlexfmuError
        Files that cannot be read or written, loads or colours that the body does not have.
    RuntimeBodyError
        A body that was built without its surface, or has no equilibrium.
    """
    check_target(request.output, SUFFIXES, inputs=[p for p in (request.file, request.table) if p is not None])
    view = _view(request, report)
    colour = _colour(request, view)
    view = _with(view, colour, request.scale)
    case = view.cases[0] if view.cases else None
    suffix = request.output.suffix.lower()
    with report.stage(f"Write {request.output}"):
        if suffix == PAGE:
            with whole_file(request.output) as part:
                part.write_text(page(view), encoding="utf-8")
        elif suffix == SERIES:
            if case is None:
                raise FlexfmuError(f"{request.output}: a series wants a motion; give loads or --modes, or take {SHAPE}")
            write_pvd(view, case, request.output)
        elif suffix == SHAPE:
            write_vtu(view, case, _telling(view, case), request.output)
        else:
            write_picture(view, case, _telling(view, case), view.colour, request.output)
    return view


def _view(request: Request, report: Reporter) -> View:
    check_input(request.file, FlexfmuError, Kind.FMU, Kind.MODAL, Kind.BODY, Kind.MESH)
    kind = kind_of(request.file)
    moves = bool(request.loads or request.table or request.modes)
    if kind is Kind.MESH:
        if moves:
            raise FlexfmuError(f"{request.file} is a mesh, which does not move: name it in a body file and view that")
        return mesh_view(request.file)
    if kind is Kind.BODY or request.file.suffix.lower() == ".toml":
        config = read_body_file(request.file)
        if not moves:
            return body_file_view(config, report)
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
    settings = dict(request.settings or {})
    method = request.method or settings.pop(METHOD, None)
    body = FlexibleBody(model, None if method is None else str(method))
    cases: list[Case] = []
    if request.loads:
        loads, words = loads_of(body, request.loads)
        cases.append(static_case(body, loads, words, report))
    if request.table is not None:
        names, values = read_table(request.table)
        rows = [Loads.unpacked(row, model.interface_count) for row in packed_rows(model, names, values)]
        cases.append(equilibria_case(body, request.table.name, values[:, 0], rows, report))
    if request.modes or not cases:
        bare = body_view(body)
        cases += mode_cases(body, request.modes or 6, bare.size)
    return body_view(body, cases)


def input_names(model: ReducedBody) -> list[str]:
    """Names of a body's loads in the order of `Loads.packed`."""
    wrench = [f"{i}.{q}.{axis}" for i in model.interface_names for q in ("force", "moment") for axis in _AXES]
    return wrench + ([] if model.masses is None else [f"{ACCELERATION}.{axis}" for axis in _AXES])


def packed_rows(model: ReducedBody, names: Sequence[str], values: FloatArray) -> FloatArray:
    """Rows of loads (rows, L), as of `Loads.packed`, of a table with time in front.

    Raises
    ------
    FlexfmuError
        A column that is no load of the body.
    """
    known = input_names(model)
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
            known = input_names(body.model)
            raise FlexfmuError(f"--load {text}: expected NAME=VALUE, such as {known[min(1, len(known) - 1)]}=5kN")
        names.append(name)
        row.append(number(value, name))
    packed = packed_rows(body.model, names, np.array([[0.0, *row]]))[0]
    return Loads.unpacked(packed, body.model.interface_count), ", ".join(text.replace("=", " = ") for text in texts)


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


def _with(view: View, colour: str, scale: float) -> View:
    from dataclasses import replace

    return replace(view, colour=colour, scale=scale)


def _telling(view: View, case: Case | None) -> int:
    """The shape of a motion that is drawn alone: the last of a load that grows, else the largest."""
    if case is None:
        return 0
    if case.unit == "%":
        return len(case.position) - 1
    return int(np.argmax(np.abs(case.places - view.points).max(axis=(1, 2))))


__all__ = ["DISPLACEMENT", "SUFFIXES", "Request", "show"]
