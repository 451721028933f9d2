"""Beams as bricks between rigid sections: each node has the corners of the sections that meet there, a rigid body.

Sections are area, ∫x₁² dA, ∫x₂² dA, torsion constant and shear areas of the usual shapes.

The brick of a section has its radii of gyration, so that mass and rotary inertia follow as of solids; of a rectangle it
is the beam itself.
"""

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import replace
from functools import cache
from math import pi, tanh
from typing import NamedTuple

import numpy as np

from ..files import sparse as sp
from ..files.basics import BoolArray, FloatArray, IntArray, MeshError, listed
from .elements import ElementBlock
from .equations import RigidLink, Row, matrix_of, merged
from .model import Mesh, hung
from .shapes import BRICK

# Shear area over area: of rectangles and circles by G. R. Cowper, J. Appl. Mech. 33 (1966) 335, without ν; of thin
# walls as Abaqus has it.
_SOLID, _ROUND, _TUBE, _WALLS = 5.0 / 6.0, 6.0 / 7.0, 0.53, 0.44


class CrossSection(NamedTuple):
    """A section in axes that need not be its principal ones.

    Attributes
    ----------
    constants : tuple of float
        Area, ∫x₁² dA, ∫x₂² dA about the centroid, torsion constant, shear areas along both axes.
    mixed : float
        ∫x₁ x₂ dA about the centroid.
    centroid, shear_centre : (2,) float
    """

    constants: tuple[float, ...]
    mixed: float = 0.0
    centroid: tuple[float, float] = (0.0, 0.0)
    shear_centre: tuple[float, float] = (0.0, 0.0)

    @property
    def transposed(self) -> "CrossSection":
        """The section whose second axis is the first one of this."""
        area, first, second, torsion, one, other = self.constants
        constants = area, second, first, torsion, other, one
        return CrossSection(constants, self.mixed, self.centroid[::-1], self.shear_centre[::-1])

    def scaled(self, length: float) -> "CrossSection":
        """The section whose numbers are in another unit of length."""
        powers = np.array([2, 4, 4, 4, 2, 2])
        places = [(place[0] * length, place[1] * length) for place in (self.centroid, self.shear_centre)]
        constants = tuple((np.array(self.constants) * length**powers).tolist())
        return CrossSection(constants, self.mixed * length**4, *places)


def rectangle(a: float, b: float) -> CrossSection:
    """Width along the first axis and along the second; torsion by Saint-Venant's series."""
    short, long = sorted((a, b))
    series = sum(tanh(0.5 * n * pi * long / short) / n**5 for n in range(1, 12, 2))
    torsion = long * short**3 * (1.0 / 3.0 - 64.0 / pi**5 * short / long * series)
    return CrossSection((a * b, a**3 * b / 12.0, a * b**3 / 12.0, torsion, _SOLID * a * b, _SOLID * a * b))


def ellipse(a: float, b: float) -> CrossSection:
    """Diameters along both axes; a circle where they are the same."""
    area = 0.25 * pi * a * b
    torsion = pi * a**3 * b**3 / (16.0 * (a**2 + b**2))
    return CrossSection((area, area * a**2 / 16.0, area * b**2 / 16.0, torsion, _ROUND * area, _ROUND * area))


def pipe(radius: float, wall: float) -> CrossSection:
    """Outer radius and thickness of the wall."""
    inner = max(radius - wall, 0.0)
    area, second = pi * (radius**2 - inner**2), 0.25 * pi * (radius**4 - inner**4)
    part = _TUBE if inner > 0.0 else _ROUND
    return CrossSection((area, second, second, 2.0 * second, part * area, part * area))


def box(a: float, b: float, side: float, flange: float) -> CrossSection:
    """Outer widths, and walls across the first axis and across the second; torsion by Bredt."""
    x, y = a - 2.0 * side, b - 2.0 * flange
    area = a * b - x * y
    torsion = 2.0 * ((a - side) * (b - flange)) ** 2 / ((a - side) / flange + (b - flange) / side)
    first, second = (a**3 * b - x**3 * y) / 12.0, (a * b**3 - x * y**3) / 12.0
    return CrossSection((area, first, second, torsion, _WALLS * area, _WALLS * area))


@cache
def principal(section: CrossSection) -> tuple[tuple[float, ...], float]:
    """As of `ElementBlock`, in principal axes, and the angle by which these are turned from the first axis."""
    area, first, second, torsion, *shear = section.constants
    angle = 0.5 * float(np.arctan2(2.0 * section.mixed, first - second)) if section.mixed else 0.0
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    if section.mixed:
        first, second = np.diag(turn @ [[first, section.mixed], [section.mixed, second]] @ turn.T).tolist()
        with np.errstate(divide="ignore"):
            shear = (1.0 / (turn**2 @ (1.0 / np.array(shear)))).tolist()
    away = (turn @ np.subtract(section.shear_centre, section.centroid)).tolist()
    return (area, first, second, torsion, *shear, *away), angle


def walls(parts: Sequence[tuple[float, ...]], shear_centre: tuple[float, float]) -> CrossSection:
    """Open section of rectangles: centre and size along both axes of each; torsion and shear as of thin walls."""
    x, y, a, b = np.array(parts).T
    areas = a * b
    area = float(areas.sum())
    centroid = float(areas @ x / area), float(areas @ y / area)
    x, y = x - centroid[0], y - centroid[1]
    ends = [float(np.max(one + 0.5 * size) - np.min(one - 0.5 * size)) for one, size in ((x, a), (y, b))]
    shear = []
    for along, across, length in ((a, b, ends[0]), (b, a, ends[1])):
        # A single wall reaches through the walls across it.
        own = along > across
        shear.append(_SOLID * float(across[own] @ (along[own] if own.sum() > 1 else np.full(own.sum(), length))))
    torsion = float(np.sum(np.maximum(a, b) * np.minimum(a, b) ** 3)) / 3.0
    first, second = float(areas @ (x**2 + a**2 / 12.0)), float(areas @ (y**2 + b**2 / 12.0))
    return CrossSection((area, first, second, torsion, *shear), float(areas @ (x * y)), centroid, shear_centre)


def i_section(height: float, widths: tuple[float, float], flanges: tuple[float, float], web: float) -> CrossSection:
    """Flanges along the first axis, below and above, and a web, from the middle of the bottom on; a flange may be 0."""
    low, high = flanges
    parts = [(0.0, 0.5 * low, widths[0], low), (0.0, height - 0.5 * high, widths[1], high)]
    parts += [(0.0, 0.5 * (low + height - high), web, height - low - high)]
    stiff = [flange * width**3 for flange, width in zip(flanges, widths, strict=True)]
    middle = (stiff[0] * 0.5 * low + stiff[1] * (height - 0.5 * high)) / (stiff[0] + stiff[1])
    return walls([part for part in parts if part[2] * part[3]], (0.0, middle))


def l_section(width: float, height: float, foot: float, leg: float) -> CrossSection:
    """A foot along the first axis and a leg along the second, from where their middle lines meet on."""
    return walls([(0.5 * (width - leg), 0.0, width, foot), (0.0, 0.5 * height, leg, height - foot)], (0.0, 0.0))


def channel(width: float, height: float, web: float, flange: float) -> CrossSection:
    """A web along the second axis with two flanges along the first, from the middle of the web on."""
    reach, away = width - web, 0.5 * (height - flange)
    parts = [(0.5 * width, side * away, reach, flange) for side in (-1.0, 1.0)]
    long, tall = width - 0.5 * web, height - flange
    centre = -3.0 * long**2 * flange / (tall * web + 6.0 * long * flange)
    return walls([(0.0, 0.0, web, height), *parts], (centre, 0.0))


def z_section(foot: float, web: float, flange: float, height: float) -> CrossSection:
    """A web along the second axis, flanges along the first: back at its top, forth at its bottom."""
    parts = [(-0.5 * s * (web + foot), 0.5 * s * (height - flange), foot, flange) for s in (-1.0, 1.0)]
    return walls([(0.0, 0.0, web, height), *parts], (0.0, 0.0))


def hat(width: float, height: float, foot: float, wall: float) -> CrossSection:
    """A top along the first axis, two webs down along the second, and feet outward, from the middle of the top on."""
    parts = [(s * 0.5 * (width - wall), 0.5 * (wall - height), wall, height - 2.0 * wall) for s in (-1.0, 1.0)]
    parts += [(s * 0.5 * (width + foot - wall), wall - height, foot + wall, wall) for s in (-1.0, 1.0)]
    h, b, c = width - wall, height - wall, foot + 0.5 * wall
    # R. J. Roark, Formulas for Stress and Strain, shear centres of thin walls.
    above = b * (3.0 * h**2 * b + 6.0 * h**2 * c - 8.0 * c**3)
    centre = above / (h**3 + 6.0 * h**2 * b + 6.0 * h**2 * c + 8.0 * c**3 + 12.0 * h * c**2)
    return walls([(0.0, 0.0, width, wall), *parts], (0.0, centre))


# Lengths below this part of the section are none; cosine of the angle up to which beams go on straight: 20 degrees.
_SAME, _SMOOTH = 1e-6, np.cos(np.radians(20.0))
_CORNERS = BRICK.corners[:4, :2]
# Radius of gyration, over the length, of bars that carry nothing but stretch: bending is a millionth of it.
_HAIR = 1e-3


class Beam(NamedTuple):
    """What makes a beam of two nodes.

    Attributes
    ----------
    section : CrossSection
        m. A bar, which stretches and may twist, has no second moments.
    direction : (3,) float
        What the section's first axis is at right angles to the beam; zeros where any is right.
    place : (2,) float
        Where the nodes are in the section's coordinates.
    offsets : (6,) float
        From both nodes to where the beam has its ends, m.
    """

    section: CrossSection
    direction: tuple[float, ...]
    place: tuple[float, float] = (0.0, 0.0)
    offsets: tuple[float, ...] = (0.0,) * 6

    @property
    def aside(self) -> tuple[float, float]:
        """From the nodes, or the ends, to the centroid, in the section's coordinates."""
        (x, y), (a, b) = self.section.centroid, self.place
        return x - a, y - b


class _Uses(NamedTuple):
    """Which nodes (n,) belong to solids, shells, beams, beams that bend, beams that are not centred on their nodes."""

    solid: BoolArray
    shell: BoolArray
    beam: BoolArray
    bent: BoolArray
    aside: BoolArray

    @property
    def kept(self) -> BoolArray:
        """What remains a point beside the corners of beams."""
        return ~self.beam | self.solid | self.shell | self.aside


def with_beams(
    mesh: Mesh, beams: Mapping[int, Beam], turning: BoolArray, hinges: Set[str] = frozenset()
) -> tuple[Mesh, BoolArray]:
    """Give beams their sections.

    Parameters
    ----------
    mesh : Mesh
        Whose beams have two nodes, or three with the middle one second, or the last one twice.
    beams : mapping of int to Beam
        By the element's label.
    turning : (n, 3) bool
        Rotations of nodes that are held at zero.
    hinges : set of str
        Node sets that mean the nodes without their turns.

    Returns
    -------
    mesh, turning : Mesh, (m, 3) bool
        Of three nodes two beams are made; nodes of beams alone are the means of their corners.
    """
    blocks, source = _split(mesh, beams)
    uses = _uses(mesh, blocks, beams, hinges)
    kept = np.flatnonzero(uses.kept)
    row = np.where(uses.kept, np.cumsum(uses.kept) - 1, -1)
    blocks, node, place, half = _bricks(mesh.points, blocks, beams, kept.size)
    origin = np.concatenate([kept, np.repeat(node, 4)])
    order, count = np.argsort(origin, kind="stable"), origin.size
    first = np.searchsorted(origin[order], np.arange(len(mesh.points) + 1))

    def moved(nodes: IntArray) -> IntArray:
        return np.unique(np.concatenate([order[:0], *(order[first[k] : first[k + 1]] for k in nodes.tolist())]))

    every, chosen = np.unique(node, return_index=True)
    links = [RigidLink(one.name, moved(one.nodes)) for one in mesh.links]
    hinged = _hinged(mesh, uses)
    links += [RigidLink(f"beams at {mesh.labels[k]}", moved(np.array([k]))) for k in every[~hinged[every]].tolist()]
    corners = kept.size + np.flatnonzero(hinged[origin[kept.size :]])
    pins = [{3 * k + i: 1.0, 3 * row[origin[k]] + i: -1.0} for k in corners.tolist() for i in range(3)]
    there = kept.size + 4 * chosen[:, None] + np.arange(4)
    fixed, rows = _supports(mesh.fixed, turning, uses, every, there, half[chosen], count)
    fixed[: kept.size] = mesh.fixed[kept]
    equations = mesh.equations @ _shares(row, every, there, count), matrix_of(pins, 3 * count)
    result = replace(
        mesh,
        points=np.concatenate([mesh.points[kept], place]),
        labels=mesh.labels[origin],
        blocks=tuple(b if b.type.beam else replace(b, connectivity=row[b.connectivity]) for b in blocks),
        node_sets={name: row[k] if name in hinges else moved(k) for name, k in mesh.node_sets.items()},
        element_sets={name: np.flatnonzero(np.isin(source, rows)) for name, rows in mesh.element_sets.items()},
        fixed=fixed,
        references=_references(mesh, uses),
        **hung(mesh, moved),
        links=merged(links, np.arange(count) >= kept.size),
        equations=sp.csr_array(sp.vstack(equations)),
        supports=matrix_of(rows, 3 * count),
        notes=(*mesh.notes, *_words(uses, every, blocks, beams)),
    )
    return result, np.concatenate([turning[kept], np.zeros((count - kept.size, 3), dtype=bool)])


def _shares(row: IntArray, every: IntArray, corners: IntArray, count: int) -> "sp.coo_array":
    """Displacements of nodes by those of points (3n, 3 count): their own where they have a row, else their corners'."""
    kept, alone = np.flatnonzero(row >= 0), row[every] < 0
    places = np.concatenate([kept, np.repeat(every[alone], 4)]), np.concatenate([row[kept], corners[alone].ravel()])
    share = np.repeat([1.0, 0.25], [kept.size, 4 * alone.sum()])
    return sp.kron(sp.coo_array((share, places), (len(row), count)), sp.eye_array(3))


def _references(mesh: Mesh, uses: _Uses) -> dict[str, FloatArray]:
    """Reference points, and middles of sets that corners of beams beside their nodes are not around."""
    aside = {name: nodes for name, nodes in mesh.node_sets.items() if uses.aside[nodes].any()}
    return {name: mesh.points[nodes].mean(axis=0) for name, nodes in aside.items()} | dict(mesh.references)


def _hinged(mesh: Mesh, uses: _Uses) -> BoolArray:
    """Nodes (n,) where bars hang on solids by hinges; nothing else would keep them from spinning."""
    found = uses.beam & uses.solid & ~uses.shell & ~uses.bent
    for link in mesh.links:
        found[link.nodes] = False
    return found


def _words(uses: _Uses, every: IntArray, blocks: Sequence[ElementBlock], beams: Mapping[int, Beam]) -> Iterator[str]:
    """What beams have become."""
    shared = int((uses.solid | uses.shell)[every].sum())
    yield f"{every.size} nodes of beams" + f"; shells turn with {shared} of them, solids only move there" * bool(shared)
    labels = [label for block in blocks if block.type.beam for label in block.labels.tolist()]
    if bars := sum(not any(beams[label].section.constants[1:3]) for label in labels):
        yield f"{bars} beams do not bend: they get a millionth of their stiffness for that; hold hinges by supports"


def _split(mesh: Mesh, beams: Mapping[int, Beam]) -> tuple[list[ElementBlock], IntArray]:
    """Blocks whose beams have two nodes and a section, and the elements that theirs were."""
    blocks, source = [], []
    for block, start in zip(mesh.blocks, mesh.starts, strict=False):
        whole = np.arange(len(block.labels))
        if block.type.beam:
            ends = np.stack([block.connectivity[:, :-1], block.connectivity[:, 1:]], axis=2)
            between = ends[..., 0] != ends[..., 1]
            whole = np.nonzero(between)[0]
            block = replace(block.part(whole), connectivity=ends[between])
            labels = block.labels.tolist()
            section = np.array([principal(beams[label].section)[0] for label in labels])
            offsets = np.array([beams[label].offsets for label in labels]).reshape(-1, 2, 3)
            length = np.linalg.norm(np.diff(mesh.points[block.connectivity] + offsets, axis=1), axis=2)
            least = section[:, :1] * (_HAIR * length) ** 2 * np.array([1.0, 1.0, 2.0])
            section[:, 1:4] = np.where(section[:, 1:4] > 0.0, section[:, 1:4], least)
            block = replace(block, section=section)
        blocks.append(block)
        source.append(start + whole)
    return blocks, np.concatenate(source)


def _uses(mesh: Mesh, blocks: Sequence[ElementBlock], beams: Mapping[int, Beam], hinges: Set[str]) -> _Uses:
    found = _Uses(*np.zeros((5, len(mesh.points)), dtype=bool))
    for name in hinges & mesh.node_sets.keys():
        found.aside[mesh.node_sets[name]] = True
    for block in blocks:
        (found.beam if block.type.beam else found.shell if block.type.shell else found.solid)[block.connectivity] = True
        if block.type.beam:
            own = [beams[label] for label in block.labels.tolist()]
            found.bent[block.connectivity[[any(one.section.constants[1:3]) for one in own]]] = True
            found.aside[block.connectivity[[any((*one.offsets, *one.aside)) for one in own]]] = True
    return found


def _bricks(
    points: FloatArray, blocks: Sequence[ElementBlock], beams: Mapping[int, Beam], first: int
) -> tuple[list[ElementBlock], IntArray, FloatArray, FloatArray]:
    """Blocks whose beams are between corners from row `first` on; nodes, places and half axes as of `_sections`."""
    bars = [block for block in blocks if block.type.beam]
    node, place, half, which = _sections(points, bars, beams)
    corners = (first + 4 * which[..., None] + np.arange(4)).reshape(-1, 8)
    own = iter(np.split(corners, np.cumsum([len(block.labels) for block in bars])[:-1]))
    return [replace(b, connectivity=next(own)) if b.type.beam else b for b in blocks], node, place, half


def _sections(
    points: FloatArray, bars: Sequence[ElementBlock], beams: Mapping[int, Beam]
) -> tuple[IntArray, FloatArray, FloatArray, IntArray]:
    """Sections: node (s,), corners' places (4s, 3), half axes (s, 2, 3); and those at the ends of beams (e, 2)."""
    ends, labels = np.concatenate([one.connectivity for one in bars]), np.concatenate([one.labels for one in bars])
    section, given = np.concatenate([one.section for one in bars]), [beams[label] for label in labels.tolist()]
    offsets = np.array([one.offsets for one in given]).reshape(-1, 2, 3)
    along = np.diff(points[ends] + offsets, axis=1)[:, 0]
    length = np.linalg.norm(along, axis=1)
    along /= np.maximum(length, 1e-300)[:, None]
    direction = np.array([one.direction for one in given])
    any_is_right = ~direction.any(axis=1)
    direction[any_is_right] = np.eye(3)[np.abs(along[any_is_right]).argmin(axis=1)]
    across = np.linalg.norm(np.cross(along, direction), axis=1) <= _SAME * np.linalg.norm(direction, axis=1)
    if (wrong := across | (length <= 0.0)).any():
        words = "beams have no length, or the direction of their section's first axis runs along them"
        raise MeshError(f"{words}: {listed(labels[wrong])}; give another direction")
    # Beams that go on nearly straight have a plane in common where they meet.
    sums: dict[int, list[FloatArray]] = {}
    plane = []
    for node, own in zip(ends.ravel().tolist(), np.repeat(along, 2, axis=0), strict=True):
        known = sums.setdefault(node, [])
        beside = [one for one in known if abs(one @ own) > _SMOOTH * np.linalg.norm(one)] or [np.zeros(3)]
        known += [] if beside[0].any() else beside
        beside[0] += own if beside[0] @ own >= 0.0 else -own
        plane.append(beside[0])
    normal = np.array(plane)
    normal *= np.sign(np.sum(normal * np.repeat(along, 2, axis=0), axis=1, keepdims=True))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    first = np.repeat(direction, 2, axis=0)
    first = first - np.sum(first * normal, axis=1, keepdims=True) * normal
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    axes = np.stack([first, np.cross(normal, first)], axis=1)
    aside = np.repeat([one.aside for one in given], 2, axis=0)[:, None] @ axes + offsets.reshape(-1, 1, 3)
    angle = np.repeat([principal(one.section)[1] for one in given], 2)
    axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]).transpose(2, 0, 1) @ axes
    size = np.repeat(np.sqrt(3.0 * section[:, 1:3] / section[:, :1]), 2, axis=0)
    half = size[..., None] * axes
    arm = _CORNERS @ half + aside
    near = np.rint(arm / (_SAME * size.max(axis=1)[:, None, None])).reshape(len(arm), 12)
    key = np.column_stack([ends.ravel(), np.log(size), near])
    _, index, which = np.unique(key, axis=0, return_index=True, return_inverse=True)
    node = ends.ravel()[index]
    return node, (points[node][:, None] + arm[index]).reshape(-1, 3), half[index], which.reshape(-1, 2)


def _supports(
    fixed: BoolArray, turning: BoolArray, uses: _Uses, nodes: IntArray, corners: IntArray, half: FloatArray, count: int
) -> tuple[BoolArray, list[Row]]:
    """Translations (count, 3) held at zero, and equations for what is held of beams' nodes (k,) otherwise."""
    held, rows = np.zeros((count, 3), dtype=bool), []
    for node, own, (one, two) in zip(nodes.tolist(), corners.tolist(), half, strict=True):
        if fixed[node].all() and turning[node].all():
            held[own] = True
            continue
        moves = fixed[node] & ~uses.kept[node]
        rows += [{3 * corner + axis: 0.25 for corner in own} for axis in np.flatnonzero(moves).tolist()]
        size = np.linalg.norm([one, two], axis=1)
        one, two = one / size[0], two / size[1]
        along = np.cross(one, two)
        # Shells hold their own turns.
        for axis in np.flatnonzero(turning[node] & ~uses.shell[node]).tolist():
            # ω of how both axes turn, ω × n.
            parts = 0.5 * along[axis] * two - two[axis] * along, one[axis] * along - 0.5 * along[axis] * one
            value = (_CORNERS / size) @ np.stack(parts)
            rows.append({3 * own[c] + k: value[c, k].item() for c, k in zip(*np.nonzero(value), strict=True)})
    return held, rows
