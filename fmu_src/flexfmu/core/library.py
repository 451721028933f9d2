"""The core through ctypes: arrays in, arrays out."""

import ctypes
import re
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..files.basics import FloatArray, IntArray, OptionError
from .building import PLATFORMS, source_hash, sources, this_platform
from .interface import parameter, read_image, symbols
from .structures import structures

SHIPPED = Path(__file__).parent / "binaries"
"""Where a wheel has the cores of all platforms."""

_WORDS = 1024
_PLACE, _NUMBER, _WHOLE, _BYTE = ctypes.c_void_p, ctypes.c_double, ctypes.c_int64, ctypes.c_char
_LIMITS, _WORK = (structures("data")[name] for name in ("StepLimits", "Work"))


@dataclass(frozen=True, slots=True)
class StepLimits:
    """What bounds the internal step, and the work of a call.

    Attributes
    ----------
    longest : float
        Longest internal step, s; zero for no limit.
    tolerance : float
        Error accepted per step in the energy norm, relative to the motion's; sub-steps are halved until it is met.
    most : float
        Work accepted per call, discarded tries included, in internal steps of ordinary cost; more is refused.
    """

    longest: float = parameter("STEP_LIMIT").start
    tolerance: float = parameter("STEP_TOLERANCE").start
    most: float = parameter("STEP_MOST").start


StepAnswer = IntEnum("StepAnswer", symbols("ANSWER"), start=0)  # type: ignore[misc]
"""How a step or an equilibrium ended, zero where it was found: a line of the table of answers."""


def _done(answer: int) -> None:
    if answer:
        raise MemoryError("the core's workspace is too short for a call, which is an error of flexfmu")


class _Numbers:
    """An array of 64-bit floats, or null, as an argument; what a call fills is one already."""

    kind: Any = np.float64

    @classmethod
    def from_param(cls, values: Any) -> Any:
        """The array's place, which keeps the array."""
        if values is None:
            return None
        array = np.ascontiguousarray(values, dtype=cls.kind)
        if array.size and array.flags.writeable:
            return ctypes.byref(_BYTE.from_buffer(array))  # type: ignore[arg-type]
        # Twice as fast as the array's own; the former is three times as fast again.
        place = _PLACE(array.ctypes.data)
        place.kept = array  # type: ignore[attr-defined]
        return place


class _Coordinates(_Numbers):
    """The same, of one body's modes."""


class _Inputs(_Numbers):
    """The same, of one body's loads."""


class _Wholes(_Numbers):
    """The same of 64-bit integers."""

    kind = np.int64


_DECLARED = re.compile(
    r"^(void |int |double |int64_t |(?:const )?\w+ \*)((?:body|coupling|channel|core)_\w+)\((.*?)\);", re.M | re.S
)
_RESULTS = {"void ": None, "double ": _NUMBER, "int64_t ": _WHOLE, "const char *": ctypes.c_char_p}
# Whose whole number is an answer of its own; that of others is `StepAnswer`'s, of a call that needs room.
_ANSWERING = ("body_options", "body_static", "body_step", "body_is_stable", "body_may_miss", "coupling_slope")


def _kind(argument: str) -> Any:
    """How an argument goes to the core, by its declaration."""
    kind, pointer, name = argument.partition("*")
    if not pointer:
        return {"int": ctypes.c_int, "double": _NUMBER, "int64_t": _WHOLE}[kind.split()[0]]
    if kind.endswith("char ") and not name.startswith("*"):
        return ctypes.c_char_p
    if kind.endswith("double "):
        return _Coordinates if name in ("q", "v") else _Inputs if name.startswith("inputs") else _Numbers
    return _Wholes if kind.endswith("int64_t ") else _PLACE


@cache
def signatures() -> dict[str, tuple[Any, tuple[Any, ...]]]:
    """What functions of the core return and take, as its headers declare them."""
    found = {}
    for path in Path(__file__).parent.glob("*.h"):
        for result, name, arguments in _DECLARED.findall(path.read_text("utf-8")):
            whole = ctypes.c_int if name in _ANSWERING else _done
            kinds = tuple(_kind(one.strip()) for one in arguments.split(",") if one != "void")
            found[name] = _RESULTS.get(result, whole if result == "int " else _PLACE), kinds
    return found


def library_path() -> Path:
    """The core's library of this machine.

    Raises
    ------
    OptionError
        There is none.
    """
    ending = PLATFORMS[this_platform()].ending
    # What was compiled here goes before what came from elsewhere.
    for path in (Path(__file__).with_name(f"_flexcore{ending}"), SHIPPED / f"{this_platform()}{ending}"):
        if path.is_file():
            return path
    found = f"no core for this machine in {Path(__file__).parent}"
    raise OptionError(f"{found}: install flexfmu anew, with a C compiler at hand or from a wheel")


@cache
def library() -> ctypes.CDLL:
    """The core, loaded.

    Raises
    ------
    OptionError
        There is none for this machine, or it was compiled from other sources.
    """
    path = library_path()
    try:
        found = ctypes.CDLL(str(path))
    except OSError as error:
        raise OptionError(f"{path} cannot be loaded: {error}; install flexfmu anew") from error
    declared = hasattr(found, "fmi2FlexfmuCall") and declare(found)
    # A call by another layout of its structures could do anything.
    if sources() and (not declared or found.core_sources() != source_hash().encode()):
        fault = f"{path} was compiled from other C files than those beside it"
        raise OptionError(f"{fault}; install again (pip install -e . in a clone)")
    return found


def declare(found: ctypes.CDLL) -> bool:
    """Give a loaded core the functions beside those of FMI, which are its only names."""
    found.fmi2FlexfmuCall.restype = _PLACE
    for name, (result, arguments) in signatures().items():
        if place := found.fmi2FlexfmuCall(name.encode()):
            setattr(found, name, ctypes.CFUNCTYPE(result, *arguments)(place))
    return True


class Core:
    """A program at work. Nothing that it is asked changes it; one thread at a time may ask.

    Parameters
    ----------
    image : bytes
        The program.
    damping_scale : float
        Factor on all modal damping ratios.
    limits : StepLimits

    Raises
    ------
    OptionError
        No program, or options out of range.
    """

    def __init__(self, image: bytes, damping_scale: float = 1.0, limits: StepLimits | None = None):
        limits = limits or StepLimits()
        self._body, self._sizes = None, dict[Any, int]()
        self._library = library()
        why = ctypes.c_char_p()
        self._body = self._library.body_open(image, len(image), ctypes.byref(why))
        if not self._body:
            raise OptionError(f"not a program: {(why.value or b'').decode()}")
        if self._ask("options", damping_scale, ctypes.byref(_LIMITS(*astuple(limits)))):
            raise OptionError("an option is out of range")
        program = read_image(image)
        sizes = program.sizes
        self.modes, self.nodes, self.frames = sizes["modes"], sizes["nodes"], sizes["frames"]
        self.interfaces, self.loads = sizes["interfaces"], sizes["loads"]
        self._sizes = {_Coordinates: self.modes, _Inputs: self.loads}
        self.turning_frame = program.arrays["turning_frame"].astype(np.int64)

    def __del__(self) -> None:
        if self._body:
            self._ask("close")

    @property
    def bytes(self) -> int:
        """Bytes of the program and of all workspaces."""
        return int(self._ask("bytes"))

    def static(self, inputs: FloatArray) -> tuple[IntEnum, FloatArray, float, int]:
        """Stable equilibrium under loads (L,).

        Returns
        -------
        answer : StepAnswer
        q : (m,) float
        share : float
            Of the load that was reached.
        rounds : int
        """
        q, share, rounds = np.zeros(self.modes), np.zeros(1), np.zeros(1, dtype=np.int64)
        return StepAnswer(self._ask("static", inputs, q, share, rounds)), q, float(share[0]), int(rounds[0])

    def step(
        self, q: FloatArray, v: FloatArray, loads: FloatArray, step: float, end: FloatArray | None = None, hint: int = 1
    ) -> tuple[IntEnum, FloatArray, FloatArray, int, tuple[int, int, float]]:
        """State after a step.

        Parameters
        ----------
        q, v : (m,) float
            Left untouched.
        loads, end : (L,) float
            Loads over the step, or at its start and end.
        step : float
            s.
        hint : int
            Number of internal steps to begin with.

        Returns
        -------
        answer : StepAnswer
        q, v : (m,) float
        hint : int
            For the next step.
        work : tuple
            Internal steps, rounds, and the estimated error.
        """
        q1, v1 = np.array([q, v], float).reshape(2, self.modes)
        tries, work = np.array([hint], np.int64), _WORK()
        answer = self._ask("step", loads, end, step, q1, v1, tries, ctypes.byref(work))
        return StepAnswer(answer), q1, v1, int(tries[0]), (work.substeps, work.iterations, work.error)

    def step_refusal(self, answer: IntEnum, step: float, work: tuple[int, int, float]) -> str:
        """Why a step of some length (s) was refused."""
        text = ctypes.create_string_buffer(_WORDS)
        self._ask("refusal", answer, step, ctypes.byref(_WORK(*work)), text, _WORDS)
        return text.value.decode()

    def static_refusal(self, answer: IntEnum, share: float) -> str:
        """Why there is no equilibrium beyond a share of the load."""
        text = ctypes.create_string_buffer(_WORDS)
        self._ask("static_refusal", answer, share, text, _WORDS)
        return text.value.decode()

    def motion(self, q: FloatArray) -> FloatArray:
        """Displacement and rotation vector of each interface in turn, (6I,)."""
        result = np.empty(6 * self.interfaces)
        self._ask("motion", q, None, result, None)
        return result

    def motion_and_rates(self, q: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same, and velocity and angular velocity, (6I,)."""
        motion, rates = np.empty(6 * self.interfaces), np.empty(6 * self.interfaces)
        self._ask("motion", q, v, motion, rates)
        return motion, rates

    def nodes_at(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places (K, 3) and rotations (K, 3, 3) of all nodes."""
        position, rotation = np.empty((self.nodes, 3)), np.empty((self.nodes, 3, 3))
        self._ask("nodes", q, position, rotation)
        return position, rotation

    def stress(self, q: FloatArray, sets: int) -> FloatArray:
        """Largest von Mises stress of each set, N/m²."""
        return self._filled(sets, "stress", q)

    def surface(self, data: tuple[IntArray, IntArray, FloatArray], q: FloatArray) -> FloatArray:
        """Places (n, 3) of a surface's points; `data` are sizes, `on` and numbers as of core/surface.h."""
        return self._filled((int(data[0][1]), 3), "surface", *data, q, np.empty(data[0][2]))

    def energies(self, q: FloatArray, v: FloatArray) -> tuple[float, float]:
        """Strain and kinetic energy, J."""
        strain, kinetic = np.empty(1), np.empty(1)
        self._ask("energies", q, v, strain, kinetic)
        return float(strain[0]), float(kinetic[0])

    def force(self, inputs: FloatArray, q: FloatArray) -> FloatArray:
        """Modal force (m,)."""
        result = np.empty(self.modes)
        self._ask("forces", inputs, q, result, None)
        return result

    def tangent(self, inputs: FloatArray, q: FloatArray) -> FloatArray:
        """Tangent stiffness (m, m), 1/s²."""
        return self._filled((self.modes, self.modes), "forces", inputs, q, None)

    def mass(self, q: FloatArray) -> FloatArray:
        """M(q), (m, m)."""
        return self._filled((self.modes, self.modes), "mass", q)

    def largest_rotation(self, q: FloatArray) -> float:
        """Largest rotation of material within its frame, rad."""
        return float(self._ask("rotations", q, None))

    def rotations(self, q: FloatArray) -> FloatArray:
        """Each rotation that is watched, rad, in the order of `turning_frame`."""
        return self._filled(self.turning_frame.size, "rotations", q)

    def strain(self, q: FloatArray) -> float:
        """Largest root mean square strain of a material in a frame."""
        return float(self._ask("strain", q))

    def stability(self, inputs: FloatArray, q: FloatArray) -> tuple[float, FloatArray]:
        """Smallest eigenvalue of the tangent over the unloaded one, and its shape (m,)."""
        shape = np.empty(self.modes)
        return float(self._ask("stability", inputs, q, shape)), shape

    def is_stable(self, inputs: FloatArray, q: FloatArray, margin: float) -> bool:
        """Whether that is above a margin."""
        return bool(self._ask("is_stable", inputs, q, margin))

    def missed(self, inputs: FloatArray) -> float:
        """Error of deflections from stiffness that the method misses."""
        return float(self._ask("missed", inputs, None))

    def compliance(self, inputs: FloatArray, step: float, q: FloatArray, interfaces: Sequence[int]) -> FloatArray:
        """Derivative (6n, 6n) of interfaces' motion at a step's end by loads on them held over the step."""
        count = len(interfaces)
        return self._filled((6 * count, 6 * count), "compliance", inputs, step, q, interfaces, count)

    def error(self, shadow: "Core", inputs: FloatArray, q: FloatArray) -> tuple[FloatArray, float, float]:
        """Errors (I, 2) of displacements (m) and rotations (rad) by a shadow; largest over the deflection; a bound."""
        result, (deflection, share, bound) = np.empty((self.interfaces, 2)), np.zeros((3, 1))
        self._ask("error", shadow._body, inputs, q, result, deflection, share, bound)
        return result, float(share[0]), float(bound[0])

    def _filled(self, shape: int | tuple[int, int], name: str, *arguments: object) -> FloatArray:
        """The array that a function of the core fills, its last argument."""
        result = np.zeros(shape)
        self._ask(name, *arguments, result)
        return result

    def _ask(self, name: str, *arguments: Any) -> Any:
        """What a function of the core answers; Ctrl-C while an argument is made stays one."""
        for kind, given in zip(signatures()[f"body_{name}"][1][1:], arguments, strict=False):
            # The core would read what lies behind fewer.
            if kind in self._sizes and given is not None and np.size(given) != (size := self._sizes[kind]):
                what = kind.__name__.strip("_").lower()
                raise OptionError(f"{np.size(given)} {what} were given, expected {size}, as this body has them")
        try:
            return getattr(self._library, f"body_{name}")(self._body, *arguments)
        except ctypes.ArgumentError as error:
            raise (KeyboardInterrupt if "KeyboardInterrupt" in str(error) else error) from None
