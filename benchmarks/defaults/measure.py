"""A body built with the shortest body file beside CalculiX's kept results."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.defaults.body import Body
from benchmarks.defaults.run_calculix import MOTION, RESULTS
from benchmarks.defaults.run_fmu import Built
from benchmarks.defaults.shapes import FloatArray
from benchmarks.records import numbers, read_records

# Seconds in which loads on a free body grow: 50 and more of its slowest periods.
GROWN = 1.0


def reference(body: Body) -> dict[tuple[str, str], FloatArray]:
    """CalculiX's motion (interfaces, 6) by case and share."""
    rows = [row for row in read_records(RESULTS) if row["body"] == body.name and row["case"] in body.cases]
    if any(row["deck"] != body.digest(row["case"]) for row in rows):
        raise ValueError(
            f"{RESULTS.name} has {body.name} with another mesh or load: run benchmarks.defaults.run_calculix"
        )
    found: dict[tuple[str, str], FloatArray] = {}
    for case in body.cases:
        for share in map(str, body.shares):
            here = [row for row in rows if (row["case"], row["share"]) == (case, share)]
            if len(here) == len(body.interfaces):
                found[case, share] = np.stack([numbers(here, column) for column in MOTION], axis=1)
    return found


def seen_from_the_first(motion: FloatArray, places: FloatArray) -> FloatArray:
    """Motion (I, 6) of interfaces at places (I, 3) as the first of them sees it: nothing else says where a body is."""
    turned = Rotation.from_rotvec(motion[:, 3:])
    to = turned[0].inv().apply(places + motion[:, :3] - places[0] - motion[0, :3])
    return np.hstack([to - (places - places[0]), (turned[0].inv() * turned).as_rotvec()])


def measure(body: Body, options: Sequence[str] = (), kept: Path | None = None) -> list[dict[str, object]]:
    """Rows of a body, one a point; FMUs stay in the folder `kept`.

    Errors are over the largest displacement of any interface, and over the largest rotation, or displacement over the
    body's size where that is larger. The estimate is that of the interface with the largest error.
    """
    rows: list[dict[str, object]] = []
    names, size = list(body.interfaces), float(np.ptp(body.mesh.points, axis=0).max())
    with tempfile.TemporaryDirectory() as top, Built(body.write(Path(top)), options, kept) as built:
        for (case, share), expected in reference(body).items():
            loads = {name: tuple(float(share) * one for one in force) for name, force in body.cases[case].items()}
            point = built.point(loads, names, GROWN if body.free else 0.0)
            found = point.motion
            if body.free and not point.refused:
                places = np.stack([body.mesh.points[body.sets[name.upper()]].mean(axis=0) for name in names])
                found, expected = (seen_from_the_first(one, places) for one in (found, expected))
            moved = np.linalg.norm(expected[:, :3], axis=1)
            turned = np.linalg.norm(expected[:, 3:], axis=1)
            scale = float(moved.max()), max(float(turned.max()), float(moved.max()) / size)
            off = np.linalg.norm(found[:, :3] - expected[:, :3], axis=1) / scale[0]
            turn = np.array([np.linalg.norm(one[3:] - two[3:]) for one, two in zip(found, expected, strict=True)])
            worst = int(np.argmax(off))
            rows.append(
                {
                    "body": body.name,
                    "case": case,
                    "share": share,
                    "moved": f"{scale[0] / size:.4g}",
                    "turned": f"{float(turned.max()):.4g}",
                    "displacement_error": f"{off[worst]:.4g}",
                    "rotation_error": f"{float(turn.max()) / scale[1]:.4g}",
                    "estimate": f"{point.estimate[worst, 0] / scale[0]:.4g}",
                    "rotation_estimate": f"{float(point.estimate[:, 1].max()) / scale[1]:.4g}",
                    "log": " | ".join(re.sub(r"\s+", " ", line)[:160] for line in point.log),
                    "build": f"{built.seconds:.3g}",
                }
            )
    return rows
