"""An independent account of what the core computes: places and energies, and by complex step what follows from them.

Written from docs/theory.md and the data of a reduced body. Everything is analytic in q: no norms, no absolute values.
"""

from reference.mechanics import Reference
from reference.rotations import exponential

__all__ = ["Reference", "exponential"]
