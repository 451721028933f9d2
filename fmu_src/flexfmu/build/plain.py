"""Tables of the body file as plain data, in SI units."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from ..files.toml_files import Table
from ..reduction.options import Place
from .tables import OF_MESH, PlaceTable


def plain_tables(kind: type[Any], given: Sequence[Table], length: float = 1.0) -> tuple[Any, ...]:
    """The same as plain data, whose fields have the keys' names; what is not given has their defaults.

    Lengths in the mesh's units, `length` m each, come out in m.
    """
    found = []
    for one in given:
        values = {field.name: getattr(one, field.name) for field in fields(kind)}
        units = {name: length if OF_MESH in type(one).model_fields[name].metadata else 1.0 for name in values}
        found.append(
            kind(**{name: _plain(value, length, units[name]) for name, value in values.items() if value is not None})
        )
    return tuple(found)


def _plain(value: Any, length: float, unit: float) -> Any:
    if isinstance(value, PlaceTable):
        return plain_tables(Place, [value], length)[0]
    if isinstance(value, list):
        return tuple(_plain(one, length, unit) for one in value)
    return value * unit if isinstance(value, float) else value
