"""*TIE of a deck: nodes of one surface move as the places of another surface's faces, or shells, that they lie on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from flexfmu.files.array_types import FloatArray, IntArray
from flexfmu.mesh.blocks import face_corners
from flexfmu.mesh.decks.cards import Card, fields, number
from flexfmu.mesh.decks.equations import TRANSLATIONS, joined
from flexfmu.mesh.decks.sets import DeckSurface
from flexfmu.mesh.nearest import nearest_faces, weighted
from flexfmu.mesh.shell_ties import EdgeTie, OfShell, ShellTie

# Distance from a face, over the mean edge of the faces, up to which a node is tied where the deck does not say.
_NEAR = 0.05


@dataclass(slots=True)
class TieTable:
    """Nodes that have been tied so far.

    Attributes
    ----------
    points : (n, 3) float
        In the deck's units; changed where a tie moves nodes onto their face.
    tied : set of int
    reach : float
        How far faces of shells are from their nodes, in the deck's units.
    shells : list of ShellTie or EdgeTie
    notes : list of str
    """

    points: FloatArray
    reach: float
    tied: set[int] = field(default_factory=set)
    shells: list[OfShell] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def rows(self, card: Card, surfaces: Mapping[str, DeckSurface]) -> list[dict[int, float]]:
        """Return the equations of a *TIE or *SHELL TO SOLID COUPLING; ties of shells go to `shells`.

        Parameters
        ----------
        card : Card
        surfaces : mapping of str to DeckSurface

        Returns
        -------
        list of dict of int to float

        Raises
        ------
        DeckError
            A surface is missing or has no faces, or no node lies near a face.
        """
        found: list[dict[int, float]] = []
        tolerance = card.parameters.get("POSITIONTOLERANCE", "")
        given = number(tolerance, card.line, "POSITION TOLERANCE") if tolerance else None
        edge = card.keyword != "TIE"
        for line in card.data:
            names = fields(line)
            if len(names) != 2:
                raise line.error(f"*{card.keyword} takes 'dependent surface, main surface', found {len(names)} names")
            dependent, main = (card.scope.find(name, surfaces, "surface", card.line) for name in names)
            faces = (*main.faces, *main.shells)
            if not faces or (main.shells and (main.faces or edge)):
                words = "no element faces" if not faces else "faces of shells" if edge else "faces of solids and shells"
                raise line.error(
                    f"surface '{names[1]}' has {words} to tie to; exchange both, or name faces of one kind"
                )
            nodes = np.array([node for node in dependent.nodes.tolist() if node not in self.tied], dtype=np.int64)
            nodes = np.setdiff1d(nodes, np.concatenate([block.ravel() for block in faces]))
            near = given if given is not None else _NEAR * _edge(self.points, faces)
            near += 2.0 * self.reach if main.shells else 0.0
            nearest = nearest_faces(self.points, nodes, faces, near)
            if not nearest:
                raise line.error(
                    f"none of the {len(nodes)} nodes of '{names[0]}' lies within {near:.4g} of the faces of "
                    f"'{names[1]}': the parts stay apart; give a larger POSITION TOLERANCE, or correct the surfaces"
                )
            self.tied.update(nearest)
            told = f"{card.line.place}: {len(nearest)} nodes of '{names[0]}' "
            left = len(nodes) - len(nearest)
            more = f"; {left} lie too far from them and stay free" if left else ""
            if edge:
                self.shells += [EdgeTie(node, main.faces) for node in nearest]
                more = f"are held by '{names[1]}' through their thickness{more}"
            elif main.shells:
                self.shells += [ShellTie(node, face) for node, (face, _) in nearest.items()]
                more = f"are tied to shells of '{names[1]}' and turn with them{more}"
            else:
                place = {node: weighted(*one) for node, one in nearest.items()}
                found += [joined(node, one, axis) for node, one in place.items() for axis in range(TRANSLATIONS)]
                more = f"are tied to faces of '{names[1]}'{more}{self._moved(card, place)}"
            self.notes.append(told + more)
        return found

    def _moved(self, card: Card, place: Mapping[int, Mapping[int, float]]) -> str:
        """Move nodes onto their faces where the deck does not forbid it; what was done."""
        target = {node: sum(w * self.points[other] for other, w in weights.items()) for node, weights in place.items()}
        gap = max(float(np.linalg.norm(self.points[node] - at)) for node, at in target.items())
        if card.parameters.get("ADJUST", "YES").upper() == "NO":
            return f"; they lie up to {gap:.3g} beside them, ADJUST=NO: the joint resists turning" if gap else ""
        for node, at in target.items():
            self.points[node] = at
        return f"; they were moved onto them, by up to {gap:.3g}" if gap else ""


def _edge(points: FloatArray, faces: Sequence[IntArray]) -> float:
    """Mean distance of neighbouring corners."""
    lengths = []
    for block in faces:
        corners = points[block[:, : face_corners(block)]]
        lengths.append(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).ravel())
    return float(np.concatenate(lengths).mean())
