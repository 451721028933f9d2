"""What a script says of a body, as a body file would say it: nodes, supports, interfaces, material."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..files.basics import BodyFileError, FloatArray, IntArray, UnitSystem
from ..files.outputs import fields_of
from ..files.toml_files import validated
from ..mesh.model import Mesh
from .config import BodySpec

Nodes = str | Mapping[str, Any] | Sequence[int] | IntArray | Callable[[FloatArray], Any]
"""A node set's name, a place as a body file has it, rows of the mesh's points, a mask of them, or a function from
the points (n, 3), in the mesh's units, to such a mask."""


@dataclass(frozen=True, slots=True)
class Support:
    """Translations held at zero, or springs to the ground.

    Attributes
    ----------
    nodes : Nodes
    fix : str
        Of "x", "y", "z", those held.
    stiffness : 3 float, optional
        Of springs instead, shared equally by the nodes, N/m.
    rotational_stiffness : 3 float, optional
        N m/rad; makes a bushing, which acts on the nodes' averaged motion.
    damping, rotational_damping : 3 float, optional
        Of dampers beside the springs, N s/m and N m s/rad; the latter makes a bushing, too.
    axes : 2 vectors, optional
        Of the bushing: its x, and a vector in the plane of its x and y; default: the body's.
    """

    nodes: Nodes
    fix: str = "xyz"
    stiffness: Sequence[float] | None = None
    rotational_stiffness: Sequence[float] | None = None
    damping: Sequence[float] | None = None
    rotational_damping: Sequence[float] | None = None
    axes: Sequence[Sequence[float]] | None = None


@dataclass(frozen=True, slots=True)
class Interface:
    """Where loads come in and motion goes out.

    Attributes
    ----------
    nodes : Nodes
    point : 3 float, optional
        Reference point, in the mesh's units; default: the nodes' weighted centre.
    weights : str
        "area", "node" or "auto".
    rigid : bool, optional
        Whether its nodes move as one rigid body; default: as the mesh says.
    compliance : bool
        Whether the FMU offers the interface's compliance over a step.
    follows : bool
        Whether force and moment turn with the interface.
    """

    nodes: Nodes
    point: Sequence[float] | None = None
    weights: str = "auto"
    rigid: bool | None = None
    compliance: bool = False
    follows: bool = False


class NodeChoices:
    """A mesh to which choices of nodes are added as named sets."""

    def __init__(self, mesh: Mesh, units: UnitSystem):
        self.mesh = mesh
        self._units = units

    def name(self, nodes: Nodes, title: str) -> Any:
        """What a body file would say of these nodes."""
        if isinstance(nodes, str):
            return nodes
        if isinstance(nodes, Mapping):
            return plain(nodes)
        count = len(self.mesh.points)
        chosen = np.asarray(nodes(self.mesh.points / self._units.length) if callable(nodes) else nodes)
        if chosen.dtype == bool and chosen.shape == (count,):
            rows = np.flatnonzero(chosen)
        elif chosen.ndim == 1 and np.issubdtype(chosen.dtype, np.integer) and not callable(nodes):
            rows = np.unique(chosen).astype(np.int64)
        else:
            found = f"nodes of {title} are an array of shape {chosen.shape} and type {chosen.dtype}"
            expected = f"a set's name, rows of the mesh's points, or a mask ({count},) of them"
            raise BodyFileError(f"{found}, expected {expected}")
        if rows.size and not 0 <= rows[0] <= rows[-1] < count:
            raise BodyFileError(f"nodes of {title} run from {rows[0]} to {rows[-1]}, expected 0 to {count - 1}")
        self.mesh = replace(self.mesh, node_sets={**self.mesh.node_sets, title: rows})
        return title

    def tables(
        self, supports: Sequence[Support | Nodes], interfaces: Mapping[str, Interface | Nodes]
    ) -> dict[str, list[dict[str, Any]]]:
        """The tables `[[support]]` and `[[interface]]`; nodes become sets of the mesh where they are none."""
        held = [one if isinstance(one, Support) else Support(one) for one in supports]
        moved = {key: one if isinstance(one, Interface) else Interface(one) for key, one in interfaces.items()}
        told = [self._told(one, f"support {k}") | {"fix": list(one.fix)} for k, one in enumerate(held, start=1)]
        # Springs or dampers hold it instead.
        firm = [{key: table[key] for key in table if key != "fix" or len(table) == 2} for table in told]
        return {
            "support": firm,
            "interface": [self._told(one, f"interface {key}") | {"name": key} for key, one in moved.items()],
        }

    def _told(self, given: Support | Interface, title: str) -> dict[str, Any]:
        found = {key: plain(value) for key, value in fields_of(given).items() if value is not None}
        return found | {"nodes": self.name(given.nodes, title)}


def material_table(given: Sequence[float] | Mapping[str, float]) -> dict[str, Any]:
    """The table `[material]`."""
    if isinstance(given, Mapping):
        return dict(plain(given))
    keys = ("youngs_modulus", "poissons_ratio", "density")
    if len(given) != len(keys):
        raise BodyFileError(f"material is {given!r}, expected three numbers: {', '.join(keys)}")
    return dict(zip(keys, plain(given), strict=True))


def plain(value: Any) -> Any:
    """The same as numbers, lists and dicts of Python, as a TOML file would give them."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: plain(one) for key, one in value.items()}
    return [plain(one) for one in value] if isinstance(value, list | tuple | range) else value


def checked_spec(data: dict[str, Any]) -> BodySpec:
    """Specification of what a body file would hold; BodyFileError with every wrong key at once."""
    return validated(BodySpec, data, BodyFileError, "docs/python.md")
