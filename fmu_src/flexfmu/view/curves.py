"""Figures of simulation results."""

from math import degrees
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.lines import Line2D

from ..files.errors import SimulationError
from ..files.figures import BLUE, GREEN, VERMILION, save
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
    """Draw a result table, one panel a quantity, one colour an axis, one line style an interface.

    Parameters
    ----------
    table : Path
        CSV as `flexfmu simulate` writes it.
    picture : Path
        PNG, PDF or SVG.

    Raises
    ------
    SimulationError
        The table cannot be read, or the picture's format is not offered.
    """
    names, values = read_table(table)
    parts = [name.split(".") for name in names]
    present = [q for q in _QUANTITIES if any(kind == q for _, kind, _ in parts)]
    interfaces = list(dict.fromkeys(interface for interface, _, _ in parts))
    figure, axes = plt.subplots(
        len(present), 1, sharex=True, figsize=(8.0, 2.4 * len(present) + 0.4), squeeze=False, layout="constrained"
    )
    lines: dict[str, Line2D] = {}
    for panel, quantity in zip(axes[:, 0], present, strict=True):
        label, factor = _QUANTITIES[quantity]
        for number, (interface, kind, axis) in enumerate(parts, start=1):
            if kind == quantity:
                style = _STYLES[interfaces.index(interface) % len(_STYLES)]
                (line,) = panel.plot(
                    values[:, 0], factor * values[:, number], color=_AXES[axis], linestyle=style, linewidth=1.2
                )
                lines.setdefault(f"{interface} {axis}" if len(interfaces) > 1 else axis, line)
        panel.set_ylabel(label)
        panel.grid(alpha=0.3)
    axes[-1, 0].set_xlabel("time / s")
    if len(interfaces) == 1:
        figure.suptitle(interfaces[0], fontsize="medium")
    figure.legend(list(lines.values()), list(lines), loc="outside right upper", fontsize="small", frameon=False)
    try:
        save(figure, picture)
    except ValueError as error:
        raise SimulationError(f"{picture}: cannot be drawn ({error})") from error
