"""Records of a sweep: one CSV, one row a combination, written as soon as it is known; see docs/scenes.md."""

import math
from dataclasses import dataclass, field

from ...files.counts import plural
from ...model.methods import Method, has_frames
from ..scenes.candidates import REDUCED
from ..scenes.errors import SceneError
from ..scenes.record_file import Layout
from ..scenes.words import modes_words

KEY = (
    "solver",
    "case",
    "basis",
    "modes",
    "frames",
    "method",
    "mass",
    "internal_step",
)
# Internal steps that need no word: without error, the FMU's own tolerance, and none at all.
_USUAL_STEPS = ("exact", "0.0001", "")


@dataclass(frozen=True, slots=True)
class Record:
    """One row of a chart's records: a reduced model on the whole scene, or a finite element model in one case.

    Attributes
    ----------
    scene, body : str
        Digest of the scene; name of the body.
    solver, case : str
        "reduced"; for finite elements "flexfmu", "calculix" or "results" (the user's own), and the case.
    basis, modes, frames, method, mass, internal_step
        The combination; empty for finite elements. `frames` is -1 where the body file gives them by hand;
        `internal_step` is "single", "exact" or the tolerance.
    mode_count, frame_count : int
        Result, interface modes included; for finite elements the degrees of freedom, and none.
    status, note : str
        "ok", or "no answer" and why; for finite elements the increments and iterations.
    static_displacement, static_rotation, static_rotation_rad, static_at, transient_displacement, transient_rotation, \
transient_rotation_rad, transient_at, share, limited_by
        As of `Errors`.
    step : float
        Communication step of the timing, s.
    step_us, step_us_median : float
        Step of the model without FMI, µs: fastest and median block; for finite elements one equilibrium, from the
        previous one.
    iterations, busy : float
        Rounds a step; slowdown of the machine while timing (1: none).
    bare_ms_per_s, fmu_ms_per_s : float
        ms per simulated second, without FMI and through the FMU.
    fmu_us, empty_us, fmu_ratio, fmu_busy : float
        Step of the FMU and of an empty one, µs, their ratio, and the slowdown; not a number without FMUs.
    equilibrium_ms : float
        Equilibrium without FMI under the first static case, from rest.
    memory_bytes, modal_bytes : int
        Program and work space while running; modal file with the data of this method.
    build_s : float
        Time of the reduction, s, common to all methods of the same basis, modes and frames.
    build_reused : str
        "yes" where parts of it came from an earlier build.
    """

    scene: str
    body: str
    solver: str = REDUCED
    case: str = ""
    basis: str = ""
    modes: int = 0
    frames: int = 0
    method: str = ""
    mass: str = ""
    internal_step: str = ""
    mode_count: int = 0
    frame_count: int = 0
    status: str = "ok"
    note: str = ""
    static_displacement: float = math.nan
    static_rotation: float = math.nan
    static_rotation_rad: float = math.nan
    static_at: str = ""
    transient_displacement: float = math.nan
    transient_rotation: float = math.nan
    transient_rotation_rad: float = math.nan
    transient_at: str = ""
    share: float = math.inf
    limited_by: str = ""
    step: float = math.nan
    step_us: float = math.nan
    step_us_median: float = math.nan
    iterations: float = math.nan
    busy: float = math.nan
    bare_ms_per_s: float = math.nan
    fmu_us: float = math.nan
    fmu_busy: float = math.nan
    fmu_ms_per_s: float = math.nan
    empty_us: float = math.nan
    fmu_ratio: float = math.nan
    equilibrium_ms: float = math.nan
    memory_bytes: int = 0
    modal_bytes: int = 0
    build_s: float = math.nan
    build_reused: str = "no"
    key: tuple[str, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Remember what tells it from others."""
        object.__setattr__(self, "key", tuple(str(getattr(self, name)) for name in KEY))

    @property
    def label(self) -> str:
        """A few words for a chart."""
        if self.solver != REDUCED:
            who = {"results": "your results", "calculix": "CalculiX"}.get(self.solver, self.solver)
            return f"finite elements ({who}), {self.case}"
        words = [self.short_label]
        if self.mass != "constant":
            words.append(f"mass {self.mass}")
        if self.internal_step == "single":
            words.append("one internal step")
        elif self.internal_step not in _USUAL_STEPS:
            words.append(f"step error {self.internal_step}")
        return f"{', '.join(words)}; {modes_words(self.basis, self.modes)}"

    @property
    def short_label(self) -> str:
        """Method and frames, for a point of a chart."""
        if self.solver != REDUCED:
            return self.label
        if not self.on_frames:
            return Method(self.method).label
        count = f"its own {plural(self.frame_count, 'frame')}" if self.frames < 0 else plural(self.frames, "frame")
        return f"{Method(self.method).label}, {count}"

    @property
    def on_frames(self) -> bool:
        """Whether its method moves the body by frames."""
        return bool(self.method) and has_frames(Method(self.method))

    @property
    def plainness(self) -> float:
        """How much there is to it beyond the plainest model: of models that are as good, the lowest is named."""
        extras = (
            self.method not in (Method.LINEAR.value, Method.FRAMES.value),
            self.mass != "constant",
            self.internal_step not in _USUAL_STEPS,
            self.basis != "normal",
        )
        return sum(extras) + 0.01 * self.mode_count


LAYOUT = Layout(
    Record,
    owner="scene",
    digits=6,
    made_by=f"{__package__}.sweep",
    called="the records of a sweep of this version",
    others="records of another scene, or of this one before its body, cases or tolerances changed",
    error=SceneError,
)
