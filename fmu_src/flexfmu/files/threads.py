"""Threads of the libraries below."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
T = TypeVar("T")


def in_one_thread(work: Callable[P, T]) -> Callable[P, T]:
    """Let OpenBLAS use one thread while a function runs: matrices are small here, and waiting threads take processors.

    Parameters
    ----------
    work : callable

    Returns
    -------
    callable
    """

    @wraps(work)
    def limited(*arguments: P.args, **options: P.kwargs) -> T:
        with ThreadpoolController().select(internal_api="openblas").limit(limits=1):
            return work(*arguments, **options)

    return limited
