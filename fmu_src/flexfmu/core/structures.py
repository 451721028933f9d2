"""Structures that Python hands to the core, made from the headers that declare them."""

import ctypes
import re
from functools import cache
from pathlib import Path
from typing import Any

_NUMBERS: dict[str, Any] = {"int64_t": ctypes.c_int64, "double": ctypes.c_double, "unsigned char": ctypes.c_ubyte}
_ELEMENTS: dict[str, Any] = {"int64_t": "int64", "double": "float64", "unsigned": "uint32"}
_STRUCTURE = re.compile(r"typedef struct \{(.*?)\} (\w+);", re.DOTALL)
_MEMBERS = re.compile(r"(?:const )?((?:unsigned )?\w+) ([^;(]+|\(\*\w+\)\([^;]+);")
_MEMBER = re.compile(r"(\(?\*)?(\w+)(?:\)\(.*|\[(\d+)\])?")


@cache
def structures(*headers: str) -> dict[str, Any]:
    """Structures of headers by name: each may hold those before it.

    Parameters
    ----------
    *headers : str
        Names of files beside this one, without ending.

    Returns
    -------
    dict of str to type of Structure
        With `elements`: the kind of the numbers to which a member points, by name.
    """
    found: dict[str, Any] = {}
    for header in headers:
        text = Path(__file__).with_name(f"{header}.h").read_text(encoding="utf-8")
        for body, name in _STRUCTURE.findall(re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)):
            fields, elements = [], {}
            for kind, members in _MEMBERS.findall(body):
                for one in [members] if members.startswith("(") else members.split(", "):
                    pointer, member, count = _MEMBER.fullmatch(one).groups()  # type: ignore[union-attr]
                    number = ctypes.c_void_p if pointer else _NUMBERS.get(kind) or found.get(kind, ctypes.c_int)
                    fields.append((member, number * int(count) if count else number))
                    if pointer == "*" and kind in _ELEMENTS:
                        elements[member] = _ELEMENTS[kind]
            found[name] = type(name, (ctypes.Structure,), {"_fields_": fields, "elements": elements})
    return found


def enumeration(header: str, name: str) -> dict[str, int]:
    """Names of an enumeration of a header beside this one, with their numbers."""
    text = Path(__file__).with_name(f"{header}.h").read_text(encoding="utf-8")
    names = re.search(rf"typedef enum \{{([^}}]*)\}} {name};", text)
    return {one.strip(): number for number, one in enumerate(names[1].split(","))}  # type: ignore[index]


class Arrays:
    """Keeps what structures point to."""

    def __init__(self) -> None:
        self._kept: list[Any] = []

    def place(self, array: Any) -> int:
        """Address of an array of ctypes."""
        self._kept.append(array)
        return ctypes.addressof(array)

    def at(self, values: Any, kind: Any = "float64") -> int:
        """Address of an array of numbers of a kind."""
        # Not everyone who knows structures fills them.
        import numpy as np

        self._kept.append(np.ascontiguousarray(values, dtype=kind))
        return int(self._kept[-1].ctypes.data)

    def filled(self, kind: Any, /, **values: Any) -> Any:
        """A structure of a kind; where a member points to numbers, its value is an array of them."""
        pointed = {name: self.at(values[name], kind.elements[name]) for name in values.keys() & kind.elements}
        return kind(**values | pointed)
