"""The shape of a body of which only the motion of its interfaces is known, as in the results of a coupled run."""

from collections.abc import Sequence

import numpy as np

from ..body.flexible_body import FlexibleBody
from ..files.array_types import FloatArray
from ..files.errors import FlexfmuError
from ..files.progress import Reporter

MOTIONS = tuple(f"{quantity}.{axis}" for quantity in ("displacement", "rotation") for axis in "xyz")
# Rounds of Newton's method and relative change at which it has settled; relative step of differences.
_ROUNDS, _SETTLED, _STEP = 30, 1e-9, 1e-6


def motion_columns(body: FlexibleBody, names: Sequence[str]) -> dict[int, int]:
    """Rows of `FlexibleBody.motion` by the columns of a table that hold them, names with or without an instance.

    Raises
    ------
    FlexfmuError
        Several instances have such columns.
    """
    found: dict[int, int] = {}
    instances = set()
    for row, output in enumerate(f"{i}.{motion}" for i in body.model.interface_names for motion in MOTIONS):
        for column, name in enumerate(names):
            if name == output or name.endswith(f".{output}"):
                instances.add(name[: -len(output)])
                found[column] = row
    if len(instances) > 1:
        raise FlexfmuError(f"the table holds motions of {', '.join(sorted(instances))}: keep those of one")
    return found


def shapes_of_least_energy(
    body: FlexibleBody, columns: dict[int, int], values: FloatArray, report: Reporter
) -> list[FloatArray]:
    """Modal coordinates (m,) of least strain energy that move interfaces as given, for each row.

    Parameters
    ----------
    body : FlexibleBody
    columns : dict of int to int
        As of `motion_columns`.
    values : (rows, n) float
        m and rad.
    report : Reporter

    Returns
    -------
    list of (m,) float
    """
    rows, wanted = list(columns.values()), values[:, list(columns)]
    stiffness = body.model.angular_frequency**2
    scale = 1.0 / np.sqrt(np.where(stiffness > 0.0, stiffness, stiffness[stiffness > 0.0].min()))
    q = np.zeros(stiffness.size)
    found, worst = [], 0.0
    with report.counted("Find shapes from the motion of interfaces", len(wanted), "rows") as tell:
        for k, motion in enumerate(wanted):
            for _ in range(_ROUNDS):
                here = body.core.motion(q)[rows]
                step = _newton(body, q, rows, motion - here, stiffness, scale)
                q = q + step
                if np.linalg.norm(step / scale) <= _SETTLED * np.linalg.norm(q / scale):
                    break
            worst = max(worst, float(np.abs(body.core.motion(q)[rows] - motion).max()))
            found.append(q)
            tell(k + 1)
    if worst > 1e-3 * max(float(np.abs(wanted).max()), 1e-12):
        report.warning(f"no shape moves the interfaces as the table says: they are off by up to {worst:.2g}")
    return found


def _newton(
    body: FlexibleBody, q: FloatArray, rows: list[int], missing: FloatArray, stiffness: FloatArray, scale: FloatArray
) -> FloatArray:
    """Change of q towards the least of ½ qᵀΛq with the motion of the rows."""
    jacobian = np.empty((len(rows), q.size))
    for j in range(q.size):
        change = np.zeros_like(q)
        # Coordinates in which the body is as stiff, one as another.
        change[j] = _STEP * scale[j] * max(float(np.linalg.norm(q / scale)), 1e-3 / float(np.linalg.norm(scale)))
        ahead, behind = body.core.motion(q + change)[rows], body.core.motion(q - change)[rows]
        jacobian[:, j] = (ahead - behind) / (2.0 * change[j])
    # With z = q / scale the energy is |z|² but for rigid motions, which cost nothing.
    scaled, elastic = jacobian * scale, stiffness > 0.0
    z = np.where(elastic, q / scale, 0.0)
    weight = np.where(elastic, 1.0, 1e-3)
    # The smallest z + dz with J dz = missing: the part across the null space of J goes away.
    right = missing + scaled @ z
    target = (np.linalg.pinv(scaled / weight, rcond=1e-10) @ right) / weight
    return (target - z) * scale
