"""Loads on a body's interfaces."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..files.basics import FloatArray, LoadError
from ..program.variable_table import ACCELERATION


@dataclass(frozen=True, slots=True)
class Loads:
    """Force and moment at each of I interfaces, fixed in direction.

    Attributes
    ----------
    force : (I, 3) float
        N, global frame.
    moment : (I, 3) float
        N m, about the interface's moving reference point, global axes.
    acceleration : (3,) float
        Of the supports, m/s², global frame.
    """

    force: FloatArray
    moment: FloatArray
    acceleration: FloatArray = field(default_factory=lambda: np.zeros(3))

    def packed(self, with_acceleration: bool) -> FloatArray:
        """Return force and moment of each interface in turn, then the acceleration: (6I,) or (6I + 3,)."""
        wrench = np.concatenate([self.force, self.moment], axis=1).ravel()
        return np.concatenate([wrench, self.acceleration]) if with_acceleration else wrench

    @classmethod
    def unpacked(cls, values: FloatArray, interfaces: int) -> "Loads":
        """Loads of what `packed` gives."""
        wrench = values[: 6 * interfaces].reshape(-1, 2, 3)
        acceleration = values[6 * interfaces :]
        return cls(wrench[:, 0], wrench[:, 1], acceleration if acceleration.size else np.zeros(3))

    def scaled(self, factor: float) -> "Loads":
        """Return the same loads times a factor."""
        return Loads(factor * self.force, factor * self.moment, factor * self.acceleration)


def load_names(interfaces: Sequence[str], accelerated: bool) -> list[str]:
    """Names of loads in the order of `Loads.packed`: a body's are those of its FMU's inputs."""
    wrench = [f"{name}.{kind}.{axis}" for name in interfaces for kind in ("force", "moment") for axis in "xyz"]
    return wrench + [f"{ACCELERATION}.{axis}" for axis in "xyz"] * accelerated


def loads_from_mapping(
    names: tuple[str, ...], loads: Mapping[str, Sequence[float]], acceleration: Sequence[float] = (0.0, 0.0, 0.0)
) -> Loads:
    """Loads from {interface: (fx, fy, fz)} or {interface: (fx, fy, fz, mx, my, mz)}.

    Parameters
    ----------
    names : tuple of str
        The body's interfaces, in order.
    loads : mapping of str to 3 or 6 float
        N and N m, global frame; interfaces left out are free.
    acceleration : 3 float
        Of the supports, m/s².

    Returns
    -------
    Loads

    Raises
    ------
    LoadError
        An unknown interface, a wrong number of components, or a value that is not finite.
    """
    if not isinstance(loads, Mapping):
        raise LoadError(f'loads are {loads!r}, expected them by interface, such as {{"{names[0]}": [0.0, 10.0, 0.0]}}')
    wrench = np.zeros((len(names), 6))
    for name, components in loads.items():
        if name not in names:
            raise LoadError(f"load on interface {name!r}: the body has {', '.join(map(repr, names))}")
        values = np.asarray(components, dtype=np.float64)
        if values.shape not in ((3,), (6,)):
            raise LoadError(f"load on {name!r} has shape {values.shape}: give 3 forces, or 3 forces and 3 moments")
        if not np.all(np.isfinite(values)):
            raise LoadError(f"load on {name!r} is not finite: {values.tolist()}")
        wrench[names.index(name), : values.size] = values
    support = np.array(acceleration, dtype=np.float64)
    if support.shape != (3,) or not np.all(np.isfinite(support)):
        raise LoadError(f"acceleration is {acceleration}: expected three finite numbers")
    return Loads(wrench[:, :3].copy(), wrench[:, 3:].copy(), support)
