"""Equilibria under loads of growing size, method by method: what the maps of buckling and rotation have in common."""

import time
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...body.flexible_body import FlexibleBody
from ...body.loads import Loads
from ...files.array_types import FloatArray
from ...model.errors import RuntimeBodyError
from ...model.methods import Method, Variant, lean
from ...program.variables import METHOD
from ..scenes.map_config import Map
from .records import Run, verdict
from .slave import Aboard, Told
from .subject import Subject, Task

Truth = Mapping[float, FloatArray | None]
"""Displacement (3,) of the interface, m, by place on the axis; None where there is no equilibrium."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of a map that one reduction of the body serves.

    Attributes
    ----------
    methods : tuple of (str, Method)
        Label and method of each.
    changes : dict of str to object
        What the reduction changes; see `Subject.reduced`.
    """

    methods: tuple[tuple[str, Method], ...]
    changes: dict[str, object]


@dataclass(frozen=True, slots=True)
class StaticMap:
    """A map of equilibria.

    Attributes
    ----------
    kind : Map
    panel : str
    measure : str
        Variable of the FMU that is recorded.
    places : tuple of float
        Along the axis.
    rows : tuple of Rows
    alone : bool
        Whether each method runs in an FMU that holds no other.
    """

    kind: Map
    panel: str
    measure: str
    places: tuple[float, ...]
    rows: tuple[Rows, ...]
    alone: bool

    def blank(self, subject: Subject, rows: Rows) -> list[Run]:
        """Runs of some rows, of which nothing is known yet."""
        return [
            subject.blank(self.kind, self.panel, f"{place:g}", label)
            for label, _ in rows.methods
            for place in self.places
        ]

    def planned(self, subject: Subject) -> list[Run]:
        """Runs of the whole map, of which nothing is known yet."""
        return [run for rows in self.rows for run in self.blank(subject, rows)]

    def tasks(
        self,
        subject: Subject,
        done: Container[object],
        loads: Callable[[FlexibleBody, int], Mapping[float, FloatArray]],
    ) -> list[Task]:
        """What is not done, a task for each reduction.

        Parameters
        ----------
        subject : Subject
        done : container of keys
        loads : callable
            Takes the finest body and the place of the interface that is read; returns loads (L,) by place on the axis.

        Returns
        -------
        list of Task
        """
        left = [(rows, [run for run in self.blank(subject, rows) if run.key not in done]) for rows in self.rows]
        finest = subject.reference()
        reader = subject.interface(finest.model)
        inputs = loads(finest, reader)
        truth = {place: _equilibrium(finest, inputs[place], reader) for place in self.places}
        return [
            partial(_run_rows, subject.silent(), self, rows, runs, inputs, truth, reader) for rows, runs in left if runs
        ]


def _equilibrium(model: FlexibleBody, inputs: FloatArray, reader: int) -> FloatArray | None:
    """Displacement (3,) of an interface, m; None where there is no equilibrium."""
    try:
        state = model.static(Loads.unpacked(inputs, model.model.interface_count))
    except RuntimeBodyError:
        return None
    displacement: FloatArray = model.response(state).displacement[reader]
    return displacement


def _run_rows(
    subject: Subject,
    static: StaticMap,
    rows: Rows,
    runs: Sequence[Run],
    inputs: Mapping[float, FloatArray],
    truth: Truth,
    reader: int,
) -> tuple[list[Run], list[str]]:
    body = subject.reduced(**rows.changes)
    found = []
    for label, method in rows.methods:
        own = [run for run in runs if run.y == label]
        parameters = {"initialization": "static"} | ({} if static.alone else {METHOD: method.value})
        with Aboard(lean(body, Variant(method)) if static.alone else body) as aboard:
            for run in own:
                start, place = time.perf_counter(), float(run.x)
                told = Told(aboard, parameters, inputs[place])
                error = measure = float("nan")
                expected = truth[place]
                if not told.refused:
                    measure = told.real(static.measure)
                    if expected is not None:
                        error = float(np.linalg.norm(told.motion()[reader, 0] - expected) / np.linalg.norm(expected))
                name = verdict(error, told.warned, told.refused, subject.table.tolerance).value
                seconds = time.perf_counter() - start
                found.append(
                    replace(run, verdict=name, error=error, measure=measure, taken=1, seconds=seconds, words=told.words)
                )
    return found, subject.quiet.warnings
