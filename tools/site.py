"""Hooks of mkdocs: fills pages with what the code itself says, the commands' help and the modal file's datasets."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any


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
    from flexfmu.model import arrays
    from flexfmu.model.reduced_body import PARTS

    entries = [*arrays.BODY, *(entry for part in PARTS for entry in part.entries)]
    rows = [f"| `{entry.path}` | {entry.unit} | {entry.description} |" for entry in entries]
    rows += [f"| `stress/NNN_NAME/{entry.path}` | {entry.unit} | {entry.description} |" for entry in arrays.STRESS]
    return "\n".join(["| dataset | unit | shape, meaning |", "|---|---|---|", *rows])


def architecture() -> str:
    """ARCHITECTURE.md, without its title."""
    return (Path(__file__).parents[1] / "ARCHITECTURE.md").read_text(encoding="utf-8").split("\n", 1)[1]


PARTS_OF_PAGES = {"architecture": architecture, "commands": commands, "exports": exports, "modal file": modal_file}


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace each `<!-- generated: NAME -->` by that part."""
    for name, make in PARTS_OF_PAGES.items():
        mark = f"<!-- generated: {name} -->"
        if mark in markdown:
            markdown = markdown.replace(mark, make())
    return markdown
