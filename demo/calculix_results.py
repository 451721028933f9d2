"""Results that CalculiX prints to the .dat file."""

from __future__ import annotations

import re

import numpy as np


def read_displacements(printed: str, interface: str) -> tuple[np.ndarray, np.ndarray]:
    """Read the displacements of the nodes of an interface, at all printed times.

    Parameters
    ----------
    printed : str
        Contents of the .dat file.
    interface : str
        Name of the interface; its nodes come in ascending order.

    Returns
    -------
    times : ndarray, shape (n_times,)
        Step times.
    displacements : ndarray, shape (n_times, n_nodes, 3)
        Displacements, m.
    """
    return _read_blocks(printed, "displacements (vx,vy,vz)", interface.upper())


def read_reaction(printed: str, support: str) -> np.ndarray:
    """Read the total force on the body at a support at all printed times, shape (n_times, 3), N."""
    rows = re.findall(rf"total force \(fx,fy,fz\) for set {support} and time .*\n\n(.*)", printed)
    return np.array([row.split() for row in rows], dtype=float)


def read_frequencies(printed: str) -> np.ndarray:
    """Read the eigenfrequencies, Hz, from the contents of a .dat file; shape (n_steps, n_modes)."""
    tables = printed.split("E I G E N V A L U E   O U T P U T")[1:]
    return np.array([_numbered_rows(table.split("P A R T I C I P A T I O N")[0])[:, 3] for table in tables])


def read_buckling_factors(printed: str) -> np.ndarray:
    """Read the buckling factors from the contents of a .dat file; shape (n_modes,)."""
    return _numbered_rows(printed.split("B U C K L I N G   F A C T O R   O U T P U T")[1])[:, 1]


def _read_blocks(printed: str, quantity: str, node_set: str) -> tuple[np.ndarray, np.ndarray]:
    """Step times (n_times,) and values (n_times, n_nodes, 3) of a quantity printed for a node set."""
    blocks = re.findall(rf"{re.escape(quantity)} for set {node_set} and time +(\S+)\n\n((?: +\d.*\n)+)", printed)
    times = np.array([float(time) for time, _ in blocks])
    tables = np.array([[line.split() for line in rows.splitlines()] for _, rows in blocks], dtype=float)
    if not tables.size:
        raise ValueError(f"no {quantity} of the node set {node_set} among the printed results")
    order = np.argsort(tables[0, :, 0])
    return times, tables[:, order, 1:]


def _numbered_rows(table: str) -> np.ndarray:
    """Rows of a printed table that begin with a mode's number."""
    rows = [line.split() for line in table.splitlines()]
    return np.array([row for row in rows if row and row[0].isdigit()], dtype=float)
