"""Modes: in each basis the fewest that will do, chosen by what they have to do with the scene."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...files.array_types import IntArray
from ...files.errors import AccuracyError, BodyFileError
from ...model.methods import Mass, Method, Variant
from ...model.reduced_body import ReducedBody
from ..candidates import Joints, Reduction
from ..scene.config import BasisChoice
from ..scene.measure import Errors
from ..scene.scene import Scene, load_names
from ..subspace import joined_numbers, normal_frequencies, pairs, subset
from ..workshop import Workshop
from .contributions import contributions, loads_by_kind, loads_to_keep
from .frames import LADDER


@dataclass(slots=True)
class Choice:
    """A model that will do.

    Attributes
    ----------
    plan : Reduction
    variant : Variant
    body : ReducedBody
    errors : Errors
    cost : float
        Fastest step seen, s.
    """

    plan: Reduction
    variant: Variant
    body: ReducedBody
    errors: Errors
    cost: float = math.inf


# Steps whose times differ by less cost the same.
_SAME_COST = 0.05
# Share of the modes with which the same steps are surely faster.
_FEWER = 0.75
# Those that are slower by more are not timed again.
_TIMINGS, _CLOSE = 3, 0.2


def reductions_to_try(workshop: Workshop, frames: int | Joints) -> list[Reduction]:
    """Reductions with plenty of modes in each basis, also with static shapes of the scene's loads alone."""
    scene, loaded = workshop.scene, loaded_inputs(workshop.scene)
    ample = workshop.ample(frames)
    found = [replace(ample, basis=basis) for basis in dict.fromkeys(scene.file.sweep.basis)]
    return [*found, replace(ample, residual=loaded)] if offers_shapes_by_load(scene) and loaded else found


def modes_needed(workshop: Workshop, most: Reduction, variant: Variant, allowed: float) -> Choice | None:
    """The fewest modes of a basis that will do.

    Parameters
    ----------
    workshop : Workshop
    most : Reduction
        One of `reductions_to_try`, whose modes are chosen among.
    variant : Variant
    allowed : float
        Error over tolerance that will do.

    Returns
    -------
    Choice or None
    """
    # Parts of a cut body have modes of their own, which no choice by contribution knows apart.
    return (_fewest_of_parts if workshop.scene.config.cut else _fewest)(workshop, most, variant, allowed)


def offers_shapes_by_load(scene: Scene) -> bool:
    """Whether static shapes of single loads may be chosen: a cut body has all of them anyway."""
    return BasisChoice.RESIDUAL in scene.file.sweep.basis and not scene.config.cut


def loaded_inputs(scene: Scene) -> tuple[str, ...]:
    """Names of the forces and moments on interfaces that a scene has."""
    every = [case.peak for case in scene.static]
    every += [loads for case in scene.transient for loads in (*case.start_loads, *case.end_loads)]
    used = np.any([loads.packed(False) != 0.0 for loads in every], axis=0)
    return tuple(name for name, one in zip(load_names(scene.names), used, strict=True) if one)


def _fewest(workshop: Workshop, most: Reduction, variant: Variant, allowed: float) -> Choice | None:
    """Of a body in one piece: those that move most are taken first, then whatever can be spared is left out again.

    Static shapes of single loads are those of the scene, and of others as far as it asks for.
    """
    scene, basis, loaded = workshop.scene, most.basis, most.residual
    try:
        body = workshop.body(replace(most, residual=()), [variant])
    except (AccuracyError, BodyFileError):
        # Interfaces that cannot be held one by one, for Craig-Bampton.
        return None
    part = contributions(scene, body, variant, basis)
    order = sorted(mode_groups(body, most), key=lambda group: -float(part[group].max()))
    tried: dict[tuple[int, ...], Errors] = {}
    limit = scene.file.fit.other_loads
    # Normal modes alone have to do as well, where static shapes are to be had instead.
    alone = basis is BasisChoice.NORMAL and limit < 1.0 and offers_shapes_by_load(scene)
    completed = replace(most, basis=BasisChoice.RESIDUAL, residual=())
    whole = workshop.body(completed, [variant]) if alone or loaded else body

    def shapes(numbers: IntArray) -> tuple[str, ...]:
        return loads_to_keep(whole, numbers, loaded, limit) if alone or loaded else ()

    def share(chosen: Sequence[IntArray]) -> float:
        numbers = joined_numbers(chosen)
        kept = shapes(numbers)
        if alone and kept:
            # It has none of the shapes that it would need.
            return math.inf
        key = tuple(numbers.tolist())
        if key not in tried:
            tried[key] = workshop.errors(subset(body, basis, numbers, kept), variant)
        return tried[key].share

    quick = variant.mass is Mass.CONSTANT
    count = _first(len(order), lambda n: share(order[:n]) <= allowed, quick)
    if count is None:
        return None
    chosen = order[:count]
    for group in reversed(chosen) if quick else ():
        fewer = [one for one in chosen if one is not group]
        if fewer and share(fewer) <= allowed:
            chosen = fewer
    numbers = joined_numbers(chosen)
    lowest = int(numbers[-1]) + 1 == numbers.size
    modes = numbers.size if lowest else tuple(int(k) + 1 for k in numbers)
    kept = shapes(numbers)
    # All of them need no list.
    listed = () if len(kept) == len(loads_by_kind(body)) else kept
    plan, errors = replace(most, modes=modes, residual=listed), tried[tuple(numbers.tolist())]
    return Choice(plan, variant, subset(body, basis, numbers, kept), errors)


def mode_groups(body: ReducedBody, reduction: Reduction) -> list[IntArray]:
    """Places of a body's elastic normal modes, pairs of equal frequency together.

    The last one is left out where it is alone: its other half may be the next.

    Parameters
    ----------
    body : ReducedBody
    reduction : Reduction
        That made it.

    Returns
    -------
    list of (k,) int
    """
    groups = pairs(normal_frequencies(body, reduction.basis)[: len(reduction.numbers)])
    return groups[:-1] if len(groups) > 1 and groups[-1].size == 1 else groups


def _first(last: int, enough: Callable[[int], bool], quick: bool) -> int | None:
    """The smallest number that is enough; by halves where each try takes long."""
    if quick:
        return next((n for n in range(1, last + 1) if enough(n)), None)
    if not enough(last):
        return None
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle, high)
    return high


def _fewest_of_parts(workshop: Workshop, most: Reduction, variant: Variant, allowed: float) -> Choice | None:
    """Of a cut body: the lowest modes of each part, which always gets residual flexibility."""
    if most.basis is BasisChoice.NORMAL and BasisChoice.RESIDUAL in workshop.scene.file.sweep.basis:
        return None
    plenty = len(most.numbers)
    # All of them first: each try is a reduction, and where they do not do fewer will not.
    for count in (plenty, *(n for n in LADDER if n < plenty), plenty):
        plan = replace(most, modes=count)
        try:
            body = workshop.body(plan, [variant])
        except (AccuracyError, BodyFileError):
            if count == plenty:
                return None
            continue
        found = workshop.errors(body, variant)
        if count == plenty and found.share > allowed:
            return None
        if count < plenty and found.share <= allowed:
            return Choice(plan, variant, body, found)
    return Choice(plan, variant, body, found)


def cheapest(workshop: Workshop, found: list[Choice]) -> Choice:
    """The fastest; of those that are as fast within 5 % the one of the fewest modes.

    Parameters
    ----------
    workshop : Workshop
    found : list of Choice
        Their costs are set, but of those that cannot be the fastest.

    Returns
    -------
    Choice
    """
    left = [choice for choice in found if not any(_beats(other, choice) for other in found)]
    # In turns, so that what else the machine does meets all of them; those that are slow by far only once.
    with workshop.report.counted("Time them", _TIMINGS * len(left), "timings at most") as tell:
        done = 0
        for _ in range(_TIMINGS):
            for choice in left:
                choice.cost = min(choice.cost, workshop.cost(choice.body, choice.variant).fastest)
                done += 1
                tell(done)
            fastest = min(choice.cost for choice in left)
            left = [choice for choice in left if choice.cost <= (1.0 + _CLOSE) * fastest]
    close = [choice for choice in left if choice.cost <= (1.0 + _SAME_COST) * fastest]
    return min(close, key=lambda choice: (choice.body.mode_count, choice.cost))


def _beats(one: Choice, other: Choice) -> bool:
    """Whether one is faster than the other without a look at the clock.

    The same steps with far fewer modes, or linear steps in place of those that follow the load or the rotation.
    """
    if one.variant.method is Method.LINEAR and other.variant.method is not Method.LINEAR:
        return one.body.mode_count <= other.body.mode_count
    same = one.variant == other.variant and one.body.frame_count == other.body.frame_count
    return same and one.body.mode_count <= _FEWER * other.body.mode_count
