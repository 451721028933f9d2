"""What a run came to, in a line."""

from collections.abc import Sequence

import numpy as np

from ..files.array_types import FloatArray

_AXES = ("x", "y", "z")


def outcome(names: Sequence[str], result: FloatArray, warnings: int) -> str:
    """Largest displacement and rotation of any interface, when, and how many warnings there were.

    Parameters
    ----------
    names : sequence of str
        Outputs.
    result : (rows, 1 + len(names)) float
        Time (s), then the outputs.
    warnings : int

    Returns
    -------
    str
    """
    found = []
    for quantity, words in (("displacement", _length), ("rotation", _angle)):
        best: tuple[float, str, float] | None = None
        for interface in dict.fromkeys(name.split(".")[0] for name in names if f".{quantity}." in name):
            columns = [1 + names.index(f"{interface}.{quantity}.{axis}") for axis in _AXES]
            length = np.linalg.norm(result[:, columns], axis=1)
            row = int(np.argmax(length))
            if best is None or length[row] > best[0]:
                best = float(length[row]), interface, float(result[row, 0])
        if best is not None:
            found.append(f"largest {quantity} {words(best[0])} of {best[1]} at {best[2]:.4g} s")
    told = "no warnings" if not warnings else "1 warning" if warnings == 1 else f"{warnings} warnings"
    return "; ".join([*found, told])


def _length(value: float) -> str:
    return f"{value:.4g} m" if value >= 1.0 else f"{1e3 * value:.4g} mm"


def _angle(value: float) -> str:
    return f"{np.degrees(value):.4g}°"
