"""A readable description of a reduced body, for `flexfmu info`."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

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
    head = (
        f"[bold]{body.name}[/]: {plural(body.mode_count, 'mode')}, {plural(body.interface_count, 'interface')}, "
        f"{plural(body.frame_count, 'frame')}; method {chosen(body).words}"
    )
    offered = f"methods: {'; '.join(variant.words for variant in offered_variants(body))}"
    missed = [f"[yellow]warning:[/] {escape(words)}" for words in [missed_words(body)] if words]
    return [head, offered, *missed, _properties(body), _modes(body), _interfaces(body), _frames(body), _origin(body)]


def data(body: ReducedBody) -> dict[str, object]:
    """The same as `describe` shows, as plain data: SI units, Hz.

    Parameters
    ----------
    body : ReducedBody

    Returns
    -------
    dict
    """
    frames = [None if int(parent) == GROUND else body.frame_names[int(parent)] for parent in body.frame_parent]
    carriers = _carriers(body)
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


def _properties(body: ReducedBody) -> Table:
    table = Table("body", Column("", overflow="fold"), title="Body", title_justify="left")
    for label, value in () if body.properties is None else summary(body.properties):
        table.add_row(escape(label), value)
    table.add_row("first frequency", first_frequency(body.angular_frequency))
    if body.damper is not None:
        first = body.rigid_count
        more = float((body.damper[:, first] ** 2).sum()) / (2.0 * float(body.angular_frequency[first]))
        table.add_row("dampers", f"add {more:.3g} to the damping ratio of the first mode")
    if body.membrane is not None:
        table.add_row("membrane energy", body.membrane.words)
    return table


def _modes(body: ReducedBody) -> Table:
    table = Table("mode", "frequency / Hz", "damping ratio", title="Modes", title_justify="left")
    for name, omega, ratio in zip(_mode_names(body), body.angular_frequency, body.damping_ratio, strict=True):
        table.add_row(name, f"{omega / (2 * math.pi):.6g}", f"{ratio:.4g}")
    return table


def _mode_names(body: ReducedBody) -> list[str]:
    """Numbers as a body file names modes: elastic ones from 1, and those of normal modes that were chosen."""
    elastic = body.mode_count - body.rigid_count
    chosen = body.provenance.get(NORMAL_MODES, "").split()
    numbers = chosen if len(chosen) == elastic else [str(j) for j in range(1, elastic + 1)]
    return ["rigid"] * body.rigid_count + numbers


def _interfaces(body: ReducedBody) -> Table:
    table = Table("interface", "point / m", "frame", title="Interfaces", title_justify="left")
    for name, place, carrier in zip(body.interface_names, body.interface_point, _carriers(body), strict=True):
        table.add_row(name, point(place), carrier or "none")
    return table


def _carriers(body: ReducedBody) -> list[str | None]:
    """Names of the frames that carry the interfaces."""
    return [None if int(frame) == GROUND else body.frame_names[int(frame)] for frame in body.interface_frame]


def _frames(body: ReducedBody) -> Tree:
    root = Tree("Frames (name, joint / m)" if body.frame_count else "No frames: the body moves linearly")
    branches: dict[int, Tree] = {GROUND: root}
    for s, name in enumerate(body.frame_names):
        held = [body.interface_names[i] for i in range(body.interface_count) if body.interface_frame[i] == s]
        carries = f"  carries {', '.join(held)}" if held else ""
        parent = branches[int(body.frame_parent[s])]
        branches[s] = parent.add(f"{name}  {point(body.joint_point[s])}{carries}")
    return root


def _origin(body: ReducedBody) -> Table:
    table = Table("origin", Column("", overflow="fold"), title="Origin", title_justify="left")
    for key, value in sorted(body.provenance.items()):
        table.add_row(key.replace("_", " "), value)
    return table
