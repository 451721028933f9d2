"""Modes that another program found: what they are, the files that hold them, and whether they can be true."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.sparse as sp

from ..fe.assembly import mass as mass_matrix
from ..files.basics import FlexfmuError, FloatArray, IntArray, UnitSystem, listed
from ..files.outputs import check_target, whole_file
from ..files.tables import Kind, check_input
from ..mesh.checks import DENSITY_RANGE, SIZE_RANGE, checked
from ..mesh.model import NO_MATERIAL, Material, Mesh
from ..reduction.model import elements_without_material, rigid_basis

SUFFIXES = (".npz", ".h5")
# Relative size of a mode at a node below which it is zero: the node is held.
_HELD = 1e-9


class GivenModesError(FlexfmuError):
    """Modes, masses or sets that do not belong together."""


@dataclass(frozen=True, slots=True, repr=False)
class GivenModes:
    """Modes of a body that was reduced elsewhere, in one consistent system of units.

    Attributes
    ----------
    nodes : (n, 3) float
        Undeformed places.
    modes : (m, n, 3) float
        Displacements; of any size, see `mass`.
    frequency : (m,) float
        Hz; zero, or nearly so, for rigid motions.
    mass : (n,) float, or sparse (n, n) or (3n, 3n)
        Lumped, consistent and the same in all directions, or consistent with node by node x, y, z. Modal masses are
        made one by it.
    sets : mapping of str to (k,) int
        Rows of `nodes`.
    cells : mapping of str to (k, nodes) int, optional
        Rows of `nodes` by meshio's names of kinds. With them the body divides into frames by itself, and interfaces
        weigh by area.
    damping : (m,) float, optional
        Modal damping ratios.
    units : UnitSystem
    name : str
    """

    nodes: FloatArray
    modes: FloatArray
    frequency: FloatArray
    mass: Any
    sets: Mapping[str, IntArray] = field(default_factory=dict)
    cells: Mapping[str, IntArray] = field(default_factory=dict)
    damping: FloatArray | None = None
    units: UnitSystem = UnitSystem.SI
    name: str = "body"

    def __post_init__(self) -> None:
        """Check shapes, finiteness and numbers of nodes."""
        nodes, modes, frequency = (np.asarray(v, dtype=float) for v in (self.nodes, self.modes, self.frequency))
        count, number = len(nodes), len(modes)
        _expect("nodes", nodes, (count, 3))
        _expect("modes", modes, (number, count, 3))
        _expect("frequency", frequency, (number,))
        if not number or not count:
            raise GivenModesError(f"{number} modes of {count} nodes, expected at least one mode and one node")
        mass = sp.csr_array(self.mass) if sp.issparse(self.mass) else np.asarray(self.mass, dtype=float)
        if mass.shape not in ((count,), (count, count), (3 * count, 3 * count)):
            fault = f"mass has shape {mass.shape}, expected ({count},) for lumped masses"
            raise GivenModesError(f"{fault}, or a sparse matrix ({count}, {count}) or ({3 * count}, {3 * count})")
        values = mass.data if sp.issparse(mass) else mass
        if not np.isfinite(values).all() or np.any((mass if mass.ndim == 1 else mass.diagonal()) < 0.0):
            raise GivenModesError("mass holds values that are not finite, or negative masses of nodes")
        if np.any(frequency < 0.0):
            raise GivenModesError("frequency holds negative values, expected Hz, zero for rigid motions")
        sets = {name: np.unique(np.asarray(rows)).astype(np.int64) for name, rows in dict(self.sets).items()}
        cells = {kind: np.asarray(rows, dtype=np.int64) for kind, rows in dict(self.cells).items()}
        named = [(f"set {k!r}", v) for k, v in sets.items()] + [(f"cells {k!r}", v) for k, v in cells.items()]
        for title, rows in named:
            if rows.size and not 0 <= rows.min() <= rows.max() < count:
                found = f"{title} has rows {rows.min()} to {rows.max()}, expected 0 to {count - 1}"
                raise GivenModesError(f"{found}: rows of nodes, counted from zero, not the other program's numbers")
        damping = None if self.damping is None else np.asarray(self.damping, dtype=float)
        if damping is not None:
            _expect("damping", damping, (number,))
        order = np.argsort(frequency, kind="stable")
        values_of = {
            "nodes": nodes, "modes": modes[order], "frequency": frequency[order], "mass": mass, "sets": sets,
            "cells": cells, "damping": None if damping is None else damping[order], "units": UnitSystem(self.units),
        }  # fmt: skip
        for key, value in values_of.items():
            object.__setattr__(self, key, value)

    @classmethod
    def of_mesh(cls, mesh: Mesh, labels: Any, modes: Any, frequency: Any, density: float | None = None) -> "GivenModes":
        """Modes of a mesh that flexfmu reads: nodes, cells, sets and the consistent mass are the mesh's.

        Parameters
        ----------
        mesh : Mesh
            In SI units, as `flexfmu.read_mesh` gives it.
        labels : (k,) int
            The other program's numbers of the nodes in `modes`.
        modes : (m, k, 3) float
            Of any size.
        frequency : (m,) float
            Hz.
        density : float, optional
            kg/m³, of elements to which the mesh gives no material.

        Returns
        -------
        GivenModes

        Raises
        ------
        GivenModesError
            Nodes of the mesh that the modes lack, elements without density, shells or beams.
        """
        mesh = checked(mesh)
        if kinds := sorted({block.type.value for block in mesh.blocks if block.type.natural}):
            found = f"the mesh holds {', '.join(kinds)}: nodes of shells and beams turn, which these modes do not tell"
            advice = "give GivenModes their nodes, translations and lumped masses, without cells"
            raise GivenModesError(f"{found}; {advice}")
        order = np.argsort(labels)
        there = order[np.minimum(np.searchsorted(np.asarray(labels)[order], mesh.labels), len(order) - 1)]
        lacking = mesh.labels[np.asarray(labels)[there] != mesh.labels]
        if lacking.size:
            raise GivenModesError(f"the modes lack nodes of the mesh: {listed(lacking)}; write results of all nodes")
        bare = elements_without_material(mesh) or any(np.isnan(material.density) for material in mesh.materials)
        if bare and density is None:
            raise GivenModesError("elements of the mesh have no material: give their density, kg/m³")
        told = [replace(m, density=density or 1.0) if np.isnan(m.density) else m for m in mesh.materials]
        materials = (*told, Material("given", 1.0, 0.0, density or 1.0))
        rows = [np.where(b.material == NO_MATERIAL, len(mesh.materials), b.material) for b in mesh.blocks]
        blocks = tuple(replace(block, material=row) for block, row in zip(mesh.blocks, rows, strict=True))
        mass = mass_matrix(replace(mesh, materials=materials, blocks=blocks))
        cells = [(block.type.shape.name, block.connectivity) for block in mesh.blocks]
        every = {name: np.concatenate([own for kind, own in cells if kind == name]) for name, _ in cells}
        return cls(mesh.points, np.asarray(modes, dtype=float)[:, there], frequency, mass, mesh.node_sets, every)

    def __repr__(self) -> str:
        """Name and size."""
        size = f"{len(self.modes)} modes of {len(self.nodes)} nodes"
        span = f"{self.frequency[0]:.4g} to {self.frequency[-1]:.4g} Hz"
        return f"<GivenModes of {self.name!r}: {size}, {span}; sets {', '.join(self.sets) or 'none'}>"

    def save(self, path: str | Path) -> Path:
        """Write the modes as .npz or .h5 (docs/given-modes.md).

        Parameters
        ----------
        path : path

        Returns
        -------
        Path
        """
        target = Path(path)
        check_target(target, SUFFIXES)
        contents: dict[str, Any] = {"nodes": self.nodes, "modes": self.modes, "frequency": self.frequency}
        if sp.issparse(self.mass):
            entries = self.mass.tocoo()
            contents |= {"mass_row": entries.row, "mass_column": entries.col, "mass_value": entries.data}
            contents["mass_size"] = np.array(entries.shape[0])
        else:
            contents["mass"] = self.mass
        if self.damping is not None:
            contents["damping"] = self.damping
        contents |= {f"set_{name}": rows for name, rows in self.sets.items()}
        contents |= {f"cells_{kind}": rows for kind, rows in self.cells.items()}
        contents |= {"units": np.array(self.units.value), "name": np.array(self.name)}
        with whole_file(target) as part:
            if target.suffix.lower() == ".npz":
                np.savez_compressed(part, **contents)
            else:
                with h5py.File(part, "w") as file:
                    for key, value in contents.items():
                        file[key] = str(value) if value.dtype.kind == "U" else value
        return target

    @property
    def shapes(self) -> FloatArray:
        """Modes (3n, m) as columns."""
        return self.modes.reshape(len(self.modes), -1).T

    @property
    def nodal_mass(self) -> FloatArray:
        """Mass (n,) of each node; of a consistent matrix its diagonal, scaled to the body's mass.

        Sums of rows would be negative at corners of elements of second order.
        """
        if not sp.issparse(self.mass):
            return np.asarray(self.mass)
        directions = self.mass.shape[0] // len(self.nodes)
        diagonal = self.mass.diagonal().reshape(-1, directions).mean(axis=1)
        return diagonal * (self.mass.sum() / directions / diagonal.sum())

    @property
    def held(self) -> IntArray:
        """Nodes (k,) that no mode moves."""
        size = np.abs(self.modes).max(axis=(1, 2), keepdims=True)
        return np.flatnonzero(np.all(np.abs(self.modes) <= _HELD * size, axis=(0, 2)))

    def momentum(self, shapes: FloatArray) -> FloatArray:
        """Mass times shapes (3n, k), (3n, k)."""
        if sp.issparse(self.mass) and self.mass.shape[0] == shapes.shape[0]:
            return np.asarray(self.mass @ shapes)
        nodal = shapes.reshape(len(self.nodes), -1)
        product = self.mass @ nodal if sp.issparse(self.mass) else self.mass[:, None] * nodal
        return np.asarray(product).reshape(shapes.shape)


def _expect(name: str, value: FloatArray, shape: tuple[int, ...]) -> None:
    if value.shape != shape:
        raise GivenModesError(f"{name} has shape {value.shape}, expected {shape}: see docs/given-modes.md")
    if not np.isfinite(value).all():
        raise GivenModesError(f"{name} holds values that are not finite")


def read_given(path: str | Path) -> GivenModes:
    """Read modes from .npz or .h5.

    Parameters
    ----------
    path : path

    Returns
    -------
    GivenModes

    Raises
    ------
    GivenModesError
        The file cannot be read, or lacks something.

    Examples
    --------
    >>> given = flexfmu.read_given("modes.npz")
    >>> given.frequency[:2].round(1)
    array([40.9, 40.9])
    """
    source = Path(path)
    check_input(source, GivenModesError, Kind.MODES, Kind.MODAL)
    try:
        contents = _npz(source) if source.suffix.lower() == ".npz" else _hdf5(source)
    # NumPy, zipfile and h5py raise whatever damaged bytes lead them to.
    except Exception as error:
        raise GivenModesError(f"{source} cannot be read as modes ({error}); see docs/given-modes.md") from error
    missing = [key for key in ("nodes", "modes", "frequency") if key not in contents]
    sparse = ("mass_row", "mass_column", "mass_value", "mass_size")
    if "mass" not in contents and not all(key in contents for key in sparse):
        missing.append("mass")
    if missing:
        there = ", ".join(contents) or "nothing"
        raise GivenModesError(f"{source} lacks {', '.join(missing)}; it holds {there}; see docs/given-modes.md")
    try:
        mass = contents.get("mass")
        if mass is None:
            size = int(contents["mass_size"])
            rows, columns, values = (contents[key] for key in sparse[:3])
            mass = sp.csr_array(sp.coo_array((values, (rows, columns)), shape=(size, size)))
        text = {key: str(contents[key]) for key in ("units", "name") if key in contents}
        sets, cells = ({k[len(p) :]: v for k, v in contents.items() if k.startswith(p)} for p in ("set_", "cells_"))
        first = contents["nodes"], contents["modes"], contents["frequency"]
        rest = contents.get("damping"), UnitSystem(text.get("units", UnitSystem.SI.value))
        return GivenModes(*first, mass, sets, cells, *rest, text.get("name", source.stem))
    except (ValueError, TypeError, GivenModesError) as error:
        raise GivenModesError(f"{source}: {error}") from error


def _npz(path: Path) -> dict[str, Any]:
    # NumPy leaves a damaged file open.
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
        return {key: file[key] for key in file.files}


def _hdf5(path: Path) -> dict[str, Any]:
    with h5py.File(path) as file:
        return {
            key: value.asstr()[()] if h5py.check_string_dtype(value.dtype) else value[()]
            for key, value in file.items()
            if isinstance(value, h5py.Dataset)
        }


# Frequencies below this share of the next are those of rigid motions.
_RIGID_FREQUENCY = 1e-2
# Largest part of a rigid motion that may be none, of a rigid mode's own size.
_NOT_RIGID = 1e-2
# Products of different modes, with modal masses of one: a warning, and what no mass that belongs to the modes has.
_DOUBTFUL, _WRONG = 0.01, 0.1
# Modal masses that count as one already: lumped masses are not those that the modes were normalised with.
_NORMALISED = 0.1
# Product of an elastic mode with a rigid motion below which the body is free, and its rigid motions were left out.
_BALANCED = 0.02
# No solid is faster, m/s: half a wave along the body takes at least its length over this.
_FASTEST = 2.5e4


def rigid_motions(given: GivenModes) -> FloatArray:
    """Rigid motions (3n, 6) of modal masses one, orthogonal to each other."""
    flat = rigid_basis(given.nodes).reshape(-1, 6)
    values, vectors = np.linalg.eigh(flat.T @ given.momentum(flat))
    if values[0] <= 1e-12 * values[-1]:
        raise GivenModesError("the masses lie on a line or in a point: they tell no rotation, expected a body in space")
    return flat @ (vectors / np.sqrt(values))


def checked_modes(given: GivenModes) -> tuple[GivenModes, tuple[str, ...], tuple[str, ...]]:
    """Modes in SI units, with modal masses of one and exact rigid motions.

    Parameters
    ----------
    given : GivenModes

    Returns
    -------
    GivenModes
        Frequencies of rigid motions are zero.
    notes, warnings : tuple of str

    Raises
    ------
    GivenModesError
        The mass does not belong to the modes, or what should be rigid is not.
    """
    units = given.units
    kilograms = units.density * units.length**3
    given = replace(given, nodes=given.nodes * units.length, mass=given.mass * kilograms, units=UnitSystem.SI)
    notes, warnings = [], list(_implausible(given, units))
    shapes = given.shapes
    gram = shapes.T @ given.momentum(shapes)
    modal = np.diagonal(gram).copy()
    warnings += _not_orthogonal(gram, modal)
    if np.any(np.abs(modal - 1.0) > _NORMALISED):
        notes.append(f"modal masses are {modal.min():.4g} to {modal.max():.4g} kg: made one")
        shapes = shapes / np.sqrt(modal)
    frequency, damping = given.frequency.copy(), given.damping
    rigid = _rigid_count(frequency)
    if rigid:
        if rigid != 6 or given.held.size:
            found = f"{rigid} modes below {_RIGID_FREQUENCY:g} of the next frequency are rigid motions"
            raise GivenModesError(f"{found}, expected 6 of a body that nothing holds, or none")
        exact = rigid_motions(given)
        wrong = shapes[:, :6] - exact @ (exact.T @ given.momentum(shapes[:, :6]))
        part = float(np.sqrt(np.abs(np.diagonal(wrong.T @ given.momentum(wrong))).max()))
        if part > _NOT_RIGID:
            found = f"the first 6 modes have almost no frequency and are no rigid motions ({part:.2g} of them is not)"
            raise GivenModesError(f"{found}: the body is a mechanism, or modes and nodes are in different axes")
        shapes = np.hstack([exact, shapes[:, 6:]])
        frequency[:6] = 0.0
    elif not given.held.size:
        exact = rigid_motions(given)
        if np.abs(exact.T @ given.momentum(shapes)).max() < _BALANCED:
            notes.append("nothing holds the body and its rigid motions are not among the modes: added")
            shapes = np.hstack([exact, shapes])
            frequency = np.concatenate([np.zeros(6), frequency])
            damping = None if damping is None else np.concatenate([np.zeros(6), damping])
    modes = shapes.T.reshape(shapes.shape[1], -1, 3)
    return replace(given, modes=modes, frequency=frequency, damping=damping), tuple(notes), tuple(warnings)


def _not_orthogonal(gram: FloatArray, modal: FloatArray) -> list[str]:
    """A warning where modes are not orthogonal by mass; an error where the mass cannot be theirs."""
    if np.any(modal <= 0.0):
        raise GivenModesError(f"mode {int(np.argmin(modal)) + 1} moves no mass: the mass belongs to other nodes")
    product = gram / np.sqrt(np.outer(modal, modal)) - np.eye(len(modal))
    worst = np.unravel_index(int(np.argmax(np.abs(product))), product.shape)
    off = abs(float(product[worst]))
    told = f"modes {worst[0] + 1} and {worst[1] + 1} have the product {off:.2g} by mass, expected 0"
    if off > _WRONG:
        raise GivenModesError(
            f"{told}: the mass is not that of these modes (nodes in another order, a part without its mass, mass of "
            "mid-side nodes left out), or the modes are no eigenmodes"
        )
    if off > _DOUBTFUL:
        return [f"{told}: lumped masses are coarse here; a consistent mass matrix would be exact"]
    return []


def _rigid_count(frequency: FloatArray) -> int:
    """How many of the first frequencies are those of rigid motions."""
    if frequency[-1] == 0.0:
        raise GivenModesError("all frequencies are zero, expected at least one elastic mode, in Hz")
    for count in range(min(6, len(frequency) - 1), 0, -1):
        if frequency[count - 1] <= _RIGID_FREQUENCY * frequency[count]:
            return count
    return 0


def _implausible(given: GivenModes, units: UnitSystem) -> list[str]:
    """What no solid body is likely to be; numbers in SI."""
    found = []
    sides = np.ptp(given.nodes, axis=0)
    size, mass = float(sides.max()), float(given.nodal_mass.sum())
    if not SIZE_RANGE[0] <= size <= SIZE_RANGE[1]:
        found.append(f"the body measures {size:.4g} m")
    if mass > DENSITY_RANGE[1] * float(np.prod(np.maximum(sides, 1e-3 * size))) or mass <= 0.0:
        found.append(f"the body has {mass:.4g} kg within {' × '.join(f'{side:.4g}' for side in sides)} m")
    elastic = given.frequency[given.frequency > 0.0]
    if elastic.size and elastic[0] * size > _FASTEST:
        found.append(f"the first frequency is {elastic[0]:.4g} Hz of a body of {size:.4g} m")
    if math.isnan(mass):
        found.append("the mass is not a number")
    known = ", ".join(f'"{system.value}"' for system in UnitSystem)
    return [f"{text}: implausible. Give the units of the modes (found {units.value}, known: {known})" for text in found]
