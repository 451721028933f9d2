"""Named sets of a mesh."""

from collections.abc import Mapping

from ..files.array_types import IntArray
from ..files.errors import BodyFileError
from ..mesh.model import Mesh


def named_set(sets: Mapping[str, IntArray], kind: str, name: str, key: str) -> IntArray:
    """Members of a set.

    Parameters
    ----------
    sets : mapping of str to (k,) int
    kind : str
        "node" or "element".
    name : str
        Upper and lower case count as the same where that is unambiguous; so does a set of an instance without the
        instance's name.
    key : str
        The key of the body file that asks, for the message.

    Returns
    -------
    (k,) int

    Raises
    ------
    BodyFileError
        No such set, several, or an empty one.
    """
    match = [known for known in sets if known == name] or [k for k in sets if k.lower() == name.lower()]
    match = match or [known for known in sets if known.lower().endswith(f".{name.lower()}")]
    if len(match) != 1:
        there = ", ".join(sorted(match or sets)) or "none"
        if match:
            raise BodyFileError(f"{key}: {name!r} may be one of several {kind} sets: {there}; give the whole name")
        raise BodyFileError(f"{key}: the mesh has no {kind} set {name!r}; it has: {there}")
    members = sets[match[0]]
    if not members.size:
        raise BodyFileError(f"{key}: {kind} set {name!r} is empty, expected at least one {kind}")
    return members


def element_set(mesh: Mesh, name: str, key: str) -> IntArray:
    """Elements of a named set, counted over all blocks; see `named_set`."""
    return named_set(mesh.element_sets, "element", name, key)
