"""The whole finite element model by CalculiX: its deck from ours, a run, and its displacements read back.

Under NLGEOM CalculiX takes *ELASTIC as a linear law between Green's strain and the second Piola-Kirchhoff stress, and
*CLOAD as forces that keep their direction, as `fe.nonlinear` does.
"""

import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexfmu.fe.layers import elasticity
from flexfmu.files.basics import FloatArray, IntArray
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.elements import ElementBlock
from flexfmu.mesh.model import Mesh
from flexfmu.reduction.model import Model
from flexfmu.study.scene.config import SceneError

PROGRAM = "ccx"
_JOB = "model"
# Largest residual over mean force at which an increment counts as converged; CalculiX's own 0.005 is no reference.
_TOLERANCE = 1e-7
# The first increment, as part of the whole load; from there on CalculiX chooses, up to so many.
_FIRST, _INCREMENTS = 0.25, 1000
# Forces below this part of the largest are round-off of the interface's operator.
_ROUND_OFF = 1e-12
# How often a run is looked at, s, and how much of its log is told when it fails, lines.
_LOOK, _TOLD = 0.2, 12


@dataclass(frozen=True, slots=True)
class CalculixRun:
    """What a run found and took.

    Attributes
    ----------
    displacement : (f, 3n) float
        At each factor, m; not a number at nodes that were not asked for.
    seconds : float
        Of one core.
    increments, iterations : int
    """

    displacement: FloatArray
    seconds: float
    increments: int
    iterations: int


def find_calculix() -> str | None:
    """Path of CalculiX's solver, or None where it is not installed."""
    return shutil.which(PROGRAM)


def deck(model: Model, load: FloatArray, factors: Sequence[float], nodes: IntArray, title: str) -> str:
    """Deck of a nonlinear static run through parts of a load, one step each.

    Nodes are numbered from one in the mesh's order, elements likewise over all blocks.

    Parameters
    ----------
    model : Model
        Every element with a material.
    load : (3n,) float
        Nodal forces, N.
    factors : sequence of float
        Parts of the load, ascending.
    nodes : (k,) int
        Nodes whose displacements are printed.
    title : str
        First comment line.

    Returns
    -------
    str
    """
    lines = [f"** {title}", *_mesh_cards(model), *_support_cards(model), *_equation_cards(model)]
    lines += ["*NSET, NSET=PRINTED", *(f"{node + 1}," for node in nodes)]
    before = 0.0
    for factor in factors:
        first = min(1.0, _FIRST * float(factors[-1]) / (factor - before))
        lines += [f"*STEP, NLGEOM, INC={_INCREMENTS}", "*STATIC", f"{first:.9g}, 1."]
        lines += ["*CONTROLS, PARAMETERS=FIELD", f"{_TOLERANCE:.9g}"]
        lines += ["*CLOAD", *_load_lines(factor * load)]
        # At the end of the step, which is always printed, and never before.
        lines += [f"*NODE PRINT, NSET=PRINTED, FREQUENCY={10 * _INCREMENTS}", "U", "*END STEP"]
        before = factor
    return "\n".join(lines) + "\n"


# Places of 11, 22, 33, 12, 13, 23 among xx, yy, zz, xy, yz, zx.
_DECK_ORDER = [0, 1, 2, 3, 5, 4]


def _mesh_cards(model: Model) -> Iterator[str]:
    mesh = model.mesh
    yield "*NODE"
    # CalculiX reads twenty characters of a number.
    for number, point in enumerate(mesh.points, start=1):
        yield f"{number}, " + ", ".join(f"{x:.12e}" for x in point)
    number, used = 0, []
    # A material in other axes is one of its own.
    made: dict[bytes, int] = {}
    for place, block in enumerate(mesh.blocks):
        keys = [found.tobytes() for found in np.column_stack([block.material, _elasticity(mesh, block)])]
        materials = np.array([made.setdefault(key, len(made)) for key in keys])
        for index in np.unique(materials):
            name = f"PART{place}_{index}"
            used.append((name, int(index)))
            yield f"*ELEMENT, TYPE={block.type.name}, ELSET={name}"
            for row in np.flatnonzero(materials == index):
                words = [str(number + row + 1), *(str(node + 1) for node in block.connectivity[row])]
                yield from _wrapped(words, 10)
        number += len(block.material)
    for key, index in made.items():
        found = np.frombuffer(key)
        material = mesh.materials[int(found[0])]
        yield f"*MATERIAL, NAME=MATERIAL{index}"
        if material.constants is None:
            yield from ("*ELASTIC", f"{material.youngs_modulus:.12e}, {material.poissons_ratio:.12e}")
        else:
            # Upper triangle, column by column, of 11, 22, 33, 12, 13, 23.
            matrix = found[1:].reshape(6, 6)[np.ix_(_DECK_ORDER, _DECK_ORDER)]
            words = [f"{value:.12e}" for value in matrix[np.tril_indices(6)]]
            yield from ("*ELASTIC, TYPE=ANISO", *_wrapped(words, 8))
        yield from ("*DENSITY", f"{material.density:.12e}")
    for name, index in used:
        yield f"*SOLID SECTION, ELSET={name}, MATERIAL=MATERIAL{index}"


def _wrapped(words: Sequence[str], most: int) -> Iterator[str]:
    """Lines of so many words; one that goes on ends in a comma."""
    for k in range(0, len(words), most):
        yield ", ".join(words[k : k + most]) + ("," if k + most < len(words) else "")


def _elasticity(mesh: Mesh, block: ElementBlock) -> FloatArray:
    """Elasticity (n_elements, 36) in global axes, zero where axes do not matter."""
    if block.axes is None and all(material.constants is None for material in mesh.materials):
        return np.zeros((len(block.labels), 36))
    return elasticity(mesh, block).reshape(-1, 36).round(3)


def _support_cards(model: Model) -> Iterator[str]:
    nodes, axes = np.nonzero(model.fixed)
    if nodes.size:
        yield "*BOUNDARY"
    yield from (f"{node + 1}, {axis + 1}, {axis + 1}" for node, axis in zip(nodes, axes, strict=True))
    number = sum(len(block.material) for block in model.mesh.blocks)
    # A spring on a translation that is held does nothing.
    stiffness = np.where(model.fixed, 0.0, model.spring)
    for axis in range(3):
        for place, value in enumerate(np.unique(stiffness[:, axis][stiffness[:, axis] > 0.0])):
            name = f"SPRING{axis + 1}_{place}"
            yield f"*ELEMENT, TYPE=SPRING1, ELSET={name}"
            for node in np.flatnonzero(stiffness[:, axis] == value):
                number += 1
                yield f"{number}, {node + 1}"
            yield from (f"*SPRING, ELSET={name}", f"{axis + 1}", f"{value:.12e}")


def _equation_cards(model: Model) -> Iterator[str]:
    """Equations, solved for what no other one and no support determines."""
    transform = model.unknowns.transform
    if transform is None:
        return
    for dof in np.setdiff1d(np.flatnonzero(~model.fixed), model.free):
        row = slice(transform.indptr[dof], transform.indptr[dof + 1])
        terms = [(dof, -1.0), *zip(model.free[transform.indices[row]], transform.data[row], strict=True)]
        yield from ("*EQUATION", str(len(terms)))
        words = [f"{place // 3 + 1}, {place % 3 + 1}, {value:.12e}" for place, value in terms]
        yield from (", ".join(words[k : k + 4]) for k in range(0, len(words), 4))


def _load_lines(load: FloatArray) -> Iterator[str]:
    forces = load.reshape(-1, 3)
    least = _ROUND_OFF * float(np.abs(forces).max(initial=0.0))
    for node, axis in zip(*np.nonzero(np.abs(forces) > least), strict=True):
        yield f"{node + 1}, {axis + 1}, {forces[node, axis]:.12e}"


def read_displacements(text: str, node_count: int) -> tuple[list[float], FloatArray]:
    """Read displacements that CalculiX printed (.dat).

    Parameters
    ----------
    text : str
    node_count : int

    Returns
    -------
    times : list of float
        Total time of each table.
    displacement : (tables, 3n) float
        m; not a number at nodes that are not in it.

    Raises
    ------
    SceneError
        A table that is none.
    """
    times: list[float] = []
    tables: list[FloatArray] = []
    for line in text.splitlines():
        head, words = re.match(r"\s*displacements .* time\s+(\S+)", line), line.split()
        if head is not None:
            times.append(float(head[1]))
            tables.append(np.full((node_count, 3), np.nan))
        elif words and tables:
            try:
                tables[-1][int(words[0]) - 1] = [float(word) for word in words[1:]]
            except (ValueError, IndexError) as error:
                found = line.strip()
                raise SceneError(f"CalculiX printed {found!r}, expected a node and three displacements") from error
    return times, np.array(tables).reshape(len(tables), 3 * node_count)


def run(text: str, factors: Sequence[float], node_count: int, report: Reporter) -> CalculixRun:
    """Run CalculiX on a deck of `deck`, on one core, in a temporary folder.

    Parameters
    ----------
    text : str
    factors : sequence of float
        Those of the deck.
    node_count : int
    report : Reporter

    Returns
    -------
    CalculixRun

    Raises
    ------
    SceneError
        It is not installed, it does not converge, or it fails otherwise.
    """
    program = find_calculix()
    if program is None:
        raise SceneError(
            f"CalculiX is asked for and {PROGRAM!r} is not on the PATH: install it (Debian package calculix-ccx), or "
            "bring results"
        )
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as name:
        folder = Path(name)
        (folder / f"{_JOB}.inp").write_text(text, encoding="ascii")
        start, before = time.perf_counter(), os.times()
        with (folder / "log.txt").open("w") as log:
            environment = os.environ | {"OMP_NUM_THREADS": "1"}
            process = subprocess.Popen(
                [program, "-i", _JOB], cwd=folder, env=environment, stdout=log, stderr=subprocess.STDOUT
            )
            try:
                _follow(process, folder / f"{_JOB}.sta", report)
            finally:
                # Interrupted by the user, it ends with us.
                process.kill()
                process.wait()
        wall, after = time.perf_counter() - start, os.times()
        own = after.children_user + after.children_system - before.children_user - before.children_system
        said = (folder / "log.txt").read_text(encoding="utf-8", errors="replace")
        result = folder / f"{_JOB}.dat"
        times, found = read_displacements(result.read_text(), node_count) if result.exists() else ([], np.zeros((0, 0)))
        _check(process.returncode, said, times, factors)
        counts = _counts(folder / f"{_JOB}.sta")
    # What other programs took of the processor meanwhile does not count.
    seconds = min(wall, own) if own > 0.0 else wall
    return CalculixRun(found, seconds, len(counts), sum(iterations for _, _, iterations in counts))


def _follow(process: subprocess.Popen[bytes], status: Path, report: Reporter) -> None:
    """Wait for the end, and say what is reached meanwhile."""
    said = 0
    while process.returncode is None:
        with suppress(subprocess.TimeoutExpired):
            process.wait(_LOOK)
        for step, reached, iterations in (counts := _counts(status))[said:]:
            report.note(f"CalculiX: {100.0 * reached:.4g} % of step {step} after {iterations} iterations")
        said = len(counts)


def _counts(status: Path) -> list[tuple[int, float, int]]:
    """Step, part of it that is reached, and iterations of each increment so far."""
    if not status.exists():
        return []
    found = []
    for line in status.read_text(encoding="utf-8", errors="replace").splitlines():
        # Step, increment, attempt, iterations, total time, step time, increment.
        words = line.split()
        if len(words) == 7 and words[0].isdigit() and words[3].isdigit():
            found.append((int(words[0]), float(words[5]), int(words[3])))
    return found


def _check(code: int, said: str, times: list[float], factors: Sequence[float]) -> None:
    """Refuse a run that did not come to its end."""
    reached = len(times)
    if code == 0 and "*ERROR" not in said and "Job finished" in said and reached == len(factors):
        return
    end = "\n  ".join([line.strip() for line in said.splitlines() if line.strip()][-_TOLD:])
    if "divergence" in said or "too many cutbacks" in said:
        where = f"beyond {factors[reached - 1]:g} of the load" if reached else "at the first part of the load"
        raise SceneError(
            f"CalculiX does not converge {where}: it is near a limit or critical load; lower the load, or bring "
            f"results. Its last lines:\n  {end}"
        )
    raise SceneError(f"CalculiX failed (exit code {code}). Its last lines:\n  {end}")
