"""What the package's TOML files have in common: how they are read, and how a wrong key is explained."""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .errors import FlexfmuError


def read_toml(path: Path, error_type: type[FlexfmuError]) -> dict[str, Any]:
    """Contents of a TOML file.

    Parameters
    ----------
    path : Path
    error_type : type of FlexfmuError
        What is raised where the file is missing, cannot be read, or is not TOML.

    Returns
    -------
    dict
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise error_type(f"{path}: no such file") from error
    except (OSError, UnicodeDecodeError) as error:
        raise error_type(f"{path}: cannot be read ({error})") from error
    except tomllib.TOMLDecodeError as error:
        raise error_type(f"{path}: not valid TOML: {error}") from error


def spelled_key(location: Sequence[int | str]) -> str:
    """The key as the file spells it, from pydantic's location; tables of an array are counted from one."""
    key = ""
    for part in location:
        key += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if key else part
    return key


def reason(problem: Mapping[str, Any], unknown: str) -> str:
    """What was found and what would do, of one of pydantic's problems; `unknown` is said of keys that are not known."""
    message = str(problem["msg"]).removeprefix("Value error, ")
    if problem["type"] == "extra_forbidden":
        return unknown
    if problem["type"] == "missing":
        return "missing, and there is no default"
    if problem["type"] == "value_error":
        return message
    message = message.replace("Input should", "should")
    return f"found {problem.get('input')!r}; {message[0].lower()}{message[1:]}"
