"""A view as a picture for reports: shaded faces from back to front, without a display."""

from typing import Any

import matplotlib
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from ..files.basics import FloatArray, IntArray, length_unit
from ..files.figures import Drawing
from ..reduction.surface import face_edges, face_normals
from .model import DISPLACEMENT, STRESS, Case, View

# A palette that colour-blind readers can tell apart (Okabe and Ito), and what belongs to nothing.
PALETTE = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442", "#999999")
PLAIN, GHOST = "#b8c2cc", "#7d858c"
_AXES = ("#d55e00", "#009e73", "#0072b2")
_HALO = [withStroke(linewidth=2.5, foreground="white", alpha=0.8)]
# Inches.
_WIDTH = 8.0
_LIGHT = np.array([-0.35, 0.55, 0.75]) / np.linalg.norm([-0.35, 0.55, 0.75])
# Cosine of the angle between faces beyond which their edge is drawn bold.
_CORNER = 0.85
# More faces than this: their edges would hide the colours.
_MANY_FACES = 12000


def camera_along(right: Any, up: Any) -> FloatArray:
    """Directions right, up and towards the eye, as rows, of a picture whose axes are closest to two directions."""
    x = np.asarray(right, dtype=float) / np.linalg.norm(right)
    y = np.asarray(up, dtype=float) - np.dot(up, x) * x
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)])


def camera_of(size: FloatArray) -> FloatArray:
    """The same of a picture that shows a body of some size (3,) from its broad side."""
    broad = size[:2][size[:2] > 0.15 * size[:2].max()]
    if size[2] < 0.12 * broad.min():
        return camera_along([1.0, 0.0, -0.35], [0.12, 1.0, -0.3])
    right = np.array([0.9, 0.45, 0.0]) if size[0] >= size[1] else np.array([-0.45, 0.9, 0.0])
    right /= np.linalg.norm(right)
    return camera_along(right, np.cross([0.87 * right[1], -0.87 * right[0], 0.5], right))


def corner_edges(points: FloatArray, faces: IntArray) -> IntArray:
    """Edges (e, 2) where the surface has a corner or ends."""
    normals = face_normals(points, faces)
    pairs, owner = face_edges(faces)
    edges, index, count = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
    total = np.zeros((len(edges), 3))
    np.add.at(total, index.ravel(), normals[owner])
    # |n₁ + n₂|² = 2 + 2 cos.
    return edges[(count != 2) | ((total**2).sum(axis=1) < 2.0 + 2.0 * _CORNER)]


def draw_surface(
    panel: Any,
    points: FloatArray,
    faces: IntArray,
    camera: FloatArray,
    colours: FloatArray,
    edges: bool = True,
    order: float = 2.0,
) -> None:
    """Draw shaded faces into axes, from back to front.

    Parameters
    ----------
    panel : matplotlib axes
    points : (n, 3) float
        m.
    faces : (f, 4) int
    camera : (3, 3) float
        As of `camera_along`.
    colours : (f, 3) float
        Of the faces, before shading.
    edges : bool
        Whether the faces' edges are drawn.
    order : float
        Higher ones hide lower ones.
    """
    seen = points @ camera.T
    normals = face_normals(points, faces) @ camera.T
    front = normals[:, 2] > 0.0
    drawn = np.flatnonzero(front)[np.argsort(seen[faces][:, :, 2].mean(axis=1)[front])]
    shade = 0.58 + 0.42 * np.clip(normals[drawn] @ _LIGHT, 0.0, 1.0)
    tint = np.clip(colours[drawn] * shade[:, None] + 0.04, 0.0, 1.0)
    lines: dict[str, Any] = {"edgecolors": (0.07, 0.1, 0.14, 0.35), "linewidths": 0.3}
    if not edges or len(faces) > _MANY_FACES:
        # Thin lines of the faces' own colour close the gaps between them.
        lines = {"edgecolors": tint, "linewidths": 0.25}
    panel.add_collection(PolyCollection([*seen[faces[drawn]][:, :, :2]], facecolors=tint, zorder=order, **lines))


def draw_outline(panel: Any, points: FloatArray, edges: IntArray, camera: FloatArray, colour: str, **look: Any) -> None:
    """Draw edges (e, 2) of points (n, 3) into axes."""
    lines = [*(points @ camera.T)[edges][:, :, :2]]
    panel.add_collection(LineCollection(lines, colors=colour, **{"linewidths": 0.7, "zorder": 1.0} | look))


def draw_triad(panel: Any, camera: FloatArray) -> None:
    """Draw the directions of the axes into a small panel of their own."""
    panel.set_aspect("equal")
    panel.set_axis_off()
    panel.set(xlim=(-1.5, 1.5), ylim=(-1.5, 1.5))
    directions = camera.T
    # Those that point at the eye come last.
    for axis in np.argsort(directions[:, 2]):
        x, y = directions[axis, :2]
        ink = _AXES[axis]
        arrow = {"arrowstyle": "-|>", "color": ink, "lw": 1.4, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 8}
        panel.annotate("", xy=(x, y), xytext=(0.0, 0.0), arrowprops=arrow)
        panel.text(1.35 * x, 1.35 * y, "xyz"[axis], color=ink, ha="center", va="center", fontsize=9)


def draw_view(view: View, case: Case | None, shape: int) -> Figure:
    """Draw one shape of a motion beside the undeformed body.

    Parameters
    ----------
    view : View
    case : Case or None
    shape : int
        Index along the motion.

    Returns
    -------
    Figure
    """
    factor = 1.0 if case is None else view.factor(case)
    points = view.points + factor * (np.zeros_like(view.points) if case is None else case.places[shape] - view.points)
    both = np.concatenate([view.points, points])
    camera = camera_of(np.ptp(both, axis=0))
    extent = np.ptp(both @ camera[:2].T, axis=0)
    height = float(np.clip(_WIDTH * 0.8 * extent[1] / max(extent[0], 1e-12) + 1.2, 3.2, 7.0))
    figure = Drawing(figsize=(_WIDTH, height))
    panel = figure.add_axes((0.02, 0.45 / height, 0.8, 1.0 - 0.95 / height))
    panel.set_aspect("equal", adjustable="datalim")
    panel.set_axis_off()
    tint, bar = _tint(view, case, shape, view.colour)
    draw_surface(panel, points, view.faces, camera, tint)
    if case is not None:
        draw_outline(panel, view.points, corner_edges(view.points, view.faces), camera, GHOST)
    _draw_marks(panel, view, case, shape, factor, camera)
    panel.margins(0.07)
    panel.autoscale_view()
    draw_triad(figure.add_axes((0.0, 0.3 / height, 0.9 / _WIDTH, 0.9 / height)), camera)
    if bar is not None:
        figure.colorbar(bar[0], cax=figure.add_axes((0.86, 0.2, 0.025, 0.6)), label=bar[1])
    else:
        _legend(panel, view, view.colour)
    title = view.title if case is None else f"{view.title}: {case.name}"
    figure.text(0.02, 1.0 - 0.12 / height, title, fontsize=12, va="top")
    if case is not None:
        scaled = "" if factor == 1.0 else f"; drawn × {factor:g}"
        figure.text(0.02, 0.1 / height, f"{case.note}{scaled}", fontsize=9, color="#5b6875")
    return figure


def _tint(view: View, case: Case | None, shape: int, colour: str) -> tuple[FloatArray, Any]:
    """Colours (f, 3) of the faces, and what a colour bar needs, or None."""
    if case is not None and colour in (DISPLACEMENT, STRESS):
        lengths = np.linalg.norm(case.places - view.points, axis=2)
        values, factor, unit = lengths, *length_unit(float(lengths.max()))
        if colour == STRESS and case.stress is not None:
            values, factor, unit = case.stress, 1e-6, "MPa"
        norm = matplotlib.colors.Normalize(0.0, factor * float(values.max()) or 1.0)
        mean = factor * values[shape][view.faces].mean(axis=1)
        scale = matplotlib.cm.ScalarMappable(norm, "viridis")
        return scale.to_rgba(mean)[:, :3], (scale, f"{colour} / {unit}")
    tint = np.tile(matplotlib.colors.to_rgb(PLAIN), (len(view.faces), 1))
    for region in view.regions:
        if region.title == colour:
            palette = np.array([region_colour(k) for k in range(len(region.names))] + [tint[0]])
            tint = palette[region.number[view.faces]].mean(axis=1)
    return tint, None


def region_colour(number: int) -> tuple[float, float, float]:
    """Colour of a name: the palette, then its lighter and its darker half."""
    red, green, blue = matplotlib.colors.to_rgb(PALETTE[number % len(PALETTE)])
    share, add = ((1.0, 0.0), (0.55, 0.45), (0.6, 0.0))[number // len(PALETTE) % 3]
    return share * red + add, share * green + add, share * blue + add


def _draw_marks(panel: Any, view: View, case: Case | None, shape: int, factor: float, camera: FloatArray) -> None:
    rest = view.mark_points
    places = rest if case is None else rest + factor * (case.marks[shape] - rest)
    looks = {
        "interface": ("o", "#d55e00", 6),
        "joint": ("D", "#1d2733", 3.5),
        "cut": ("D", "#cc79a7", 5),
        "support": ("^", "#1d2733", 7),
        "spring": ("s", "#1d2733", 6),
    }
    for mark, place in zip(view.marks, places @ camera.T, strict=True):
        form, ink, size = looks[mark.kind]
        panel.plot(*place[:2], form, color=ink, markersize=size, markeredgecolor="white", zorder=8)
        if mark.kind != "joint":
            words = {"xytext": (7, 7), "textcoords": "offset points", "fontsize": 9, "zorder": 9, "path_effects": _HALO}
            panel.annotate(mark.name, place[:2], **words)


def _legend(panel: Any, view: View, colour: str) -> None:
    for region in view.regions:
        if region.title == colour:
            used = [k for k in range(len(region.names)) if np.any(region.number == k)]
            handles = [panel.plot([], [], "s", color=region_colour(k), label=region.names[k])[0] for k in used]
            beside = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5)}
            panel.legend(handles=handles, title=region.title, frameon=False, fontsize=9, **beside)
