"""Parts of pages that promise all, made from the code: keys of files, commands, datasets, messages.

A page has them between `<!-- generated: NAME -->` and `<!-- end -->`. `python -m docs.generators.reference_pages`
writes anew those that the repository's pages hold; the site (`site.py`) fills in all of them.
"""

import ast
import importlib
import os
import re
import subprocess
import sys
from collections.abc import Callable, Collection, Iterator
from enum import Enum
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "fmu_src" / "flexfmu"
_REGION = re.compile(r"<!-- generated: (?P<name>[^>]+) -->\n.*?<!-- end -->\n", re.DOTALL)


# --- keys of files -----------------------------------------------------------------------------------------------


def described(table: type[BaseModel]) -> dict[tuple[str, ...], str]:
    """What the section Attributes of a table's docstring says of its keys, those of its bases included."""
    found: dict[tuple[str, ...], str] = {}
    for kind in reversed(table.__mro__):
        text = kind.__dict__.get("__doc__") or ""
        if kind is not BaseModel and "    Attributes\n" in text:
            part = text.split("----------\n", 1)[1]
            for names, words in re.findall(r"^    (\w[\w, ]*)\n((?:^        .*\n)+)", part, re.MULTILINE):
                found[tuple(names.split(", "))] = " ".join(words.split())
    return found


def keys_of(table: type[BaseModel]) -> dict[str, FieldInfo]:
    """Fields of a table that hold values, by the name in the file; those that hold tables only are left out."""
    fields = {field.alias or name: field for name, field in table.model_fields.items()}
    return {name: field for name, field in fields.items() if _inner(field) is None or "Literal" in str(field)}


def tables_of(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """A file's tables in order, each once, the file itself first."""
    yield model
    seen: set[type[BaseModel]] = set()
    for field in model.model_fields.values():
        inner = _inner(field)
        if inner is not None:
            found = [one for one in tables_of(inner) if one not in seen]
            seen.update(found)
            yield from found


def _inner(field: FieldInfo) -> type[BaseModel] | None:
    """The table that a field holds, by itself or in a list; none where a name would do as well."""

    def tables(annotation: Any) -> list[Any]:
        inside = [one for part in get_args(annotation) for one in tables(part)]
        return [annotation, *inside] if isinstance(annotation, type) else inside

    found = tables(field.annotation)
    if str in found:
        return None
    return next((one for one in found if issubclass(one, BaseModel)), None)


def keys(*models: type[BaseModel]) -> str:
    """Table of all keys of a file, or of some of its tables."""
    rows = ["| key | meaning | default |", "|---|---|---|"]
    for table in dict.fromkeys(models if len(models) > 1 else tables_of(models[0])):
        title, _, words = (table.__doc__ or "").split("\n")[0].partition(": ")
        own = keys_of(table)
        if title.startswith("`[") and own:
            rows.append(f"| **{title}** | {words[0].upper()}{words[1:]} | |")
        texts = described(table)
        for names in sorted(texts, key=lambda names: list(own).index(names[0])):
            text, _, usual = texts[names].partition(" Default: ")
            shown = list(dict.fromkeys(_default(own[name]) for name in names))
            rows.append(f"| {', '.join(f'`{name}`' for name in names)} | {text} | {usual or ', '.join(shown)} |")
    return "\n".join(rows)


def _default(field: FieldInfo) -> str:
    """A key's default as TOML spells it; empty where there is none."""
    if field.is_required():
        return "required"
    return "none" if field.default in (None, {}, []) else f"`{_toml(field.default)}`"


def _toml(value: Any) -> str:
    if isinstance(value, Enum):
        return _toml(value.value)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(_toml(one) for one in value)}]"
    return f'"{value}"' if isinstance(value, str) else f"{value:g}" if isinstance(value, float) else str(value)


def body_keys() -> str:
    """Keys of the body file."""
    from flexfmu.build.config import BodyFile

    return keys(BodyFile)


def place_keys() -> str:
    """Conditions of a place."""
    from flexfmu.build.tables import PlaceTable

    return keys(PlaceTable).replace("| key |", "| condition |")


def coupling_keys() -> str:
    """Keys of the coupling file."""
    from flexfmu.master.config import CouplingFile

    return keys(CouplingFile)


def scene_keys() -> str:
    """Keys of the scene file."""
    from flexfmu.study.scene.config import SceneFile

    return keys(SceneFile)


# --- commands, exports, datasets ---------------------------------------------------------------------------------


def commands() -> str:
    """Help of all commands, in Markdown."""
    command = [sys.executable, "-m", "typer", "flexfmu.commands.cli", "utils", "docs", "--name", "flexfmu"]
    text = subprocess.run(command, check=True, capture_output=True, text=True, env={**os.environ, "COLUMNS": "200"})
    # The page has a title of its own.
    return text.stdout.split("\n", 1)[1]


def exports() -> str:
    """All that the package exports, for mkdocstrings."""
    import flexfmu

    return "\n\n".join(f"::: flexfmu.{name}" for name in flexfmu.__all__ if name != "__version__")


def modal_file() -> str:
    """Table of the datasets of a modal file."""
    from flexfmu.model.arrays import ARRAYS
    from flexfmu.model.reduced_body import GROUPS

    entries = [*ARRAYS["body"], *(entry for part in GROUPS for entry in ARRAYS[part])]
    rows = [f"| `{entry.path}` | {entry.unit} | {entry.description} |" for entry in entries]
    rows += [f"| `stress/NNN_NAME/{entry.path}` | {entry.unit} | {entry.description} |" for entry in ARRAYS["stress"]]
    return "\n".join(["| dataset | unit | shape, meaning |", "|---|---|---|", *rows])


# --- messages ----------------------------------------------------------------------------------------------------


def messages_of(tree: ast.AST) -> Iterator[str]:
    """Texts of errors that a module raises and of warnings that it gives; `…` stands for what a run fills in."""
    for node in ast.walk(tree):
        called = node.exc if isinstance(node, ast.Raise) else node
        if isinstance(called, ast.Call) and called.args:
            name = called.func.attr if isinstance(called.func, ast.Attribute) else getattr(called.func, "id", "")
            if name.endswith("Error") if isinstance(node, ast.Raise) else name == "warning":
                text = _literal(called.args[-1])
                if len(re.findall(r"[a-z]{2,}", text)) > 3:
                    yield text


def _literal(node: ast.AST) -> str:
    """A text as it is written, `…` where it is computed."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(map(_literal, node.values))
    if isinstance(node, ast.BinOp):
        return _literal(node.left) + _literal(node.right)
    return "…"


def core_messages(source: str) -> Iterator[str]:
    """Texts that a C file writes; `…` stands for what a run fills in."""
    for found in re.findall(r'"(?:[^"\\]|\\.)*"(?:\s*"(?:[^"\\]|\\.)*")*', source):
        text = "".join(re.findall(r'"((?:[^"\\]|\\.)*)"', found)).replace('\\"', '"')
        text = re.sub(r"%%", "%", re.sub(r"%[-.\d]*(?:lld|[a-zA-Z])", "…", text))
        if len(re.findall(r"[a-z]{2,}", text)) > 4:
            yield text


def messages() -> str:
    """Every message, by the folder of the package that gives it."""
    found: dict[str, list[str]] = {}
    for path in sorted(PACKAGE.glob("*/**/*.*")):
        room = path.relative_to(PACKAGE).parts[0]
        if path.suffix == ".py":
            found.setdefault(room, []).extend(messages_of(ast.parse(path.read_text(encoding="utf-8"))))
        elif path.suffix in (".c", ".def"):
            found.setdefault(room, []).extend(core_messages(path.read_text(encoding="utf-8")))
    parts = []
    for room, texts in found.items():
        rows = [f"- `` {re.sub(r'…+', '…', ' '.join(text.split()))} ``" for text in dict.fromkeys(texts)]
        parts += [f"## `{room}`\n\n" + "\n".join(rows)] if rows else []
    return "\n\n".join(parts)


# --- pages -------------------------------------------------------------------------------------------------------


def _file(name: str) -> Callable[[], str]:
    """A file of the repository without its title, with links as a page of `docs/` has them."""

    def read() -> str:
        text = (ROOT / name).read_text(encoding="utf-8").split("\n", 1)[1]
        return re.sub(r"\]\(docs/", "](", text)

    return read


def _of(module: str, name: str) -> Callable[[], str]:
    """A table of another module, which is imported when it is made."""
    return lambda: str(getattr(importlib.import_module(f"docs.generators.{module}"), name)())


PARTS: dict[str, Callable[[], str]] = {
    "architecture": _file("ARCHITECTURE.md"),
    "body keys": body_keys,
    "changelog": _file("CHANGELOG.md"),
    "commands": commands,
    "costs of many instances": _of("result_tables", "costs_of_many"),
    "costs of steps": _of("result_tables", "costs_of_steps"),
    "costs of watches": _of("result_tables", "costs_of_watches"),
    "coupling keys": coupling_keys,
    "errors of methods in full": _of("result_tables", "methods_in_full"),
    "errors of methods in short": _of("result_tables", "methods_in_short"),
    "the shortest body file": _of("result_tables", "defaults_in_full"),
    "what bodies say of their own error": _of("result_tables", "defaults_certified"),
    "the shortest body file by frames": _of("result_tables", "defaults_by_frames"),
    "the shortest body file in short": _of("result_tables", "defaults_in_short"),
    "exports": exports,
    "messages": messages,
    "modal file": modal_file,
    "place keys": place_keys,
    "published problems in full": _of("result_tables", "field_in_full"),
    "published problems in short": _of("result_tables", "field_in_short"),
    "public files that are read": _of("result_tables", "coverage"),
    "scene keys": scene_keys,
    "thin bodies": _of("result_tables", "thin_bodies"),
    "variables: inputs and outputs": _of("variable_tables", "variables_in_and_out"),
    "variables: local": _of("variable_tables", "local_variables"),
    "variables: log": _of("variable_tables", "log_messages"),
    "variables: parameters": _of("variable_tables", "parameters"),
    "variables: status": _of("variable_tables", "status_codes"),
    "variables: words": _of("variable_tables", "parameter_words"),
}


ON_SITE = ("architecture", "changelog", "commands", "exports", "messages", "modal file")
"""Parts that only the site has."""
KEPT = tuple(name for name in PARTS if name not in ON_SITE)
"""Parts that the repository's pages hold as well, for readers without the site."""
PAGES = (
    *sorted((ROOT / "docs").rglob("*.md")),
    *(ROOT / name for name in ("demo/RESULTS.md", "benchmarks/field/README.md", "benchmarks/defaults/README.md")),
)


def filled(markdown: str, names: Collection[str] = tuple(PARTS)) -> str:
    """A page with these of its generated parts made anew."""

    def part(found: re.Match[str]) -> str:
        name = found["name"]
        made = f"\n{PARTS[name]().strip()}\n\n" if name in names else ""
        return f"<!-- generated: {name} -->\n{made}<!-- end -->\n"

    return _REGION.sub(part, markdown)


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    for path in PAGES:
        text = path.read_text(encoding="utf-8")
        if text != filled(text, KEPT):
            path.write_text(filled(text, KEPT), encoding="utf-8")
            print(path.relative_to(ROOT))
