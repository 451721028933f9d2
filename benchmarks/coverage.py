"""Which input files of a folder are read, by source and kind of element, and why the others are refused.

Run from the repository's root: python -m benchmarks.coverage FOLDER [--only PATTERN]; it writes benchmarks/coverage.csv
(with --only it does not). Each folder in FOLDER is a source, OWNER+NAME a repository. Every file with nodes and with
solids, shells or beams counts once, however often it is there. It is read in a process of its own, which may take a
minute and 4 GB.

Classes are solids, shells, beams, mixed and mesh file (of formats that have no names of elements). Files that are
refused and hold elements of another physics or dimension count as "other": fluids, acoustics, networks, heat, axial
symmetry, plane strain or stress, membranes; so do mesh files of lines alone, and bulk data whose only materials conduct
heat. Surfaces alone are read as shells of some thickness.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import os
import re
import resource
import signal
import sys
import tempfile
import time
from collections import Counter, defaultdict
from pathlib import Path

from flexfmu import FlexfmuError, read_mesh
from flexfmu.files.basics import UnitSystem

RECORD = Path(__file__).with_suffix(".csv")
SECONDS, BYTES = 60, 4 << 30
SUFFIXES = {
    ".inp",
    ".bdf",
    ".nas",
    ".fem",
    ".dat",
    ".cdb",
    ".msh",
    ".med",
    ".exo",
    ".e",
    ".g",
    ".gen",
    ".unv",
    ".vtu",
    ".vtk",
}
_SOLIDS = re.compile(r"C3D\d|CTETRA|CHEXA|CPENTA|CPYRAM|tetra|hexahedron|wedge")
_SHELLS = re.compile(r"S[34]R?5?$|S[689]R?5?$|STRI\d|CTRIA|CQUAD")
_BEAMS = re.compile(r"B[23][123]|T[23]D|CBAR|CBEAM|C?ROD|CONROD|CTUBE")
# Solids, shells and beams of Ansys by number.
_ANSYS = {**dict.fromkeys((45, 62, 64, 65, 70, 72, 73, 87, 90, 92, 95, 96, 185, 186, 187, 190, 285), "C3D8"),
          **dict.fromkeys((28, 41, 43, 63, 93, 99, 91, 131, 132, 181, 281, 208, 209), "S4"),
          **dict.fromkeys((1, 3, 4, 8, 10, 16, 23, 24, 44, 54, 180, 188, 189, 288, 289, 290), "B31")}  # fmt: skip
_OTHER = re.compile(
    r"\bTYPE\s*=\s*(D|F3D\d|AC3D\d+|DC3D\d+R?|DC2D\d|CAX\d\w*|CPE\d\w*|CPS\d\w*|M3D\d\w*|T2D\d)\s*(,|$)|"
    r"^(CQUADX\d?|CTRIAX\d?|CHBDY\w|CHACAB|CAABSF|MAT10|PLPLANE|ACMODL)\b",
    re.MULTILINE | re.IGNORECASE,
)
_LONGEST = 240
OUTCOMES = ("read", "refused", "traceback", "time", "memory")


def kind_of(path: Path) -> str:
    """Solids, shells, beams or mixed, by the names of elements in a file and those it includes; empty for others."""
    text, suffix = _text(path, 0), path.suffix.lower()
    if suffix in (".msh", ".med", ".exo", ".e", ".g", ".gen", ".unv", ".vtu", ".vtk"):
        return "" if "git-lfs" in text[:100] else "mesh file"
    names: set[str] = set()
    if re.search(r"^\s*\*ELEMENT\b", text, re.M | re.I):
        # Without a section it is a part of another deck.
        if not re.search(r"^\s*\*[\w ]*SECTION", text, re.M | re.I):
            return ""
        if not re.search(r"^\s*\*\s*NODE\b(?!\s*(PRINT|FILE|OUTPUT))", text, re.M | re.I):
            return ""
        names = {one.upper() for one in re.findall(r"^\s*\*ELEMENT\b[^\n]*TYPE\s*=\s*(\w+)", text, re.M | re.I)}
    elif re.search(r"^\s*(EBLOCK|NBLOCK)", text, re.M | re.I):
        kinds = re.findall(r"^\s*ET\s*,\s*\w+\s*,\s*(\d+)", text, re.M | re.I)
        names = {_ANSYS.get(int(kind), "") for kind in kinds}
    elif re.search(r"^GRID\b", text, re.M | re.I):
        names = {one.upper() for one in re.findall(r"^(C[A-Z]+\d?)\b", text, re.M | re.I)}
    found = [kind for kind, known in (("solids", _SOLIDS), ("shells", _SHELLS), ("beams", _BEAMS))
             if any(known.match(name) for name in names)]  # fmt: skip
    return found[0] if len(found) == 1 else "mixed" if found else ""


def _conducts(text: str) -> bool:
    """Whether all materials of bulk data are of heat."""
    return {int(number) for number in re.findall(r"^MAT(\d+)\b", text, re.M | re.I)} in ({4}, {5}, {4, 5})


def _text(path: Path, depth: int) -> str:
    """A file's text with what it includes."""
    try:
        text = path.read_text(encoding="latin-1").replace("\r", "\n")
    except OSError:
        return ""
    parts = [text]
    found = re.findall(r"^\s*\*INCLUDE\s*,\s*INPUT\s*=\s*\"?([^\n\"]+)|^INCLUDE\s+'([^']+)'", text, re.M | re.I)
    if depth < 5:
        parts += [_text(path.parent / (one or other).strip(), depth + 1) for one, other in found]
    return "\n".join(parts)


def outcome_of(path: Path) -> tuple[str, str, float]:
    """What reading a file comes to, the message and the processor's seconds, in a forked process."""
    start = time.monotonic()
    with tempfile.TemporaryFile("w+") as said:
        child = os.fork()
        if not child:
            _read(path, said)
        usage = None
        while usage is None and time.monotonic() - start < SECONDS:
            ended, status, used = os.wait4(child, os.WNOHANG)
            usage = used if ended else None
            time.sleep(0.005)
        if usage is None:
            os.kill(child, signal.SIGKILL)
            os.wait4(child, 0)
            return "time", "", float(SECONDS)
        said.seek(0)
        outcome, _, message = said.read().partition("\n")
    seconds = usage.ru_utime + usage.ru_stime
    return outcome or "traceback", message or ("" if outcome else f"the process ended with {status}"), seconds


def _read(path: Path, said: object) -> None:
    """Read a file, write what it comes to, and end the process."""
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    with Path(os.devnull).open("w") as nothing:
        os.dup2(nothing.fileno(), 1)
        os.dup2(nothing.fileno(), 2)
    try:
        found = _in_some_units(path)
    except MemoryError:
        found = "memory\n"
    except BaseException as error:
        found = f"traceback\n{type(error).__name__}: {error}"
    said.write(found)  # type: ignore[attr-defined]
    said.flush()  # type: ignore[attr-defined]
    os._exit(0)


def _in_some_units(path: Path) -> str:
    """What comes of a file in the units that fit it; a user knows them."""
    for system in UnitSystem:
        try:
            mesh = read_mesh(path, system)
            return f"read\n{mesh.element_count} elements; {' | '.join(mesh.notes)}"
        except FlexfmuError as error:
            found = f"refused\n{error}"
            if "no volume cells" in found and re.search("triangle|quad", found):
                return _as_shells(path, system)
            if "units" not in found:
                break
    return found


def _as_shells(path: Path, system: UnitSystem) -> str:
    try:
        return f"read\n{read_mesh(path, system, {'': 1e-3}).element_count} elements; as shells"
    except FlexfmuError as error:
        return f"refused\n{error}"


def reason_of(message: str, path: Path) -> str:
    """A message without names, numbers and places, so that alike ones are counted together."""
    bare = re.sub(r"^\S*?" + re.escape(path.name) + r"(, line \d+)?:? ?", "", message.replace(str(path), path.name))
    bare = re.sub(r"'[^']*'|\"[^\"]*\"", "'…'", bare)
    return re.sub(r"\b\d[\d.e+-]*\b", "#", bare)[:110]


def table(rows: list[dict[str, str]]) -> str:
    """Read files over all, by source and kind, as Markdown."""
    kinds = ("solids", "shells", "beams", "mixed", "mesh file")
    others = Counter(row["repository"] for row in rows if row["class"] == "other")
    rows = [row for row in rows if row["class"] != "other"]
    count: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for row in rows:
        for source in (row["repository"], "**all**"):
            for kind in (row["class"], "all"):
                count[source, kind][row["outcome"]] += 1
    lines = [f"| source | {' | '.join(kinds)} | all | other |", "|---" * 8 + "|"]
    for source in [*sorted({row["repository"] for row in rows}), "**all**"]:
        cells = []
        for kind in (*kinds, "all"):
            found = count[source, kind]
            cells.append(f"{found['read']} of {found.total()}" if found.total() else "")
        number = others.total() if source == "**all**" else others[source]
        lines.append(f"| {source} | {' | '.join(cells)} | {number or ''} |")
    return "\n".join(lines)


def row_of(path: Path, folder: Path) -> dict[str, str] | None:
    """A file's row of the record; none of what is no deck."""
    if not (kind := kind_of(path)):
        return None
    outcome, message, seconds = outcome_of(path)
    text = _text(path, 0)
    lines_alone = kind == "mesh file" and "one of the cell sets ," in message
    if outcome == "refused" and (_OTHER.search(text) or lines_alone or _conducts(text)):
        kind = "other"
    source, *rest = path.relative_to(folder).parts
    message = " ".join(message.replace(f"{path.parent}/", "").replace(f"{folder}/", "").split())[:_LONGEST]
    print(f"{outcome:10} {seconds:6.1f} s  {source}/{'/'.join(rest)}", flush=True)
    return {"repository": source.replace("+", "/"), "path": "/".join(rest), "class": kind, "outcome": outcome,
            "message": message}  # fmt: skip


def main() -> None:
    """Read all files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    folder, rows, seen = options.folder.resolve(), [], set()
    # What readers leave behind falls there.
    os.chdir(tempfile.mkdtemp())
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() not in SUFFIXES or not path.is_file() or options.only not in str(path):
            continue
        digest = hashlib.sha256(path.read_bytes()).digest()
        if digest not in seen and (row := row_of(path, folder)) is not None:
            rows.append(row)
        seen.add(digest)
    if not options.only:
        with RECORD.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    print(table(rows))
    for outcome in OUTCOMES[1:]:
        refused = [row for row in rows if row["outcome"] == outcome and row["class"] != "other"]
        for reason, number in Counter(reason_of(row["message"], Path(row["path"])) for row in refused).most_common(60):
            print(f"{outcome:10} {number:5}  {reason}")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
