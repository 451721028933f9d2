"""A view on paper, on a page, in ParaView or in a notebook."""

import base64
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import meshio
import numpy as np

from ..files.basics import FlexfmuError, FloatArray
from ..files.outputs import PICTURE_SUFFIXES, check_target, page_text, whole_file
from .model import Case, View

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_vtu(view: View, case: Case | None, shape: int, path: Path) -> None:
    """Write one shape of the surface: undeformed points, with the true displacement as a field.

    Parameters
    ----------
    view : View
    case : Case or None
    shape : int
        Index along the motion.
    path : Path

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    triangle = view.faces[:, 2] == view.faces[:, 3]
    cells = [
        (kind, faces)
        for kind, faces in (("quad", view.faces[~triangle]), ("triangle", view.faces[triangle, :3]))
        if len(faces)
    ]
    data = {region.title.replace(" ", "_"): region.number for region in view.regions}
    if case is not None:
        data["displacement"] = case.places[shape] - view.points
        if case.stress is not None:
            data["von_mises"] = case.stress[shape]
    with whole_file(path) as part:
        meshio.Mesh(view.points, cells, point_data=data).write(part, file_format="vtu")


def write_pvd(view: View, case: Case, path: Path) -> list[Path]:
    """Write a motion as NAME.pvd, and its shapes into the folder NAME beside it.

    Parameters
    ----------
    view : View
    case : Case
    path : Path

    Returns
    -------
    list of Path
        The .vtu files.

    Raises
    ------
    OutputError
        A file cannot be written.
    """
    folder = path.with_suffix("")
    with whole_file(path) as part:
        folder.mkdir(exist_ok=True)
        files = [folder / f"{path.stem}_{k:04d}.vtu" for k in range(len(case.position))]
        for k, file in enumerate(files):
            write_vtu(view, case, k, file)
        rows = [
            f"    <DataSet timestep={quoteattr(repr(float(t)))} file={quoteattr(f'{folder.name}/{file.name}')}/>"
            for t, file in zip(np.asarray(case.position), files, strict=True)
        ]
        head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        part.write_text(head + "\n".join(rows) + "\n  </Collection>\n</VTKFile>\n", encoding="utf-8")
    return files


_RAMP = 33
# Displacements are whole multiples of their largest over this: finer than any screen.
_MOST, _MOST_STRESS = 32767, 65535


def page(view: View) -> str:
    """Text of the page.

    Parameters
    ----------
    view : View

    Returns
    -------
    str
    """
    import matplotlib

    ramp = matplotlib.colormaps["viridis"](np.linspace(0.0, 1.0, _RAMP))[:, :3]
    content = {
        "title": view.title,
        "subtitle": view.subtitle,
        "points": _packed(view.points, "<f4"),
        "faces": _packed(view.faces, "<u4"),
        "regions": [{"title": r.title, "names": [*r.names], "number": _packed(r.number, "<i4")} for r in view.regions],
        "marks": [{"kind": mark.kind, "name": mark.name} for mark in view.marks],
        "markPoints": _rounded(view.mark_points),
        "sets": {name: [int(i) for i in rows] for name, rows in view.sets.items()},
        "colours": list(view.colours),
        "colour": view.colour if view.colour in view.colours else next(iter(view.colours), ""),
        "ramp": np.round(ramp, 3).tolist(),
        "cases": [_case(view, case) for case in view.cases],
        "live": view.live,
    }
    return page_text(__package__, view.title, content, *(() if view.live is None else ("fmu.js", "live.js")))


def _case(view: View, case: Case) -> dict[str, Any]:
    moved = case.places - view.points
    largest = float(np.abs(moved).max())
    quantum = largest / _MOST if largest > 0.0 else 1.0
    found: dict[str, Any] = {
        "name": case.name,
        "label": case.label,
        "unit": case.unit,
        "position": [float(f"{x:.9g}") for x in case.position],
        "quantum": quantum,
        "moved": _packed(np.round(moved / quantum), "<i2"),
        "top": float(np.linalg.norm(moved, axis=2).max()),
        "low": _rounded((case.places.min(axis=(0, 1)) - view.points.min(axis=0))[None])[0],
        "high": _rounded((case.places.max(axis=(0, 1)) - view.points.max(axis=0))[None])[0],
        "marks": [_rounded(places) for places in case.marks],
        "peak": view.telling(case) / max(len(case.position) - (0 if case.cyclic else 1), 1),
        "cyclic": case.cyclic,
        "note": case.note,
        "factor": view.factor(case),
    }
    if case.stress is not None:
        top = float(case.stress.max())
        found["stressTop"] = top
        found["stress"] = _packed(np.round(case.stress * (_MOST_STRESS / top if top > 0.0 else 0.0)), "<u2")
    return found


def _packed(values: Any, kind: str) -> str:
    """Numbers as base64 of their bytes."""
    return base64.b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode()


def _rounded(places: FloatArray) -> list[list[float]]:
    return [[float(f"{x:.7g}") for x in place] for place in places]


PAGE, SHAPE, SERIES = ".html", ".vtu", ".pvd"
SUFFIXES = (PAGE, SHAPE, SERIES, *PICTURE_SUFFIXES)
_FRAME = "border: 1px solid #8888; border-radius: 6px; width: 100%; height: 560px"


@dataclass(frozen=True, slots=True, repr=False)
class Shown:
    """A body as it is seen; the last value of a notebook's cell is a page to turn and play.

    Attributes
    ----------
    view : View
    """

    view: View

    @property
    def _first(self) -> tuple[Case | None, int]:
        """The first motion and its most telling shape."""
        case = self.view.cases[0] if self.view.cases else None
        return case, 0 if case is None else self.view.telling(case)

    def __repr__(self) -> str:
        """Title, motions."""
        return f"<Shown {self.view.title!r}: {', '.join(case.name for case in self.view.cases) or self.view.subtitle}>"

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(page(self.view))}" style="{_FRAME}"></iframe>'

    def plot(self) -> "Figure":
        """A matplotlib figure of the first motion's most telling shape, beside the undeformed body."""
        from .picture import draw_view

        return draw_view(self.view, *self._first)

    def save(self, path: str | Path) -> Path:
        """Write a page (.html), files for ParaView (.vtu, .pvd) or a picture (.png, .pdf, .svg).

        Parameters
        ----------
        path : path

        Returns
        -------
        Path

        Raises
        ------
        FlexfmuError
            The file cannot be written, or a series is asked of a body that does not move.
        """
        output = Path(path)
        check_target(output, (PAGE,) if self.view.live else SUFFIXES)
        (case, shape), suffix = self._first, output.suffix.lower()
        if suffix == SHAPE:
            write_vtu(self.view, case, shape, output)
        elif suffix == SERIES:
            if case is None:
                raise FlexfmuError(f"{output}: a series wants a motion; give loads or --modes, or take {SHAPE}")
            write_pvd(self.view, case, output)
        elif suffix == PAGE:
            with whole_file(output) as part:
                part.write_text(page(self.view), encoding="utf-8")
        else:
            from ..files.figures import save

            save(self.plot(), output)
        return output
