"""A body's motion under a table of loads, with its modal coordinates: what its FMU does in a master that holds inputs.

The FMU tells a master only how its interfaces move. It runs the same core as `FlexibleBody`, so that the same loads at
the same times give the same motion to the last bit; here its state is at hand.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..core.interface import word_of
from ..core.library import StepLimits
from ..files.basics import FloatArray, StepError
from ..files.outputs import Reporter
from ..model.reduced_body import ReducedBody
from ..program import variable_table as names
from .flexible_body import FlexibleBody
from .loads import Loads

# Relative difference of times that are the same.
_SAME = 1e-9


def body_with(model: ReducedBody, parameters: Mapping[str, object], method: str | None = None) -> FlexibleBody:
    """The body as an FMU with some parameters has it; those of watches do not change the motion, scales `replay` takes.

    Parameters
    ----------
    model : ReducedBody
    parameters : mapping of str to float or str
        By the FMU's names.
    method : str, optional
        Goes before that of the parameters.

    Returns
    -------
    FlexibleBody
    """
    usual, (stiffer, _, pace) = StepLimits(), _scales(parameters)
    limits = StepLimits(
        pace * _number(parameters, names.STEP_LIMIT, usual.longest),
        _number(parameters, names.STEP_TOLERANCE, usual.tolerance),
        _number(parameters, names.STEP_MOST, usual.most),
    )
    if model.surface is not None and model.surface.stress is not None:
        model = replace(model, surface=replace(model.surface, stress=stiffer * model.surface.stress))
    held = [name for name in model.interface_names if str(parameters.get(name + names.FIXED, "")).lower() in _YES]
    chosen = method or parameters.get(names.METHOD)
    damping = _number(parameters, names.DAMPING_SCALE, 1.0)
    return FlexibleBody(model, None if chosen is None else str(chosen), None, damping, limits, tuple(held))


def _number(parameters: Mapping[str, object], name: str, usual: float) -> float:
    return float(str(parameters.get(name, usual)))


def _scales(parameters: Mapping[str, object]) -> tuple[float, float, float]:
    """Factors of stiffness and density, and how many times faster all goes by them."""
    stiffness, density = (_number(parameters, name, 1.0) for name in (names.STIFFNESS_SCALE, names.DENSITY_SCALE))
    return stiffness, density, math.sqrt(stiffness / density)


_YES = ("true", "1", "1.0")


def loads_at(table: FloatArray, time: float) -> FloatArray:
    """Loads (L,) at a time (s): linear between the rows of a table (rows, 1 + L), after a jump where there is one."""
    times = table[:, 0]
    after = int(np.searchsorted(times, time + _SAME * abs(time), side="right"))
    if after == 0 or after == len(times):
        return table[min(after, len(times)) - 1 if after else 0, 1:]
    share = max(time - times[after - 1], 0.0) / (times[after] - times[after - 1])
    return table[after - 1, 1:] + share * (table[after, 1:] - table[after - 1, 1:])


def replay(
    body: FlexibleBody, table: FloatArray, points: FloatArray, parameters: Mapping[str, object], report: Reporter
) -> tuple[FloatArray, FloatArray]:
    """Step a body through communication points, or as far as it goes.

    Parameters
    ----------
    body : FlexibleBody
    table : (rows, 1 + L) float
        Time (s), then loads as of `Loads.packed`.
    points : (T,) float
        s.
    parameters : mapping of str to float or str
        By the FMU's names: initialization and interpolation count.
    report : Reporter

    Returns
    -------
    time : (T,) float
        s.
    q : (T, m) float
        kg^1/2 m.
    """
    interpolation = word_of("INTERPOLATION", parameters.get(names.INTERPOLATION))
    stiffness, density, pace = _scales(parameters)
    table = np.column_stack([table[:, :1], table[:, 1:] / stiffness])
    table[:, 1 + 6 * body.model.interface_count :] *= density
    # fmpy sets the values before a jump for the start, those after it for the first step.
    before = table[0, 1:]
    state = body.rest()
    if word_of("START", parameters.get(names.INITIALIZATION)) == "static":
        state = body.static(Loads.unpacked(before, body.model.interface_count))
    states, length = [state.q], 0.0
    with report.counted(f"Follow {body.model.name} to {points[-1]:g} s", len(points) - 1, "steps") as tell:
        for k, (begin, end) in enumerate(pairwise(points)):
            now = loads_at(table, float(begin))
            start, finish = now, now
            if interpolation == "ramp":
                start = before
            elif interpolation == "linear" and length > 0.0:
                finish = now + (now - before) * ((end - begin) / length)
            try:
                same = np.array_equal(start, finish)
                state, _ = body.step_packed(state, start, pace * float(end - begin), None if same else finish)
            except StepError:
                break
            states.append(state.q)
            before, length = now, float(end - begin)
            tell(k + 1)
    return points[: len(states)], np.array(states)
