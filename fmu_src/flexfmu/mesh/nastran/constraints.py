"""Nastran's cards of nodes that move together or are held: RBE2, RBE3, MPC, single-point constraints."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flexfmu.files.array_types import FloatArray
from flexfmu.files.errors import MeshError
from flexfmu.mesh.listing import listed

# Cards of nodes that move with a reference point: which of their nodes are on the body, and the reference.
SPIDERS = {"RBE2": ("dependent_nodes", "gn"), "RBE3": ("independent_nodes", "refgrid")}
# Translations in a grid point's own constraints, and of an MPC's terms.
_TRANSLATIONS = "123"


def spiders(
    model: Any, points: FloatArray, row: Mapping[int, int], path: Path, notes: list[str]
) -> tuple[dict[str, list[int]], dict[str, FloatArray]]:
    """Return the nodes of RBE2 and RBE3 on the body, and their reference points.

    Parameters
    ----------
    model : pyNastran.bdf.bdf.BDF
    points : (n, 3) float
    row : mapping of int to int
        Rows of `points` by grid point.
    path : Path
    notes : list of str
        Gets what is left out of each.

    Returns
    -------
    nodes : dict of str to list of int
        Grid points, by "RBE2 n".
    references : dict of str to (3,) float

    Raises
    ------
    MeshError
        Several have the same reference, or one hangs on another: they join the body's parts.
    """
    ends = spider_ends(model)
    uses = Counter(reference for _, reference in ends.values())
    members = {node for nodes, _ in ends.values() for node in nodes}
    joining = [number for number, (_, reference) in ends.items() if uses[reference] > 1 or reference in members]
    if joining:
        raise MeshError(
            f"{path}: rigid elements {listed(joining)} share their reference points, which joins parts of the body: "
            "not supported; join these parts by solids or MPC"
        )
    sets, references = {}, {}
    for number, (nodes, reference) in ends.items():
        kind = model.rigid_elements[number].type
        name = f"{kind} {number}"
        sets[name] = nodes
        if reference in row:
            references[name] = points[row[reference]]
        holds = "; that it holds them rigid is left out" if kind == "RBE2" else ""
        notes.append(f"{name} is offered as an interface: nodes = '{name}', with its reference node as point{holds}")
    return sets, references


def spider_ends(model: Any) -> dict[int, tuple[list[int], int]]:
    """Grid points on the body and reference of each RBE2 and RBE3, by its number."""
    return {
        number: (list(getattr(element, SPIDERS[element.type][0])), int(getattr(element, SPIDERS[element.type][1])))
        for number, element in sorted(model.rigid_elements.items())
    }


def multi_point_rows(model: Any, row: Mapping[int, int], path: Path) -> list[dict[int, float]]:
    """Return the equations of the MPC set that the case control chooses, or of the only one.

    Parameters
    ----------
    model : pyNastran.bdf.bdf.BDF
    row : mapping of int to int
        Rows of the nodes by grid point.
    path : Path

    Returns
    -------
    list of dict of int to float
        Coefficients by unknown, 3 i + j for node i in direction j.

    Raises
    ------
    MeshError
        Several sets and none that is chosen, or terms that are no translations in the global system.
    """
    if not model.mpcs:
        return []
    cards = [card for number in _chosen_set(model, path) for card in model.mpcs.get(number, ())]
    found: list[dict[int, float]] = []
    for card in cards:
        terms: dict[int, float] = {}
        for node, component, factor in zip(card.nodes, card.components, card.coefficients, strict=True):
            if node not in row or str(component) not in tuple(_TRANSLATIONS) or model.nodes[node].cd:
                raise MeshError(
                    f"{path}: MPC {card.conid} has the term {node}, {component}: supported are translations 1 to 3 of "
                    "grid points, along the global axes"
                )
            key = 3 * row[node] + int(component) - 1
            terms[key] = terms.get(key, 0.0) + float(factor)
        found.append(terms)
    return found


def _chosen_set(model: Any, path: Path) -> list[int]:
    """Numbers of the MPC cards that count."""
    subcases = [] if model.case_control_deck is None else model.case_control_deck.subcases.values()
    chosen = {int(subcase.params["MPC"][0]) for subcase in subcases if "MPC" in subcase.params}
    known = {*model.mpcs, *model.mpcadds}
    if not chosen and len(known) == 1:
        chosen = known
    if len(chosen) != 1:
        raise MeshError(
            f"{path}: the MPC sets {listed(sorted(known))} are there, and the case control chooses "
            f"{listed(sorted(chosen))}: expected one, MPC = n for all subcases"
        )
    (number,) = chosen
    return [int(one) for card in model.mpcadds[number] for one in card.mpc_ids] if number in model.mpcadds else [number]


def single_point_sets(model: Any, notes: list[str]) -> dict[str, list[int]]:
    """Return the nodes of single-point constraints; grid points' own constraints count as set 0.

    Parameters
    ----------
    model : pyNastran.bdf.bdf.BDF
    notes : list of str
        Gets a word on each.

    Returns
    -------
    dict of str to list of int
        Grid points, by "SPC n".
    """
    sets: dict[str, list[int]] = {}
    for number, cards in model.spcs.items():
        for card in cards:
            sets.setdefault(f"SPC {number}", []).extend(getattr(card, "nodes", ()))
    own = [label for label, grid in model.nodes.items() if set(str(grid.ps)) & set(_TRANSLATIONS)]
    if own:
        sets["SPC 0"] = own
    notes.extend(
        f"{name}: its nodes are a node set, and it holds nothing: give a [[support]]" for name in sets if sets[name]
    )
    return sets
