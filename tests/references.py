"""CalculiX results kept with the demos, and how errors against them are measured."""

from pathlib import Path

import numpy as np

from flexfmu.build.config import read_body_file
from flexfmu.model.methods import Mass
from flexfmu.program.mechanics import inertial_modes

DEMO = Path(__file__).parent.parent / "demo"
BEAM = DEMO / "clamped_beam"
L_FRAME = DEMO / "l_frame"


def body_without_error(path):
    """Body file of a body that tells no error, which would take twice as long, and has no surface, a fifth of that."""
    config = read_body_file(path)
    return config.model_copy(update={"output": config.output.model_copy(update={"error": False, "surface": False})})


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


def drift(model, states, step):
    """How far coordinates (n, m) go off, undamped, by what the mass of steps omits; at n states, a step apart."""
    mass, omega = model.polynomial, model.angular_frequency
    slow, known = (np.arange(omega.size) < inertial_modes(model, rates) for rates in (False, True))
    form = mass.form * known * known[:, None]
    q, v = (np.array(each) for each in zip(*((state.q, state.v) for state in states), strict=True))
    if model.mass is Mass.POLYNOMIAL:
        first, second = np.triu_indices(slow.sum())
        pairs = lambda x: np.hstack([x, x[:, first] * x[:, second]])  # noqa: E731
        powers = lambda x: x[:, mass.factor[:, 0]] * pairs(x)[:, mass.factor[:, 1]]  # noqa: E731
        factor = lambda x: powers(x) @ mass.further.T  # noqa: E731
    else:
        factor = lambda x: x @ mass.linear.T + np.einsum("kab,ta,tb->tk", mass.square * slow * slow[:, None], x, x)  # noqa: E731
    momentum = np.einsum("tk,kab,tb->ta", factor(q), form, v)
    half, rate = 0.5 * (q[1:] + q[:-1]), 0.5 * (v[1:] + v[:-1])
    twice = np.einsum("kab,ta,tb->tk", form, rate, rate)
    push = np.zeros_like(half)
    for j, unit in enumerate(np.eye(omega.size)):
        # Exact but for round-off: factors are polynomials.
        push[:, j] = 0.5 * np.sum(twice * factor(half + 1e-30j * unit).imag, axis=1) / 1e-30
    mean = push - np.diff(momentum, axis=0) / step
    cosine, sine, found = np.cos(omega * step), np.sin(omega * step) / omega, [np.zeros((2, omega.size))]
    if model.ties is not None:
        # Modes that the step does not resolve go by the rule of the middle.
        fast, whole = omega * step > 1.5, 1.0 + 0.25 * (omega * step) ** 2
        cosine, sine = np.where(fast, 2.0 / whole - 1.0, cosine), np.where(fast, step / whole, sine)
    for each in mean:
        x, y = found[-1]
        off = cosine * x + sine * y + (1.0 - cosine) / omega**2 * each
        found.append(np.array([off, cosine * y + sine * (each - omega**2 * x)]))
    return np.array(found)[:, 0]


def missed_share(model, states, step):
    """Its motion of the first interface over the body's, or where rates carry it; linear, rms; twice of polynomials."""
    rows, more = model.interface_displacement[0], 2.0 if model.mass is Mass.POLYNOMIAL else 1.0
    off = drift(model, states, step)
    ways = np.array([(state.q, state.v / model.angular_frequency) for state in states]) @ rows.T
    moved = np.linalg.norm(ways, axis=2).max(axis=1)
    return more * np.linalg.norm(off @ rows.T) / np.linalg.norm(moved)
