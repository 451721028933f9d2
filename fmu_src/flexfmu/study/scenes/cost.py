"""What steps and equilibria of a model cost, without FMI."""

import math

from ...body.flexible_body import FlexibleBody
from ...body.loads import Loads
from .measure import on_interfaces
from .pace import Clock, StepCost, time_steps
from .scene import Scene

_EQUILIBRIA = 3


def communication_step(scene: Scene, model: FlexibleBody) -> float:
    """Step (s) at which models are timed: that of the scene's first transient, else what the body suggests."""
    return scene.transient[0].step if scene.transient else model.model.suggested_step


def timing_loads(scene: Scene) -> tuple[Loads, ...]:
    """Loads of steps that are timed: the scene's first transient, or half its first static load, suddenly put on."""
    return scene.transient[0].start_loads if scene.transient else (scene.static[0].peak.scaled(0.5),)


def step_cost(scene: Scene, model: FlexibleBody, step: float) -> StepCost:
    """Time steps of a model under `timing_loads`.

    Parameters
    ----------
    scene : Scene
    model : FlexibleBody
    step : float
        s.

    Returns
    -------
    StepCost

    Raises
    ------
    RuntimeBodyError
        The model has no answer.
    """
    heavy = model.model.masses is not None
    rows = [on_interfaces(scene, model, loads).packed(heavy) for loads in timing_loads(scene)]
    return time_steps(model, rows, step)


def equilibrium_time(scene: Scene, model: FlexibleBody) -> float:
    """Time (s) that a model takes for the equilibrium under the first static case, from rest; the fastest of a few.

    Parameters
    ----------
    scene : Scene
    model : FlexibleBody

    Returns
    -------
    float
        Not a number where the scene has no static case.

    Raises
    ------
    RuntimeBodyError
        There is none.
    """
    if not scene.static:
        return math.nan
    case = scene.static[0]
    loads = on_interfaces(scene, model, case.peak.scaled(case.factors[-1]))
    times = []
    for _ in range(_EQUILIBRIA):
        clock = Clock()
        model.static(loads)
        times.append(clock.elapsed())
    return min(times)
