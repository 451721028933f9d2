"""The one place where reduced bodies are made: of their motion, of parts beside it, and of how they will be used."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from ..files.array_types import FloatArray, IntArray
from ..files.errors import BodyFileError
from ..model.inertia import LumpedMass
from ..model.membrane import Membrane
from ..model.methods import Method, Variant
from ..model.reduced_body import GROUND, Masses, ReducedBody, SecondOrder, StressSet, Surface, Ties, WholeFrame
from .interfaces import InterfaceFit
from .options import BodyUse
from .subdomains import FrameOperators, Subdomain


@dataclass(frozen=True, slots=True)
class Motion:
    """How interfaces and frames move with m modal coordinates; arrays as of `ReducedBody`."""

    angular_frequency: FloatArray
    interface_names: tuple[str, ...]
    interface_point: FloatArray
    interface_displacement: FloatArray
    interface_rotation: FloatArray
    interface_frame: IntArray
    frame_names: tuple[str, ...]
    frame_parent: IntArray
    joint_point: FloatArray
    joint_displacement: FloatArray
    joint_rotation: FloatArray
    frame_rotation: FloatArray
    floating: bool = False

    @classmethod
    def of_tree(
        cls,
        angular_frequency: FloatArray,
        shapes: FloatArray,
        interfaces: Sequence[InterfaceFit],
        subdomains: Sequence[Subdomain],
        frames: FrameOperators,
    ) -> "Motion":
        """Motion by mode shapes (3n, m)."""
        moved = np.array([interface.motion(shapes) for interface in interfaces])
        return cls(
            angular_frequency,
            tuple(interface.name for interface in interfaces),
            np.array([interface.point for interface in interfaces]),
            moved[:, :3],
            moved[:, 3:],
            np.array([interface.frame for interface in interfaces]),
            tuple(domain.name for domain in subdomains),
            np.array([domain.parent for domain in subdomains], dtype=np.int64),
            np.array([domain.joint_point for domain in subdomains]),
            frames.joint_displacement,
            frames.joint_rotation,
            frames.frame_rotation,
            any(domain.floating for domain in subdomains),
        )

    @classmethod
    def of_interfaces(
        cls, angular_frequency: FloatArray, points: Mapping[str, Sequence[float] | FloatArray], moved: FloatArray
    ) -> "Motion":
        """Motion (I, 6, m) of interfaces alone, at points (3,), m, by their names."""
        count, none = angular_frequency.size, np.zeros(0, dtype=np.int64)
        empty = np.zeros((0, 3, count))
        places = np.array([list(point) for point in points.values()], dtype=float)
        ground = np.full(len(points), GROUND)
        return cls(
            angular_frequency, tuple(points), places, moved[:, :3], moved[:, 3:], ground, (), none, np.zeros((0, 3)),
            empty, empty, empty,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Parts:
    """What a reduced body may hold beside its motion; as of `ReducedBody`."""

    watched_frame: IntArray | None = None
    watched_rotation: FloatArray | None = None
    watched_strain: FloatArray | None = None
    frequency_spread: FloatArray | None = None
    damper: FloatArray | None = None
    root_interface: int = GROUND
    whole: WholeFrame | None = None
    masses: Masses | None = None
    stress_sets: tuple[StressSet, ...] = ()
    stiffness_by_load: FloatArray | None = None
    stiffness_by_mode: FloatArray | None = None
    inertia: LumpedMass | None = None
    surface: Surface | None = None
    ties: Ties | None = None
    second: SecondOrder | None = None
    membrane: Membrane | None = None


NO_PARTS = Parts()


def made_body(motion: Motion, use: BodyUse, parts: Parts = NO_PARTS) -> ReducedBody:
    """Make a reduced body.

    Parameters
    ----------
    motion : Motion
    use : BodyUse
    parts : Parts

    Returns
    -------
    ReducedBody

    Raises
    ------
    BodyFileError
        Damping ratios that are not one a mode.
    """
    given = {entry.name: getattr(part, entry.name) for part in (motion, parts) for entry in fields(part)}
    return used_body(ReducedBody(name=use.name, damping_ratio=np.zeros(motion.angular_frequency.size), **given), use)


def used_body(body: ReducedBody, use: BodyUse) -> ReducedBody:
    """The body with another use; parameters as of `made_body`."""
    return replace(
        body,
        name=use.name,
        damping_ratio=_damping(use.damping, body.mode_count, body.rigid_count),
        method=use.variant.method,
        mass=use.variant.mass,
        velocity_outputs=use.velocities,
        compliance_interfaces=use.compliance,
        following_interfaces=use.follows,
        provenance=dict(use.provenance),
        properties=use.properties,
    )


def linear_use(name: str, damping: float | FloatArray, provenance: Mapping[str, str]) -> BodyUse:
    """Use of a body that knows method "linear" only."""
    return BodyUse(name, damping, Variant(Method.LINEAR), provenance=provenance)


def _damping(ratio: float | Sequence[float] | FloatArray, count: int, rigid: int) -> FloatArray:
    """Damping ratios (m,); a list for elastic modes alone leaves rigid motions without."""
    values = np.asarray(ratio, dtype=np.float64)
    if values.ndim and values.size == count - rigid:
        values = np.concatenate([np.zeros(rigid), values])
    if values.ndim and values.size != count:
        raise BodyFileError(
            f"damping.ratio lists {values.size} values, and the basis has {count - rigid} elastic modes, interface "
            "modes and static shapes included"
        )
    return np.broadcast_to(values, (count,))
