"""Accuracy runs shared among processes: of this machine, or of a Dask cluster. Timings never go through here."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any, TypeVar

import joblib

from ..files.errors import FlexfmuError

T = TypeVar("T")


class JobsError(FlexfmuError):
    """Processes that were asked for are not to be had."""


class Crew:
    """Processes among which tasks are shared; a context, at whose end they end.

    Parameters
    ----------
    jobs : str
        A number of processes of this machine, 1: this one alone, -1: one a core; or the address of a Dask cluster's
        scheduler, as tcp://host:8786.

    Raises
    ------
    JobsError
        Neither a number nor an address, no Dask, or nobody at the address.
    """

    def __init__(self, jobs: str = "1"):
        self._client: Any = None
        self._backend: dict[str, Any] = {"backend": "loky", "inner_max_num_threads": 1}
        if "://" in jobs:
            self._client, self._backend = _dask_client(jobs), {"backend": "dask"}
            self.count = max(1, sum(self._client.nthreads().values()))
            return
        try:
            asked = int(jobs)
        except ValueError as error:
            raise JobsError(
                f"jobs is {jobs!r}, expected a number of processes or the address of a Dask scheduler (tcp://host:8786)"
            ) from error
        if asked == 0 or asked < -1:
            raise JobsError(f"jobs is {asked}, expected 1 or more, or -1: one process for each core")
        self.count = joblib.cpu_count() if asked == -1 else asked

    def each(self, tasks: Sequence[Callable[[], T]]) -> Iterator[T]:
        """Do tasks, and yield their results in the order of the tasks as soon as they are there.

        Parameters
        ----------
        tasks : sequence of callable
            Functions of modules, or `functools.partial` of them: they are sent to other processes.

        Yields
        ------
        object
        """
        if self.count == 1 or len(tasks) < 2:
            for task in tasks:
                yield task()
            return
        with joblib.parallel_config(n_jobs=min(self.count, len(tasks)), **self._backend):
            yield from joblib.Parallel(return_as="generator", batch_size=1)(joblib.delayed(task)() for task in tasks)

    def __enter__(self) -> "Crew":
        """Processes start when there is something for them to do."""
        return self

    def __exit__(self, *_: object) -> None:
        """End the processes of this machine, and leave the cluster."""
        if self._client is not None:
            self._client.close()
        elif self.count > 1:
            # Otherwise they wait for more for some minutes.
            with suppress(Exception):
                joblib.externals.loky.get_reusable_executor().shutdown(wait=False, kill_workers=True)


def _dask_client(address: str) -> Any:
    try:
        client = import_module("distributed").Client
    except ImportError as error:
        raise JobsError(f'jobs = {address}: Dask is not installed; pip install "flexfmu[cluster]"') from error
    try:
        return client(address, timeout="5s")
    except (OSError, ValueError) as error:
        raise JobsError(f"jobs = {address}: no Dask scheduler answers there ({error})") from error
