"""The table of all arrays of a reduced body: what checks them, and what writes, digests and reads the modal file.

Shapes are words: m modes, I interfaces, S frames, L unit loads (6I, and three accelerations of a body
with masses), K nodes of the tree (frames, interfaces, centres of mass, ends a of all ties, ends b). Any other letter is
a number of the part's own, told by the first array that has it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import ModalFileError


@dataclass(frozen=True, slots=True)
class Entry:
    """An array, or a list of names.

    Attributes
    ----------
    name : str
        Attribute of the class that holds it.
    path : str
        Dataset of the file.
    shape : str
        Sizes, as above.
    unit : str
        SI unit, "1" for none.
    words : str
    kind : type
        float, int, or str.
    optional : bool
        Whether it may be absent.
    single : bool
        Whether it is kept in single precision.
    """

    name: str
    path: str
    shape: str
    unit: str
    words: str
    kind: type = float
    optional: bool = False
    single: bool = False

    @property
    def symmetric(self) -> bool:
        """Whether it is of symmetric matrices, as all but geometric stiffness: the file has the lower triangles."""
        return self.shape.endswith(" m m") and not self.path.startswith("stiffness/")

    @property
    def description(self) -> str:
        """Shape and meaning, as the file tells them."""
        sizes = {"L": "6I or 6I + 3"}
        shape, triangles = (self.shape[:-4], ["m (m + 1) / 2: lower triangles"]) if self.symmetric else (self.shape, [])
        listed = [sizes.get(token, token) for token in shape.split()] + triangles
        return f"({', '.join(listed)}{',' if len(listed) == 1 else ''}) {self.words}"


# Modal coordinates are mass-normalised: kg^0.5 m.
BODY = (
    Entry("interface_names", "interfaces/name", "I", "1", "names", str),
    Entry("frame_names", "frames/name", "S", "1", "names", str),
    Entry("angular_frequency", "modes/angular_frequency", "m", "rad/s", "undamped angular frequencies"),
    Entry(
        "frequency_spread", "modes/frequency_spread", "m", "1", "spread of the vibrations that a mode is made of",
        optional=True,
    ),
    Entry("damper", "modes/damper", "d m", "s^-0.5", "rows D of the damping DᵀD beside ratios", optional=True),
    Entry("damping_ratio", "modes/damping_ratio", "m", "1", "modal damping ratios"),
    Entry("interface_point", "interfaces/point", "I 3", "m", "reference points"),
    Entry("interface_displacement", "interfaces/displacement", "I 3 m", "kg^-0.5", "displacement per mode"),
    Entry("interface_rotation", "interfaces/rotation", "I 3 m", "rad/(kg^0.5 m)", "rotation per mode"),
    Entry("interface_frame", "interfaces/frame", "I", "1", "frame that carries the interface, -1 for none", int),
    Entry("frame_parent", "frames/parent", "S", "1", "parent frame, -1 for a root", int),
    Entry("joint_point", "frames/joint_point", "S 3", "m", "joints with the parents"),
    Entry("joint_displacement", "frames/joint_displacement", "S 3 m", "kg^-0.5", "displacement per mode"),
    Entry("joint_rotation", "frames/joint_rotation", "S 3 m", "rad/(kg^0.5 m)", "rotation per mode"),
    Entry("frame_rotation", "frames/rotation", "S 3 m", "rad/(kg^0.5 m)", "averaged rotation per mode"),
    Entry(
        "stiffness_by_load", "stiffness/by_load", "L m m", "s^-2/N",
        "per unit load: forces, moments (/(N m)), accelerations (/(m/s^2))", optional=True,
    ),
    Entry("watched_frame", "watched/frame", "w", "1", "frame of each watched element, -1 for none", int, optional=True),
    Entry(
        "watched_rotation", "watched/rotation", "w 3 m", "rad/(kg^0.5 m)", "mean rotation of watched elements",
        optional=True, single=True,
    ),
    Entry(
        "watched_strain", "watched/strain", "v 6 m", "1/(kg^0.5 m)",
        "patterns whose squares add up to the mean square strain of each material in each frame", optional=True,
    ),
    Entry(
        "stiffness_by_mode", "stiffness/by_mode", "m m m", "s^-2/(kg^0.5 m)", "per unit modal coordinate", optional=True
    ),
)  # fmt: skip
WHOLE = (
    Entry("joint_point", "whole/joint_point", "3", "m", "centre of the supports"),
    Entry("joint_displacement", "whole/joint_displacement", "3 m", "kg^-0.5", "displacement per mode"),
    Entry("joint_rotation", "whole/joint_rotation", "3 m", "rad/(kg^0.5 m)", "rotation per mode"),
    Entry("frame_rotation", "whole/rotation", "3 m", "rad/(kg^0.5 m)", "averaged rotation of the whole body per mode"),
)
MASSES = (
    Entry("mass", "masses/mass", "P", "kg", "mass of each sub-domain"),
    Entry("point", "masses/point", "P 3", "m", "centres of mass"),
    Entry("displacement", "masses/displacement", "P 3 m", "kg^-0.5", "displacement of the centres per mode"),
    Entry("frame", "masses/frame", "P", "1", "frame that carries it, -1 for none", int),
)
INERTIA = (
    Entry("frame", "inertia/frame", "P", "1", "frame that carries each lump", int),
    Entry("mass", "inertia/mass", "P", "kg", "mass of each lump"),
    Entry("point", "inertia/point", "P 3", "m", "centres of mass of the lumps"),
    Entry("displacement", "inertia/displacement", "P 3 m", "kg^-0.5", "displacement of the centres per mode"),
    Entry("turning", "inertia/turning", "S 3 3", "kg m^2", "rotary inertia of a frame's lumps about their centres"),
    Entry("sweep", "inertia/sweep", "S 3 m", "kg^0.5 m", "integral of rho r x e_j within a frame's lumps"),
    Entry(
        "curvature", "inertia/curvature", "P 3 m m", "kg^-1 m^-1", "second derivative of displacements", optional=True
    ),
)
POLYNOMIAL = (
    Entry("form", "polynomial/form", "R m m", "1", "symmetric U_k of M(q) = 1 + sum of (l_k q + q V_k q) U_k"),
    Entry("linear", "polynomial/linear", "R m", "kg^-0.5 m^-1", "l_k"),
    Entry("square", "polynomial/square", "R m m", "kg^-1 m^-2", "symmetric V_k"),
    Entry(
        "centre", "polynomial/centre", "3 m", "kg^-0.5", "displacement of a free body's centre of mass", optional=True
    ),
    Entry("centre_square", "polynomial/centre_square", "3 m m", "kg^-1 m^-1", "its second order", optional=True),
    Entry(
        "factor", "polynomial/factor", "n 2", "1", "of products left out: a coordinate, another or a pair", int, True
    ),
    Entry("further", "polynomial/further", "R n", "1", "what these would add to l_k q + q V_k q", optional=True),
)
TIES = (
    Entry("frame", "ties/frame", "T 2", "1", "frames that carry the ends, -1 for the ground", int),
    Entry("point", "ties/point", "T 2 3", "m", "centres of the sections"),
    Entry("displacement", "ties/displacement", "T 2 3 m", "kg^-0.5", "displacement per mode"),
    Entry("rotation", "ties/rotation", "T 2 3 m", "rad/(kg^0.5 m)", "rotation per mode"),
    Entry("stiffness", "ties/stiffness", "T 3", "N/m", "along the global axes"),
    Entry("lever", "ties/lever", "T 3 3", "m", "in columns, points of the springs that resist tilting"),
)
SECOND = (
    Entry("displacement", "second/displacement", "K 3 m m", "kg^-1 m^-1", "second derivative of displacements"),
    Entry("rotation", "second/rotation", "K 3 m m", "rad/(kg m^2)", "second derivative of rotation vectors"),
)
MEMBRANE = (
    Entry("quadratic", "membrane/quadratic", "R m m", "J^0.5/(kg m^2)", "stretches, quadratic in the modes"),
    Entry("linear", "membrane/linear", "R m", "J^0.5/(kg^0.5 m)", "what of them is linear beside it"),
    Entry("sign", "membrane/sign", "R", "1", "1, or -1 of sections that flatten"),
)
SURFACE = (
    Entry("points", "surface/points", "n 3", "m", "undeformed corner nodes of the outer faces", single=True),
    Entry("faces", "surface/faces", "f 4", "1", "rows of points; a triangle repeats its last corner", int),
    Entry("modes", "surface/modes", "n 3 m", "kg^-0.5", "mode shapes", single=True),
    Entry("frame", "surface/frame", "n", "1", "frame that carries the point, -1 for none", int),
    Entry("interface", "surface/interface", "n", "1", "interface that holds the point, or -1", int, optional=True),
    Entry("support", "surface/support", "n", "1", "1 where a support holds the point", int, optional=True),
    Entry("second", "surface/second", "n 3 r", "m", "second-order displacement per form", optional=True, single=True),
    Entry("form", "surface/form", "r m m", "1/(kg m^2)", "forms of modal coordinates", optional=True, single=True),
    Entry("turn", "surface/turn", "g 3 m", "rad/(kg^0.5 m)", "rotation to undo in second, per mode", optional=True),
    Entry("pivot", "surface/pivot", "g 3", "m", "the points that they are about", optional=True),
    Entry("piece", "surface/piece", "n", "1", "which of them each point takes part in", int, optional=True),
    Entry(
        "stress", "surface/stress", "n 6 m", "N/m^2/(kg^0.5 m)",
        "xx, yy, zz, xy, yz, zx per mode, turning with the material", optional=True, single=True,
    ),
)  # fmt: skip
PROPERTIES = (
    Entry("material_names", "properties/material", "k", "1", "names of the materials", str),
    Entry("box", "properties/box", "2 3", "m", "smallest and largest coordinates of the undeformed body"),
    Entry("volume", "properties/volume", "k", "m^3", "volume of each material"),
    Entry("youngs_modulus", "properties/youngs_modulus", "k", "N/m^2", "of each material"),
    Entry("poissons_ratio", "properties/poissons_ratio", "k", "1", "of each material"),
    Entry("density", "properties/density", "k", "kg/m^3", "of each material"),
    Entry("point_mass", "properties/point_mass", "P", "kg", "masses at points", optional=True),
    Entry("spring", "properties/spring", "3", "N/m", "all springs to the ground", optional=True),
    Entry("support_names", "properties/support", "B", "1", "names of the supports", str, optional=True),
    Entry("support_point", "properties/support_point", "B 3", "m", "their centres", optional=True),
    Entry("support_spring", "properties/support_spring", "B", "1", "1 where springs hold", int, optional=True),
)
# The shadow's own arrays are those of a body, in the same group.
SHADOW = (Entry("embedding", "shadow/embedding", "M m", "1", "coordinates of the shadow per coordinate of the body"),)
# In a group of each stress set's name.
STRESS = (
    Entry("point", "point", "Q 3", "m", "undeformed places"),
    Entry(
        "stress", "stress", "Q 6 m", "N/m^2/(kg^0.5 m)",
        "xx, yy, zz, xy, yz, zx per mode, turning with the material",
    ),
)  # fmt: skip


def in_single(holder: Any) -> Any:
    """A data class of arrays, or None, with its numbers rounded to single precision."""
    rounded = {f.name: getattr(holder, f.name).astype(np.float32) for f in fields(holder)} if holder else {}
    return replace(holder, **rounded) if rounded else None


def turned(holder: Any, entries: Iterable[Entry], turn: NDArray[Any]) -> dict[str, Any]:
    """Arrays with modal axes, their last ones, in other coordinates.

    Parameters
    ----------
    holder : object
    entries : iterable of Entry
    turn : (m, k) float
        Their modes in those of the holder.

    Returns
    -------
    dict of str to array
        What the holder has of these, by name.
    """
    found = {}
    for entry in entries:
        array, axes = getattr(holder, entry.name), entry.shape.split().count("m")
        if array is not None and axes == 1:
            found[entry.name] = array @ turn
        elif array is not None and axes == 2:
            found[entry.name] = turn.T @ array @ turn
        elif array is not None and axes == 3:
            found[entry.name] = np.einsum("abc,ai,bj,ck->ijk", array, turn, turn, turn, optimize=True)
    return found


def settle(holder: object, entries: tuple[Entry, ...], sizes: Mapping[str, int], title: str = "") -> None:
    """Bring the arrays of a data class into their types, read-only, and check shapes and finiteness.

    Parameters
    ----------
    holder : object
        Frozen data class; its attributes are set.
    entries : tuple of Entry
    sizes : mapping of str to int
        Of the letters that are known.
    title : str
        What the arrays are of, for messages.

    Raises
    ------
    ModalFileError
        Naming the first array that is wrong, and how.
    """
    known = dict(sizes)
    for entry in entries:
        given, label = getattr(holder, entry.name), f"{title}: {entry.name}" if title else entry.name
        if given is None and entry.optional:
            continue
        if entry.kind is str:
            value: Any = tuple(given)
            found: tuple[int, ...] = (len(value),)
        else:
            value = np.asarray(given, dtype=np.int64 if entry.kind is int else np.float64)
            found = value.shape
        tokens = entry.shape.split()
        if len(found) == len(tokens):
            for token, size in zip(tokens, found, strict=True):
                known.setdefault(token, int(token) if token.isdigit() else size)
        expected = tuple(known.get(token, int(token) if token.isdigit() else -1) for token in tokens)
        # Empty arrays of any shape will do where nothing is expected.
        if found != expected and not (0 in found and 0 in expected and entry.kind is not str):
            wanted = expected if -1 not in expected else f"({entry.shape.replace(' ', ', ')})"
            raise ModalFileError(f"{label} has shape {found}, expected {wanted}")
        if entry.kind is not str:
            if not np.all(np.isfinite(value)):
                raise ModalFileError(f"{label} holds values that are not finite")
            value = value.reshape(expected)
            if value.flags.writeable or (isinstance(value.base, np.ndarray) and value.base.flags.writeable):
                # The caller's array stays the caller's.
                value = 0.5 * value + 0.5 * value.swapaxes(-1, -2) if entry.symmetric else value.copy()
            if entry.single:
                value = value.astype(np.float32).astype(np.float64)
            value.flags.writeable = False
        object.__setattr__(holder, entry.name, value)
