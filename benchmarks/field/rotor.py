"""A rotating blade with a swept tip, whose frequencies were measured, with the shortest body file.

It spins by itself on a hinge; a blow across its plane sets it swinging, and peaks of its tip's spectrum are compared.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import scipy.linalg
from demo.mesh_tools import Material, box_mesh
from numpy.typing import NDArray

from benchmarks.defaults.body import Body, about, both, end, near
from benchmarks.defaults.shapes import moved
from benchmarks.field.bodies import INCH, POUND
from benchmarks.field.records import Record
from flexfmu.body.flexible_body import FlexibleBody, State
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter

FloatArray = NDArray[np.float64]

PROBLEM, SOURCE = "Rotating blade", "Epps, Chandra, J. Am. Helicopter Soc. 41 (1996) 29: measured"
# Hz, of the first three bendings across the plane, by sweep of the tip (degrees) and speed (rpm).
MEASURED = {
    (0, 0): (1.4, 10.3, 27.7),
    (0, 500): (10.2, 25.2, 47.0),
    (0, 750): (14.8, 36.1, 62.9),
    (45, 0): (1.6, 10.4, 24.8),
    (45, 500): (10.2, 21.6, 35.1),
    (45, 750): (14.7, 26.1, 44.8),
}
# Lengths of hub, blade and tip, width, thickness, m; aluminium.
HUB, BLADE, TIP, WIDTH, THICKNESS = (INCH * size for size in (2.5, 31.5, 6.0, 1.0, 0.063))
_SOFT = 10.6e6 * POUND / INCH**2, 0.325, 2.51e-4 * POUND / INCH**4
# Seconds of swinging, of a step, and of the blow.
_LONG, _STEP, _BLOW = 4.0, 1e-3, 8e-3


def blade(sweep: float) -> Body:
    """A blade on a stiff hub about z, its tip turned by `sweep` (degrees) in the plane of rotation."""
    x = np.concatenate([[-HUB, 0.0], np.linspace(HUB, HUB + BLADE, 22), HUB + BLADE + np.linspace(0.2, 1.0, 5) * TIP])
    half, kink, turn = np.radians(0.5 * sweep), HUB + BLADE, np.radians(sweep)

    def place(points: FloatArray) -> FloatArray:
        far, y = points[:, 0] - kink, points[:, 1]
        # Sections lean to the bisector at the kink.
        along = far - np.sign(far) * y * np.tan(half) * np.clip(1.0 - abs(far) / TIP, 0.0, 1.0)
        along[far == 0.0] = 0.0
        out = points.copy()
        tip = far > 0.0
        out[~tip, 0] = kink + along[~tip]
        out[tip, 0] = kink + along[tip] * np.cos(turn) + y[tip] * np.sin(turn)
        out[tip, 1] = y[tip] * np.cos(turn) - along[tip] * np.sin(turn)
        at = far == 0.0
        out[at, 0], out[at, 1] = kink + y[at] * np.tan(half), y[at]
        return out

    y, z = np.linspace(-0.5, 0.5, 3) * WIDTH, np.linspace(-0.5, 0.5, 2) * THICKNESS
    mesh = moved(box_mesh(x, y, z), place)
    soft, stiff = Material("SOFT", *_SOFT), Material("STIFF", 1e3 * _SOFT[0], *_SOFT[1:])
    hub = about(0, [0.0], HUB)
    axis = both(near(0, 0.0), near(1, 0.0))
    return Body(
        "blade", mesh, axis, {"tip": end(mesh, (2, 1), True)}, {}, soft, inlay=(stiff, hub),
        guides={"z": lambda p: (p[:, 0] < HUB + 1e-9) & np.isclose(p[:, 2], 0.0)},
    )  # fmt: skip


def built(sweep: float) -> FlexibleBody:
    """The blade by the shortest body file, free to turn about its hinge."""
    with tempfile.TemporaryDirectory() as top:
        path = blade(sweep).write(Path(top))
        text = "free = true\n" + path.read_text(encoding="utf-8") + "[damping]\nratio = 1e-3\n"
        path.write_text(text, encoding="utf-8")
        return FlexibleBody(reduce_body(read_body_file(path), Reporter()))


def frequencies(body: FlexibleBody, speed: float) -> FloatArray:
    """Hz of the three largest peaks of the tip's swing across the plane, at a speed (rpm)."""
    model, rates, swing = body.model, np.zeros(body.model.mode_count), []
    rates[0] = 2.0 * np.pi / 60.0 * speed / model.interface_rotation[0][2, 0]
    state = State(body.rest().q, rates)
    for k in range(round(_LONG / _STEP)):
        state = body.step(state, {"tip": [0.0, 0.0, 0.05]} if k < round(_BLOW / _STEP) else {}, _STEP)
        swing.append(body.response(state).displacement[0, 2])
    size = abs(np.fft.rfft(np.array(swing) * np.blackman(len(swing)), 16 * len(swing)))
    peaks = np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] > size[2:])) + 1
    return np.sort(peaks[np.argsort(-size[peaks])[:3]]) / (16.0 * _LONG)


def flapping(speed: float, shapes: int = 9) -> FloatArray:
    """Hz of the straight blade by Ritz's method: EI d4w/dx4 - d/dx (N dw/dx) = rho A omega^2 w, N by the spin (rpm)."""
    length, line = BLADE + TIP, _SOFT[2] * WIDTH * THICKNESS
    x, weight = np.polynomial.legendre.leggauss(30)
    x, weight = 0.5 * (x + 1.0), 0.5 * length * weight
    k = np.arange(2, shapes + 2)[:, None]
    shape, slope, bend = x**k, k * x ** (k - 1) / length, k * (k - 1) * x ** (k - 2) / length**2
    tension = line * (2.0 * np.pi / 60.0 * speed) ** 2 * (HUB * length * (1.0 - x) + 0.5 * length**2 * (1.0 - x**2))
    stiffness = _SOFT[0] * WIDTH * THICKNESS**3 / 12.0 * (bend * weight) @ bend.T + (slope * weight * tension) @ slope.T
    squares = scipy.linalg.eigh(stiffness, line * (shape * weight) @ shape.T, eigvals_only=True)
    return np.sqrt(squares[:3]) / (2.0 * np.pi)


def rotor_records() -> list[Record]:
    """Frequencies at three speeds of a straight blade and of a swept one, measured; of the first by theory, too."""
    records = []
    for sweep in (0, 45):
        body = built(sweep)
        for speed in (0, 500, 750):
            ours, words = tuple(map(float, frequencies(body, speed))), f"flapping at {speed} rpm, Hz"
            named = f"{words}, tip swept by {sweep}°"
            records.append(Record(PROBLEM, SOURCE, named, "default", ours, MEASURED[sweep, speed]))
            if not sweep:
                theory = tuple(map(float, flapping(speed)))
                records.append(Record(PROBLEM, "beam under tension", f"{words}, theory", "default", ours, theory))
    return records
