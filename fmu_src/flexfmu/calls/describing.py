"""A readable description of a reduced body, for `flexfmu info`."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Column, Table
from rich.tree import Tree

from ..files.basics import plural
from ..model.reduced_body import GROUND, ReducedBody
from ..model.summary import NORMAL_MODES, first_frequency, missed_loads, missed_words, point, summary
from ..model.variants import chosen, offered_variants

if TYPE_CHECKING:
    from ..model.methods import Variant
    from ..study.cost import StepCost


def describe(body: ReducedBody) -> list[RenderableType]:
    """Tables of mass, size and materials, of modes and interfaces, the tree of frames, and where the body comes from.

    Parameters
    ----------
    body : ReducedBody

    Returns
    -------
    list of rich renderables
    """
    found = data(body)
    head = (
        f"[bold]{body.name}[/]: {plural(body.mode_count, 'mode')}, {plural(body.interface_count, 'interface')}, "
        f"{plural(body.frame_count, 'frame')}; method {found['method']}"
    )
    missed = [f"[yellow]warning:[/] {escape(words)}" for words in [missed_words(body)] if words]
    modes = [(one["name"], f"{one['frequency']:.6g}", f"{one['damping_ratio']:.4g}") for one in found["modes"]]
    interfaces = [(one["name"], point(one["point"]), one["frame"] or "none") for one in found["interfaces"]]
    origin = [(key.replace("_", " "), value) for key, value in sorted(body.provenance.items())]
    return [
        head,
        f"methods: {'; '.join(found['methods'])}",
        *missed,
        _table("Body", ["body", Column("", overflow="fold")], _properties(body)),
        _table("Modes", ["mode", "frequency / Hz", "damping ratio"], modes),
        _table("Interfaces", ["interface", "point / m", "frame"], interfaces),
        _frames(body),
        _table("Origin", ["origin", Column("", overflow="fold")], origin),
    ]


def _table(title: str, columns: Sequence[str | Column], rows: Iterable[Sequence[str]]) -> Table:
    table = Table(*columns, title=title, title_justify="left")
    for row in rows:
        table.add_row(*row)
    return table


def data(body: ReducedBody) -> dict[str, Any]:
    """The same as `describe` shows, as plain data: SI units, Hz.

    Parameters
    ----------
    body : ReducedBody

    Returns
    -------
    dict
    """
    names = {GROUND: None} | dict(enumerate(body.frame_names))
    frames, carriers = ([names[int(k)] for k in frame] for frame in (body.frame_parent, body.interface_frame))
    modes = zip(_mode_names(body), body.angular_frequency.tolist(), body.damping_ratio.tolist(), strict=True)
    return {
        "name": body.name,
        "method": chosen(body).words,
        "methods": [variant.words for variant in offered_variants(body)],
        "properties": body.properties,
        "missed_by_basis": missed_loads(body),
        "modes": [{"name": n, "frequency": omega / (2 * math.pi), "damping_ratio": ratio} for n, omega, ratio in modes],
        "interfaces": [
            {"name": name, "point": place, "frame": frame}
            for name, place, frame in zip(body.interface_names, body.interface_point.tolist(), carriers, strict=True)
        ],
        "frames": [
            {"name": name, "joint": place, "parent": parent}
            for name, place, parent in zip(body.frame_names, body.joint_point.tolist(), frames, strict=True)
        ],
        "origin": body.provenance,
    }


def cost_table(costs: Mapping["Variant", "StepCost"]) -> Table:
    """Table of what a step of each method costs.

    Parameters
    ----------
    costs : mapping of Variant to StepCost

    Returns
    -------
    rich.table.Table
    """
    table = Table("method", "median / µs", "fastest / µs", "iterations", title="Cost of a step")
    for variant, cost in costs.items():
        table.add_row(variant.words, f"{1e6 * cost.median:.0f}", f"{1e6 * cost.fastest:.0f}", f"{cost.iterations:.1f}")
    return table


def _properties(body: ReducedBody) -> Iterator[tuple[str, str]]:
    for label, value in () if body.properties is None else summary(body.properties):
        yield escape(label), value
    yield "first frequency", first_frequency(body.angular_frequency)
    if body.damper is not None:
        first = body.rigid_count
        more = float((body.damper[:, first] ** 2).sum()) / (2.0 * float(body.angular_frequency[first]))
        yield "dampers", f"add {more:.3g} to the damping ratio of the first mode"
    if body.membrane is not None:
        yield "membrane energy", body.membrane.words


def _mode_names(body: ReducedBody) -> list[str]:
    """Numbers as a body file names modes: elastic ones from 1, and those of normal modes that were chosen."""
    elastic = body.mode_count - body.rigid_count
    chosen = body.provenance.get(NORMAL_MODES, "").split()
    numbers = chosen if len(chosen) == elastic else [str(j) for j in range(1, elastic + 1)]
    return ["rigid"] * body.rigid_count + numbers


def _frames(body: ReducedBody) -> Tree:
    root = Tree("Frames (name, joint / m)" if body.frame_count else "No frames: the body moves linearly")
    branches: dict[int, Tree] = {GROUND: root}
    for s, name in enumerate(body.frame_names):
        held = [body.interface_names[i] for i in range(body.interface_count) if body.interface_frame[i] == s]
        carries = f"  carries {', '.join(held)}" if held else ""
        parent = branches[int(body.frame_parent[s])]
        branches[s] = parent.add(f"{name}  {point(body.joint_point[s])}{carries}")
    return root
