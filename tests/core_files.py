"""The core's C files in the order of ARCHITECTURE.md."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def core_order():
    """Names without endings, from the lowest up."""
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    rows = text.split("| files | what they do |")[1].split("\n\n")[0].splitlines()[2:]
    return [name for row in rows for name in re.findall(r"`(\w+)`", row.split("|")[1])]
