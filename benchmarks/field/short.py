"""Published static problems with the shortest body file: bodies and CalculiX's results are those of `defaults`."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.defaults import published
from benchmarks.defaults.body import Body
from benchmarks.defaults.measure import reference
from benchmarks.field.records import Record, linear_cost, median_time
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.basics import EquilibriumError
from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Method

FloatArray = NDArray[np.float64]
Sizes = Mapping[str, tuple[float, ...]]

# Tip under 4 MN, m (Wang et al.); inner and outer end of the lip, by share of the load (Sze, Liu, Lo).
TWISTED = {"1.0": (-1.132727, -1.715123, -3.578671)}
ANNULUS = {"0.1": (4.277, 5.876), "0.3": (8.340, 11.213), "0.5": (10.468, 13.768), "1.0": (13.891, 17.528)}
SZE = "Sze, Liu, Lo, Finite Elem. Anal. Des. 40 (2004) 1551"


def records_of(
    body: Body, problem: str, source: str, words: str, values: Callable[[FloatArray], FloatArray], known: Sizes
) -> list[Record]:
    """Records of a body with one interface and one case, at each share of its load.

    Parameters
    ----------
    body : Body
    problem, source, words : str
    values : callable
        What is compared, from displacement and rotation vector (6,).
    known : mapping of str to tuple of float
        Published values by share.
    """
    with tempfile.TemporaryDirectory() as top:
        default = FlexibleBody(reduce_body(read_body_file(body.write(Path(top))), Reporter()))
    models = {"linear": FlexibleBody(default.model, Method.LINEAR), "default": default}
    loads, records = next(iter(body.cases.values())), []
    for (_, share), (expected,) in reference(body).items():
        part = {name: [float(share) * one for one in force] for name, force in loads.items()}
        base = linear_cost(default, part)
        for name, model in models.items():
            ours, cost = (), 0.0
            try:
                ours = tuple(map(float, values(model.motion(model.static(part)))))
                cost = median_time(partial(model.static, part))
            except EquilibriumError:
                pass
            calculix = tuple(map(float, values(expected)))
            quantity = f"{words} at {float(share):g} of the load"
            records.append(
                Record(problem, source, quantity, name, ours, known.get(share, ()), calculix, cost, cost / base)
            )
    return records


def twisted_records() -> list[Record]:
    """A cantilever twisted by 90 degrees."""
    body, words = published.twisted_cantilever(), "displacement of the tip, m"
    return records_of(body, "Twisted cantilever", "Wang et al. (2017)", words, lambda m: m[:3], TWISTED)


def annulus_records() -> list[Record]:
    """A slit annular plate whose lip is lifted."""

    def ends(motion: FloatArray) -> FloatArray:
        turn = Rotation.from_rotvec(motion[3:]).as_matrix()
        return np.array([motion[2] + turn[2] @ [arm, 0.0, 0.0] for arm in (-2.0, 2.0)])

    body, words = published.slit_annulus(), "inner and outer end of the lip"
    return records_of(body, "Slit annulus", SZE, words, ends, ANNULUS)


def half_cylinder_records() -> list[Record]:
    """A half-cylinder held at one end and pinched at the other."""
    body, words = published.half_cylinder(), "displacement under the load, m"
    return records_of(body, "Pinched half-cylinder", f"body of {SZE}", words, lambda m: m[2:3], {})
