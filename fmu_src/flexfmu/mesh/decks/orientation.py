"""Material axes: the *ORIENTATION cards of a deck."""

from dataclasses import dataclass

import numpy as np

from flexfmu.files.basics import FloatArray
from flexfmu.mesh.decks.cards import Card, fields, integer, number
from flexfmu.model.rotations import turned_by

# Sine of an angle below which two directions span no plane.
_PARALLEL = 1e-9


@dataclass(frozen=True, slots=True)
class Orientation:
    """Material axes in space.

    Attributes
    ----------
    cylindrical : bool
        Whether the first axis points away from the line through both points, the third along it; otherwise the axes
        are the same everywhere.
    first, second : (3,) float
        Rectangular: on the first axis, and in the plane of the first two, from the origin. Cylindrical: on the line.
    turn : (3, 3) float
        Turn about one of the axes, applied last.
    on_shells : tuple of int
        Axes in the order in which shells take them, the last nearest to their normal.
    """

    cylindrical: bool
    first: FloatArray
    second: FloatArray
    turn: FloatArray
    on_shells: tuple[int, ...]

    def at(self, places: FloatArray, *, shell: bool) -> FloatArray:
        """Return the axes of the material, of shells in the order of theirs.

        Parameters
        ----------
        places : (n, 3) float
        shell : bool

        Returns
        -------
        (n, 3, 3) float
        """
        return self.axes(places)[:, :, self.on_shells] if shell else self.axes(places)

    def axes(self, places: FloatArray) -> FloatArray:
        """Return the axes as columns (n, 3, 3) at places (n, 3).

        Parameters
        ----------
        places : (n, 3) float

        Returns
        -------
        (n, 3, 3) float
        """
        if self.cylindrical:
            third = np.broadcast_to(self.second - self.first, places.shape)
            along = _unit(third)
            away = places - self.first
            first = away - np.sum(away * along, axis=1, keepdims=True) * along
            second = np.cross(along, first)
        else:
            first = np.broadcast_to(self.first, places.shape)
            third = np.broadcast_to(np.cross(self.first, self.second), places.shape)
            second = np.cross(third, first)
        return np.stack([_unit(first), _unit(second), _unit(third)], axis=2) @ self.turn


def orientation(card: Card) -> Orientation:
    """Return what an *ORIENTATION card says.

    Parameters
    ----------
    card : Card

    Returns
    -------
    Orientation
        In the global frame: an instance's turn is applied.

    Raises
    ------
    DeckError
        Another system than rectangular or cylindrical, or points that give no axes.
    """
    system = card.parameters.get("SYSTEM", "RECTANGULAR").upper()
    system = next((one for one in ("RECTANGULAR", "CYLINDRICAL") if system and one.startswith(system)), system)
    if system not in ("RECTANGULAR", "CYLINDRICAL") or not 1 <= len(card.data) <= 2:
        raise card.line.error(
            f"*ORIENTATION with SYSTEM={system} and {len(card.data)} rows is not supported; give RECTANGULAR or "
            "CYLINDRICAL and the row 'x1, y1, z1, x2, y2, z2', then 'axis, degrees' if it is turned"
        )
    values = np.array([number(text, card.data[0], "each coordinate", 0.0) for text in card.row])
    if values.size not in (6, 9):
        raise card.data[0].error(f"an orientation takes two points, 6 numbers, or three, 9; found {values.size}")
    first, second = values[:3], values[3:6]
    cylindrical = system == "CYLINDRICAL"
    if values.size == 9 and not cylindrical:
        first, second = first - values[6:], second - values[6:]
    size = np.linalg.norm(second - first) if cylindrical else np.linalg.norm(np.cross(first, second))
    scale = np.abs(values).max() if cylindrical else np.linalg.norm(first) * np.linalg.norm(second)
    if not size > _PARALLEL * scale:
        raise card.data[0].error("the points of this orientation lie on one line, which gives no axes; correct them")
    turn, axis = np.eye(3), 3
    if len(card.data) == 2:
        row = [*fields(card.data[1]), "", ""]
        axis = integer(row[0], card.data[1], "the axis of the turn") if row[0] else 1
        if not 1 <= axis <= 3:
            raise card.data[1].error(f"the axis of the turn should be 1, 2 or 3, found {axis}")
        angle = number(row[1], card.data[1], "the turn", 0.0)
        turn = turned_by(np.radians(angle) * np.eye(3)[axis - 1])
    if card.scope.rotation is not None and card.scope.shift is not None:
        first, second = (card.scope.rotation @ point for point in (first, second))
        if cylindrical:
            first, second = first + card.scope.shift, second + card.scope.shift
    return Orientation(cylindrical, first, second, turn, (axis % 3, (axis + 1) % 3, axis - 1))


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)
