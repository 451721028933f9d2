"""What meshio's reader of MED files lacks: families without groups, and bricks with nodes in their faces."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from meshio.med import _med

_KINDS = {"H27": "hexahedron27", "QU9": "quad9", "TR7": "triangle7"}


@contextmanager
def completed() -> Iterator[None]:
    """Let meshio read what gmsh writes without physical groups, and 27-node bricks."""
    families, kinds = _med._read_families, _med.med_to_meshio_type

    def with_groups(given: Any) -> Any:
        return families({name: one for name, one in given.items() if "GRO" in one})

    _med._read_families, _med.med_to_meshio_type = with_groups, {**kinds, **_KINDS}
    try:
        yield
    finally:
        _med._read_families, _med.med_to_meshio_type = families, kinds
