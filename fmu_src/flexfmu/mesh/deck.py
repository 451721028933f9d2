"""Reader of Abaqus and CalculiX decks: a body's mesh, sets, materials and supports from the model part."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from flexfmu.errors import DeckError, MeshError
from flexfmu.mesh.deck_boundary import hold
from flexfmu.mesh.deck_cards import Card, read_cards
from flexfmu.mesh.deck_geometry import ElementTable, NodeTable
from flexfmu.mesh.deck_materials import MaterialTable
from flexfmu.mesh.deck_sets import SetTable
from flexfmu.mesh.deck_surfaces import surface_nodes
from flexfmu.mesh.model import ElementBlock, IntArray, Mesh
from flexfmu.mesh.units import UnitSystem

# Keywords that are honoured and their parameters; others might change what the card means.
HONOURED: dict[str, tuple[str, ...]] = {
    "NODE": ("NSET",),
    "ELEMENT": ("TYPE", "ELSET"),
    "NSET": ("NSET", "GENERATE", "ELSET", "UNSORTED", "INTERNAL"),
    "ELSET": ("ELSET", "GENERATE", "UNSORTED", "INTERNAL"),
    "SURFACE": ("NAME", "TYPE", "INTERNAL"),
    "MATERIAL": ("NAME",),
    "ELASTIC": ("TYPE",),
    "DENSITY": (),
    "SOLID SECTION": ("ELSET", "MATERIAL"),
    "BOUNDARY": ("AMPLITUDE",),
}
PARAMETERS = {keyword.replace(" ", ""): names for keyword, names in HONOURED.items()}

# Say nothing of the body: passed over in silence.
HARMLESS = frozenset({"HEADING", "PREPRINT", "NODEPRINT", "NODEFILE", "NODEOUTPUT", "ELPRINT", "ELFILE",
                      "ELEMENTOUTPUT", "OUTPUT"})  # fmt: skip

# Do not bear on stiffness or mass at rest: passed over with a note.
UNUSED = frozenset({"AMPLITUDE", "CONDUCTIVITY", "DAMPING", "EXPANSION", "PHYSICALCONSTANTS", "SPECIFICHEAT",
                    "TIMEPOINTS"})  # fmt: skip

ASSEMBLY_KEYWORDS = frozenset({"PART", "ENDPART", "ASSEMBLY", "ENDASSEMBLY", "INSTANCE", "ENDINSTANCE"})


def read_deck(path: Path, units: UnitSystem) -> Mesh:
    """Read the body in a deck's model part; the steps are the analysis of something else and left unused.

    Parameters
    ----------
    path : Path
        A flat deck (without parts and instances), with included files relative to the including one.
    units : UnitSystem
        What the deck's numbers are in.

    Returns
    -------
    Mesh
        SI units. Elements are in one block for each type. Surfaces are node sets.

    Raises
    ------
    MeshError
        The file cannot be read, or holds no nodes or no elements.
    DeckError
        A line cannot be honoured.
    """
    content = _Content(MaterialTable(units))
    content.sort(read_cards(path))
    blocks = content.elements.blocks(content.nodes)
    if not content.nodes.rows or not blocks:
        missing = "elements (*ELEMENT)" if content.nodes.rows else "nodes (*NODE)"
        raise MeshError(f"{path} defines no {missing} outside its steps; give a deck that holds the body's mesh")
    node_sets, element_sets = _resolved_sets(content, blocks)
    surfaces = _resolved_surfaces(content, node_sets, element_sets, blocks)
    fixed = np.zeros((len(content.nodes.rows), 3), dtype=bool)
    for card in content.boundaries:
        hold(card, node_sets, fixed)
    labels = np.concatenate([block.labels for block in blocks])
    materials, material_rows, unused = content.materials.assigned(element_sets, labels)
    return Mesh(
        points=content.nodes.points() * units.length,
        labels=content.nodes.labels(),
        blocks=_with_materials(blocks, material_rows),
        node_sets=node_sets.arrays() | surfaces,
        element_sets=element_sets.arrays(),
        materials=materials,
        fixed=fixed,
        notes=(*content.notes, *node_sets.notes, *element_sets.notes, *unused),
    )


@dataclass(slots=True)
class _Content:
    """A deck's cards, sorted by what they define; sets wait until all nodes and elements are known."""

    materials: MaterialTable
    nodes: NodeTable = field(default_factory=NodeTable)
    elements: ElementTable = field(default_factory=ElementTable)
    sets: list[tuple[Card, list[int]]] = field(default_factory=list)
    surfaces: list[Card] = field(default_factory=list)
    boundaries: list[Card] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def sort(self, cards: Iterator[Card]) -> None:
        """Take all cards."""
        for card in cards:
            if card.key == "STEP":
                self.notes.append(_skipped_step(card, cards))
            elif card.key in PARAMETERS:
                card.allow(PARAMETERS[card.key])
                self._take(card)
            elif card.key in UNUSED:
                self.notes.append(f"{card.line.file}, line {card.line.number}: *{card.keyword} is left unused")
            elif card.key not in HARMLESS:
                raise _unsupported(card)

    def _take(self, card: Card) -> None:
        match card.key:
            case "NODE":
                self.sets.append((card, self.nodes.add(card)))
            case "ELEMENT":
                self.sets.append((card, self.elements.add(card)))
            case "NSET" | "ELSET":
                self.sets.append((card, []))
            case "SURFACE":
                self.surfaces.append(card)
            case "MATERIAL":
                self.materials.begin(card)
            case "ELASTIC":
                self.materials.elastic(card)
            case "DENSITY":
                self.materials.density(card)
            case "SOLIDSECTION":
                self.materials.section(card)
            case "BOUNDARY":
                self.boundaries.append(card)


def _unsupported(card: Card) -> DeckError:
    if card.key in ASSEMBLY_KEYWORDS:
        advice = "write a flat deck (in Abaqus/CAE: 'Do not use parts and assemblies in input files')"
    else:
        advice = "take it out if the body does without it, or put it into a *STEP if it belongs to an analysis"
    supported = ", ".join(f"*{name}" for name in HONOURED)
    return card.line.error(f"*{card.keyword} is not supported (supported: {supported}, *INCLUDE); {advice}")


def _skipped_step(step: Card, cards: Iterator[Card]) -> str:
    """Pass over the cards up to *END STEP and return a note that names them."""
    passed: dict[str, None] = {}
    for card in cards:
        if card.key == "ENDSTEP":
            begin, end = f"{step.line.file}, lines {step.line.number}", f"{card.line.number}"
            if card.line.file != step.line.file:
                end += f" of {card.line.file}"
            return f"{begin} to {end}: a step is analysis and left unused: {', '.join(passed) or 'empty'}"
        if card.key == "STEP":
            break
        passed[f"*{card.keyword}"] = None
    raise step.line.error("this *STEP has no *END STEP; add it, so that the analysis can be told from the body")


def _resolved_sets(content: _Content, blocks: tuple[ElementBlock, ...]) -> tuple[SetTable, SetTable]:
    nodes = SetTable("node", content.nodes.rows)
    elements = SetTable("element", content.elements.positions())
    for card, labels in content.sets:
        if card.key in ("NODE", "ELEMENT"):
            table, parameter = (nodes, "NSET") if card.key == "NODE" else (elements, "ELSET")
            if parameter in card.parameters:
                table.extend_by_labels(card.required(parameter), labels)
        elif card.key == "ELSET":
            elements.add(card, card.required("ELSET"))
        elif "ELSET" in card.parameters:
            # *NSET, ELSET=...: the nodes of these elements.
            members = elements.find(card.parameters["ELSET"], card.line)
            nodes.extend(card.required("NSET"), _nodes_of(members, blocks))
        else:
            nodes.add(card, card.required("NSET"))
    return nodes, elements


def _nodes_of(positions: set[int], blocks: tuple[ElementBlock, ...]) -> list[int]:
    rows: list[int] = []
    start = 0
    for block in blocks:
        inside = [place - start for place in positions if start <= place < start + len(block.labels)]
        rows += np.unique(block.connectivity[inside]).tolist()
        start += len(block.labels)
    return rows


def _resolved_surfaces(
    content: _Content, node_sets: SetTable, element_sets: SetTable, blocks: tuple[ElementBlock, ...]
) -> dict[str, IntArray]:
    surfaces: dict[str, IntArray] = {}
    for card in content.surfaces:
        name = card.required("NAME")
        rows = surface_nodes(card, node_sets, element_sets, blocks)
        if name.upper() in node_sets.members:
            where = f"{card.line.file}, line {card.line.number}"
            content.notes.append(f"{where}: surface '{name}' is left unused: a node set has its name")
        else:
            surfaces[name] = rows
    return surfaces


def _with_materials(blocks: tuple[ElementBlock, ...], rows: IntArray) -> tuple[ElementBlock, ...]:
    ends = np.cumsum([len(block.labels) for block in blocks])
    parts = np.split(rows, ends[:-1])
    return tuple(replace(block, material=part) for block, part in zip(blocks, parts, strict=True))
