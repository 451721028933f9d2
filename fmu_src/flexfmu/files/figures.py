"""What all pictures have in common: how they are saved, and colours that colour-blind readers can tell apart."""

import io
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from .targets import whole_file

BLACK, ORANGE, SKY, GREEN, YELLOW, BLUE, VERMILION, PINK = (
    "#000000", "#e69f00", "#56b4e9", "#009e73", "#f0e442", "#0072b2", "#d55e00", "#cc79a7",
)  # fmt: skip
"""Colours of Okabe and Ito."""
_DPI = 150


def save(figure: Figure, picture: Path) -> None:
    """Write a figure and close it.

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
    try:
        with whole_file(picture) as part:
            figure.savefig(part, dpi=_DPI, format=picture.suffix[1:])
    finally:
        plt.close(figure)


def picture_html(figure: Figure) -> str:
    """A figure for a notebook, as SVG within HTML; it is closed."""
    text = io.StringIO()
    figure.savefig(text, format="svg")
    plt.close(figure)
    return text.getvalue().partition("<svg")[1] + text.getvalue().partition("<svg")[2]
