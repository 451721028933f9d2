"""What all pictures have in common: how they are saved, and colours that colour-blind readers can tell apart."""

import io
from pathlib import Path

from matplotlib.figure import Figure

from .outputs import whole_file

BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILION, PINK = (
    "#000000", "#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7",
)  # fmt: skip
"""Colours of Okabe and Ito."""
_DPI = 150


class Drawing(Figure):
    """A figure without a window: notebooks show it by itself, and keep their own way to draw others."""

    def _repr_png_(self) -> bytes:
        data = io.BytesIO()
        self.savefig(data, format="png")
        return data.getvalue()


def save(figure: Figure, picture: Path) -> None:
    """Write a figure.

    Parameters
    ----------
    figure : Figure
    picture : Path
        PNG, PDF or SVG; there whole or not at all.

    Raises
    ------
    OutputError
        It cannot be written.
    """
    with whole_file(picture) as part:
        figure.savefig(part, dpi=_DPI, format=picture.suffix[1:])
