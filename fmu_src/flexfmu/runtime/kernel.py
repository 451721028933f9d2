"""The compiled step (kernel.c), where there is one for this machine; NumPy does the same without it.

The library is built when the package is installed, if there is a C compiler, and travels inside the FMU. It knows
nothing of Python: any version loads it. Where it cannot be loaded, on another platform say, nothing but speed is lost.
"""

import ctypes
import math
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .dynamics import Dynamics
from .kernel_data import kernel_arrays
from .propagation import Propagator
from .reduced_body import LoadPlacement
from .tied_stepping import TiedRule, TiedSteps

FloatArray = NDArray[np.float64]

PATTERN = "_kernel.*"
"""File names of the library, which end in what the platform asks for."""
_VERSION = 6
_PLACEMENT = {LoadPlacement.REFERENCE: 0, LoadPlacement.CORRECTIVE_MOMENT: 1, LoadPlacement.DEFORMED: 2}
# Rotation, rad, and displacement relative to the body's size, over which forces are differenced.
_DIFFERENCE = 1e-6
# Extent of the nodes over their coordinates below which they are all at one place, and the body's size is not known.
_ONE_PLACE = 1e-9
# What kernel_substeps answers where there is a state, and where there is an error that is too large.
_DONE, _INACCURATE = 0, 2
# As many as the cache of propagators holds.
_MOST_PROPAGATORS = 16
_POINTER = ctypes.c_void_p
_PROPAGATOR = ("p11", "p12", "p21", "p22", "gq", "gv", "ramp", "ramp_rate")


class _Body(ctypes.Structure):
    """`Body` of kernel.c."""

    _fields_ = [
        *((name, ctypes.c_int64) for name in ("modes", "nodes", "frames", "interfaces", "masses")),
        *((name, ctypes.c_int64) for name in ("placement", "nonlinear", "turnings", "parts", "ties", "pulls")),
        *((name, _POINTER) for name in ("parent", "offset", "base", "point", "operator", "curvature")),
        *((name, _POINTER) for name in ("part", "core", "extent", "basis", "load_operator", "mass")),
        *((name, _POINTER) for name in ("inertia", "by_load", "by_mode", "omega", "weight", "turning")),
        *((name, _POINTER) for name in ("tie_stiffness", "tie_lever", "tie_apart", "tie_initial", "material", "pull")),
        ("noise", ctypes.c_double),
        ("work", _POINTER),
    ]


class _TiedRule(ctypes.Structure):
    """`TiedRule` of kernel.c."""

    _fields_ = [("response", _POINTER), ("lag", _POINTER), ("step", ctypes.c_double)]


class _Propagator(ctypes.Structure):
    """`Propagator` of kernel.c."""

    _fields_ = [(name, _POINTER) for name in _PROPAGATOR]


@cache
def _library() -> ctypes.CDLL | None:
    """The library beside this file, if it loads and is of this version."""
    for path in sorted(Path(__file__).parent.glob(PATTERN)):
        try:
            library = ctypes.CDLL(str(path))
            library.kernel_version.restype = ctypes.c_int64
            if library.kernel_version() != _VERSION:
                continue
        except (OSError, AttributeError):
            continue
        integer, number, place = ctypes.c_int64, ctypes.c_double, _POINTER
        library.kernel_work_size.restype = integer
        library.kernel_work_size.argtypes = [place]
        library.kernel_substeps.restype = integer
        library.kernel_substeps.argtypes = [*[place] * 6, integer, number, integer, place, place]
        library.kernel_tied_substeps.restype = integer
        library.kernel_tied_substeps.argtypes = [*[place] * 7, integer, number, integer, place, place]
        library.kernel_linear_step.restype = integer
        library.kernel_linear_step.argtypes = [place] * 6
        library.kernel_largest_rotation.restype = number
        library.kernel_largest_rotation.argtypes = [place] * 2
        library.kernel_force_derivative.restype = None
        library.kernel_force_derivative.argtypes = [place] * 5
        library.kernel_motion.restype = None
        library.kernel_motion.argtypes = [place] * 5
        return library
    return None


def compiled(dynamics: Dynamics, turning: FloatArray, tied: TiedSteps | None = None) -> "Kernel | None":
    """The compiled step of a body under a formulation; None where there is none.

    Parameters
    ----------
    dynamics : Dynamics
    turning : (3n, m) float
        Rotations within frames, as of `indicators.Turning`.
    tied : TiedSteps, optional
        Steps in NumPy of a body with ties.

    Returns
    -------
    Kernel or None
    """
    library = _library()
    return None if library is None else Kernel(library, dynamics, turning, tied)


class Kernel:
    """Compiled steps and outputs of one `Dynamics`; its buffers serve one call at a time.

    Parameters
    ----------
    library : ctypes.CDLL
    dynamics : Dynamics
    turning : (3n, m) float
    tied : TiedSteps or None
    """

    def __init__(self, library: ctypes.CDLL, dynamics: Dynamics, turning: FloatArray, tied: TiedSteps | None):
        tree = dynamics.tree
        modes, nodes, masses = dynamics.stiffness.size, len(tree.parent), dynamics.mass.size
        self._library = library
        arrays, integers = kernel_arrays(dynamics, turning, tied)
        owned = {k: np.ascontiguousarray(a, dtype=np.float64) for k, a in arrays.items()}
        counted = {k: np.ascontiguousarray(a, dtype=np.int64) for k, a in integers.items()}
        self._body = _Body(
            modes=modes,
            nodes=nodes,
            frames=tree.frame_count,
            interfaces=tree.interface_count,
            masses=masses,
            placement=_PLACEMENT[dynamics.placement],
            nonlinear=int(dynamics.nonlinear),
            turnings=len(turning) // 3,
            parts=len(counted.get("extent", ())),
            ties=tree.tie_count,
            pulls=len(counted.get("pull", ())),
            noise=0.0 if tied is None else tied.noise,
            **{name: array.ctypes.data for name, array in (*owned.items(), *counted.items())},
        )
        work = np.zeros(library.kernel_work_size(ctypes.addressof(self._body)))
        self._body.work = work.ctypes.data
        # What the struct points to must live as long as it does.
        self._owned = (*owned.values(), *counted.values(), work)
        self._change = _difference_steps(dynamics)
        self._derivative = np.zeros((modes, modes))
        self._q, self._v = np.zeros(modes), np.zeros(modes)
        self._inputs, self._end = (np.zeros(6 * tree.interface_count + (3 if masses else 0)) for _ in range(2))
        self._motion, self._rate = (np.zeros(6 * tree.interface_count) for _ in range(2))
        self._rounds, self._worst = ctypes.c_int64(), ctypes.c_double()
        self._at = ctypes.addressof(self._body)
        self._places = [a.ctypes.data for a in (self._inputs, self._end, self._q, self._v)]
        self._results = self._motion.ctypes.data, self._rate.ctypes.data
        self._counters = ctypes.addressof(self._rounds), ctypes.addressof(self._worst)
        self._propagators: dict[int, tuple[Propagator, _Propagator, int]] = {}
        self._rules: dict[int, tuple[TiedRule, _TiedRule, int]] = {}

    def linear_step(
        self, p: Propagator, inputs: FloatArray, end_inputs: FloatArray | None, q: FloatArray, v: FloatArray
    ) -> tuple[FloatArray, FloatArray] | None:
        """State (q, v) after a step where no load depends on q; None where one does.

        Parameters
        ----------
        p : Propagator
            Of the step.
        inputs : (6I,) or (6I + 3,) float
            Force and moment of each interface, then the acceleration of a body with masses.
        end_inputs : like inputs, or None
            At the step's end, where they are others.
        q, v : (m,) float
        """
        at_start, at_end, at_q, at_v = self._places
        end = self._load(inputs, end_inputs, q, v, at_end)
        if self._library.kernel_linear_step(self._at, self._place(p), at_start, end, at_q, at_v):
            return None
        return self._q.copy(), self._v.copy()

    def substeps(
        self,
        p: Propagator,
        inputs: FloatArray,
        end_inputs: FloatArray | None,
        q: FloatArray,
        v: FloatArray,
        count: int,
        tolerance: float,
        most: int,
        rule: TiedRule | None = None,
    ) -> tuple[tuple[FloatArray, FloatArray] | None, int, float]:
        """`count` equal sub-steps.

        Parameters
        ----------
        p : Propagator
            Of a sub-step.
        inputs, end_inputs, q, v
            As for `linear_step`.
        count : int
        tolerance : float
            Error accepted in a sub-step.
        most : int
            Rounds of the iteration after which no sub-step is begun.
        rule : TiedRule, optional
            Of a body with ties, in place of p.

        Returns
        -------
        state : tuple of (m,) float, or None
            None where one does not settle, errs too much, or is beyond the rounds.
        rounds : int
            Of the iteration.
        error : float
            The largest of a sub-step; infinite where one has none.
        """
        at_start, at_end, at_q, at_v = self._places
        end = self._load(inputs, end_inputs, q, v, at_end)
        rest = at_start, end, at_q, at_v, count, tolerance, most, *self._counters
        if rule is None:
            answer = self._library.kernel_substeps(self._at, self._place(p), *rest)
        else:
            places = self._place(rule.p), self._rule_place(rule)
            answer = self._library.kernel_tied_substeps(self._at, *places, *rest)
        state = (self._q.copy(), self._v.copy()) if answer == _DONE else None
        return state, self._rounds.value, self._worst.value if answer in (_DONE, _INACCURATE) else math.inf

    def motion(self, q: FloatArray) -> FloatArray:
        """Displacement and rotation vector of each interface in turn, (6I,), at q (m,)."""
        self._q[:] = q
        self._library.kernel_motion(self._at, self._places[2], None, self._results[0], None)
        return self._motion.copy()

    def motion_and_rates(self, q: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same, and velocity and angular velocity of each interface in turn, (6I,), at q and v (m,)."""
        self._q[:], self._v[:] = q, v
        self._library.kernel_motion(self._at, *self._places[2:], *self._results)
        return self._motion.copy(), self._rate.copy()

    def largest_rotation(self, q: FloatArray) -> float:
        """Largest rotation within a frame, rad."""
        self._q[:] = q
        found: float = self._library.kernel_largest_rotation(self._at, self._places[2])
        return found

    def force_derivative(self, inputs: FloatArray, q: FloatArray) -> FloatArray:
        """∂Q/∂q (m, m) by differences, to some six digits."""
        self._inputs[:], self._q[:] = inputs, q
        at_start, _, at_q, _ = self._places
        change, out = self._change.ctypes.data, self._derivative.ctypes.data
        self._library.kernel_force_derivative(self._at, at_start, at_q, change, out)
        return self._derivative.T.copy()

    def _load(
        self, inputs: FloatArray, end_inputs: FloatArray | None, q: FloatArray, v: FloatArray, at_end: int
    ) -> int | None:
        """Fill the buffers; the place of the end's inputs, if any."""
        self._inputs[:], self._q[:], self._v[:] = inputs, q, v
        if end_inputs is None:
            return None
        self._end[:] = end_inputs
        return at_end

    def _place(self, p: Propagator) -> int:
        """Address of a propagator's struct."""
        found = self._propagators.get(id(p))
        if found is None or found[0] is not p:
            if len(self._propagators) > _MOST_PROPAGATORS:
                self._propagators.clear()
            struct = _Propagator(**{name: getattr(p, name).ctypes.data for name in _PROPAGATOR})
            found = self._propagators[id(p)] = (p, struct, ctypes.addressof(struct))
        return found[2]

    def _rule_place(self, rule: TiedRule) -> int:
        """Address of a rule's struct."""
        found = self._rules.get(id(rule))
        if found is None or found[0] is not rule:
            if len(self._rules) > _MOST_PROPAGATORS:
                self._rules.clear()
            struct = _TiedRule(rule.response.ctypes.data, rule.lag.ctypes.data, rule.p.step)
            found = self._rules[id(rule)] = (rule, struct, ctypes.addressof(struct))
        return found[2]


def _difference_steps(dynamics: Dynamics) -> FloatArray:
    """Steps (m,) of q for differences: small against every motion that matters, large against round-off.

    All have the same strain energy, that of the softest motion by `_DIFFERENCE`. A mode that moves no node at first
    order, by symmetry say, has nothing but round-off to derive a step of its own from.
    """
    tree = dynamics.tree
    d, c = np.abs(tree.operator).reshape(2, -1, dynamics.stiffness.size).max(axis=1)
    size = float(np.abs(tree.point - tree.point[0]).max())
    if size <= _ONE_PLACE * float(np.abs(tree.point).max()):
        size = 1.0
    softness = float(np.max(np.maximum(c, d / size) / dynamics.weight))
    result: FloatArray = _DIFFERENCE / (dynamics.weight * (softness or 1.0))
    return result
