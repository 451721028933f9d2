"""A view on paper, on a page, in ParaView or in a notebook."""

from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from ..files.errors import FlexfmuError, OutputError
from ..files.targets import PICTURE_SUFFIXES, check_target, whole_file
from .model import Case, View
from .page import page
from .paraview import write_pvd, write_vtu

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
        else:
            with whole_file(output) as part:
                if suffix == PAGE:
                    part.write_text(page(self.view), encoding="utf-8")
                else:
                    try:
                        self.plot().savefig(part, dpi=160)
                    except ValueError as error:
                        raise OutputError(f"{output}: cannot be drawn ({error})") from error
        return output
