"""Loads that bend a body as far as it is likely to be bent, where nobody says how far."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import product

import numpy as np
from scipy.linalg import eigh

from ..core.interface import parameter
from ..files.basics import EquilibriumError, FloatArray, RuntimeBodyError
from ..mesh.model import Along
from ..model.methods import Mass, Method
from ..model.reduced_body import ReducedBody, Shadow
from ..program.mechanics import inertial_modes
from ..reduction.bushings import SpringReading
from .flexible_body import FlexibleBody, State

# Reference loads turn an interface by so much (rad), or move it by such a share of the body's size, in linear theory.
_TURN, _MOVE = 0.5, 0.2
# Part of its softness that tells one axis from the next, and an entry of an axis that tells its sign.
_UNLIKE, _LARGE = 1e-6, 0.3
# A direction that is stiffer by more is not loaded: the body would give way across it first.
_STIFF = 100.0
# Where the body has no equilibrium a load is halved, so often at most.
_HALVES = 6
# A load that acts suddenly bends a body so many times as far as a slow one.
_SUDDEN = 2.0
# A step that only asks for the mass, in times over the highest frequency.
_SHORT = 1e-6
# At such a share of the reference loads the polynomial is exact; the mass of lumps on few frames may differ by so much.
_NEAR, _ALIKE = 0.25, 0.01
# Share of the reference loads under which frequencies are compared, and how many of the lowest.
_HALF, _LOWEST = 0.5, 3
# Share that these may lack: by a polynomial, which lumps replace at a cost, else, and with as many as it takes.
_BEARABLE, _SMALL, _NOTHING = 5e-3, 2e-3, 1e-3
# Steps a slow period, how many are tried, and internal steps of each from which on a motion is too dear.
_STEPS, _TRIED, _DEAR = 50, 25, 40
# Difference from another body that is none to warn of, half of what an FMU warns of; and one that tells enough itself:
# a leaf on a shackle, 4 % off by its own shadow, snaps as the opened one does, a cross pivot, 8 %, does not.
_SLIGHT, _TOLD = 5e-3, 0.05
# Error that a step finds under reference loads, over the difference of equilibria, where it leads astray: of a vault
# on four posts, 2.6 % off an opened shadow, 0.1 off the finite element model, it found 100 %.
_ASTRAY = 2.0
# Beyond this an error tells no more than that the motion is wrong, as FMUs say, too.
_VAGUE = 0.1


def reference_loads(
    model: FlexibleBody, *others: FlexibleBody, back: bool = True
) -> Iterator[tuple[str, str, FloatArray, State]]:
    """Forces on each interface across the directions in which it is stiff, as far as the body bears them.

    None of them hangs on round-off, which turns axes that are equally soft, and reverses any. What it never bears is
    left out.

    Parameters
    ----------
    model : FlexibleBody
        Held, with its properties.
    *others : FlexibleBody
        That bear them, too.
    back : bool
        Whether also the other way: an arch that is pressed is another body than one that is lifted.

    Yields
    ------
    name : str
    interface : str
    force : (3,) float
        N.
    state : State
        Of the model, under it.
    """
    body = model.model
    size = float(np.ptp(np.array(body.properties.box), axis=0).max()) if body.properties else 0.0
    every = body.interface_names, body.interface_displacement, body.interface_rotation
    for name, moved, turned in zip(*every, strict=True):
        gives, turns = ((part / body.angular_frequency**2) @ moved.T for part in (moved, turned))
        softness, ways = np.linalg.eigh(gives + _UNLIKE * np.trace(gives) * np.diag([0.0, 1.0, 2.0]))
        ways *= np.sign(ways[np.argmax(np.abs(ways) > _LARGE, axis=0), range(3)])
        # The stiffest direction of a slender body is along it; a held interface has none that gives.
        for number, sign in product((2, 1), (1.0, -1.0) if back else (1.0,)):
            if not softness[number] * _STIFF >= softness[2] > 0.0:
                continue
            way = sign * ways[:, number]
            force = min(_MOVE * size / softness[number], _TURN / max(float(np.linalg.norm(turns @ way)), 1e-300)) * way
            for _ in range(_HALVES):
                try:
                    state, *_ = [one.static({name: force.tolist()}) for one in (model, *others)]
                    break
                except EquilibriumError:
                    force = 0.5 * force
            else:
                continue
            yield f"{name}_{3 - number}{'' if sign > 0.0 else '_back'}", name, force, state


def _bent(model: FlexibleBody, factor: float) -> Iterator[FloatArray]:
    """So many times the coordinates (m,) under each reference load."""
    yield from (factor * state.q for *_, state in reference_loads(model))


def keeps_its_mass(body: ReducedBody) -> bool:
    """Whether a held body's mass polynomial reaches as far as reference loads bend it that act suddenly."""
    if body.rigid_count or body.mass is not Mass.POLYNOMIAL:
        return True
    model, step = FlexibleBody(body), _SHORT / float(body.angular_frequency[-1])
    still, loads = np.zeros(model.core.modes), np.zeros(model.core.loads)
    return "BEYOND_MASS" not in {model.core.step(q, still, loads, step)[0].name for q in _bent(model, _SUDDEN)}


def lumps_are_fine(body: ReducedBody) -> bool:
    """Whether the lumps of a held body have its kinetic energy near rest, where the polynomial has it."""
    alike = replace(body, mass_modes=0)
    one, other = (FlexibleBody(alike, mass=mass) for mass in (Mass.POLYNOMIAL, Mass.CONFIGURATION))
    energies = [[q @ model.core.mass(q) @ q for model in (one, other)] for q in _bent(one, _NEAR)]
    return all(abs(lumps - whole) < _ALIKE * whole for whole, lumps in energies)


def mass_modes(body: ReducedBody, lumped: ReducedBody, dear: bool) -> int:
    """How many of the first coordinates the mass of a held body has to know of.

    The mass of stiff coordinates, of twist or stretch, grows by many times itself as a body bends, and they follow slow
    motions. Where the lowest frequencies about equilibria under half of the reference loads lack too much without
    them, as many count as bring that close to nothing, if a motion with them is not too dear.

    Parameters
    ----------
    body : ReducedBody
    lumped : ReducedBody
        It or another one in its coordinates, whose lumps count.
    dear : bool
        Whether each costs as much as with lumps: a polynomial has them for little.

    Returns
    -------
    int
    """
    modes, equilibria = body.mode_count, []
    model = FlexibleBody(body, mass=Mass.CONSTANT)
    heavy = FlexibleBody(replace(lumped, mass_modes=modes), mass=Mass.CONFIGURATION)
    every = list(reference_loads(model))
    for _, name, force, _ in every:
        inputs, start = np.zeros(model.core.loads), 6 * body.interface_names.index(name)
        inputs[start : start + 3] = _HALF * force
        with suppress(EquilibriumError, np.linalg.LinAlgError):
            state = model.static({name: (_HALF * force).tolist()})
            stiffness, mass = model.tangent(state, inputs), heavy.mass(state)
            equilibria.append((stiffness, mass, eigh(stiffness, mass, eigvals_only=True)[:_LOWEST]))

    def off(known: int) -> float:
        worst = 0.0
        for stiffness, mass, squares in equilibria:
            own = np.eye(modes)
            own[:known, :known] = mass[:known, :known]
            ratio = eigh(stiffness, own, eigvals_only=True)[:_LOWEST] / squares
            worst = max(worst, float(np.max(np.abs(np.sqrt(np.abs(ratio)) - 1.0))))
        return worst

    known = inertial_modes(body)
    if off(known) <= (_BEARABLE if dear and body.mass is not Mass.CONFIGURATION else _SMALL):
        return known
    more = next(one for one in range(known, modes + 1) if one == modes or off(one) <= _NOTHING)
    moving = FlexibleBody(replace(lumped, mass_modes=more), mass=Mass.CONFIGURATION)
    loads = [{name: (_HALF * force).tolist()} for _, name, force, _ in every]
    return more if not dear or _moves(moving, loads) else known


def _moves(model: FlexibleBody, cases: list[dict[str, list[float]]]) -> bool:
    """Whether loads that act suddenly move a body for half a period in steps that are not dear."""
    step = 2.0 * np.pi / (_STEPS * float(model.model.angular_frequency[0]))
    for loads in cases:
        state, taken = model.rest(), 0
        for _ in range(_TRIED):
            try:
                state, work = model.step_with_work(state, loads, step)
            except RuntimeBodyError:
                return False
            taken += work.substeps
        if taken > _DEAR * _TRIED:
            return False
    return True


def differs_more(body: ReducedBody, shadow: Shadow, more: bool = True) -> bool:
    """Whether reference loads part a held body from a shadow, and further than from its own one.

    Where its own already tells a lot, another counts that bears them all. None counts to whose equilibria a step of
    Newton's method, all that a body makes of it, does not lead. Without `more` that alone is asked.
    """
    *own, other = apart(body, body.shadow, shadow)
    unborne = max(own, default=0.0) > _TOLD and max(apart(body, shadow, first=body)) >= 1.0
    if unborne or (more and not other > max([*own, _SLIGHT])):
        return False
    model, finer = FlexibleBody(replace(body, shadow=shadow)), _with(body, shadow)[1]
    for _, name, force, state in reference_loads(model, finer):
        here, there = (one.response(one.static({name: force.tolist()})).displacement for one in (model, finer))
        off = max(float(np.linalg.norm(here - there) / np.linalg.norm(here)), _TOLD)
        if model.error(state, {name: force.tolist()}).relative > _ASTRAY * off:
            return False
    return True


def apart(body: ReducedBody, *shadows: Shadow | None, first: ReducedBody | None = None) -> FloatArray:
    """Largest shares of its deflection by which reference loads that all bear part a body from shadows.

    Those of the first, if there is one, that it bears with its shadow: who does not is all off.
    """
    every = _with(body, *shadows)
    off = np.zeros(len(every) - 1)
    for _, name, force, _ in reference_loads(*(every[:1] if first is None else _with(first, first.shadow))):
        try:
            own, *rest = (one.response(one.static({name: force.tolist()})).displacement for one in every)
            off = np.maximum(off, [np.linalg.norm(own - one) / np.linalg.norm(own) for one in rest])
        except EquilibriumError:
            off = np.maximum(off, float(first is not None))
    return off


def _with(body: ReducedBody, *shadows: Shadow | None) -> list[FlexibleBody]:
    return [FlexibleBody(body), *(FlexibleBody(one.body, Method.SECOND_ORDER) for one in shadows if one is not None)]


def missed_by_lines(body: ReducedBody, shapes: FloatArray, springs: Sequence[SpringReading]) -> list[str]:
    """How far reference loads put a held body off, in words, as springs follow their line by its second order alone.

    Of places that have given way to that order, forces of both are compared, and the linear body answers.

    Parameters
    ----------
    body : ReducedBody
    shapes : (3n, m) float
        Its modes.
    springs : sequence of SpringReading

    Returns
    -------
    list of str
        None if it is no more than FMUs warn of.
    """
    lines = [one for one in springs if one.spring.along is Along.LINE]
    if not lines or body.rigid_count:
        return []
    model, worst, eased = FlexibleBody(body), (0.0, ""), body.angular_frequency**2
    for _, name, force, state in reference_loads(model):
        missed = np.zeros(body.mode_count)
        for one in lines:
            moved, stiffness = one.rows @ shapes[one.columns], one.spring.stiffness[0]
            z = moved @ state.q
            slope, bend = one.slope(0.0 * z)[0], one.bend(0.0 * z)[0] @ z
            given = z - 0.5 * stiffness * (bend @ z) * (moved / eased) @ (slope @ moved)
            true = one.values(given)[0] * one.slope(given)[0]
            missed += stiffness * (true - (slope @ given + 0.5 * bend @ z) * (slope + bend)) @ moved
        each = np.linalg.norm(
            [body.interface_displacement @ (missed / eased), model.response(state).displacement], axis=2
        )
        off, far = map(float, each.max(axis=1))
        worst = max(worst, (off / far, f"{100.0 * off / far:.2g} % under {np.linalg.norm(force):.3g} N on {name}"))
    found = f"springs along a line ({', '.join(one.spring.name for one in lines[:3])}) that turn far are known to"
    do = "make their ends interfaces, and join these by a [[spring]] of a coupling file"
    words = f"{found} second order, which puts the body off by up to {worst[1]}: {do}"
    return [words] * (worst[0] > (body.tolerance or parameter("ERROR_LIMIT").start))


def own_error(body: ReducedBody) -> list[str]:
    """The largest error under reference loads that the body tells of itself, in words; none of a free body."""
    if body.rigid_count or body.properties is None or body.shadow is None:
        return []
    model, worst = FlexibleBody(body), (-1.0, "")
    for _, name, force, state in reference_loads(model):
        found = model.error(state, {name: force.tolist()})
        moved = np.linalg.norm(model.response(state).displacement[body.interface_names.index(name)])
        size = f"up to {100.0 * found.relative:.2g} %" if found.relative < _VAGUE else f"more than {100.0 * _VAGUE:g} %"
        words = f"{size} under {np.linalg.norm(force):.3g} N on {name}, which moves by {moved:.3g} m"
        worst = max(worst, (found.relative, words))
    ties = None if body.ties is not None else body.shadow.body.ties
    do = "more frames or modes" if ties is None else "a cut" if ties.joins else "rotational_stiffness of its supports"
    hint = f"; {do} or --tolerance lower it" * (worst[0] > (body.tolerance or parameter("ERROR_LIMIT").start))
    return [f"own estimate of its error: {worst[1]}{hint}"] * bool(worst[1])
