"""Colours, markers and words of a chart's points, the same in the picture and on the page."""

from ...files.figures import BLACK, BLUE, GREEN, ORANGE, PINK, SKY, VERMILION, YELLOW
from ...model.methods import Method

COLOURS = {
    Method.LINEAR.value: BLACK,
    Method.STIFFNESS_BY_LOAD.value: ORANGE,
    Method.FLOATING_FRAME.value: YELLOW,
    Method.FRAMES.value: SKY,
    Method.FRAMES_STIFFNESS.value: GREEN,
    Method.SECOND_ORDER.value: BLUE,
}
"""Of models on the front, by method; all others are grey."""
OTHER, BEATEN, TAKEN, WHOLE = PINK, "#bfbfbf", VERMILION, VERMILION
MARKERS = {"normal": "o", "residual": "s", "craig_bampton": "^"}
"""By basis."""
BASES = {"normal": "normal modes", "residual": "with residual flexibility", "craig_bampton": "Craig-Bampton"}
STARS = {"flexfmu": "*", "calculix": "P", "results": "X"}
"""By solver of the finite element model."""
SOLVERS = {"flexfmu": "finite elements (flexfmu)", "calculix": "CalculiX", "results": "your results"}
BEATEN_WORDS = "beaten in speed and accuracy"
TAKEN_WORDS = "take this: the fastest within the tolerance"
