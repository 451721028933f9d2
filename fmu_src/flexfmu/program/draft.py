"""What will be a program: sizes and arrays by the names of core/fields.def."""

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from ..core.image import fields, write_image


@dataclass(slots=True)
class Draft:
    """What will be a program.

    Attributes
    ----------
    sizes : dict of str to int
        Those left out are the number of elements of an array that has as many.
    arrays : dict of str to array or bytes
    """

    sizes: dict[str, int]
    arrays: dict[str, NDArray[Any] | bytes]

    def image(self, base: bytes = b"") -> bytes:
        """All of it as bytes, but for arrays that another image holds."""
        counted = {
            field.count: len(array) if isinstance(array := self.arrays[field.name], bytes) else array.size
            for field in fields()
            if field.name in self.arrays and field.count.isidentifier()
        }
        return write_image(counted | self.sizes, self.arrays, base)


def texts(*words: str) -> bytes:
    """Texts as a program has them."""
    return b"".join(text.encode() + b"\0" for text in words)
