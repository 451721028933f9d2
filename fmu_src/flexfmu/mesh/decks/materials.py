"""Materials of a deck, their elastic constants, and the sections of solids and shells that name them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from flexfmu.files.basics import FloatArray, IntArray, UnitsError, UnitSystem, listed
from flexfmu.mesh.checks import is_likely_density
from flexfmu.mesh.decks.cards import Card, Line, Scope, fields, number
from flexfmu.mesh.decks.orientation import Orientation, orientation
from flexfmu.mesh.decks.sets import SetTable
from flexfmu.mesh.elements import ElementBlock
from flexfmu.mesh.model import NO_MATERIAL, Material, isotropic_average, laminate
from flexfmu.model.arrays import whole

# Constants a row holds at most, in both solvers.
_ROW = 8
# Number of constants of each type; a temperature may follow them.
_COUNTS = {"ISO": 2, "ISOTROPIC": 2, "ENGINEERINGCONSTANTS": 9, "ENGCONSTANTS": 9, "ORTHO": 9, "ORTHOTROPIC": 9,
           "ANISO": 21, "ANISOTROPIC": 21}  # fmt: skip
_WORDS = {2: "Young's modulus, Poisson's ratio", 9: "nine constants", 21: "21 constants"}
# Places of 11, 22, 33, 12, 13, 23, the decks' order, among xx, yy, zz, xy, yz, zx.
_PLACES = np.array([0, 1, 2, 3, 5, 4])


def _isotropic(line: Line, values: list[float], units: UnitSystem) -> tuple[float, float]:
    youngs, poisson = values[0] * units.stress, values[1]
    if youngs <= 0.0:
        raise line.error(f"Young's modulus should be positive, found {values[0]:g}")
    if not -1.0 < poisson < 0.5:
        raise line.error(f"Poisson's ratio should lie between -1 and 0.5 (both excluded), found {poisson:g}")
    return youngs, poisson


def _matrix(kind: str, values: FloatArray, line: Line, units: UnitSystem) -> tuple[float, ...]:
    """Matrix (6, 6) in the order xx, yy, zz, xy, yz, zx of an anisotropic material's constants, N/m², by rows."""
    matrix = np.zeros((6, 6))
    if values.size == 21:
        # Upper triangle, column by column.
        matrix[:] = whole(values)
    elif kind.startswith("ORTHO"):
        matrix[:3, :3] = whole(values[:6])
        matrix[range(3, 6), range(3, 6)] = values[6:]
    else:
        moduli, ratios, shear = values[:3], values[3:6], values[6:]
        if min(*moduli, *shear) <= 0.0:
            raise line.error("Young's moduli and shear moduli should be positive")
        compliance = np.diag(1.0 / np.concatenate([moduli, shear]))
        for (i, j), ratio in zip(((0, 1), (0, 2), (1, 2)), ratios, strict=True):
            compliance[i, j] = compliance[j, i] = -ratio / moduli[i]
        if np.linalg.eigvalsh(compliance)[0] <= 0.0:
            raise line.error("these moduli and Poisson's ratios belong to no material; check their order")
        matrix[:] = np.linalg.inv(compliance)
    matrix = matrix[np.ix_(_PLACES, _PLACES)] * units.stress
    if not np.isfinite(matrix).all() or np.linalg.eigvalsh(matrix)[0] <= 0.0:
        found = "these elastic constants belong to no material: some deformation would give energy back"
        raise line.error(f"{found}; check their order and Poisson's ratios")
    return tuple(matrix.ravel().tolist())


# Hardly any solid lies outside, kg/m³; a deck whose units are not the declared ones misses by 1e6 and more.
DENSITY_RANGE = (1e-4, 1e5)
# Differences of directions that are none.
_SAME = 1e-6


def untold(name: str) -> Material:
    """A material of which nothing is said."""
    return Material(name, np.nan, np.nan, np.nan)


def _vectors(line: Line) -> Line:
    """A row of a distribution without the element or set."""
    return line._replace(text=line.text.partition(",")[2])


class Ply(NamedTuple):
    """A row of *SHELL SECTION, COMPOSITE: `direction` is an angle in degrees, or an orientation."""

    thickness: float
    material: str
    direction: str
    line: Line


class Section(NamedTuple):
    """A section: an element set made of a material, or of layers."""

    element_set: str
    material: str
    orientation: str
    line: Line
    scope: Scope
    shell: bool
    layers: tuple[Ply, ...]


def plies(card: Card) -> tuple[Ply, ...]:
    """Layers of a *SHELL SECTION; none without COMPOSITE."""
    if "COMPOSITE" not in card.parameters:
        return ()
    found = []
    for line in card.data:
        thickness, _, material, direction, *_ = [*fields(line), "", "", ""]
        found.append(Ply(number(thickness, line, "the thickness of the layer"), material, direction, line))
        if found[-1].thickness <= 0.0 or not material:
            raise line.error("a layer should have a positive thickness, then, third, its material; correct the row")
    if not found:
        raise card.line.error("*SHELL SECTION, COMPOSITE should have a row for each layer; add them")
    return (*found, *(found[::-1] if "SYMMETRIC" in card.parameters else ()))


@dataclass(slots=True)
class DeckMaterials:
    """The materials and sections read so far.

    Attributes
    ----------
    units : UnitSystem
    cards : dict of str to (Line, Material)
        By name in capitals: where it begins, and what is said of it so far; constants that are not are NaN.
    sections : list of Section
    orientations : dict of str to Orientation
    distributions : dict of str to Card
    exceptions : list of (Orientation, Line, Orientation)
        Where elements that a line of a distribution names have another orientation than the rest.
        By qualified name in capitals.
    notes : list of str
    """

    units: UnitSystem
    cards: dict[str, tuple[Line, Material]] = field(default_factory=dict)
    sections: list[Section] = field(default_factory=list)
    orientations: dict[str, Orientation] = field(default_factory=dict)
    distributions: dict[str, Card] = field(default_factory=dict)
    exceptions: list[tuple[Orientation, Line, Orientation]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def begin(self, card: Card) -> None:
        """Take a *MATERIAL card, to which the following cards belong.

        Parameters
        ----------
        card : Card

        Raises
        ------
        DeckError
            The material has no name, or there is one of the same name.
        """
        name = card.required("NAME")
        if name.upper() in self.cards:
            raise card.line.error(f"material '{name}' is defined again; rename or remove one of them")
        self.cards[name.upper()] = card.line, untold(name)

    def elastic(self, card: Card) -> None:
        """Take an *ELASTIC card; of several temperatures the first.

        Parameters
        ----------
        card : Card

        Raises
        ------
        DeckError
            Its type is not supported, constants are missing, or it is not physical.
        """
        kind = card.parameters.get("TYPE", "ISO").upper()
        count = _COUNTS.get(kind.replace(" ", ""))
        if count is None:
            found = f"*ELASTIC, TYPE={kind} is not supported"
            advice = "give ISOTROPIC, ENGINEERING CONSTANTS, ORTHOTROPIC or ANISOTROPIC constants"
            raise card.line.error(f"{found}; {advice}")
        rows = -(-count // _ROW)
        values = [number(text, line, f"each of {_WORDS[count]}") for line in card.data[:rows] for text in fields(line)]
        if not count <= len(values) <= count + 1:
            raise card.first.error(f"*ELASTIC should have {_WORDS[count]}, found {len(values)} numbers")
        if len(card.data) > rows:
            at = f" ({values[count]:g})" if len(values) > count else ""
            taken = f"the elastic constants of the first temperature{at} are taken for all"
            self.notes.append(f"{card.line.place}: {taken}")
        line, constants = card.data[0], None
        if count > 2:
            constants = _matrix(kind, np.array(values[:count]), line, self.units)
        modulus, ratio = isotropic_average(constants) if constants else _isotropic(line, values, self.units)
        self._tell(card, youngs_modulus=modulus, poissons_ratio=ratio, constants=constants)

    def density(self, card: Card) -> None:
        """Take a *DENSITY card.

        Parameters
        ----------
        card : Card

        Raises
        ------
        DeckError
            It has no number, or is not physical in the declared units.
        """
        if not card.row:
            raise card.line.error("*DENSITY should have the row 'density'")
        line = card.first
        value = number(card.row[0], line, "the density")
        if len(card.data) > 1:
            self.notes.append(f"{line.place}: the density of the first row is taken, {value:g}, at all temperatures")
        density = value * self.units.density
        if not DENSITY_RANGE[0] <= density <= DENSITY_RANGE[1]:
            likely = [
                f"; if the file is in {other.value}, where it is {value * other.density:g} kg/m³, set units = "
                f'"{other.value}" in [mesh]'
                for other in UnitSystem
                if is_likely_density(value * other.density)
            ]
            raise UnitsError(
                f"density {value:g} means {density:g} kg/m³ in the declared units {self.units.value}, "
                f"expected {DENSITY_RANGE[0]:g} to {DENSITY_RANGE[1]:g}"
                + ("".join(likely) or "; correct the density or the units given for this file"),
                line.file,
                line.number,
            )
        self._tell(card, density=density)

    def section(self, card: Card) -> None:
        """Take a *SOLID SECTION card, or that of shells or beams.

        Parameters
        ----------
        card : Card

        Raises
        ------
        DeckError
            Its element set or material is not given.
        """
        name = card.parameters.get("ORIENTATION", "")
        layers, elements = plies(card), card.required("ELSET")
        material = f"layers of {elements}, {card.line.place}" if layers else card.required("MATERIAL")
        shell = card.key == "SHELLSECTION"
        self.sections.append(Section(elements, material, name, card.line, card.scope, shell, layers))

    def oriented(self, card: Card) -> None:
        """Take an *ORIENTATION card.

        Parameters
        ----------
        card : Card

        Raises
        ------
        DeckError
            As of `orientation`.
        """
        name = next(iter(card.row), "")
        rest = Card("", {}, card.line)
        if name and not name.lstrip("+-.")[:1].isdigit():
            rest = card.scope.find(name, self.distributions, "distribution", card.data[0])
            card = replace(card, data=[_vectors(line) for line in rest.data[:1]] + card.data[1:])
        own = orientation(card)
        self.orientations[card.scope.qualified(card.required("NAME")).upper()] = own
        for line in rest.data[1:]:
            self.exceptions.append((own, line, orientation(replace(card, data=[_vectors(line), *card.data[1:]]))))

    def distributed(self, card: Card) -> None:
        """Take a *DISTRIBUTION of orientations.

        Parameters
        ----------
        card : Card
            Before the *ORIENTATION that names it; its first row is that of all other elements.
        """
        self.distributions[card.scope.qualified(card.required("NAME")).upper()] = card

    def assigned(
        self, element_sets: SetTable, blocks: Sequence[ElementBlock], points: FloatArray
    ) -> tuple[tuple[Material, ...], tuple[ElementBlock, ...]]:
        """Return the materials that sections name, and the elements with these.

        Parameters
        ----------
        element_sets : SetTable
        blocks : sequence of ElementBlock
        points : (n, 3) float
            In the deck's units.

        Returns
        -------
        materials : tuple of Material
            Constants that the deck does not tell are NaN.
        blocks : tuple of ElementBlock
            With axes where any material has a direction.

        Raises
        ------
        DeckError
            A section names an unknown set or orientation, or an element has two materials.
        """
        made: dict[str, Material] = {}
        labels = np.concatenate([block.labels for block in blocks])
        centres = np.concatenate([points[block.connectivity].mean(axis=1) for block in blocks])
        rows = np.full(len(labels), NO_MATERIAL, dtype=np.int64)
        axes, directed = np.tile(np.eye(3), (len(labels), 1, 1)), False
        for section in self.sections:
            found = element_sets.find(section.element_set, section.line, section.scope)
            members = np.array(sorted(one for one in found if one < len(labels)), dtype=np.int64)
            base = self._axes(section, centres[members])
            self._except(section, element_sets, members, centres[members], base)
            name = section.material.upper()
            if name not in made:
                layered = section.layers and len(members)
                made[name] = self._laminate(section, centres[members], base) if layered else self._material(section)
            row = list(made).index(name)
            taken = members[(rows[members] != NO_MATERIAL) & (rows[members] != row)]
            if len(taken):
                raise section.line.error(
                    f"elements of set '{section.element_set}' have the material "
                    f"'{[*made.values()][rows[taken[0]]].name}' already: {listed(labels[taken])}; "
                    f"give each element one section"
                )
            rows[members] = row
            axes[members] = base
            directed |= made[name].constants is not None or bool(section.layers)
        used = {layer.material.upper() for section in self.sections for layer in section.layers} | made.keys()
        idle = [card for key, card in self.cards.items() if key not in used]
        self.notes += [f"{line.place}: no section uses the material '{one.name}'" for line, one in idle]
        ends = np.cumsum([len(block.labels) for block in blocks])[:-1]
        every = zip(blocks, np.split(rows, ends), np.split(axes, ends), strict=True)
        parts = (replace(block, material=row, axes=own if directed else None) for block, row, own in every)
        return tuple(made.values()), tuple(parts)

    def _axes(self, section: Section, places: FloatArray, name: str = "") -> FloatArray:
        """Axes (n, 3, 3), as columns, of a section's orientation or another; of shells the last is the normal's."""
        name, scope = name or section.orientation, section.scope
        if not name:
            return np.tile(np.eye(3) if scope.rotation is None else scope.rotation, (len(places), 1, 1))
        return self._found(section, name).at(places, shell=section.shell)

    def _found(self, section: Section, name: str) -> Orientation:
        return section.scope.find(name, self.orientations, "orientation", section.line)

    def _except(self, section: Section, sets: SetTable, members: IntArray, at: FloatArray, base: FloatArray) -> None:
        """Give axes (n, 3, 3) of a section those of the elements that a distribution names."""
        for general, line, own in self.exceptions:
            if section.orientation and self._found(section, section.orientation) is general:
                inside = np.isin(members, [*sets.find(fields(line)[0], line, section.scope)])
                base[inside] = own.at(at[inside], shell=section.shell)

    def _laminate(self, section: Section, places: FloatArray, base: FloatArray) -> Material:
        """What a section with layers is made of, whose axes are `base` at places; they become that of a layer."""
        materials = [self._material(section._replace(material=layer.material)) for layer in section.layers]
        texts = [layer.direction for layer in section.layers]
        named = [text for text in texts if text and not text.lstrip("+-.")[:1].isdigit()]
        if not named:
            degrees = [number(one.direction, one.line, "the angle of the layer", 0.0) for one in section.layers]
            angles = np.radians(degrees).tolist()
        else:
            if any(text and text not in named for text in texts):
                raise section.line.error("layers have angles and orientations; give them one or the other")
            if not section.orientation:
                base[:] = self._axes(section, places, named[0])
            own = [self._axes(section, places, text) for text in texts]
            turns = [base.swapaxes(1, 2) @ one for one in own]
            if any(np.ptp(one, axis=0).max() > _SAME or abs(one[0, 2, 2]) < 1.0 - _SAME for one in turns):
                expected = "differ by turns about one axis, the same in all elements"
                raise section.line.error(f"the orientations of the layers should {expected}")
            angles = [float(np.arctan2(one[0, 1, 0], one[0, 0, 0])) for one in turns]
        heights = [layer.thickness for layer in section.layers]
        return laminate(section.material, list(zip(heights, angles, materials, strict=True)), by_normal=not named)

    def _material(self, section: Section) -> Material:
        if section.material.upper() in self.cards:
            return self.cards[section.material.upper()][1]
        self.notes.append(f"{section.line.place}: the deck does not define the material '{section.material}'")
        return untold(section.material)

    def _tell(self, card: Card, **constants: Any) -> None:
        """Say more of the last material."""
        if not self.cards:
            raise card.line.error(f"*{card.keyword} stands before any *MATERIAL; put it below the one it belongs to")
        name, (line, known) = [*self.cards.items()][-1]
        self.cards[name] = line, replace(known, **constants)
