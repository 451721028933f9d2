"""Timing on a machine that does other things too: blocks of work, of which those count that met it calm."""

import math
import sys
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

T = TypeVar("T")

# Up to so much more time than a block itself takes the machine counts as calm. Blocks that count; where it is not calm,
# they are repeated up to so many, with pauses (s).
_CALM, _BLOCKS, _MOST_BLOCKS, _PAUSE = 1.25, 3, 5, 0.01
# Time that a block may take, s, if that is enough for a few steps; and steps of a block.
_BLOCK_TIME, _SHORTEST, _LONGEST = 0.02, 10, 300


class Clock:
    """Time of a piece of work that neither waits nor has threads, without what other programs took of the processor."""

    def __init__(self) -> None:
        self._own = time.thread_time()
        self._wall = time.perf_counter()

    def elapsed(self) -> float:
        """Time since the clock was made, s."""
        wall = time.perf_counter() - self._wall
        # Windows counts a thread's time in ticks that are much too long.
        return wall if sys.platform == "win32" else min(wall, time.thread_time() - self._own)


def timed_piece(rows: Sequence[T], took: float) -> list[T]:
    """Loads of the steps of a block: from the first on; a single one holds.

    Parameters
    ----------
    rows : sequence
        One a step.
    took : float
        Time of a step, s.

    Returns
    -------
    list
    """
    piece = list(rows[:_LONGEST]) if len(rows) > 1 else list(rows) * _LONGEST
    return piece[: max(_SHORTEST, math.ceil(_BLOCK_TIME / max(took, 1e-9)))]


def calm_blocks(block: Callable[[], tuple[float, ...]]) -> list[tuple[float, tuple[float, ...]]]:
    """Do a block of work until the machine was calm often enough.

    Parameters
    ----------
    block : callable
        Does the work and tells how long its parts took.

    Returns
    -------
    list of (float, tuple of float)
        The calmest blocks: the time that passed over that of the block itself, and what it told.
    """
    done: list[tuple[float, tuple[float, ...]]] = []
    for _ in range(_MOST_BLOCKS):
        wall, own = time.perf_counter(), time.thread_time()
        told = block()
        wall, own = time.perf_counter() - wall, time.thread_time() - own
        done.append((wall / own if own > 0.0 else 1.0, told))
        if sum(busy <= _CALM for busy, _ in done) >= _BLOCKS:
            break
        if done[-1][0] > _CALM:
            # Someone else is at work: wait a little.
            time.sleep(_PAUSE)
    return sorted(done, key=lambda one: one[0])[:_BLOCKS]
