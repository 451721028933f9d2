"""The one place where reduced bodies are made: of their motion, of parts beside it, and of how they will be used."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from ..files.basics import BodyFileError, FloatArray
from ..model.methods import Method, Variant
from ..model.reduced_body import GROUND, ReducedBody
from .interfaces import InterfaceFit
from .options import BodyUse
from .subdomains import FrameOperators, Subdomain


def motion_of_tree(
    angular_frequency: FloatArray,
    shapes: FloatArray,
    interfaces: Sequence[InterfaceFit],
    subdomains: Sequence[Subdomain],
    frames: FrameOperators,
) -> dict[str, Any]:
    """How interfaces and frames move with mode shapes (3n, m): fields of `ReducedBody` by name."""
    moved = np.array([interface.motion(shapes) for interface in interfaces])
    return {
        "angular_frequency": angular_frequency,
        "interface_names": tuple(interface.name for interface in interfaces),
        "interface_point": np.array([interface.point for interface in interfaces]),
        "interface_displacement": moved[:, :3],
        "interface_rotation": moved[:, 3:],
        "interface_frame": np.array([interface.frame for interface in interfaces]),
        "frame_names": tuple(domain.name for domain in subdomains),
        "frame_parent": np.array([domain.parent for domain in subdomains], dtype=np.int64),
        "joint_point": np.array([domain.joint_point for domain in subdomains]),
        **{field.name: getattr(frames, field.name) for field in fields(frames)},
        "floating": any(domain.floating for domain in subdomains),
    }


def motion_of_interfaces(
    angular_frequency: FloatArray, points: Mapping[str, Sequence[float] | FloatArray], moved: FloatArray
) -> dict[str, Any]:
    """Motion (I, 6, m) of interfaces alone, at points (3,), m, by their names; as of `motion_of_tree`."""
    empty = np.zeros((0, 3, angular_frequency.size))
    return {
        "angular_frequency": angular_frequency,
        "interface_names": tuple(points),
        "interface_point": np.array([list(point) for point in points.values()], dtype=float),
        "interface_displacement": moved[:, :3],
        "interface_rotation": moved[:, 3:],
        "interface_frame": np.full(len(points), GROUND),
        **dict.fromkeys(("joint_displacement", "joint_rotation", "frame_rotation"), empty),
    }


def made_body(use: BodyUse, **given: Any) -> ReducedBody:
    """Make a reduced body.

    Parameters
    ----------
    use : BodyUse
    **given : object
        Its motion, and what it holds beside it: fields of `ReducedBody`.

    Returns
    -------
    ReducedBody

    Raises
    ------
    BodyFileError
        Damping ratios that are not one a mode.
    """
    return used_body(ReducedBody(name=use.name, damping_ratio=np.zeros(given["angular_frequency"].size), **given), use)


def used_body(body: ReducedBody, use: BodyUse) -> ReducedBody:
    """The body with another use; parameters as of `made_body`."""
    return replace(
        body,
        name=use.name,
        damping_ratio=_damping(use.damping, body.angular_frequency, body.rigid_count),
        method=use.variant.method,
        mass=use.variant.mass,
        velocity_outputs=use.velocities,
        compliance_interfaces=use.compliance,
        following_interfaces=use.follows,
        tolerance=use.tolerance,
        provenance=dict(use.provenance),
        properties=use.properties,
    )


def linear_use(name: str, damping: float | FloatArray, provenance: Mapping[str, str]) -> BodyUse:
    """Use of a body that knows method "linear" only."""
    return BodyUse(name, damping, Variant(Method.LINEAR), provenance=provenance)


def _damping(ratio: float | Sequence[float] | FloatArray, angular_frequency: FloatArray, rigid: int) -> FloatArray:
    """Damping ratios (m,), as of `BodyUse`; a list for elastic modes alone leaves rigid motions without."""
    values, count = np.asarray(ratio, dtype=np.float64), angular_frequency.size
    if values.ndim == 2:
        values = np.interp(angular_frequency[rigid:] / (2.0 * np.pi), *values.T)
    if values.ndim and values.size == count - rigid:
        values = np.concatenate([np.zeros(rigid), values])
    if values.ndim and values.size != count:
        raise BodyFileError(
            f"damping.ratio lists {values.size} values, and the basis has {count - rigid} elastic modes, interface "
            "modes and static shapes included"
        )
    return np.broadcast_to(values, (count,))
