"""Reader of Abaqus and CalculiX decks: a body's mesh, sets, materials and supports from the model part."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from flexfmu.files.basics import BoolArray, DeckError, FloatArray, IntArray, MeshError, UnitSystem, listed
from flexfmu.mesh.beams import Beam, with_beams
from flexfmu.mesh.decks import structures
from flexfmu.mesh.decks.assembly import Assembly
from flexfmu.mesh.decks.attached import MASSES, SPRINGS, Carriers, deck_springs, point_masses
from flexfmu.mesh.decks.cards import Card, read_cards
from flexfmu.mesh.decks.couplings import COUPLINGS, offered, resolved
from flexfmu.mesh.decks.equations import TieTable, equations, held_by_steps, hold, inclined
from flexfmu.mesh.decks.geometry import Elements, ElementTable, NodeTable
from flexfmu.mesh.decks.keywords import HARMLESS, HONOURED, PARAMETERS, SECTIONS, UNUSED, unused
from flexfmu.mesh.decks.materials import DeckMaterials
from flexfmu.mesh.decks.orientation import orientation
from flexfmu.mesh.decks.sets import Deck, DeckSurface, SetTable, surface
from flexfmu.mesh.equations import Row, matrix_of
from flexfmu.mesh.model import Mesh
from flexfmu.mesh.shells import FoldedShellError, expanded
from flexfmu.mesh.ties import OfShell


def read_deck(path: Path, units: UnitSystem) -> Mesh:
    """Read the body in a deck's model part; the steps are the analysis of something else and left unused.

    Parameters
    ----------
    path : Path
        A deck, flat or of parts and instances, with included files relative to the including one.
    units : UnitSystem
        What the deck's numbers are in.

    Returns
    -------
    Mesh
        SI units. Elements are in one block for each type. Surfaces are node sets. Sets of instances are called
        ``instance.set``. Constants of materials that the deck does not tell are NaN.

    Raises
    ------
    MeshError
        The file cannot be read, or holds no nodes or no elements.
    DeckError
        A line cannot be honoured.
    """
    content = _Content(DeckMaterials(units))
    content.sort(content.assembly.flat(read_cards(path)))
    elements = content.elements.resolved(content.nodes)
    heights: dict[int, structures.Faces] = {}
    thickness: dict[int, float] = {}
    beams: dict[int, Beam] = {}
    if content.structures or any(one.dimension == 1 for one in content.elements.known.values()):
        deck = content.deck(elements, units)
        thickness = structures.thickness_by_node(content.cards["NODALTHICKNESS"], deck)
        cards, table, materials = content.structures, content.elements, content.materials
        heights = structures.take_shells([k for k in cards if k.key == structures.KEY], deck, table, materials)
        long = [*(k for k in cards if k.key in structures.KEYS), *content.cards["SOLIDSECTION"]]
        beams = structures.take_beams(long, deck, table, materials)
        elements = content.elements.resolved(content.nodes)
    if not content.nodes.rows or not elements.blocks:
        missing = "elements (*ELEMENT of solids)" if content.nodes.rows else "nodes (*NODE)"
        found = f" (found: {listed(sorted({one.name for one in elements.others}))})" if elements.others else ""
        raise MeshError(f"{path} defines no {missing} outside its steps{found}; give a deck that holds the body's mesh")
    _refuse_early_end(content, elements)
    content.beams = bool(beams)
    content.reach = max((abs(side) for one in heights.values() for side in one[:2]), default=0.0)
    content.reach *= max(thickness.values(), default=1.0)
    mesh, turning = _mesh(content, content.deck(elements, units))
    if beams:
        mesh, turning = with_beams(mesh, beams, turning)
    if not heights:
        return mesh
    thick = units.length * structures.by_element(heights, mesh.blocks, mesh.labels, thickness)
    try:
        return expanded(mesh, thick, turning, content.ties)
    except FoldedShellError as error:
        raise content.elements.known[error.label].line.error(str(error)) from error


def _mesh(content: "_Content", deck: Deck) -> tuple[Mesh, BoolArray]:
    """The mesh, of shells the middle surface, and the rotations (n, 3) that are held."""
    node_sets, element_sets, elements, units, _ = deck
    blocks = elements.blocks
    _refuse_structures(content, deck)
    named = {card.scope.qualified(card.required("NAME")): card for card in content.cards["SURFACE"]}
    surfaces = {name: surface(card, deck) for name, card in named.items()}
    # They are node sets, too, where their name is free.
    own = {name: found for name, found in surfaces.items() if name.upper() not in node_sets.members}
    for name in (one for one in surfaces if one not in own):
        content.notes.append(f"{named[name].line.place}: surface '{name}' is left unused: a node set has its name")
    fixed = np.zeros((len(content.nodes.rows), 6), dtype=bool)
    for card in content.cards["BOUNDARY"]:
        content.notes += hold(card, deck, fixed)
    points = content.nodes.points()
    axes = _transformed(content, node_sets, points)
    by_steps = held_by_steps(content.steps, deck, axes)
    content.notes += [f"steps hold the node sets {', '.join(by_steps)}: hold them by [[support]]"] * bool(by_steps)
    rows = inclined(axes, fixed, content.cards["TRANSFORM"][-1]) if axes else []
    if rows:
        content.notes.append(f"{len(rows)} inclined supports of *TRANSFORM are equations: boundary = false leaves them")
    used = {row for block in blocks for row in block.connectivity.ravel().tolist()}
    rows += _equations(content, deck, surfaces, points, axes, used | {*np.nonzero(fixed)[0].tolist()})
    couplings = resolved(content.couplings, deck, own)
    turning = {row for block in blocks if block.type.beam for row in block.connectivity.ravel().tolist()}
    # Nodes whose displacement equations and supports determine in all directions carry, too.
    keys = {key for row in rows for key in row}
    tied = {key // 3 for key in keys if all(3 * (key // 3) + k in keys or fixed[key // 3, k] for k in range(3))}
    carriers = Carriers(deck, points * units.length, fixed, used | tied, turning, couplings)
    heavy, soft = ([card for key in keys for card in content.cards[key]] for keys in (MASSES, SPRINGS))
    masses = point_masses(heavy, carriers)
    springs = deck_springs(soft, carriers, content.materials.orientations, axes.keys())
    used |= {key // 3 for row in rows for key in row}
    coupled, references, links, pinned, told = offered(couplings, points * units.length, fixed, used)
    rows += pinned
    content.notes.extend(told)
    materials, made = content.materials.assigned(element_sets, blocks, points)
    faces = _sets_of_faces(content, deck)
    telling = (content.assembly, content.elements, content, node_sets, element_sets, content.materials)
    mesh = Mesh(
        points=points * units.length,
        labels=content.nodes.labels(),
        blocks=made,
        node_sets=node_sets.arrays() | {name: found.nodes for name, found in own.items()} | faces | coupled | by_steps,
        element_sets=_solids(element_sets, elements.solid_count),
        materials=materials,
        fixed=fixed[:, :3],
        references=references,
        masses=masses,
        springs=springs,
        links=tuple(links),
        equations=matrix_of(rows, 3 * len(points)) if rows else None,
        notes=tuple(note for part in telling for note in part.notes),
    )
    return mesh, fixed[:, 3:]


@dataclass(slots=True)
class _Content:
    """A deck's cards, sorted by what they define; sets wait until all nodes and elements are known."""

    materials: DeckMaterials
    assembly: Assembly = field(default_factory=Assembly)
    nodes: NodeTable = field(default_factory=NodeTable)
    elements: ElementTable = field(default_factory=ElementTable)
    sets: list[tuple[Card, list[int]]] = field(default_factory=list)
    couplings: list[Card] = field(default_factory=list)
    structures: list[Card] = field(default_factory=list)
    cards: dict[str, list[Card]] = field(default_factory=lambda: defaultdict(list))
    reach: float = 0.0
    beams: bool = False
    ties: list[OfShell] = field(default_factory=list)
    steps: list[list[Card]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    last: Card | None = None

    def sort(self, cards: Iterator[Card]) -> None:
        """Take all cards."""
        told: set[str] = set()
        for card in cards:
            self.last = card
            if card.key == "STEP":
                self.steps.append(_skipped_step(card, cards, self.notes))
            elif card.key == "TIE" and "CYCLICSYMMETRY" in card.parameters:
                self.notes.append(f"{card.line.place}: {unused(card.keyword, 'CYCLICSYMMETRYMODEL')}")
            elif card.key in PARAMETERS:
                card.allow(PARAMETERS[card.key])
                self._take(card)
            elif card.key in SECTIONS:
                self.structures.append(card)
            elif card.key in UNUSED:
                # A card of a part stands once for each of its instances.
                note = f"{card.line.place}: {unused(card.keyword, card.key)}"
                self.notes.extend([note] * (note not in told))
                told.add(note)
            elif card.key not in HARMLESS:
                raise _unsupported(card)

    def deck(self, elements: Elements, units: UnitSystem) -> Deck:
        """What the cards name."""
        offsets = self.assembly.offsets
        node_sets = SetTable("node", self.nodes.rows, offsets)
        element_sets = SetTable("element", self.elements.positions(), offsets)
        for card, labels in self.sets:
            if card.key in ("NODE", "ELEMENT"):
                table, parameter = (node_sets, "NSET") if card.key == "NODE" else (element_sets, "ELSET")
                if parameter in card.parameters:
                    table.extend(card.scope.qualified(card.required(parameter)), map(table.rows.__getitem__, labels))
            elif card.key == "ELSET":
                element_sets.add(card, card.required("ELSET"))
            elif "ELSET" in card.parameters:
                # *NSET, ELSET=...: the nodes of these elements.
                members = element_sets.find(card.parameters["ELSET"], card.line, node_sets.inside(card))
                node_sets.extend(card.scope.qualified(card.required("NSET")), elements.nodes_of(members))
            else:
                node_sets.add(card, card.required("NSET"))
        return Deck(node_sets, element_sets, elements, units, self.notes)

    def _take(self, card: Card) -> None:
        of_material = {
            "MATERIAL": self.materials.begin,
            "ELASTIC": self.materials.elastic,
            "DENSITY": self.materials.density,
            "SOLIDSECTION": self.materials.section,
            "ORIENTATION": self.materials.oriented,
            "DISTRIBUTION": self.materials.distributed,
        }
        if card.key in ("NODE", "ELEMENT"):
            self.sets.append((card, (self.nodes if card.key == "NODE" else self.elements).add(card)))
        elif card.key in ("NSET", "ELSET"):
            self.sets.append((card, []))
        elif card.key in of_material:
            of_material[card.key](card)
            self.cards[card.key].append(card)
        elif card.key in COUPLINGS:
            self.couplings.append(card)
        else:
            self.cards[card.key].append(card)


def _refuse_early_end(content: _Content, elements: Elements) -> None:
    """Refuse a deck whose last card lists elements while nodes are left over: some elements may be missing."""
    if content.last is None or content.last.key != "ELEMENT":
        return
    named = [block.connectivity.ravel() for block in elements.blocks]
    named += [np.array(content.nodes.rows_of(other)) for other in elements.others]
    used = np.isin(np.arange(len(content.nodes.rows)), np.concatenate(named))
    if not used.all():
        raise content.last.line.error(
            f"the deck ends with this *ELEMENT, and {int(np.sum(~used))} of its {len(used)} nodes belong to no element "
            f"({listed(content.nodes.labels()[~used])}). It may have been cut short: write it again. If they are "
            "meant to be left over, end the deck with another card, such as *NSET"
        )


def _unsupported(card: Card) -> DeckError:
    return card.line.error(
        f"*{card.keyword} is not supported, and may belong to the body (supported: *{', *'.join(HONOURED)}, *INCLUDE, "
        "*PART, *INSTANCE, *ASSEMBLY); say the same with these, or take it out if the body is the same without it"
    )


def _skipped_step(step: Card, cards: Iterator[Card], notes: list[str]) -> list[Card]:
    """Pass over the cards up to *END STEP, note their names and return those that hold nodes."""
    passed: list[Card] = []
    for card in cards:
        if card.key == "ENDSTEP":
            end = f"{card.line.number}" + f" of {card.line.file}" * (card.line.file != step.line.file)
            names = ", ".join(dict.fromkeys(f"*{one.keyword}" for one in passed)) or "empty"
            where = f"{step.line.file}, lines {step.line.number} to {end}"
            notes.append(f"{where}: a step is analysis and left unused: {names}")
            return [one for one in passed if one.key == "BOUNDARY"]
        if card.key == "STEP":
            break
        passed.append(card)
    raise step.line.error("this *STEP has no *END STEP; add it, so that the analysis can be told from the body")


def _refuse_structures(content: _Content, deck: Deck) -> None:
    """Refuse sections that make membranes, frames or bars of what would otherwise serve sets."""
    for card in content.structures:
        if card.key in (structures.KEY, *structures.KEYS):
            continue
        if "ELSET" in card.parameters and deck.members(card):
            found = f"*{card.keyword} makes a membrane or frame of elements of set '{card.parameters['ELSET']}'"
            advice = "only solids, shells and beams are supported; mesh this part of the body with these"
            raise card.line.error(f"{found}: {advice}")


def _transformed(content: _Content, node_sets: SetTable, points: FloatArray) -> dict[int, FloatArray]:
    """Axes (3, 3) of nodes by *TRANSFORM, as columns, by row of the node."""
    found: dict[int, FloatArray] = {}
    for card in content.cards["TRANSFORM"]:
        rows = sorted(node_sets.find(card.required("NSET"), card.line, card.scope))
        kind = {"R": "RECTANGULAR", "C": "CYLINDRICAL"}.get(given := card.parameters.get("TYPE", "R").upper(), given)
        found |= zip(rows, orientation(replace(card, parameters={"SYSTEM": kind})).axes(points[rows]), strict=True)
    return found


def _equations(
    content: _Content,
    deck: Deck,
    surfaces: Mapping[str, DeckSurface],
    points: FloatArray,
    axes: Mapping[int, FloatArray],
    busy: Set[int],
) -> list[Row]:
    """Equations of *TIE, which may move nodes, of *EQUATION and of *MPC."""
    found: list[Row] = []
    table = TieTable(points, content.reach)
    shells = deck.turning if content.cards["TIE"] else set()
    for card in (*content.cards["TIE"], *content.cards["SHELLTOSOLIDCOUPLING"]):
        tied = table.rows(card, surfaces)
        if any(key // 3 in shells for row in tied for key in row) or (table.shells and content.beams):
            raise card.line.error(
                "*TIE joins shells to solids, or beams, which would turn freely there: let the shells be the second "
                "surface, use *SHELL TO SOLID COUPLING at their edges, or let parts share nodes"
            )
        found += tied
    content.ties = table.shells
    content.notes.extend(table.notes)
    return found + equations([*content.cards["EQUATION"], *content.cards["MPC"]], deck, points, axes, busy)


def _sets_of_faces(content: _Content, deck: Deck) -> dict[str, IntArray]:
    """Node sets of the element sets that hold faces or edges, which are no part of the body by themselves."""
    node_sets, element_sets, elements, *_ = deck
    faces = [other for other in elements.others if other.dimension]
    if faces:
        kinds = ", ".join(dict.fromkeys(other.name for other in faces))
        content.notes.append(f"{len(faces)} elements of type {kinds} without a section are no solids: they serve sets")
    found = {}
    for name, members in element_sets.members.items():
        chosen = [other for other in elements.others_of(members) if other.dimension]
        if chosen and name not in node_sets.members:
            rows = {row for other in chosen for row in content.nodes.rows_of(other)}
            found[element_sets.spelling[name]] = np.array(sorted(rows), dtype=np.int64)
    return found


def _solids(element_sets: SetTable, count: int) -> dict[str, IntArray]:
    """Element sets without what is no solid; those of nothing else are left out."""
    found = element_sets.arrays()
    return {name: rows[rows < count] for name, rows in found.items() if not rows.size or rows[0] < count}
