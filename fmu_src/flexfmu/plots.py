"""Figures of simulation results."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from .errors import SimulationError
from .fmu.simulation import read_table
from .targets import whole_file

_QUANTITIES = {
    "displacement": "displacement / m",
    "rotation": "rotation / rad",
    "velocity": "velocity / (m/s)",
    "angular_velocity": "angular velocity / (rad/s)",
}


def plot_result(table: Path, picture: Path) -> None:
    """Draw a result table, one panel a quantity, one colour an interface, one line style an axis.

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
    present = [q for q in _QUANTITIES if any(name.split(".")[1:2] == [q] for name in names)]
    interfaces = list(dict.fromkeys(name.split(".")[0] for name in names))
    figure, axes = plt.subplots(len(present), 1, sharex=True, figsize=(7.0, 2.6 * len(present)), squeeze=False)
    for panel, quantity in zip(axes[:, 0], present, strict=True):
        for column, name in enumerate(names, start=1):
            interface, kind, axis = name.split(".")
            if kind == quantity:
                panel.plot(
                    values[:, 0],
                    values[:, column],
                    color=f"C{interfaces.index(interface) % 10}",
                    linestyle={"x": "-", "y": "--", "z": ":"}[axis],
                    label=f"{interface} {axis}",
                )
        panel.set_ylabel(_QUANTITIES[quantity])
        panel.grid(alpha=0.3)
    axes[0, 0].legend(ncols=3, fontsize="small", frameon=False)
    axes[-1, 0].set_xlabel("time / s")
    figure.tight_layout()
    try:
        with whole_file(picture) as part:
            figure.savefig(part, dpi=150)
    except ValueError as error:
        raise SimulationError(f"{picture}: cannot be drawn ({error})") from error
    finally:
        plt.close(figure)
