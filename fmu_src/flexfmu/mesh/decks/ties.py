"""*TIE of a deck: nodes of one surface move as the places of another surface's faces, or shells, that they lie on."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from flexfmu.files.array_types import FloatArray, IntArray
from flexfmu.mesh.blocks import face_corners
from flexfmu.mesh.decks.cards import Card, fields, number
from flexfmu.mesh.decks.equations import TRANSLATIONS, joined
from flexfmu.mesh.decks.sets import DeckSurface
from flexfmu.mesh.shapes import FACE_SHAPES
from flexfmu.mesh.shell_ties import ShellTie

# Distance from a face, over the mean edge of the faces, up to which a node is tied where the deck does not say.
_NEAR = 0.05
# Rounds and step, in a face's own coordinates, with which the nearest place on it is found.
_ROUNDS, _SETTLED = 20, 1e-12
# Weights below this are round-off: the node lies on an edge or on a node of the face.
_NO_WEIGHT = 1e-9


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
    shells : list of ShellTie
    notes : list of str
    """

    points: FloatArray
    reach: float
    tied: set[int] = field(default_factory=set)
    shells: list[ShellTie] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def rows(self, card: Card, surfaces: Mapping[str, DeckSurface]) -> list[dict[int, float]]:
        """Return the equations of a *TIE card.

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
        for line in card.data:
            names = fields(line)
            if len(names) != 2:
                raise line.error(f"*TIE takes 'dependent surface, main surface', found {len(names)} names")
            dependent, main = (card.scope.find(name, surfaces, "surface", card.line) for name in names)
            faces = (*main.faces, *main.shells)
            if not faces or (main.faces and main.shells):
                words = "faces of solids and shells" if faces else "no element faces"
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
            if main.shells:
                self.shells += [ShellTie(node, face) for node, (face, _) in nearest.items()]
                left = f"; {len(nodes) - len(nearest)} lie too far from them and stay free"
                self.notes.append(
                    f"{card.line.place}: {len(nearest)} nodes of '{names[0]}' are tied to shells of '{names[1]}', with "
                    f"their turns{left if len(nearest) < len(nodes) else ''}"
                )
                continue
            place = {node: weighted(*one) for node, one in nearest.items()}
            for node, weights in place.items():
                found += [joined(node, weights, axis) for axis in range(TRANSLATIONS)]
            self._tell(card, names, len(nodes), place)
        return found

    def _tell(self, card: Card, names: Sequence[str], count: int, place: Mapping[int, Mapping[int, float]]) -> None:
        """Move nodes onto their faces where the deck does not forbid it, and say what was done."""
        target = {node: sum(w * self.points[other] for other, w in weights.items()) for node, weights in place.items()}
        gap = max(float(np.linalg.norm(self.points[node] - at)) for node, at in target.items())
        note = f"{card.line.place}: {len(place)} nodes of '{names[0]}' are tied to faces of '{names[1]}'"
        if len(place) < count:
            note += f"; {count - len(place)} lie too far from them and stay free"
        if card.parameters.get("ADJUST", "YES").upper() == "NO":
            note += f"; they lie up to {gap:.3g} beside them, ADJUST=NO: the joint resists turning" if gap else ""
        else:
            for node, at in target.items():
                self.points[node] = at
            note += f"; they were moved onto them, by up to {gap:.3g}" if gap else ""
        self.notes.append(note)


def _edge(points: FloatArray, faces: Sequence[IntArray]) -> float:
    """Mean distance of neighbouring corners."""
    lengths = []
    for block in faces:
        corners = points[block[:, : face_corners(block)]]
        lengths.append(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).ravel())
    return float(np.concatenate(lengths).mean())


def weighted(face: Sequence[int], value: FloatArray) -> dict[int, float]:
    """Shape functions at a place of a face by its nodes, without round-off."""
    return {int(node): float(w) for node, w in zip(face, value, strict=True) if abs(w) > _NO_WEIGHT}


def nearest_faces(
    points: FloatArray, nodes: IntArray, faces: Sequence[IntArray], near: float
) -> dict[int, tuple[tuple[int, ...], FloatArray]]:
    """Return where on faces nodes lie.

    Parameters
    ----------
    points : (n, 3) float
    nodes : (k,) int
    faces : sequence of (f, a) int
    near : float
        Greatest distance.

    Returns
    -------
    dict of int to (tuple of int, (a,) float)
        Nodes of the face and their shape functions at the nearest place, by node; those farther away are left out.
    """
    best: dict[int, tuple[float, tuple[int, ...], FloatArray]] = {}
    for block in faces if len(nodes) else ():
        centre = points[block].mean(axis=1)
        reach = float(np.linalg.norm(points[block] - centre[:, None], axis=2).max()) + near
        inside = cKDTree(centre).query_ball_point(points[nodes], reach * (1.0 + _NO_WEIGHT))
        pairs = [(node, face) for node, found in zip(nodes.tolist(), inside, strict=True) for face in found]
        if not pairs:
            continue
        node, face = np.array(pairs).T
        value, distance = _projected(points[node], points[block[face]], face_corners(block))
        for k in np.flatnonzero(distance <= near).tolist():
            if node[k] not in best or distance[k] < best[node[k]][0]:
                best[int(node[k])] = (float(distance[k]), tuple(block[face[k]].tolist()), value[k])
    return {node: best[node][1:] for node in sorted(best)}


def _projected(targets: FloatArray, nodes: FloatArray, corners: int) -> tuple[FloatArray, FloatArray]:
    """Shape functions (p, a) at the places of faces (p, a, 3) nearest to targets (p, 3), and the distances (p,)."""
    shape = FACE_SHAPES[nodes.shape[1]]
    place = np.full((len(nodes), 2), 0.0 if corners == 4 else 1.0 / 3.0)
    for _ in range(_ROUNDS):
        value, slope = shape.value(place), shape.gradient(place)
        gap = targets - np.einsum("pa,pai->pi", value, nodes)
        tangent = np.einsum("pab,pai->pib", slope, nodes)
        normal = np.einsum("pib,pic->pbc", tangent, tangent)
        step = np.linalg.solve(normal, np.einsum("pib,pi->pb", tangent, gap)[..., None])[..., 0]
        before, place = place, _inside(place + step, corners)
        if np.abs(place - before).max() < _SETTLED:
            break
    value = shape.value(place)
    return value, np.linalg.norm(targets - np.einsum("pa,pai->pi", value, nodes), axis=1)


def _inside(place: FloatArray, corners: int) -> FloatArray:
    """Places moved into the face where they lie beside it."""
    if corners == 4:
        return np.clip(place, -1.0, 1.0)
    area = np.column_stack([1.0 - place.sum(axis=1), place])
    area = np.maximum(area, 0.0)
    return (area / area.sum(axis=1, keepdims=True))[:, 1:]
