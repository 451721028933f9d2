"""A model that will do."""

from dataclasses import dataclass

from ...model.methods import Variant
from ...model.reduced_body import ReducedBody
from ..scenes.candidates import Reduction
from ..scenes.measure import Errors


@dataclass(slots=True)
class Choice:
    """A model that will do.

    Attributes
    ----------
    plan : Reduction
    variant : Variant
    body : ReducedBody
    errors : Errors
    cost : float
        Fastest step seen, s.
    """

    plan: Reduction
    variant: Variant
    body: ReducedBody
    errors: Errors
    cost: float = float("inf")
