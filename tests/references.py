"""CalculiX results kept with the demos, and how errors against them are measured."""

from pathlib import Path

import numpy as np

from flexfmu.build.config import read_body_file

DEMO = Path(__file__).parent.parent / "demo"
BEAM = DEMO / "clamped_beam"
L_FRAME = DEMO / "l_frame"


def body_without_error(path):
    """Body file of a body that does not tell its error, which would take twice as long."""
    config = read_body_file(path)
    return config.model_copy(update={"output": config.output.model_copy(update={"error": False})})


def calculix(path):
    """Table of a CalculiX result, columns by name."""
    return np.genfromtxt(path, delimiter=",", names=True)


def displacement(table):
    """Tip displacement (n, 3), m."""
    return np.stack([table["ux_m"], table["uy_m"], table["uz_m"]], axis=-1)


def rotation(table):
    """Tip rotation vector (n, 3), rad."""
    return np.stack([table["rx_rad"], table["ry_rad"], table["rz_rad"]], axis=-1)


def relative(found, expected):
    """|found − expected| / |expected|."""
    return float(np.linalg.norm(np.asarray(found) - expected) / np.linalg.norm(expected))
