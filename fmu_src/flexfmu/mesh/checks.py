"""What a mesh must pass before it becomes a body: sound elements, no nodes left over, connected, of a likely size."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from flexfmu.files import sparse as sp
from flexfmu.files.basics import UNITS, BoolArray, FloatArray, IntArray, MeshError, UnitSystem, listed
from flexfmu.mesh.elements import ElementBlock, ElementType
from flexfmu.mesh.equations import RigidLink, coupled_nodes, merged, without
from flexfmu.mesh.model import Material, Mesh, hung, once

# Volume ratio, in units of the element's extent cubed, that is taken for zero: far below that of the thinnest
# sensible element (1e-6 for one of aspect 1000 to 1000 to 1), far above round-off of coordinates (1e-13).
DEGENERATE = 1e-10
# Opposite faces of a brick.
_OPPOSITE = np.array([(0, 1), (2, 4), (3, 5)])
# Coordinates, m, beyond which volumes overflow: no body is there.
_FARTHEST = 1e90


@once
def checked(mesh: Mesh) -> Mesh:
    """Return the mesh without the nodes that no element uses, if its elements are sound.

    Elements without a material pass.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    Mesh
        Rows renumbered, sets reduced, and a note that names the nodes dropped; `mesh` itself if there are none.

    Raises
    ------
    MeshError
        There are no elements, a coordinate is not finite, or elements are inverted or degenerate.
    """
    if mesh.element_count == 0:
        raise MeshError("the mesh has no solid elements; give a file that holds the body's volume mesh")
    wrong = ~(np.abs(mesh.points) < _FARTHEST).all(axis=1)
    if wrong.any():
        raise MeshError(f"coordinates of nodes are not finite: {listed(mesh.labels[wrong])}; correct the mesh file")
    bad = np.concatenate([block.labels[_unsound(mesh.points, block)] for block in mesh.blocks])
    if len(bad):
        raise MeshError(
            f"{len(bad)} of {mesh.element_count} elements are inverted or degenerate (Jacobian determinant not "
            f"positive at a corner or quadrature point): {listed(bad)}; mesh again, or correct their node order"
        )
    return _without_unused_nodes(_once(mesh))


def _once(mesh: Mesh) -> Mesh:
    """Return the mesh with one solid of those between the same corners: that of the most nodes, the first of equals."""
    seen: dict[tuple[int, ...], int] = {}
    kept = np.ones(mesh.element_count, dtype=bool)
    numbers = np.concatenate([block.labels for block in mesh.blocks])
    for start, block in sorted(zip(mesh.starts, mesh.blocks, strict=False), key=lambda one: -one[1].type.node_count):
        if not block.type.natural:
            corners = np.sort(block.connectivity[:, : block.type.corner_count], axis=1)
            for place, key in enumerate(map(tuple, corners.tolist()), start=int(start)):
                kept[place] = seen.setdefault(key, place) == place
    if kept.all():
        return mesh
    left = f"{int((~kept).sum())} elements lie on others with the same corners and are left out"
    note = f"{left}, as their stiffness counts once: {listed(numbers[~kept])}"
    rows = np.cumsum(kept) - 1
    parts = [(b, kept[s : s + len(b.labels)]) for s, b in zip(mesh.starts, mesh.blocks, strict=False)]
    return replace(
        mesh,
        blocks=tuple(block.part(chosen) for block, chosen in parts if chosen.any()),
        element_sets={name: rows[members[kept[members]]] for name, members in mesh.element_sets.items()},
        notes=(*mesh.notes, note),
    )


def without_mechanisms(mesh: Mesh) -> Mesh:
    """Return the mesh with C3D20 for C3D20R elements of which two pairs of opposite faces are free.

    Each would move without energy, as in a bar one element across; those with one free pair at most hold each other.

    Parameters
    ----------
    mesh : Mesh
        Checked.

    Returns
    -------
    Mesh
        Elements in another order, sets likewise, and a note; `mesh` itself if there are none.
    """
    outer, element = (np.concatenate([getattr(faces, name) for faces in mesh.faces]) for name in ("outer", "element"))
    blocks, places, count = [], [], 0
    for block, start in zip(mesh.blocks, mesh.starts, strict=False):
        own = np.arange(start, start + len(block.labels))
        lone = np.zeros(len(own), dtype=bool)
        if block.type is ElementType.C3D20R:
            free = outer[np.isin(element, own)].reshape(-1, len(block.type.shape.faces))
            lone = free[:, _OPPOSITE].all(axis=2).sum(axis=1) > 1
            count += int(lone.sum())
        for chosen, kind in ((~lone, block.type), (lone, ElementType.C3D20)):
            if chosen.any():
                blocks.append(replace(block.part(chosen), type=kind))
                places.append(own[chosen])
    if not count:
        return mesh
    rows = np.argsort(np.concatenate(places))
    note = f"{count} C3D20R with two pairs of opposite faces free would move without energy: they are taken as C3D20"
    sets = {name: np.sort(rows[members]) for name, members in mesh.element_sets.items()}
    return replace(mesh, blocks=tuple(blocks), element_sets=sets, notes=(*mesh.notes, note))


def nodes_of_elements(mesh: Mesh) -> "sp.csr_array":
    """Which nodes each element has, ones (e, n)."""
    columns = np.concatenate([np.zeros(0, int), *(block.connectivity.ravel() for block in mesh.blocks)])
    ends = np.cumsum(np.concatenate([[0], *([block.type.node_count] * len(block.labels) for block in mesh.blocks)]))
    return sp.csr_array((np.ones(columns.size), columns, ends), shape=(mesh.element_count, len(mesh.points)))


def connected_parts(mesh: Mesh) -> IntArray:
    """Return the part that each node belongs to; nodes of one element or equation belong together.

    Parameters
    ----------
    mesh : Mesh

    Returns
    -------
    (n,) int
        Counted from zero without gaps. A node that no element uses is a part of its own.
    """
    uses = nodes_of_elements(mesh)
    graph = sp.block_array([[coupled_nodes(mesh.equations), None], [uses, sp.csr_array((len(uses.indptr) - 1,) * 2)]])
    # Nodes and elements are the graph's vertices: far fewer edges than between the nodes themselves.
    _, parts = sp.csgraph.connected_components(graph, directed=False)
    _, numbered = np.unique(parts[: len(mesh.points)], return_inverse=True)
    return numbered.astype(np.int64)


def node_groups(mesh: Mesh, nodes: IntArray) -> IntArray:
    """Number (k,) of the group of each of some nodes (k,), of which elements have several."""
    uses = nodes_of_elements(mesh)[:, nodes]
    return np.asarray(sp.csgraph.connected_components(uses.T @ uses, directed=False)[1], dtype=np.int64)


def linked_pieces(pairs: IntArray, count: int) -> IntArray:
    """Number (count,) of the connected piece of each of some things, by pairs (k, 2) that hang together."""
    graph = sp.coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count))
    return np.asarray(sp.csgraph.connected_components(graph, directed=False)[1], dtype=np.int64)


def jacobian_determinants(points: FloatArray, block: ElementBlock) -> FloatArray:
    """Return the determinants of the map from the reference element, where soundness is asked for.

    Parameters
    ----------
    points : (n, 3) float
        m.
    block : ElementBlock

    Returns
    -------
    (n_elements, n_places) float
        m³; at the corners first, then at the quadrature points of the type.
    """
    shape = block.type.shape
    places = np.concatenate([shape.polytope.corners, block.type.stiffness.points])
    # Relative to the first node, so that a body far from the origin loses no digits.
    coordinates = points[block.connectivity] - points[block.connectivity[:, :1]]
    return np.linalg.det(np.einsum("ena,pnb->epab", coordinates, shape.gradient(places)))


def _unsound(points: FloatArray, block: ElementBlock) -> BoolArray:
    corners = points[block.connectivity]
    extent = np.linalg.norm(corners.max(axis=1) - corners.min(axis=1), axis=1)
    smallest: FloatArray = jacobian_determinants(points, block).min(axis=1)
    return smallest <= DEGENERATE * extent**3


def _without_unused_nodes(mesh: Mesh) -> Mesh:
    used = np.isin(np.arange(len(mesh.points)), np.concatenate([one.connectivity.ravel() for one in mesh.blocks]))
    # Nodes of beams that are points beside the corners there.
    used |= np.isin(mesh.labels, mesh.labels[used])
    # And of those in equations the ones on which something hangs, or that are rigid with others.
    hanging = [*(end for one in mesh.springs for end in one.ends), *(one.nodes for one in mesh.masses)]
    hanging += [one.nodes for one in mesh.links]
    used[np.intersect1d(mesh.equations.indices // 3, np.concatenate([mesh.equations.indices[:0], *hanging]))] = True
    if used.all():
        return mesh
    rows = np.cumsum(used) - 1
    # Couplings and rigid bodies speak for their reference nodes.
    spoken = np.isin(np.arange(used.size), np.concatenate([rows[:0], *(one.nodes for one in mesh.links)]))
    for point in mesh.references.values():
        spoken |= np.all(mesh.points == point, axis=1)
    dropped = mesh.labels[~used & ~spoken]
    notes = [f"{len(dropped)} nodes that no element uses are left out: {listed(dropped)}"] * bool(dropped.size)
    node_sets = {name: rows[members[used[members]]] for name, members in mesh.node_sets.items()}
    if emptied := [name for name, left in node_sets.items() if len(mesh.node_sets[name]) and not len(left)]:
        notes.append(f"node sets that hold none but such nodes are empty now: {listed(emptied)}")
    # What the file holds of such a node is zero, the rest of it is eliminated.
    held = sp.diags_array((~(mesh.fixed & ~used[:, None])).ravel().astype(float))
    gone = np.repeat(~used, 3)
    both = (sp.csr_array(without(one @ held, gone)[:, ~gone]) for one in (mesh.equations, mesh.supports))
    return replace(
        mesh,
        points=mesh.points[used],
        labels=mesh.labels[used],
        blocks=tuple(replace(block, connectivity=rows[block.connectivity]) for block in mesh.blocks),
        node_sets=node_sets,
        fixed=mesh.fixed[used],
        notes=(*mesh.notes, *notes),
        **dict(zip(("equations", "supports"), both, strict=True)),
        **hung(mesh, lambda nodes: rows[nodes[used[nodes]]]),
        # A reference point that several have makes one of them.
        links=tuple(
            RigidLink(one.name, rows[one.nodes[used[one.nodes]]])
            for one in merged(mesh.links, ~used)
            if used[one.nodes].any()
        ),
    )


# Longest side, m: flexible bodies from a flexure hinge to a rotor blade.
SIZE_RANGE = (2e-3, 100.0)
# Young's modulus, N/m²: from soft rubber to diamond.
MODULUS_RANGE = (1e6, 2e12)
# Density, kg/m³: from aerogel to osmium.
DENSITY_RANGE = (1.0, 3e4)
# √(E/ρ), m/s: no solid is faster than diamond, at 18 000.
_FASTEST = 2.5e4
# What is as dense as metal or ceramics, kg/m³, is not as soft as rubber, N/m².
_DENSE, _SOFT = 2500.0, 5e9
# What a number is likely to be: sizes of machine parts, moduli and densities of what bears loads.
_LIKELY_SIZE = (5e-3, 20.0)
_LIKELY_MODULUS = (1e9, 1.3e12)
_LIKELY_DENSITY = (500.0, 2.5e4)
_LENGTHS = {"m": 1.0, "mm": UNITS["m"]["mm"], "inches": UNITS["m"]["in"]}
_STRESSES = {"N/m²": 1.0, **{name: UNITS["Pa"][name] for name in ("MPa", "GPa", "psi")}}


def implausible(mesh: Mesh, units: UnitSystem) -> tuple[str, ...]:
    """Say what no solid body is likely to be, with the units that would explain it.

    Parameters
    ----------
    mesh : Mesh
        SI units.
    units : UnitSystem
        What its numbers were declared in.

    Returns
    -------
    tuple of str
        Warnings; none for a plausible body.
    """
    found = [_size_doubt(mesh, units), *(_material_doubt(material, units) for material in mesh.materials)]
    doubts = [doubt for doubt in found if doubt is not None]
    if not doubts:
        return ()
    for other in UnitSystem:
        if other is not units and _plausible_in(other, mesh, units):
            what = "; ".join(fault for fault, _ in doubts)
            return (
                f"{what}: implausible. In {other.value} the body would be {_sides(mesh, other.length / units.length)} "
                f'and all its numbers plausible: if the mesh is in {other.value}, set units = "{other.value}" in '
                f"[mesh] (found {units.value})",
            )
    return tuple(f"{fault}: implausible. {cause}" for fault, cause in doubts)


def is_likely_density(density: float) -> bool:
    """Whether machine parts have such a density, kg/m³."""
    return _within(density, _LIKELY_DENSITY)


def is_likely(mesh: Mesh) -> bool:
    """Whether a mesh (SI units) has the size of machine parts, of materials that they may be of if it tells."""
    known = (one for one in mesh.materials if not np.isnan(one.youngs_modulus + one.density))
    return _within(_size(mesh), _LIKELY_SIZE) and all(_likely(one.youngs_modulus, one.density) for one in known)


def _plausible_in(other: UnitSystem, mesh: Mesh, units: UnitSystem) -> bool:
    """Whether the same numbers are a likely body throughout in another system."""
    stress, density = other.stress / units.stress, other.density / units.density
    likely = (_likely(one.youngs_modulus * stress, one.density * density) for one in mesh.materials)
    return _within(_size(mesh) * other.length / units.length, _LIKELY_SIZE) and all(likely)


def _likely(modulus: float, density: float) -> bool:
    return _solid(modulus, density) and is_likely_density(density)


def _solid(modulus: float, density: float) -> bool:
    return (
        _within(modulus, MODULUS_RANGE)
        and _within(density, DENSITY_RANGE)
        and modulus <= density * _FASTEST**2
        and not (density > _DENSE and modulus < _SOFT)
    )


def _size_doubt(mesh: Mesh, units: UnitSystem) -> tuple[str, str] | None:
    """What is wrong with the body's size, and the likely cause; None if nothing is."""
    if _within(_size(mesh), SIZE_RANGE):
        return None
    fits = [
        f"in {name}, {_sides(mesh, factor / units.length)}"
        for name, factor in _LENGTHS.items()
        if _within(_size(mesh) * factor / units.length, _LIKELY_SIZE)
    ]
    known = ", ".join(f'"{system.value}"' for system in UnitSystem)
    return (
        f"the body measures {_sides(mesh, 1.0)}",
        _cause(fits, "its mesh") + f"Give the mesh's units in [mesh] (found {units.value}, known: {known}); [material] "
        "is in the same units",
    )


def _material_doubt(material: Material, units: UnitSystem) -> tuple[str, str] | None:
    """What is wrong with a material, and the likely cause; None if nothing is."""
    modulus, density = material.youngs_modulus, material.density
    if _solid(modulus, density):
        return None
    stress_name, density_name = units.stress_name, units.density_name
    given = f"Young's modulus {modulus / units.stress:.6g} {stress_name} and density {density / units.density:.6g}"
    fault = f"material {material.name!r} has {given} {density_name}"
    if units is not UnitSystem.SI:
        fault += f" ({modulus:.3g} N/m², {density:.3g} kg/m³)"
    causes = []
    if not _within(density, DENSITY_RANGE) or modulus > density * _FASTEST**2:
        fits = _fits(density, units.density, UNITS["kg/m³"], _LIKELY_DENSITY, density_name)
        causes.append(_cause(fits, "the density"))
    if not _within(modulus, MODULUS_RANGE) or (density > _DENSE and modulus < _SOFT):
        fits = _fits(modulus, units.stress, _STRESSES, _LIKELY_MODULUS, stress_name)
        causes.append(_cause(fits, "the modulus"))
    return fault, "".join(causes) + f"Give both in the units of [mesh] ({units.value}), or correct these"


def _fits(value: float, unit: float, table: Mapping[str, float], likely: tuple[float, float], name: str) -> list[str]:
    """Other units in which the number that was read is a likely one, with what it is then."""
    return [
        f"in {other}, {value / unit * factor / unit:.4g} {name}"
        for other, factor in table.items()
        if factor != unit and _within(value / unit * factor, likely)
    ]


def _cause(fits: list[str], what: str) -> str:
    return f"{what[0].upper()}{what[1:]} may be {', or '.join(fits)}. " if fits else ""


def _sides(mesh: Mesh, factor: float) -> str:
    return " × ".join(f"{factor * side:.4g}" for side in np.ptp(mesh.points, axis=0)) + " m"


def _size(mesh: Mesh) -> float:
    return float(np.ptp(mesh.points, axis=0).max())


def _within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= value <= limits[1]
