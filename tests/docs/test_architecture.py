"""The order of packages is that of ARCHITECTURE.md, and imports make no circle."""

import ast
import io
import re
import tokenize
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

from core_files import core_order

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "fmu_src" / "flexfmu"
CORE = PACKAGE / "core"
LONGEST_FUNCTION, LONGEST_FILE = 80, 500
LONGEST_PYTHON_FUNCTION = 60
# Lines of Python with code, a ceiling that goes down as the package does: 19 000 is the aim.
MOST_CODE = 22610
# Where what is short lies: all but the tests, whose modules are lists of facts.
SHORT = [ROOT / name for name in ("fmu_src", "benchmarks", "demo", "docs", ".ci")]
BLANK = {getattr(tokenize, name) for name in ["COMMENT", "NL", "NEWLINE", "INDENT", "DEDENT", "ENDMARKER"]}


@cache
def parsed(path):
    """Text of a module, and its tree; each is read once."""
    text = path.read_text(encoding="utf-8")
    return text, ast.parse(text)


def below(node):
    """A statement and those within it: expressions, which are most of a tree, hold none."""
    yield node
    for block in ("body", "orelse", "finalbody", "handlers", "cases"):
        for inner in getattr(node, block, ()):
            yield from below(inner)


@cache
def statements(path):
    """Every statement of a module, which is the first."""
    return list(below(parsed(path)[1]))


@cache
def modules():
    """Every module's name and file."""
    found = {}
    for path in PACKAGE.rglob("*.py"):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(name, path, known):
    """Modules of the package that a module imports."""
    package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
    found = set()
    for node in statements(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            inner = {f"{base}.{alias.name}" for alias in node.names} & known.keys()
            found |= inner or {base}
    return (found & known.keys()) - {name}


def test_no_module_imports_one_that_imports_it():
    known = modules()
    # The package's face names what it hands on.
    graph = {name: imports(name, path, known) for name, path in known.items() if name != PACKAGE.name}
    assert sum(map(len, graph.values())) > 2 * len(graph)
    # It raises where there is a circle, and names it.
    assert {*TopologicalSorter(graph).static_order()} == graph.keys()


def test_no_benchmark_imports_one_that_imports_it():
    known = {f"benchmarks.{path.stem}": path for path in (ROOT / "benchmarks").glob("*.py") if path.stem != "__init__"}
    graph = {name: imports(name, path, known) for name, path in known.items()}
    assert sum(map(len, graph.values())) > 5
    assert {*TopologicalSorter(graph).static_order()} == graph.keys()


def test_packages_import_from_those_above_them_only():
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \|", text.split("| package |")[1].split("\n\n")[0], re.M)
    rank = {name: number for number, name in enumerate(rows)}
    assert set(rank) == {path.parent.name for path in PACKAGE.glob("*/*.py")}
    downward = []
    known = modules()
    for name, path in known.items():
        own = rank.get([*name.split("."), ""][1])
        if own is not None:
            others = {other: [*other.split("."), ""][1] for other in imports(name, path, known)}
            downward += [f"{name} imports {other}" for other, room in others.items() if rank.get(room, 99) > own]
    assert downward == []


def test_few_modules_lie_loose():
    """In the package itself lies its face; everything else has a room."""
    assert len(list(PACKAGE.glob("*.py"))) <= 6


def test_files_of_the_core_include_those_before_them_only():
    order = core_order()
    files = sorted([*CORE.glob("*.c"), *CORE.glob("*.h")])
    # Every file has one place in the order.
    assert sorted(order) == sorted({path.stem for path in files})
    upward, arrows = [], 0
    for path in files:
        for other in re.findall(r'^#include "(\w+)\.h"', path.read_text(encoding="utf-8"), re.M):
            arrows += other != path.stem
            if order.index(other) > order.index(path.stem):
                upward.append(f"{path.name} includes {other}.h")
    assert upward == []
    assert arrows > 2 * len(order)


def c_functions(text):
    """Names and lengths of a C file's functions, which begin and end at the margin."""
    start = None
    for number, line in enumerate(text.splitlines()):
        if re.match(r"\w[^=;]*\(", line) and not line.endswith(";"):
            start, name = number, line
        elif line == "}" and start is not None:
            yield name, number - start + 1
            start = None


def test_functions_and_files_in_c_are_short():
    long, count = [], 0
    for path in sorted(path for folder in SHORT for path in folder.rglob("*.[ch]")):
        text = path.read_text(encoding="utf-8")
        found = list(c_functions(text))
        count += len(found)
        long += [path.name] * (len(text.splitlines()) > LONGEST_FILE)
        long += [(path.name, name) for name, length in found if length > LONGEST_FUNCTION]
    assert long == []
    assert count > 200


def python_functions(path):
    """Names and lengths of a module's functions, from `def` to the end, docstrings included."""
    for node in statements(path):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.name, node.end_lineno - node.lineno + 1


def test_functions_and_modules_in_python_are_short():
    long, count = [], 0
    for path in sorted(path for folder in SHORT for path in folder.rglob("*.py")):
        text, _ = parsed(path)
        found = list(python_functions(path))
        count += len(found)
        long += [path.name] * (len(text.splitlines()) > LONGEST_FILE)
        long += [(path.name, name) for name, length in found if length > LONGEST_PYTHON_FUNCTION]
    assert long == []
    assert count > 1500


def code_lines(path):
    """Lines with tokens, without docstrings."""
    tokens = tokenize.generate_tokens(io.StringIO(parsed(path)[0]).readline)
    lines = {number for each in tokens if each.type not in BLANK for number in range(each.start[0], each.end[0] + 1)}
    for node in statements(path):
        kinds = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
        if isinstance(node, kinds) and ast.get_docstring(node) is not None:
            lines -= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return len(lines)


def test_the_package_does_not_grow():
    code = sum(code_lines(path) for path in PACKAGE.rglob("*.py"))
    assert 10_000 < code <= MOST_CODE


def test_a_class_has_a_name_of_its_own():
    """One word, one meaning: no name of a class means two things."""
    found = {}
    for path in PACKAGE.rglob("*.py"):
        for node in statements(path):
            if isinstance(node, ast.ClassDef):
                found.setdefault(node.name, []).append(path.relative_to(PACKAGE).as_posix())
    assert {name: paths for name, paths in found.items() if len(paths) > 1} == {}
