"""Damping from test: frequencies and ratios of a motion that dies away."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..files.basics import FloatArray, SimulationError
from ..files.tables import read_table

# Share of the largest singular value, of the largest amplitude, and of a step by which rows may be apart unevenly.
_NOISE, _SMALL, _UNEVEN = 0.02, 0.02, 0.01
# Most and fewest means of rows that are used, and fewest in a period; poles, two a mode.
_ROWS, _FEWEST, _PERIOD, _POLES = 1000, 20, 5, 20


@dataclass(frozen=True, slots=True)
class Decay:
    """What a free decay consists of.

    Attributes
    ----------
    frequency : (k,) float
        Hz, of the undamped vibration; ascending.
    ratio : (k,) float
        Damping ratios.
    amplitude : (k,) float
        At the first row, in the column's unit.
    unexplained : float
        Root mean square of what they leave of the motion, over that of the motion.
    used, whole : float
        Seconds of the motion that were used, and all of them.
    """

    frequency: FloatArray
    ratio: FloatArray
    amplitude: FloatArray
    unexplained: float
    used: float
    whole: float

    @property
    def words(self) -> list[str]:
        """Lines for a terminal; the last ones are a table of a body file."""
        rows = list(zip(self.frequency, self.ratio, self.amplitude, strict=True))
        found = [f"{f:.5g} Hz: damping ratio {z:.3g}, amplitude {a:.3g}" for f, z, a in rows]
        found.append(f"{100.0 * self.unexplained:.2g} % of the motion (rms) is left unexplained")
        if self.used < self.whole:
            found.append(f"of the first {self.used:.3g} s of {self.whole:.3g}: its fastest vibration needs all rows")
        pairs = ", ".join(f"[{f:.5g}, {z:.3g}]" for f, z, _ in rows)
        return [*found, "", "[damping]", f"measured = [{pairs}]"]


def decay(file: str | Path, column: str = "") -> Decay:
    """Find frequencies and damping ratios in a table of a motion that nothing drives, by the matrix pencil.

    A sum of damped vibrations is y_k = Σ c z^k; the z are eigenvalues of two shifted Hankel matrices, truncated to
    their large singular values (Y. Hua and T. K. Sarkar, IEEE Trans. ASSP 38, 1990).

    Parameters
    ----------
    file : path
        CSV: time, then the motion at equal steps, from where the body was let go.
    column : str
        Default: the first one after time.

    Returns
    -------
    Decay

    Raises
    ------
    SimulationError
        Rows that are too few or uneven, a column that is not there, or nothing that vibrates.

    Examples
    --------
    >>> flexfmu.decay("decay.csv").ratio  # doctest: +SKIP
    array([0.0121])
    """
    names, table = read_table(Path(file))
    if column and column not in names:
        raise SimulationError(f"{file}: no column {column!r}, expected one of {', '.join(names)}")
    time, motion = table[:, 0], table[:, 1 + (names.index(column) if column else 0)]
    step = float(np.ptp(time)) / max(time.size - 1, 1)
    if time.size < _FEWEST or np.abs(np.diff(time) - step).max() > _UNEVEN * step:
        fault = f"{file}: {time.size} rows, {np.diff(time).min(initial=np.inf):g} s apart or more"
        raise SimulationError(f"{fault}, expected {_FEWEST} or more at equal steps")
    found = _parts(motion - motion[-motion.size // 4 :].mean(), step)
    if not found.frequency.size:
        raise SimulationError(f"{file}: nothing in it vibrates and dies away; give a free decay, from where it begins")
    return found


def _parts(rows: FloatArray, row: float) -> Decay:
    """Damped vibrations in a motion, a row every `row` seconds.

    Of long motions, means of as many rows as the fastest vibration allows: they have the poles of the motion.
    """
    spectrum = np.abs(np.fft.rfft(rows))
    fastest = int(np.flatnonzero(spectrum >= _SMALL * spectrum.max())[-1])
    many = max(min(-(-rows.size // _ROWS), rows.size // (_PERIOD * max(fastest, 1))), 1)
    motion, step = rows[: rows.size // many * many].reshape(-1, many).mean(axis=1)[:_ROWS], many * row
    hankel = np.lib.stride_tricks.sliding_window_view(motion, motion.size // 3 + 1)
    _, size, right = np.linalg.svd(hankel, full_matrices=False)
    kept = right[: min(int(np.sum(size > _NOISE * size[0])), _POLES)].T
    poles = np.linalg.eigvals(np.linalg.lstsq(kept[:-1], kept[1:], rcond=None)[0])
    waves = poles[:, None] ** np.arange(motion.size)
    amplitude = np.linalg.lstsq(waves.T, motion.astype(complex), rcond=None)[0]
    left = np.linalg.norm(motion - (amplitude @ waves).real) / max(float(np.linalg.norm(motion)), 1e-300)
    rate = np.log(poles) / step
    amplitude /= np.exp(rate[:, None] * row * np.arange(many)).mean(axis=1)
    large = np.abs(amplitude) > _SMALL * np.abs(amplitude).max(initial=0.0)
    chosen = np.flatnonzero((rate.imag > 0.0) & (rate.real < 0.0) & large)
    chosen = chosen[np.argsort(np.abs(rate[chosen]))]
    found = rate[chosen]
    ratio: FloatArray = -found.real / np.abs(found)
    size = 2.0 * np.abs(amplitude[chosen])
    # A rest shorter than a mean is none.
    used = motion.size * step if motion.size * many + many <= rows.size else rows.size * row
    return Decay(np.abs(found) / (2.0 * np.pi), ratio, size, float(left), used, rows.size * row)
