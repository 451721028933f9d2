"""Views of a reduced body: as it is, its modes, equilibria, its motion over time; and what a live page needs."""

import base64
import gzip
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..body.flexible_body import FlexibleBody, State
from ..body.loads import Loads
from ..body.recovery import surface_data, surface_of, surface_von_mises
from ..core.binaries import web_core
from ..core.interface import DESCRIPTION
from ..files.basics import FlexfmuError, FloatArray, IntArray, OptionError, metres, plural
from ..files.outputs import Reporter
from ..model.reduced_body import GROUND
from ..program.compile import programs, with_guid
from ..program.variable_table import variable_table
from .model import DISPLACEMENT, STRESS, Case, Mark, Region, View

# Shapes of an oscillation, and of a load that grows.
_PHASES, _SHARES = 24, 11
# Largest displacement of a mode's picture, in sizes of the body.
_MODE_AMPLITUDE = 0.08
# Modes that are shown where nobody says how many.
MODES = 6
FRAMES, INTERFACES = "frames", "interfaces and supports"


def body_view(body: FlexibleBody, cases: Sequence[Case] = (), **more: object) -> View:
    """A body with its frames, interfaces and joints, and motions of it.

    Parameters
    ----------
    body : FlexibleBody
    cases : sequence of Case
    **more
        Other attributes of `View`.

    Returns
    -------
    View

    Raises
    ------
    OptionError
        The body was built without its surface.
    """
    surface, model = surface_of(body.model), body.model
    regions = []
    if model.frame_count:
        regions.append(Region(FRAMES, model.frame_names, surface.frame))
    if surface.interface is not None and surface.support is not None:
        number = np.where(surface.interface >= 0, surface.interface, -1)
        number = np.where((number < 0) & (surface.support > 0), model.interface_count, number)
        regions.append(Region(INTERFACES, (*model.interface_names, "supports"), number))
    marks = marks_of(body)
    words = f"{plural(model.mode_count, 'mode')}, {plural(model.frame_count, 'frame')}, method {body.variant.words}"
    return View(
        title=model.name,
        subtitle=words,
        points=surface.points,
        faces=surface.faces,
        regions=tuple(regions),
        marks=marks,
        mark_points=mark_places(body, np.zeros(model.mode_count)),
        cases=tuple(cases),
        **more,  # type: ignore[arg-type]
    )


def marks_of(body: FlexibleBody) -> tuple[Mark, ...]:
    """Interfaces, then supports, joints between frames, cuts."""
    model, properties = body.model, body.model.properties
    marks = [Mark("interface", name) for name in model.interface_names]
    if properties is not None and properties.support_spring is not None:
        marks += support_marks(properties.support_names, properties.support_spring)
    marks += [Mark("joint", model.frame_names[s]) for s in _joints(body)]
    return (*marks, *(Mark("cut", f"cut {k + 1}") for k in range(len(_cuts(body)))))


def support_marks(names: Sequence[str], springs: IntArray) -> list[Mark]:
    """Marks of supports, by whether springs hold."""
    return [Mark("spring" if spring else "support", name) for name, spring in zip(names, springs, strict=True)]


def _joints(body: FlexibleBody) -> list[int]:
    return [s for s in range(body.core.frames) if not (body.model.floating and s == 0)]


def _cuts(body: FlexibleBody) -> list[int]:
    """Ties between two sections of the body."""
    ties = body.model.ties
    return [] if ties is None else [t for t in range(len(ties.frame)) if np.all(ties.frame[t] != GROUND)]


def mark_places(body: FlexibleBody, q: FloatArray) -> FloatArray:
    """Where the marks are, (k, 3), m."""
    model = body.model
    places = [model.interface_point + body.core.motion(q).reshape(-1, 2, 3)[:, 0]]
    if model.properties is not None and model.properties.support_point is not None:
        places.append(model.properties.support_point)
    cuts = _cuts(body)
    if body.core.frames:
        position, _ = body.core.nodes_at(q)
        places.append(position[_joints(body)])
        if model.ties is not None:
            first = len(position) - 2 * len(model.ties.frame)
            places.append(position[[first + t for t in cuts]])
    elif model.ties is not None:
        places.append(model.ties.point[cuts, 0] + model.ties.displacement[cuts, 0] @ q)
    return np.concatenate(places)


def motion_case(
    body: FlexibleBody,
    name: str,
    states: Sequence[FloatArray],
    position: Sequence[float],
    label: str = "time",
    unit: str = "s",
    cyclic: bool = False,
    note: str = "",
) -> Case:
    """A motion of which the modal coordinates are known.

    Parameters
    ----------
    body : FlexibleBody
    name : str
    states : sequence of (m,) float
        q, kg^1/2 m.
    position : sequence of float
    label, unit : str
        What `position` is.
    cyclic : bool
    note : str
        Default: the largest displacement and when.

    Returns
    -------
    Case
    """
    surface = surface_of(body.model)
    places = np.array([body.surface_positions(State(q, q)) for q in states])
    stress = None if surface.stress is None else np.array([surface_von_mises(body.model, q) for q in states])
    marks = np.array([mark_places(body, q) for q in states])
    case = Case(name, label, unit, np.array(position, dtype=float), places, marks, stress, cyclic, note)
    if note:
        return case
    moved = np.linalg.norm(places - surface.points, axis=2).max(axis=1)
    last = int(np.argmax(moved))
    when = f" at {label} {position[last]:.4g} {unit}".rstrip() if label == "time" else ""
    turned = max(body.core.largest_rotation(q) for q in states)
    words = f"largest displacement {metres(float(moved[last]))}{when}, rotation in a frame {np.degrees(turned):.2g}°"
    return replace(case, note=words if stress is None else f"{words}, {STRESS} {stress.max() / 1e6:.4g} MPa")


def mode_cases(body: FlexibleBody, count: int) -> list[Case]:
    """The lowest elastic modes, swinging by a share of the body's size."""
    surface, model = surface_of(body.model), body.model
    size = float(np.ptp(surface.points, axis=0).max())
    cases = []
    for number, j in enumerate(range(model.rigid_count, min(model.rigid_count + count, model.mode_count)), start=1):
        amplitude = _MODE_AMPLITUDE * size / np.linalg.norm(surface.modes[:, :, j], axis=1).max()
        phases = np.arange(_PHASES) * 360.0 / _PHASES
        unit = np.zeros(model.mode_count)
        unit[j] = amplitude
        states = [unit * np.sin(np.radians(phase)) for phase in phases]
        hertz = model.angular_frequency[j] / (2.0 * np.pi)
        note = f"damping ratio {model.damping_ratio[j]:.3g}; amplitude as drawn, not as loads make it"
        name = f"mode {number}, {hertz:.4g} Hz"
        cases.append(motion_case(body, name, states, [*phases], "phase", "°", cyclic=True, note=note))
    return cases


def static_case(body: FlexibleBody, loads: Loads, name: str, report: Reporter) -> Case:
    """The equilibrium under loads, reached by growing them.

    Parameters
    ----------
    body : FlexibleBody
    loads : Loads
    name : str
    report : Reporter

    Returns
    -------
    Case

    Raises
    ------
    EquilibriumError
        There is none under the whole of the loads.
    """
    shares = np.linspace(0.0, 1.0, _SHARES)
    with report.stage(f"Equilibrium under {name}"):
        states = [body.static(loads.scaled(share)).q for share in shares]
    missed = body.stiffness_missed(loads.packed(body.model.masses is not None))
    case = motion_case(body, name, states, [*(100.0 * shares)], "load", "%")
    if missed > 0.1:
        report.warning(f"{name}: the method misses stiffness worth up to {100.0 * missed:.0f} % of the displacement")
    return case


MOTIONS = tuple(f"{quantity}.{axis}" for quantity in ("displacement", "rotation") for axis in "xyz")
# Rounds of Newton's method and relative change at which it has settled; relative step of differences.
_ROUNDS, _SETTLED, _STEP = 30, 1e-9, 1e-6


def motion_columns(body: FlexibleBody, names: Sequence[str]) -> dict[int, int]:
    """Rows of `FlexibleBody.motion` by the columns of a table that hold them, names with or without an instance.

    Raises
    ------
    FlexfmuError
        Several instances have such columns.
    """
    found: dict[int, int] = {}
    instances = set()
    for row, output in enumerate(f"{i}.{motion}" for i in body.model.interface_names for motion in MOTIONS):
        for column, name in enumerate(names):
            if name == output or name.endswith(f".{output}"):
                instances.add(name[: -len(output)])
                found[column] = row
    if len(instances) > 1:
        raise FlexfmuError(f"the table holds motions of {', '.join(sorted(instances))}: keep those of one")
    return found


def shapes_of_least_energy(
    body: FlexibleBody, columns: dict[int, int], values: FloatArray, report: Reporter
) -> list[FloatArray]:
    """Modal coordinates (m,) of least strain energy that move interfaces as given, for each row.

    Parameters
    ----------
    body : FlexibleBody
    columns : dict of int to int
        As of `motion_columns`.
    values : (rows, n) float
        m and rad.
    report : Reporter

    Returns
    -------
    list of (m,) float
    """
    rows, wanted = list(columns.values()), values[:, list(columns)]
    stiffness = body.model.angular_frequency**2
    scale = 1.0 / np.sqrt(np.where(stiffness > 0.0, stiffness, stiffness[stiffness > 0.0].min()))
    q = np.zeros(stiffness.size)
    found, worst = [], 0.0
    with report.counted("Find shapes from the motion of interfaces", len(wanted), "rows") as tell:
        for k, motion in enumerate(wanted):
            for _ in range(_ROUNDS):
                step = _newton(body, q, rows, motion - body.core.motion(q)[rows], stiffness, scale)
                q = q + step
                if np.linalg.norm(step / scale) <= _SETTLED * np.linalg.norm(q / scale):
                    break
            worst = max(worst, float(np.abs(body.core.motion(q)[rows] - motion).max()))
            found.append(q)
            tell(k + 1)
    if worst > 1e-3 * max(float(np.abs(wanted).max()), 1e-12):
        report.warning(f"no shape moves the interfaces as the table says: they are off by up to {worst:.2g}")
    return found


def _newton(
    body: FlexibleBody, q: FloatArray, rows: list[int], missing: FloatArray, stiffness: FloatArray, scale: FloatArray
) -> FloatArray:
    """Change of q towards the least of ½ qᵀΛq with the motion of the rows."""
    jacobian = np.empty((len(rows), q.size))
    for j in range(q.size):
        change = np.zeros_like(q)
        # Coordinates in which the body is as stiff, one as another.
        change[j] = _STEP * scale[j] * max(float(np.linalg.norm(q / scale)), 1e-3 / float(np.linalg.norm(scale)))
        ahead, behind = body.core.motion(q + change)[rows], body.core.motion(q - change)[rows]
        jacobian[:, j] = (ahead - behind) / (2.0 * change[j])
    # With z = q / scale the energy is |z|² but for rigid motions, which cost nothing.
    scaled, elastic = jacobian * scale, stiffness > 0.0
    z = np.where(elastic, q / scale, 0.0)
    weight = np.where(elastic, 1.0, 1e-3)
    # The smallest z + dz with J dz = missing: the part across the null space of J goes away.
    return ((np.linalg.pinv(scaled / weight, rcond=1e-10) @ (missing + scaled @ z)) / weight - z) * scale


# Programs that the page runs: the body's own, the linear one beside it, and the one that tells the error.
_PROGRAMS = (DESCRIPTION, "linear.prog", "shadow.prog")
_GUID = "live"
# Spring of the pointer over the softest direction of an interface; frequency of rigid motions over the first one's.
_PULL, _FREE = 2.0, 0.1


def live_view(body: FlexibleBody, alone: bool = True) -> View:
    """View of a body that answers to the pointer, with its interfaces.

    Parameters
    ----------
    body : FlexibleBody
    alone : bool
        Whether nothing else is asked of the page.

    Returns
    -------
    View

    Raises
    ------
    OptionError
        Something else is.
    """
    if not alone:
        raise OptionError("a live page begins at rest, without loads, motion or modes: ask for these in another page")
    view = body_view(body)
    model = replace(body.model, method=body.method, mass=body.variant.mass)
    made = {name: draft for name, draft in programs(model).items() if name in _PROGRAMS}
    sizes, on, numbers = surface_data(model, body.method)
    parts = with_guid(made, _GUID) | {"core": web_core(), "numbers": numbers.astype("<f4").tobytes()}
    if (stress := surface_of(model).stress) is not None:
        parts["stress"] = stress.astype("<f4").tobytes()
    live = {
        "guid": _GUID,
        "parts": {name: base64.b64encode(gzip.compress(part, 6, mtime=0)).decode() for name, part in parts.items()},
        "variables": [v.name for v in variable_table(model)],
        "interfaces": model.interface_names,
        "stiffness": _stiffness(body),
        "frequency": model.angular_frequency[model.rigid_count] / (2.0 * np.pi),
        "free": model.rigid_count > 0,
        "sizes": sizes,
        "on": on,
    }
    count = model.interface_count + (len(model.properties.support_names) if model.properties is not None else 0)
    return replace(view, marks=view.marks[:count], mark_points=view.mark_points[:count], colour=DISPLACEMENT, live=live)


def _stiffness(body: FlexibleBody) -> list[float]:
    """Stiffness (N/m) of the pointer's spring at each interface."""
    model, first = body.model, body.model.rigid_count
    omega = np.maximum(model.angular_frequency, _FREE * model.angular_frequency[first])
    weighed: FloatArray = model.interface_displacement / omega
    return [float(_PULL / np.linalg.norm(shape, 2) ** 2) for shape in weighed]
