"""What a body's shadow is made of: the same body, reduced finer, that tells its error (docs/theory.md, section 7a)."""

from collections.abc import Sequence
from dataclasses import replace

from ..files.basics import MOST_FRAMES, FloatArray
from ..model.methods import Data, Method, Variant
from .options import BodyOptions
from .subdomains import Subdomain
from .supported import Supported

FINER = 2
"""Frames of the shadow for each of the body's."""
# Energy of shapes of second and third order that it has beside the body's own, and how many, of all interfaces and of
# each: posts of a tower that is pressed at two places bend in more ways than two each.
THIRD_LEAST, THIRD_MOST = 1e-3, (6, 4)


def shadow_options(config: BodyOptions, subdomains: Sequence[Subdomain]) -> BodyOptions:
    """Options of the shadow: second order and stretching, and twice the frames, all of them levels.

    One frame that was taken by itself stays one: more would open a loop, or lie on joints that tell nothing.

    Parameters
    ----------
    config : BodyOptions
        Of the body.
    subdomains : sequence of Subdomain
        Its frames.

    Returns
    -------
    BodyOptions
    """
    own = sum(not domain.floating for domain in subdomains)
    found = not (config.frames or config.branches)
    levels = max(FINER * (config.levels if found and own > 1 else own), FINER)
    if found and own == 1 and not config.levels_asked:
        levels = 1
    return finer_shadow(config, levels)


def finer_shadow(config: BodyOptions, levels: int) -> BodyOptions:
    """Options of a shadow with so many levels of frames: second order and stretching, and nothing to look at."""
    return replace(
        config,
        levels=min(levels, MOST_FRAMES),
        levels_asked=True,
        frames=(),
        branches=(),
        stress=(),
        membrane="stretching",
        variant=Variant(Method.SECOND_ORDER),
        stored=frozenset({Data.SECOND_ORDER}),
        surface=False,
        surface_stress=False,
        certificate=False,
        watched=False,
    )


def embedding(model: Supported, shadow: FloatArray, shapes: FloatArray) -> FloatArray:
    """The coordinates (M, m), of a basis (3n, M), of the motions (3n, m) of another one: P = Φ_Sᵀ M Φ."""
    return model.unknowns.of(shadow).T @ (model.mass @ model.unknowns.of(shapes))
