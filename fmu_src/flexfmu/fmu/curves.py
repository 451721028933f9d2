"""Figures of simulation results."""

from collections.abc import Sequence
from math import degrees
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..files.basics import FloatArray, SimulationError
from ..files.figures import BLUE, GREEN, VERMILION, Drawing, save
from ..files.tables import read_table

# Label, and factor from SI units.
_QUANTITIES = {
    "displacement": ("displacement / mm", 1e3),
    "rotation": ("rotation / °", degrees(1.0)),
    "velocity": ("velocity / (m/s)", 1.0),
    "angular_velocity": ("angular velocity / (°/s)", degrees(1.0)),
}
_AXES = {"x": VERMILION, "y": GREEN, "z": BLUE}
_STYLES = ("-", "--", ":", "-.")


def plot_result(table: Path, picture: Path) -> None:
    """Draw a result table, as `result_figure` does.

    Parameters
    ----------
    table : Path
        CSV as `flexfmu simulate` writes it.
    picture : Path
        PNG, PDF or SVG.

    Raises
    ------
    SimulationError
        The table cannot be read.
    """
    names, values = read_table(table)
    save(result_figure(names, values[:, 0], values[:, 1:]), picture)


def result_figure(names: Sequence[str], time: FloatArray, values: FloatArray) -> Figure:
    """Draw motion over time, one panel a quantity, one colour an axis, one line style an interface.

    Parameters
    ----------
    names : sequence of str
        Of outputs; those that are no motion are left out.
    time : (n,) float
        s.
    values : (n, len(names)) float

    Returns
    -------
    Figure
    """
    parts = []
    for number, name in enumerate(names):
        interface, kind, axis = ("..." + name).rsplit(".", 2)
        if kind in _QUANTITIES:
            parts.append((number, interface.lstrip("."), kind, axis))
    if not parts:
        raise SimulationError(f"of {', '.join(names)} none is a motion, nothing to draw")
    present = [q for q in _QUANTITIES if any(kind == q for _, _, kind, _ in parts)]
    interfaces = list(dict.fromkeys(interface for _, interface, _, _ in parts))
    figure = Drawing(figsize=(8.0, 2.4 * len(present) + 0.4), layout="constrained")
    axes = figure.subplots(len(present), 1, sharex=True, squeeze=False)
    lines: dict[str, Line2D] = {}
    for panel, quantity in zip(axes[:, 0], present, strict=True):
        label, factor = _QUANTITIES[quantity]
        for number, interface, kind, axis in parts:
            if kind == quantity:
                style = _STYLES[interfaces.index(interface) % len(_STYLES)]
                shown = factor * values[:, number]
                (line,) = panel.plot(time, shown, color=_AXES[axis], linestyle=style, linewidth=1.2)
                lines.setdefault(f"{interface} {axis}" if len(interfaces) > 1 else axis, line)
        panel.set_ylabel(label)
        panel.grid(alpha=0.3)
    axes[-1, 0].set_xlabel("time / s")
    if len(interfaces) == 1:
        figure.suptitle(interfaces[0], fontsize="medium")
    figure.legend(list(lines.values()), list(lines), loc="outside right upper", fontsize="small", frameon=False)
    return figure
