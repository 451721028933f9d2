"""Mutations that no one thought of: operators drawn at random in the lines of physics (see mutations.py).

A drawn mutation turns a sign, doubles a factor, moves an index, turns a comparison round, or deletes a statement.
Left out are lines that do no physics: messages, docstrings, annotations, imports, guards that only refuse, sizes of
work arrays, memos, and bookkeeping of round-off. What compiles to the same bytes is no mutation and is drawn anew.

First run the tests that noticed others in the same file, then the quick tests of ROWS, the slow ones of these, and for
what is left every quick test. Limits are in processor time, so that other work on the machine decides nothing.

What a number of a seed is follows from the lines of physics, and changes with them: the record says of which commit.
"""

from __future__ import annotations

import ast
import csv
import io
import marshal
import queue
import random
import re
import subprocess
import tempfile
import threading
import time
import tokenize
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from fnmatch import fnmatch
from pathlib import Path

from benchmarks import mutated as tools
from benchmarks.records import where

KINDS = ("sign", "factor", "index", "comparison", "deletion")
REFERENCE = "tests/reference/test_reference.py"
PHYSICS = "tests/physics/test_"
# Files below the package, and the tests that can notice, the likeliest first; the first row that fits counts.
ROWS: tuple[tuple[str, str], ...] = (
    ("core/step_free.c", "spinning inertia free_bodies followers acceleration"),
    ("core/free_body.c", "spinning inertia free_bodies followers acceleration"),
    ("core/step_inertial.c", "inertia motion mass_polynomial spinning"),
    ("core/learning.c", "inertia spinning motion"),
    ("core/inertia.c", "= inertia spinning"),
    ("core/polynomial.c", "motion mass_polynomial"),
    ("core/step_tied.c", "ties cut motion stepping"),
    ("core/ties.c", "= ties cut motion"),
    ("core/step_plain.c", "motion stepping step_bounds followers propagation"),
    ("core/step*.c", "motion stepping step_bounds ties inertia spinning"),
    ("core/propagation.c", "propagation motion ties stepping"),
    ("core/statics.c", "statics motion membrane followers stability_watch"),
    ("core/compliance.c", "compliance watch coupling motion"),
    ("core/watch.c", "stability_watch watch missed_inertia spinning ties"),
    ("core/membrane.c", "= membrane motion"),
    ("core/motion.c", "= stress statics motion"),
    ("core/joints.c", "tests/cli/test_master.py coupling"),
    ("core/exchange.c", "tests/cli/test_master.py coupling"),
    ("core/acceleration.c", "tests/cli/test_master.py coupling"),
    ("core/coupling.c", "coupling"),
    ("core/certificate.c", "certificate watched_material"),
    ("core/channel.c", "tests/unit/test_channel.py tests/cli/test_foreign_fmus.py"),
    ("core/surface.c", "@surface @live @view"),
    ("core/doubts.c", "coupling"),
    ("core/*.c", "= statics motion followers cut inertia stability_watch compliance acceleration"),
    ("fe/shells.py", "shells"),
    ("mesh/shapes.py", "shells"),
    ("fe/*.py", "@fe @surface stress nonlinear stability_watch second_order membrane @modes thin_bodies"),
    ("reduction/cut/*.py", "cut loops inner_loops ties acceleration"),
    ("reduction/membrane.py", "membrane loops"),
    ("reduction/fourth_order.py", "membrane loops"),
    ("reduction/fourth_order.py", "loops membrane"),
    ("reduction/second_order.py", "second_order curved_bodies membrane"),
    ("reduction/division.py", "@division chain tree @run_time_division"),
    ("reduction/subdomains.py", "@division averaged_rotation free_bodies tree chain"),
    ("reduction/*.py", "@modes @bases @rigid_fit free_bodies acceleration @division @surface inertia point_masses cut"),
    ("program/mass_polynomial.py", "mass_polynomial"),
    ("program/*.py", "= stability_watch statics tree membrane watch motion free_bodies"),
    ("model/variants.py", "@bases second_order free_bodies acceleration coupling inertia"),
    ("model/*.py", "= @rotations @methods second_order inertia statics membrane"),
    ("body/*.py", "@surface statics motion stress tree"),
)
TEXT = re.compile(
    r"message|report|note|warn|words|raise |Error\(|print|digest|__all__|isinstance|flags\.writeable|dtype"
)
# Sizes, memos, round-off and refusals of the core.
NO_PHYSICS = re.compile(
    r"take|demand|arena|remember|recall|memo|ROUND_OFF|NOISE|isfinite|return [A-Z_]+;|rounds|work->|hint|quiet|reach"
    r"|blur|#|static const|refus"
)
C_DECLARATION = re.compile(
    r"^\s*(const |static |double|int64_t|int |size_t|char|void|typedef|struct|enum|[A-Z]\w+ \*?\w+ ?[=;,])"
)
C_STATEMENT = re.compile(r"^\s*(?:[\w.>\[\]*+ \-]+ (?:[-+*/]?=) [^;]*|\w+\([^;]*\));$")
COMPARED = {"<": ">", ">": "<", "<=": ">", ">=": "<", "==": "!=", "!=": "=="}


@dataclass(frozen=True)
class Mutation:
    """One changed line.

    Attributes
    ----------
    file : str
        Below the package.
    line : int
        From one.
    kind : str
    before, after : str
        The line.
    """

    file: str
    line: int
    kind: str
    before: str
    after: str


def tests_of(file: str) -> str:
    """Arguments of pytest for a file's mutations: tests of its name, then those of its row."""
    words = next(words for pattern, words in ROWS if fnmatch(file, pattern)).split()
    names = {"=": REFERENCE}
    unit = {word: f"tests/unit/test_{word[1:]}.py" for word in words if word.startswith("@")}
    own = (f"tests/{folder}/test_{Path(file).stem}.py" for folder in ("unit", "physics", "reference"))
    likely = [names.get(w) or unit.get(w) or (w if "/" in w else f"{PHYSICS}{w}.py") for w in words]
    return " ".join(dict.fromkeys([*(path for path in own if (tools.ROOT / path).is_file()), *likely]))


def python_lines(text: str) -> dict[int, list[tokenize.TokenInfo]]:
    """Tokens of the lines that compute."""
    tree, left_out = ast.parse(text), set()
    spans: list[ast.AST] = []
    for node in ast.walk(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom, ast.Raise, ast.Assert, ast.JoinedStr)):
            spans.append(node)
        elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            left_out |= set(range(node.lineno, node.body[0].lineno))
            if node.name in ("__post_init__", "__repr__") or "words" in node.name or "check" in node.name:
                spans.append(node)
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            spans.append(node)
        elif isinstance(node, ast.If) and all(isinstance(each, ast.Raise) for each in node.body):
            spans += [node.test, *node.body]
        elif isinstance(node, ast.AnnAssign) and node.value is None:
            spans.append(node)
    # Constants of a module are thresholds; what stands in no function is no formula.
    inside = {
        number
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        for number in range(node.body[0].lineno, (node.end_lineno or 0) + 1)
    }
    for node in spans:
        left_out |= set(range(node.lineno, (node.end_lineno or 0) + 1))
    found: dict[int, list[tokenize.TokenInfo]] = {}
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in (tokenize.OP, tokenize.NUMBER, tokenize.NAME) and token.start[0] in inside - left_out:
            found.setdefault(token.start[0], []).append(token)
    return found


def python_mutations(file: str, text: str) -> Iterator[Mutation]:
    """All mutations of a Python file."""
    lines = text.splitlines()
    single = {
        node.lineno
        for node in ast.walk(ast.parse(text))
        if isinstance(node, (ast.AugAssign, ast.Expr, ast.Assign)) and node.lineno == node.end_lineno
    }
    for number, tokens in python_lines(text).items():
        line = lines[number - 1]
        if TEXT.search(line):
            continue
        yield from token_mutations(file, number, line, [(t.string, t.start[1], t.end[1]) for t in tokens])
        # A name that is set nowhere else would stop every run: only what changes something is deleted.
        if number in single and re.match(r"\s*[\w.]+(\[.*\])? ?[-+*/@]=|\s*[\w.]+\[.*\] = |\s*np\.\w+(\.at)?\(", line):
            yield Mutation(file, number, "deletion", line, re.match(r"\s*", line)[0] + "pass")  # type: ignore[index]


def token_mutations(file: str, number: int, line: str, tokens: list[tuple[str, int, int]]) -> Iterator[Mutation]:
    """Signs, factors, indices and comparisons of a line of either language."""
    depth, before = 0, ""

    def changed(kind: str, start: int, end: int, new: str) -> Mutation:
        return Mutation(file, number, kind, line, line[:start] + new + line[end:])

    for word, start, end in tokens:
        depth += (word == "[") - (word == "]")
        operand = bool(re.match(r"[\w\])]", before[-1:])) and before not in (
            "return",
            "in",
            "and",
            "or",
            "not",
            "if",
            "else",
        )
        if word in ("+", "-") and operand:
            yield changed("sign" if not depth else "index", start, end, "-" if word == "+" else "+")
        elif word in ("+=", "-="):
            yield changed("sign", start, end, "-=" if word == "+=" else "+=")
        elif word in COMPARED and not line.lstrip().startswith("for "):
            yield changed("comparison", start, end, COMPARED[word])
        elif re.fullmatch(r"\d+\.\d+(e-?\d+)?", word):
            yield changed("factor", start, end, repr(2.0 * float(word) or 1.0))
        elif word.isdigit() and depth:
            yield changed("index", start, end, str(int(word) + 1))
        before = word


def c_mutations(file: str, text: str) -> Iterator[Mutation]:
    """All mutations of a C file."""
    # Comments and strings become blanks of their length.
    blank = re.sub(r'/\*.*?\*/|"(?:\\.|[^"\\])*"', lambda m: re.sub(r"[^\n]", " ", m[0]), text, flags=re.S)
    for number, (line, code) in enumerate(zip(text.splitlines(), blank.splitlines(), strict=True), 1):
        if not code.startswith("    ") or NO_PHYSICS.search(code) or TEXT.search(code):
            continue
        words = re.finditer(r"\d+\.\d+(?:e-?\d+)?|\w+|->|\+\+|--|[-+*/<>=!]=|.", code)
        tokens = [(m[0], m.start(), m.end()) for m in words if m[0].strip()]
        declared = C_DECLARATION.match(code) and "=" not in code
        if not declared:
            yield from token_mutations(file, number, line, tokens)
        if C_STATEMENT.match(code) and not C_DECLARATION.match(code):
            yield Mutation(file, number, "deletion", line, ";")


def all_mutations(package: Path) -> list[Mutation]:
    """Every mutation of the package's physics, in a fixed order."""
    found: list[Mutation] = []
    rooms = ("core", "fe", "reduction", "program", "model", "body")
    # Wide vectors, FMI and files: no physics of ours.
    others = (
        "vectors",
        "fmi[23]*",
        "component",
        "instance*",
        "program",
        "files",
        "version",
        "arena",
        "refusals",
        "monitor",
        "looks",
        "participant",
    )
    data = (
        "arrays",
        "modal_file",
        "errors",
        "summary",
        "methods",
        "reduced_body",
        "variables",
        "variable_table",
        "variants",
    )
    speed = ("factorisation", "basis", "materials", "places", "sets", "programs", "drafts", "loads", "replay")
    for room in rooms:
        for path in sorted((package / room).rglob("*.c" if room == "core" else "*.py")):
            skipped = others if room == "core" else (*data, *speed)
            if not any(fnmatch(path.stem, pattern) for pattern in skipped):
                file, text = path.relative_to(package).as_posix(), path.read_text(encoding="utf-8")
                found += c_mutations(file, text) if room == "core" else python_mutations(file, text)
    return found


def drawn(package: Path, count: int, seed: int) -> list[Mutation]:
    """Mutations drawn without repetition: each time first the kind, then one of that kind."""
    by_kind = {kind: [each for each in all_mutations(package) if each.kind == kind] for kind in KINDS}
    chance, found = random.Random(seed), []
    while len(found) < count and any(by_kind.values()):
        kind = chance.choice([kind for kind in KINDS if by_kind[kind]])
        found.append(by_kind[kind].pop(chance.randrange(len(by_kind[kind]))))
    return found


COLUMNS = (
    "seed",
    "number",
    *(field.name for field in fields(Mutation)),
    "outcome",
    "by",
    "seconds",
    "reason",
    "commit",
)
KILLED, SURVIVED, NONE, UNCLEAR = "killed", "survived", "no mutation", "unclear"
# Reductions that a mutation does not touch are found once for all of a copy's runs.
KEPT = """

from pathlib import Path


@pytest.fixture(scope="session")
def bodies():
    return Bodies(Store(Path(__file__).parents[2] / "reductions"))
"""
# Rounds of tests that a mutation has to pass, each with its limit (s of the processor).
MOST_KILLERS = 5
ROUNDS = (("killers", 150.0), ("quick", 300.0), ("slow", 600.0), ("all", 1200.0))
EVERY_TEST = "tests/reference tests/physics tests/unit tests/fmi tests/cli tests/foreign"
QUICK, ANY = ["-m", "not slow"], ["-m", "not long"]
# Pytest's answers where it finds none, and where a test of this name has no such parameters.
NO_TESTS, NOT_THERE = 5, 4


def nodes(tree: Path, name: str) -> list[str]:
    """Where a test function is, as pytest asks for it."""
    files = sorted((tree / "tests").rglob("test_*.py"))
    found = (path for path in files if f"def {name}(" in path.read_text(encoding="utf-8"))
    return [f"{path.relative_to(tree).as_posix()}::{name}" for path in found]


def killers(tree: Path, file: str, records: list[dict[str, str]]) -> list[str]:
    """Tests that noticed mutations of a file, or of others in C, the most frequent first."""
    noticed = [row for row in records if row["outcome"] == KILLED and row["by"].startswith("test_")]
    own = [row for row in noticed if row["file"] == file]
    if not own and file.endswith(".c"):
        own = [row for row in noticed if row["file"].endswith(".c")]
    names = Counter(row["by"].split(" - ")[0].partition("[")[0] for row in own)
    return [node for name, _ in names.most_common(MOST_KILLERS) for node in nodes(tree, name)]


def tests_of_round(tree: Path, name: str, file: str, records: list[dict[str, str]]) -> list[str]:
    """Arguments of pytest for a round, none where it has no tests."""
    if name == "killers":
        found = killers(tree, file, records)
        return [*found, *ANY] if found else []
    if name == "all":
        return [*EVERY_TEST.split(), *QUICK]
    return [*tests_of(file).split(), *(QUICK if name == "quick" else ["-m", "slow and not long"])]


def tried(tree: Path, mutation: Mutation, records: list[dict[str, str]]) -> tuple[str, str]:
    """What became of a mutation, and by which test."""
    path, library = tree / tools.PACKAGE / mutation.file, tools.library_of(tree)
    text, right = path.read_text(encoding="utf-8"), library.read_bytes()
    lines = text.splitlines(keepends=True)
    lines[mutation.line - 1] = mutation.after + "\n"
    path.write_text("".join(lines), encoding="utf-8")
    try:
        if path.suffix == ".c":
            # Once for all rounds.
            try:
                tools.compile_core(tree)
            except SystemExit:
                return NONE, "does not compile"
            if library.read_bytes() == right:
                return NONE, "compiles to the same"
        elif marshal.dumps(compile(text, "", "exec")) == marshal.dumps(compile("".join(lines), "", "exec")):
            return NONE, "compiles to the same"
        for name, longest in ROUNDS:
            tests = tests_of_round(tree, name, mutation.file, records)
            done = tools.run_tests(tree, tests, processor=longest) if tests else None
            if done is None or done.returncode in (0, NO_TESTS):
                continue
            if -done.returncode == tools.OUT_OF_TIME:
                return UNCLEAR, f"no end within {longest:.0f} s of the processor"
            outcome, by = tools.judged(done.returncode, done.stdout)
            return (KILLED if outcome is tools.Outcome.KILLED else UNCLEAR), by
        return SURVIVED, ""
    except subprocess.TimeoutExpired:
        return UNCLEAR, "no end"
    finally:
        path.write_text(text, encoding="utf-8")
        library.unlink()
        library.write_bytes(right)


def confirmed(tree: Path, by: str, known: dict[str, bool]) -> bool:
    """Whether the test that failed passes without the mutation."""
    name, _, parameters = by.split(" - ")[0].partition("[")
    if not name.startswith("test_"):
        return True
    if by not in known:
        whole = f"[{parameters}" if parameters.endswith("]") else ""
        known[by] = all(
            tools.run_tests(tree, [f"{node}{whole}", *ANY]).returncode in (0, NO_TESTS, NOT_THERE)
            for node in nodes(tree, name)
        )
    return known[by]


def read(path: Path, seed: int) -> dict[int, dict[str, str]]:
    """Rows of a record by their number."""
    if not path.is_file():
        return {}
    with path.open(newline="", encoding="utf-8") as file:
        return {int(row["number"]): row for row in csv.DictReader(file) if int(row["seed"]) == seed}


def run(count: int, seed: int, minutes: float, output: Path, jobs: int = 2) -> bool:
    """Try drawn mutations until `count` of them are decided; whether all were killed."""
    rows, lock, known = read(output, seed), threading.Lock(), dict[str, bool]()
    with (tools.ROOT / "benchmarks" / "mutations.csv").open(newline="", encoding="utf-8") as file:
        others = list(csv.DictReader(file))
    commit = where()["commit"]
    waiting: queue.Queue[tuple[int, Mutation]] = queue.Queue()
    for each in enumerate(drawn(tools.ROOT / tools.PACKAGE, 2 * count, seed), 1):
        if rows.get(each[0], {}).get("outcome", UNCLEAR) == UNCLEAR:
            waiting.put(each)
    end = time.monotonic() + 60.0 * minutes

    def decided() -> int:
        return sum(row["outcome"] in (KILLED, SURVIVED, UNCLEAR) for row in rows.values())

    def work(tree: Path) -> None:
        while time.monotonic() < end and decided() < count:
            try:
                number, mutation = waiting.get_nowait()
            except queue.Empty:
                return
            start = time.monotonic()
            outcome, by = tried(tree, mutation, [*others, *rows.values()])
            if outcome == KILLED and not confirmed(tree, by, known):
                outcome, by = UNCLEAR, f"fails without the mutation, too: {by}"
            seconds = f"{time.monotonic() - start:.0f}"
            result = {"outcome": outcome, "by": by, "seconds": seconds, "reason": "", "commit": commit}
            with lock:
                rows[number] = {"seed": str(seed), "number": str(number)} | asdict(mutation) | result
                with output.open("w", newline="", encoding="utf-8") as file:
                    writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
                    writer.writeheader()
                    writer.writerows(rows[key] for key in sorted(rows))
                print(
                    f"{number}: {outcome}: {mutation.file}:{mutation.line}: {mutation.after.strip()} ({by})", flush=True
                )

    with tempfile.TemporaryDirectory(prefix="mutations_") as name:
        trees = [Path(name).resolve() / str(job) / "tree" for job in range(jobs)]
        for tree in trees:
            tools.copied(tree, KEPT)
        threads = [threading.Thread(target=work, args=(tree,)) for tree in trees]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    counts = {word: sum(row["outcome"] == word for row in rows.values()) for word in (KILLED, SURVIVED, UNCLEAR, NONE)}
    print(", ".join(f"{number} {word}" for word, number in counts.items()))
    return counts[KILLED] == decided()
