"""A body and what loads it, as a deck and as the shortest body file; conditions on where its nodes are."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from demo.mesh_tools import STEEL, BrickMesh, Material
from numpy.typing import NDArray

from benchmarks.defaults.shapes import FloatArray

Where = Callable[[FloatArray], NDArray[np.bool_]]
"""A condition on points (n, 3)."""
Loads = Mapping[str, tuple[float, float, float]]
"""Force on interfaces by name, N."""


@dataclass(frozen=True)
class Body:
    """A body and what loads it.

    Attributes
    ----------
    name : str
    mesh : BrickMesh
    supports : Where
        Nodes that are held in all directions.
    interfaces : mapping of str to Where
    cases : mapping of str to Loads
        Full loads.
    material : Material
    inlay : tuple of Material and Where, optional
        Another material, where elements' centres meet a condition.
    guides : mapping of str to Where
        Nodes that are held along x, y or z alone.
    shares : tuple of float
        Of the full loads, growing.
    frames : int
        That the body file asks for; 0: none, as in the shortest body file.
    own : str
        Deck for flexfmu with the same sets, where `mesh` is the reference's alone.
    free : bool
        That nothing holds the body; supports are the reference's, and loads are in balance.
    """

    name: str
    mesh: BrickMesh
    supports: Where
    interfaces: Mapping[str, Where]
    cases: Mapping[str, Loads]
    material: Material = STEEL
    inlay: tuple[Material, Where] | None = None
    guides: Mapping[str, Where] = field(default_factory=dict)
    shares: tuple[float, ...] = (0.1, 0.4, 1.0)
    frames: int = 0
    own: str = ""
    free: bool = False
    sets: dict[str, NDArray[np.int64]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        chosen = {"HELD": self.supports} | {name.upper(): where for name, where in self.interfaces.items()}
        chosen |= {f"GUIDE_{axis.upper()}": where for axis, where in self.guides.items()}
        self.sets.update({name: np.flatnonzero(where(self.mesh.points)) for name, where in chosen.items()})

    def deck(self) -> str:
        """Model deck for CalculiX and flexfmu: nodes, elements, sets, materials."""
        out = ["*NODE", *(f"{i}, {x:.10g}, {y:.10g}, {z:.10g}" for i, (x, y, z) in enumerate(self.mesh.points, 1))]
        kind = {10: "C3D10", 15: "C3D15", 20: "C3D20R"}[self.mesh.bricks.shape[1]]
        other = np.zeros(len(self.mesh.bricks), dtype=bool)
        if self.inlay is not None:
            other = self.inlay[1](self.mesh.centres())
        for material, chosen in ((self.material, ~other), *([(self.inlay[0], other)] if self.inlay else [])):
            out.append(f"*ELEMENT, TYPE={kind}, ELSET=E_{material.name}")
            for i in np.flatnonzero(chosen):
                words = [str(number) for number in (i + 1, *(self.mesh.bricks[i] + 1))]
                out += [", ".join(words[:16]) + ("," if len(words) > 16 else "")]
                out += [", ".join(words[16:])] if len(words) > 16 else []
            out += [f"*MATERIAL, NAME={material.name}", "*ELASTIC"]
            out += [f"{material.youngs_modulus:.6g}, {material.poisson_ratio:.6g}", "*DENSITY"]
            out += [f"{material.density:.6g}", f"*SOLID SECTION, ELSET=E_{material.name}, MATERIAL={material.name}"]
        for name, nodes in self.sets.items():
            out += [f"*NSET, NSET={name}", *(", ".join(map(str, row)) + "," for row in _rows(nodes + 1))]
        return "\n".join(out) + "\n"

    def digest(self, case: str) -> str:
        """Short hash of the deck and a case's loads, to tell results of others; of places to a millionth of the size.

        Round-off is another on other processors. The offset keeps round numbers away from where it would count.
        """
        deck, size = self.deck(), np.ptp(self.mesh.points, axis=0).max()
        places = np.floor(1e6 / size * self.mesh.points + 0.237).astype("<i8")
        text = deck[deck.index("*ELEMENT") :] + repr(sorted(self.cases[case].items()))
        return hashlib.sha256(places.tobytes() + text.encode()).hexdigest()[:12]

    def write(self, folder: Path) -> Path:
        """Write the deck and the shortest body file, or one with frames; its path."""
        (folder / f"{self.name}.inp").write_text(self.own or self.deck(), encoding="ascii")
        text = [f'name = "{self.name}"', *([f"frames = {self.frames}"] if self.frames else [])]
        text += ["[mesh]", f'file = "{self.name}.inp"']
        held = ["[[support]]", 'nodes = "HELD"', 'fix = ["x", "y", "z"]']
        text = ["free = true", *text, "[damping]", "ratio = 0.5"] if self.free else [*text, *held]
        for axis in self.guides:
            text += ["[[support]]", f'nodes = "GUIDE_{axis.upper()}"', f'fix = ["{axis}"]']
        for name in self.interfaces:
            text += ["[[interface]]", f'name = "{name}"', f'nodes = "{name.upper()}"']
        path = folder / f"{self.name}.toml"
        path.write_text("\n".join(text) + "\n", encoding="utf-8")
        return path


def _rows(numbers: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    return np.split(numbers, range(15, numbers.size, 15))


def near(axis: int, value: float) -> Where:
    """Points at a value along an axis."""
    return lambda p: np.isclose(p[:, axis], value, atol=1e-7)


def above(axis: int, value: float) -> Where:
    """Points above a value along an axis."""
    return lambda p: p[:, axis] > value


def below(axis: int, value: float) -> Where:
    """Points below a value along an axis."""
    return lambda p: p[:, axis] < value


def reach(radius: float) -> Where:
    """Points on a cylinder about z."""
    return lambda p: np.isclose(np.hypot(p[:, 0], p[:, 1]), radius, atol=1e-7)


def about(axis: int, values: FloatArray | Sequence[float], half: float) -> Where:
    """Points within a distance of any of some values along an axis."""
    return lambda p: np.min(abs(p[:, axis : axis + 1] - np.asarray(values)), axis=1) < half


def both(*wheres: Where) -> Where:
    """Points that meet all conditions."""
    return lambda p: np.all([where(p) for where in wheres], axis=0)


def either(*wheres: Where) -> Where:
    """Points that meet any condition."""
    return lambda p: np.any([where(p) for where in wheres], axis=0)


def outside(axis: int, half: float) -> Where:
    """Points farther than a distance from zero along an axis."""
    return lambda p: abs(p[:, axis]) > half


def section_at(way: FloatArray) -> Where:
    """Points of the section at the first of two places of a path, within 30 mm of it."""
    at, normal = way[0], (way[1] - way[0]) / np.linalg.norm(way[1] - way[0])
    return lambda p: (abs((p - at) @ normal) < 1e-6) & (np.linalg.norm(p - at, axis=1) < 0.03)


def end(mesh: BrickMesh, across: tuple[int, int], last: bool) -> Where:
    """The first or last section of a bar whose mesh is a mapped box: nodes are numbered section by section."""
    a, b = across
    count = (2 * a + 1) * (2 * b + 1) - a * b
    chosen = np.zeros(len(mesh.points), dtype=bool)
    chosen[-count:] = last
    chosen[:count] |= not last
    return lambda _: chosen
