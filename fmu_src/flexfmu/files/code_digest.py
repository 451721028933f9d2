"""Which code makes a result: a module, all modules of this package that it imports, and the libraries that count.

Results that are kept on disk are known by it. A version number would not do: it stays the same from change to change.
What computes nothing does not count: the room of files, comments, docstrings, and what errors say.
"""

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

_PACKAGE = __name__.partition(".")[0]
_CORE, _COMPILED = f"{_PACKAGE}.core.library", (".c", ".h", ".def")
_ROOT = Path(__file__).parents[2]
# Errors, progress, files: no result hangs on them, but for the factors of units.
_ROOM = __name__.rpartition(".")[0]
_UNITS = f"{_ROOM}.units"
# Another version of these may give other numbers; the last two need not be there.
_LIBRARIES = ("numpy", "scipy", "pymetis", "pypardiso", "mkl")


@cache
def code_digest(module: str) -> str:
    """Hash of the code of a module.

    Parameters
    ----------
    module : str
        Full name, such as `__name__`.

    Returns
    -------
    str
        12 hexadecimal digits.
    """
    digest = hashlib.sha256()
    for name in sorted(imported_modules(module)):
        if name == _UNITS or not name.startswith(f"{_ROOM}."):
            digest.update(f"{name}\0{_read(name)[0]}\0".encode())
        # What is compiled belongs to the module that calls it.
        compiled = (
            [path for path in _source(name).parent.iterdir() if path.suffix in _COMPILED] if name == _CORE else []
        )
        for path in sorted(compiled):
            digest.update(f"{path.name}\0".encode() + hashlib.sha256(path.read_bytes()).digest())
    digest.update(repr([_version(name) for name in _LIBRARIES]).encode())
    return digest.hexdigest()[:12]


def imported_modules(module: str) -> set[str]:
    """Modules of this package on which a module depends, itself among them; the package's own face left out.

    Parameters
    ----------
    module : str
        Full name.

    Returns
    -------
    set of str
    """
    found: set[str] = set()
    left = [module]
    while left:
        name = left.pop()
        if name not in found and name != _PACKAGE:
            found.add(name)
            left += _read(name)[1]
    return found


@cache
def _read(module: str) -> tuple[str, tuple[str, ...]]:
    """Hash of what a module computes, and the modules of this package that it imports, wherever in its text."""
    path = _source(module)
    package = module if path.stem == "__init__" else module.rpartition(".")[0]
    tree = ast.parse(path.read_bytes())
    imports = tuple(name for node in ast.walk(tree) for name in _named(node, package))
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise):
            node.exc = node.cause = None
        elif isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body = node.body[1:]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest(), imports


def _named(node: ast.AST, package: str) -> Iterator[str]:
    """Modules of this package that a statement in a module of a package names."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names if alias.name.partition(".")[0] == _PACKAGE)
    elif isinstance(node, ast.ImportFrom):
        above = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
        base = ".".join([*above, *([node.module] if node.module else [])])
        if base.partition(".")[0] == _PACKAGE:
            for alias in node.names:
                inner = f"{base}.{alias.name}"
                yield inner if _find(inner) is not None else base


@cache
def _find(module: str) -> Path | None:
    path = _ROOT.joinpath(*module.split("."))
    return next((p for p in (path / "__init__.py", path.with_suffix(".py")) if p.is_file()), None)


def _source(module: str) -> Path:
    path = _find(module)
    if path is None:
        raise ValueError(f"no source of {module} below {_ROOT}: expected a module of {_PACKAGE}")
    return path


def _version(library: str) -> str:
    # Its import takes a tenth of a second, and `flexfmu info` needs no key.
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(library)
    except PackageNotFoundError:
        return ""
