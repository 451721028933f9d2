"""Hooks of mkdocs: fills pages with what the code itself says."""

import sys
from pathlib import Path
from typing import Any


def on_startup(**_: Any) -> None:
    """Let the project's own folders be imported."""
    sys.path.insert(0, str(Path(__file__).parents[2]))


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Make the generated parts of a page."""
    from docs.generators.reference_pages import filled

    return filled(markdown)
