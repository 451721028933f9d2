"""What inputs the FMUs' outputs ask for: tables, connections and springs, and how the answer to inputs is known."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from ..files.array_types import BoolArray, FloatArray
from .acceleration import KnownResponse
from .layout import EndResponse, Wiring
from .springs import Springs, backward_rates, energy, loads, losses, tangent

# Of a step: on which side of a jump in a table its ends lie does not hang on round-off.
_NEAR = 1e-9
# A load held over a step changes the velocity at its end twice as much as the motion suggests.
_RATE_BY_MOTION = 2.0
# Multiples of round-off that outputs are trusted to, and the change of any input that never counts.
_ROUND_OFF, _NOTHING = 1e3 * np.finfo(float).eps, 1e-12


def base_inputs(wiring: Wiring, time: float, step: float, before: bool = False) -> FloatArray:
    """What the driven inputs have apart from the coupling.

    Parameters
    ----------
    wiring : Wiring
    time, step : float
        s.
    before : bool, optional
        At a jump of a table take the value before it.

    Returns
    -------
    (n,) float
    """
    result = wiring.base.copy()
    for table in wiring.tables:
        moment = time + (-_NEAR if before else _NEAR) * step
        row = int(np.searchsorted(table.time, moment, side="right"))
        if row in (0, len(table.time)):
            result[table.inputs] = table.values[min(row, len(table.time) - 1)]
        else:
            span = table.time[row] - table.time[row - 1]
            part = (moment - table.time[row - 1]) / span
            result[table.inputs] = table.values[row - 1] + part * (table.values[row] - table.values[row - 1])
    return result


class Dampers(Enum):
    """What dampers go by."""

    NOW = "now"
    """The ends' velocities where they are offered, else the change since the last communication point."""
    MEAN = "mean"
    """The change since the last communication point: of a force held over the step the power is never positive."""
    NONE = "none"
    """They are left out."""


def coupled_inputs(
    wiring: Wiring, signals: FloatArray, before: FloatArray, step: float, dampers: Dampers = Dampers.NOW
) -> FloatArray:
    """What connections and springs ask the driven inputs to be, in addition to the base.

    Parameters
    ----------
    wiring : Wiring
    signals : (m,) float
        Now.
    before : (m,) float
        A step ago, for the rates of ends without velocities.
    step : float
        s.
    dampers : Dampers, optional

    Returns
    -------
    (n,) float
    """
    result: FloatArray = wiring.matrix @ signals
    if len(wiring.springs.a):
        motion, rates = _motion(wiring, signals, before, step, dampers)
        places, values = wiring.ends.loads, loads(wiring.springs, motion, rates)
        there = places >= 0
        result[places[there]] += values[there]
    return result


def interface_response(
    wiring: Wiring,
    signals: FloatArray,
    before: FloatArray,
    step: float,
    compliance: Sequence[FloatArray],
    share: float = 1.0,
    dampers: Dampers = Dampers.NOW,
) -> KnownResponse | None:
    """Derivative of the coupled inputs with respect to themselves, held over a step, from the interfaces' compliance.

    Of springs only one of whose ends offers its compliance nothing is known.

    Parameters
    ----------
    wiring : Wiring
    signals, before : (m,) float
        At the step's end and beginning.
    step : float
        s.
    compliance : sequence of (6, 6) float
        Of each of the wiring's responses: displacement and rotation at the step's end by force and moment held over it.
    share : float, optional
        Part that the step's end has in what is held.
    dampers : Dampers, optional

    Returns
    -------
    KnownResponse or None
        None: nothing is known.
    """
    ends, fed = wiring.ends, wiring.matrix != 0.0
    sound = [(r, block) for r, block in zip(wiring.responses, compliance, strict=True) if np.all(np.isfinite(block))]
    if not sound:
        return None
    by_inputs, told = _signals_by_inputs(wiring, step, sound)
    slope = wiring.matrix @ by_inputs[:-1]
    # Signals that no coupled input of their FMU can move are known, too.
    movable = wiring.signal_role[:, None] == np.where(wiring.coupled, wiring.input_role, -1)
    unknown = np.any(movable, axis=1) & ~np.any(told[:-1], axis=1)
    known = np.any(fed, axis=1) & ~np.any(fed & unknown, axis=1)
    springs = _known_springs(wiring, [response for response, _ in sound])
    if len(springs.a):
        motion, _ = _motion(wiring, signals, before, step)
        if dampers is Dampers.MEAN:
            # Their part in what is held is one, whatever that of the springs.
            by_motion = np.full(len(motion), 1.0 / (share * step))
        else:
            by_motion = np.where(ends.rates[:, 0] >= 0, _RATE_BY_MOTION, 1.0) / step
        loads_by_inputs = tangent(springs, motion, by_motion) @ by_inputs[ends.motion.ravel()]
        places = ends.loads.ravel()
        slope[places[places >= 0]] += loads_by_inputs[places >= 0]
        touched = np.unique(np.concatenate([springs.a, springs.b]))
        places = ends.loads[touched[touched < len(ends.names)]]
        known[places[places >= 0]] = True
    used = np.append(np.any(fed, axis=0), False)
    used[ends.motion] = True
    # Nothing is missing where all is told of every signal that is used.
    complete = np.all(told[:-1] | ~movable, axis=1) | ~used[:-1]
    return KnownResponse(share * slope, known, bool(np.all(complete)))


def _known_springs(wiring: Wiring, responses: Sequence[EndResponse]) -> Springs:
    """Springs both of whose ends offer their compliance."""
    springs = wiring.springs
    offered = {response.moved for response in responses if response.moved == response.loaded}
    # The ground does not give way.
    held = np.array([*(name in offered for name in wiring.ends.names), True])
    kept = held[springs.a] & held[springs.b]
    return Springs(springs.a[kept], springs.b[kept], springs.stiffness[kept], springs.damping[kept])


def _signals_by_inputs(
    wiring: Wiring, step: float, responses: Sequence[tuple[EndResponse, FloatArray]]
) -> tuple[FloatArray, BoolArray]:
    """Derivatives (m + 1, n) of the signals by the driven inputs, and which are told; the last signal is none."""
    shape = wiring.matrix.shape[1] + 1, wiring.matrix.shape[0]
    derivative, told = np.zeros(shape), np.zeros(shape, dtype=bool)
    for response, block in responses:
        column = response.loads >= 0
        for places, factor in ((response.motion, 1.0), (response.rates, _RATE_BY_MOTION / step)):
            row = places >= 0
            there = np.ix_(places[row], response.loads[column])
            derivative[there], told[there] = factor * block[np.ix_(row, column)], True
    return derivative, told


@dataclass(frozen=True, slots=True)
class EnergyCount:
    """Energies of springs and dampers, J.

    What the loads did to the bodies, what the springs took up and what the dampers lost would be nothing together if
    the loads followed the motion. Held over steps they do not.

    Attributes
    ----------
    created : float
        What came from holding the loads, so far.
    stored : float
        In the springs, the most so far.
    exchanged : float
        Work of all loads, whichever its sign, so far.
    now : float
        In the springs.
    """

    created: float
    stored: float
    exchanged: float
    now: float = 0.0


def counted(
    count: EnergyCount, wiring: Wiring, signals: FloatArray, before: FloatArray, held: FloatArray, step: float
) -> EnergyCount:
    """Add a step to the count of energies; connections to inputs that springs load count as loads of springs.

    Parameters
    ----------
    count : EnergyCount
    wiring : Wiring
    signals, before : (m,) float
        At the step's end and beginning.
    held : (n,) float
        Coupled inputs held over the step.
    step : float
        s.

    Returns
    -------
    EnergyCount
    """
    springs = wiring.springs
    if not len(springs.a):
        return count
    motion, motion_before = (np.append(values, 0.0)[wiring.ends.motion] for values in (signals, before))
    work = np.append(held, 0.0)[wiring.ends.loads] * step * backward_rates(motion, motion_before, step)
    stored, stored_before = energy(springs, motion), energy(springs, motion_before)
    created = float(np.sum(work)) + stored - stored_before + losses(springs, motion, motion_before, step)
    exchanged = count.exchanged + float(np.sum(np.abs(work)))
    return EnergyCount(count.created + created, max(count.stored, stored, stored_before), exchanged, stored)


def noise(wiring: Wiring, signals: FloatArray, step: float, nominal: bool = False) -> FloatArray:
    """Residuals of the coupled inputs that round-off of the signals explains.

    An FMU may well find a small value as the difference of large ones: its round-off is that of the nominal value.

    Parameters
    ----------
    wiring : Wiring
    signals : (m,) float
    step : float
        s.
    nominal : bool, optional
        Take no signal for smaller than its nominal value.

    Returns
    -------
    (n,) float
    """
    sizes = np.maximum(np.abs(signals), wiring.nominal) if nominal else np.abs(signals)
    result: FloatArray = np.abs(wiring.matrix) @ sizes
    if len(wiring.springs.a):
        motion, _ = _motion(wiring, signals, signals, step)
        size = np.repeat(np.max(np.append(sizes, 0.0)[wiring.ends.motion], axis=1, initial=0.0), 6)
        by_motion = np.full(len(motion), 2.0 / step)
        places = wiring.ends.loads.ravel()
        result[places[places >= 0]] += (np.abs(tangent(wiring.springs, motion, by_motion)) @ size)[places >= 0]
    return _ROUND_OFF * result + _NOTHING


def _motion(
    wiring: Wiring, signals: FloatArray, before: FloatArray, step: float, dampers: Dampers = Dampers.NOW
) -> tuple[FloatArray, FloatArray]:
    """Motion of the ends and, for dampers, their rates, (E, 6) each; what an FMU does not offer is zero."""
    # Place −1 is the zero at the end.
    now, then = np.append(signals, 0.0), np.append(before, 0.0)
    motion = now[wiring.ends.motion]
    if dampers is Dampers.NONE or not np.any(wiring.springs.damping):
        return motion, np.zeros_like(motion)
    difference = backward_rates(motion, then[wiring.ends.motion], step)
    if dampers is Dampers.MEAN:
        return motion, difference
    return motion, np.where(wiring.ends.rates >= 0, now[wiring.ends.rates], difference)
