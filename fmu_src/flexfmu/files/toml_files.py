"""What the package's TOML files have in common: how they are read, and how a wrong key is explained."""

import json
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from math import hypot, inf
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic.fields import FieldInfo

from .basics import FlexfmuError, FloatArray, alike
from .tables import Kind, check_input, toml_kind

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
"""Letters, digits and _, beginning with a letter."""
Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]


def _share(value: float) -> float:
    if not 0.0 <= value <= 1.0:
        percent = f"; {value:g} % is {value / 100.0:g}" if value > 1.0 else ""
        raise ValueError(f"is {value:g}, expected a share from 0 to 1, such as 0.01{percent}")
    return value


Share = Annotated[float, AfterValidator(_share)]
"""A number from 0 to 1."""


def ascending(words: str) -> AfterValidator:
    """Return what checks that values of a list ascend; `words` say what they are, with an example.

    Parameters
    ----------
    words : str

    Returns
    -------
    pydantic.AfterValidator
    """

    def checked(value: list[float]) -> list[float]:
        if any(b <= a for a, b in pairwise(value)):
            raise ValueError(f"is {value}, expected ascending {words}")
        return value

    return AfterValidator(checked)


class Table(BaseModel):
    """A table of a file. Strict: no unknown keys, no number from text, none from true or false."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


File = TypeVar("File", bound=Table)

# Slips by what a line shows of them, and what to write instead.
_SLIPS = {
    r"[“”„‘’]": "quotes are straight, \" or '",
    r"//": "a comment begins with #",
    r"=\s*(True|False)\b": "true and false are written in small letters",
    r"\"[^\"]*\\": "a backslash in double quotes begins an escape, so write / or 'single quotes'",
}
# In what pydantic says of a number that is too large or too small.
_OF_SIZE = " than "


def different(names: Sequence[str], said: str, expected: str = "different names") -> None:
    """Raise ValueError where two names are the same; `said` is what two of something have."""
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"two {said} {name!r}, expected {expected}")


def read_toml(path: Path, error_type: type[FlexfmuError], wanted: Kind) -> dict[str, Any]:
    """Contents of a TOML file.

    Parameters
    ----------
    path : Path
    error_type : type of FlexfmuError
        What is raised where the file is missing, cannot be read, is not TOML, or is another kind of file.
    wanted : Kind

    Returns
    -------
    dict
    """
    check_input(path, error_type, wanted)
    try:
        text = path.read_text(encoding="utf-8")
        data = tomllib.loads(text)
    except (OSError, UnicodeDecodeError) as error:
        raise error_type(f"{path}: cannot be read ({error})") from error
    except ValueError as error:  # wrong TOML, or numbers of thousands of digits
        line = re.search(r"at line (\d+)", str(error))
        wrong = text.splitlines()[int(line[1]) - 1].strip() if line else ""
        slips = [words for sign, words in _SLIPS.items() if re.search(sign, wrong)]
        slips = slips or ["texts stand in quotes, a [table] stands once, and several of a kind are [[tables]]"]
        shown = f": {wrong!r}" if wrong else ""
        raise error_type(f"{path}: not valid TOML: {error}{shown}; {'; '.join(slips)}") from error
    found = toml_kind(data)
    if found not in (None, wanted):
        raise error_type(f"{path} is {found.words}, expected {wanted.words}: {found.use}")
    return data


def validated(model: type[File], data: Any, kind: type[FlexfmuError], document: str, path: Path | None = None) -> File:
    """The contents of a file after all of them are checked.

    Parameters
    ----------
    model : type of Table
        Of the whole file.
    data : dict
    kind : type of FlexfmuError
        What is raised where keys are wrong: it tells all of them, with what was found and what would do.
    document : str
        Where the keys are described.
    path : Path, optional
        For the message.

    Returns
    -------
    Table
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise kind(("" if path is None else f"{path}:\n  ") + explain(error, model, data, document)) from error


def explain(error: ValidationError, model: type[BaseModel], data: Any, document: str) -> str:
    """One line for each wrong key: the key, what was found, what would do.

    Parameters
    ----------
    error : ValidationError
    model : type of BaseModel
        Of the whole file.
    data : dict
        What was checked.
    document : str
        Where the keys are described.

    Returns
    -------
    str
        Indented lines, the first one without indentation.
    """
    reasons: dict[str, list[tuple[str, str, str]]] = {}
    for problem in error.errors():
        place = _place(data, problem)
        reasons.setdefault(_spelled(place), []).append(_reason(problem, model, place, document))
    # Of a key that may be of one type or another, the reason that went deepest is the one that helps.
    deepest = [key for key in reasons if not any(other.startswith((f"{key}[", f"{key}.")) for other in reasons if key)]
    lines = []
    for key in deepest:
        # What is wrong with a value of the right kind says more than that it is of no other kind.
        told = [r for r in reasons[key] if not r[1]] or [r for r in reasons[key] if _OF_SIZE in r[1]] or reasons[key]
        found = told[0][0]
        wanted = " or ".join(dict.fromkeys(text for _, text, _ in told if text))
        example = next((text for *_, text in told if text), "")
        text = "; ".join(part for part in (found, wanted) if part) + example
        lines.append(f"{key}: {text}" if key else text)
    return "\n  ".join(lines)


def _place(data: Any, problem: Mapping[str, Any]) -> tuple[int | str, ...]:
    """Where a problem stands in the data; pydantic adds the names of the types that a key may have."""
    place: list[int | str] = []
    here = data
    location: Sequence[int | str] = problem["loc"]
    for depth, part in enumerate(location):
        inside = part in here if isinstance(here, Mapping) else isinstance(here, list) and isinstance(part, int)
        if inside:
            here = here[part]
        elif not (problem["type"] == "missing" and depth == len(location) - 1):
            continue
        place.append(part)
    return tuple(place)


def _spelled(place: Sequence[int | str]) -> str:
    """The key as the file spells it; tables of an array are counted from one."""
    key = ""
    for part in place:
        key += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if key else part
    return key


def _reason(
    problem: Mapping[str, Any], model: type[BaseModel], place: Sequence[int | str], document: str
) -> tuple[str, str, str]:
    """What was found, what would do, and an example, of one of pydantic's problems."""
    kind, found, context = str(problem["type"]), problem.get("input"), problem.get("ctx", {})
    names = [part for part in place if isinstance(part, str)]
    key = names[-1] if names else ""
    table = _table(model, names[:-1])
    field = _fields(table).get(key) if table is not None else None
    inner = None if field is None else _inner(field.annotation)
    example = f", such as {key} = {toml_value(field.examples[0])}" if field is not None and field.examples else ""
    shown = f"found {found!r}"
    if inner is not None and field is not None and str in get_args(field.annotation):
        # A name would do as well as a table.
        if kind in ("model_type", "model_attributes_type"):
            return shown, f"expected a table {{ … }} of the keys {_listed(inner)}", ""
        inner = None
    match kind:
        case "extra_forbidden":
            return _unknown(key, model, table, document), "", ""
        case "missing":
            return "missing, and there is no default", "give a table" if inner is not None else "give it", example
        case "value_error":
            return str(problem["msg"]).removeprefix("Value error, "), "", ""
        case "list_type" if inner is not None:
            if isinstance(found, dict):
                return "found one table", f"expected [[{key}]], in double brackets, since there may be several", ""
            other = [name for name in alike(key, _fields(table) if table is not None else ()) if name != key]
            return shown, f"expected [[{key}]] tables{f', or the key {other[0]}' if other else ''}", ""
        case "model_type" | "model_attributes_type" if inner is not None:
            wanted = f"expected one table, [{'.'.join(names)}], in single brackets, with the keys {_listed(inner)}"
            return "found several tables" if isinstance(found, list) else shown, wanted, ""
        case "list_type":
            usual = None if field is None else field.default
            plain = isinstance(usual, list) and all(isinstance(one, int | float | str) for one in usual)
            single = [found] if isinstance(found, int | float) else usual if plain else []
            example = example or (f", such as {key} = {toml_value(single)}" if single else "")
            return shown, "should be a valid list", example
        case "too_short" | "too_long":
            limit, words = ("min_length", "at least ") if kind == "too_short" else ("max_length", "at most ")
            bound = context.get(limit)
            if bound in _bounds(field, "min_length") and bound in _bounds(field, "max_length"):
                words = ""
            there = f"there {'is' if context['actual_length'] == 1 else 'are'} {context['actual_length']}"
            return shown, f"expected {words}{bound} value{'s'[: bound != 1]}, {there}", example
        case "string_pattern_mismatch":
            return shown, "expected letters, digits and _, beginning with a letter", example
        case "int_type" if isinstance(found, float) and found.is_integer():
            most = _bounds(field, "le")
            limit = f", at most {most[0]}" if most else ""
            return shown, f"should be a valid integer, written without point and exponent{limit}", ""
        case "bool_type":
            return shown, "should be true or false without quotes", ""
        case "path_type":
            return shown, "should be a file's name in quotes", example
        case "float_type" if isinstance(found, str):
            return shown, "should be a number without quotes and unit", example
    text = str(problem["msg"]).replace("Input should", "should")
    return shown, text[0].lower() + text[1:], example if kind.endswith("_type") else ""


def _unknown(key: str, model: type[BaseModel], table: type[BaseModel] | None, document: str) -> str:
    """What is said of a key that is not known where it stands."""
    near = alike(key, (_fields(table) if table is not None else {}), 1)
    elsewhere = [place for name, place in _places(model, "") if name == key]
    if near:
        hint = f", did you mean {near[0]!r}?{f' Or it belongs {elsewhere[0]}' if elsewhere else ''}"
    elif elsewhere:
        hint = f" here: it belongs {' or '.join(elsewhere)}"
    else:
        others = alike(key, dict(_places(model, "")), 1)
        hint = f", did you mean {others[0]!r}, {dict(_places(model, ''))[others[0]]}?" if others else ""
    known = f"; known here: {_listed(table)}" if table is not None and not near else ""
    return f"unknown key{hint}{known}; {document} describes them"


def _fields(table: type[BaseModel]) -> dict[str, FieldInfo]:
    """Fields of a table by the name that the file gives them."""
    return {field.alias or name: field for name, field in table.model_fields.items()}


def _listed(table: type[BaseModel]) -> str:
    return ", ".join(_fields(table))


def _inner(annotation: Any) -> type[BaseModel] | None:
    """The table that a key holds, by itself or in a list."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for part in get_args(annotation) if (found := _inner(part)) is not None), None)


def _table(model: type[BaseModel], names: Sequence[str]) -> type[BaseModel] | None:
    """The table at a place, or None if there is none."""
    table: type[BaseModel] | None = model
    for name in names:
        field = _fields(table).get(name) if table is not None else None
        table = None if field is None else _inner(field.annotation)
    return table


def _places(table: type[BaseModel], title: str) -> Iterator[tuple[str, str]]:
    """Every key that there is, with words for where it stands; those of the outer tables first."""
    for name, field in _fields(table).items():
        inner = _inner(field.annotation)
        yield name, f"to {title}" if title else "at the top, above the first table" if inner is None else "at the top"
    for name, field in _fields(table).items():
        if (inner := _inner(field.annotation)) is not None:
            outer = f"{title.strip('[]')}.{name}" if title else name
            several = "list" in str(field.annotation)
            yield from _places(inner, f"[[{outer}]]" if several else f"[{outer}]")


def _bounds(part: Any, name: str) -> list[Any]:
    """Bounds of a name ("le", "max_length" …) that a field, or one of the types that it may have, is held to."""
    constraints = [*(getattr(part, "metadata", None) or ()), *getattr(part, "__metadata__", ())]
    own = [getattr(constraint, name) for constraint in constraints if hasattr(constraint, name)]
    inner = [*constraints, *get_args(getattr(part, "annotation", part))]
    return own + [bound for one in inner if one is not part for bound in _bounds(one, name)]


def toml_value(value: Any) -> str:
    """A value as TOML spells it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(one) for one in value) + "]"
    if isinstance(value, dict):
        named = [(key if key.isidentifier() else toml_value(key), toml_value(one)) for key, one in value.items()]
        return "{ " + ", ".join(f"{key} = {one}" for key, one in named) + " }"
    # A JSON text is a basic string of TOML.
    return repr(value) if isinstance(value, int | float) else json.dumps(str(value), ensure_ascii=False)


# Sine of the angle between two vectors below which they are parallel.
_PARALLEL = 1e-6


def _not_parallel(value: list[list[float]]) -> list[list[float]]:
    (a, b, c), (x, y, z) = value
    normal = hypot(b * z - c * y, c * x - a * z, a * y - b * x)
    if not _PARALLEL * hypot(a, b, c) * hypot(x, y, z) < normal < inf:
        raise ValueError(f"are {value}, expected two vectors that are not parallel")
    return value


Axes = Annotated[list[Vector], Field(min_length=2, max_length=2), AfterValidator(_not_parallel)]
"""Two vectors that are not parallel."""


def orthonormal(vectors: Sequence[Sequence[float]] | FloatArray | None) -> FloatArray:
    """Axes (3, 3), in rows, of two vectors; the global ones without them."""
    first, second = np.asarray(vectors if vectors is not None else np.eye(3)[:2], dtype=np.float64)
    third = np.cross(first, second)
    found = np.array([first, np.cross(third, first), third])
    return found / np.linalg.norm(found, axis=1)[:, None]
