"""A body file's text, with the reason of each choice as comments."""

import os
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..build.config import BodyFile
from ..files.toml_files import toml_value
from ..reduction.options import Basis

_WIDTH = 118
# Tables that are written by hand, with their reasons.
_CHOSEN = ("name", "frames", "reduction", "formulation")


def body_text(config: BodyFile, folder: Path, header: Sequence[str], reasons: Mapping[str, str]) -> str:
    """TOML of a body file.

    Parameters
    ----------
    config : BodyFile
        With the mesh's path relative to the working directory.
    folder : Path
        Where the file will lie.
    header : sequence of str
        Paragraphs at the top; an empty one is an empty line.
    reasons : mapping of str to str
        Comments by key: "frames", "interface", "basis", "modes", "method", "mass".

    Returns
    -------
    str
    """
    lines = [line for paragraph in header for line in _comment(paragraph)]
    lines += ["", f"name = {toml_value(config.name)}", *_comment(reasons.get("frames", ""))]
    if config.frames is not None:
        lines.append(f"frames = {config.frames}")
    data = config.model_dump(mode="json", exclude_defaults=True, exclude_none=True)
    mesh = Path(os.path.relpath(config.mesh.file, folder)).as_posix()
    data["mesh"] = {**data["mesh"], "file": mesh}
    plain = {key: value for key, value in data.items() if key not in _CHOSEN}
    lines += [f"{key} = {toml_value(value)}" for key, value in plain.items() if not _is_table(value)]
    for key, value in plain.items():
        if not _is_table(value):
            continue
        comment = _comment(reasons.get(key, ""))
        for table in value if isinstance(value, list) else [value]:
            lines += ["", *comment, f"[[{key}]]" if isinstance(value, list) else f"[{key}]"]
            lines += [f"{name} = {toml_value(one)}" for name, one in table.items()]
            comment = []
    reduction = config.reduction
    chosen: dict[str, dict[str, Any]] = {
        "reduction": {"basis": reduction.basis.value, "modes": reduction.modes},
        "formulation": {
            "method": config.variant.method.value,
            "mass": config.variant.mass.value,
        },
    }
    if reduction.basis is Basis.NORMAL:
        chosen["reduction"]["residual_flexibility"] = config.residual
    if reduction.membrane != "auto":
        chosen["reduction"]["membrane"] = reduction.membrane
    for title, table in chosen.items():
        lines += ["", f"[{title}]"]
        for name, one in table.items():
            lines += [*_comment(reasons.get(name, "")), f"{name} = {toml_value(one)}"]
    return "\n".join(lines) + "\n"


def _comment(text: str) -> list[str]:
    if not text:
        return []
    return [f"# {line}" for line in textwrap.wrap(text, _WIDTH, break_long_words=False)]


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))
