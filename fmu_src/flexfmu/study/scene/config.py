"""The scene file (TOML): its keys, checked, with errors that name the key."""

from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from ...files.basics import MOST_FRAMES, MOST_MODES, MOST_STEPS, FlexfmuError
from ...files.tables import Kind
from ...files.toml_files import Name, NotNegative, Positive, Share, Table, ascending, different, read_toml, validated
from ...model.methods import Mass, Method

Modes = Annotated[int, Field(ge=1, le=MOST_MODES)]
Frames = Annotated[int, Field(ge=1, le=MOST_FRAMES)]
Numbers = Annotated[list[Positive], Field(min_length=1)]
Results = Annotated[Path | None, Field(strict=False)]


_BAND = ascending("[lowest, highest] in Hz; the lowest may be 0")
Accepted = Annotated[Share, Field(gt=0.0, lt=1.0)]


def _some(loads: dict[str, float]) -> dict[str, float]:
    if not any(loads.values()):
        raise ValueError("all loads are zero, expected at least one that is not")
    return loads


SomeLoads = Annotated[dict[str, float], AfterValidator(_some)]


class SceneError(FlexfmuError):
    """The scene file, its tables or its records name, lack or contradict something."""


class BasisChoice(Enum):
    """Modal basis, with what completes it."""

    NORMAL = "normal"
    """Eigenmodes with the supports in place."""
    RESIDUAL = "residual"
    """Eigenmodes and residual flexibility of the interfaces."""
    CRAIG_BAMPTON = "craig_bampton"
    """Constraint modes of the interfaces and fixed-interface normal modes."""


class StaticTable(Table):
    """`[[static]]`: loads that hold still.

    Attributes
    ----------
    name
        Name of the case.
    loads
        Peak values by input: `"INTERFACE.force.AXIS"`, `"INTERFACE.moment.AXIS"`, `"body.acceleration.AXIS"`.
    factors
        Fractions of the loads that are compared, ascending.
    results
        Your results in place of flexfmu's finite elements: CSV `factor,INTERFACE.displacement.x,…`.
        `#` begins a comment; missing columns are not compared.
    results_seconds
        Time of the run that made the results, s: adds a point to the chart. Its rows count as equilibria.
    """

    name: Name
    loads: SomeLoads = Field(examples=[{"tip.force.y": 1000.0}])
    factors: Annotated[Numbers, ascending("parts of the loads, such as [0.25, 0.5, 1.0]")] = [0.5, 1.0]
    results: Results = None
    results_seconds: Positive | None = None

    @model_validator(mode="after")
    def _time_of_results(self) -> "StaticTable":
        if self.results_seconds is not None and self.results is None:
            raise ValueError("results_seconds is the time that results took to find: give results as well")
        return self


class TransientTable(Table):
    """`[[transient]]`: motion from rest under loads over time.

    Attributes
    ----------
    name
        Name of the case.
    loads
        A sudden load, or a CSV table (`time`, then inputs) from time 0, linear within steps.
        A repeated time is a jump, exact at a communication point.
    duration
        Length of the motion, s. Default: end of the table
    step
        Communication step, s.
    frequencies
        `[lowest, highest]`, Hz: the band that is compared. Default: all
    results
        Your results: CSV `time,INTERFACE.displacement.x,…`.
    seconds_per_second
        Time of a finite element solver per simulated second: adds a point to the chart.
    """

    name: Name
    loads: SomeLoads | str = Field(examples=[{"tip.force.y": 1000.0}])
    duration: Positive | None = None
    step: Positive = Field(examples=[1e-3])
    frequencies: Annotated[list[NotNegative], Field(min_length=2, max_length=2), _BAND] | None = None
    results: Results = None
    seconds_per_second: Positive | None = None

    @model_validator(mode="after")
    def _consistent(self) -> "TransientTable":
        if isinstance(self.loads, dict) and self.duration is None:
            raise ValueError("a sudden load needs a duration (s); only a table of loads has an end of its own")
        if self.duration is not None:
            if self.duration < 2.0 * self.step:
                raise ValueError(f"a duration of {self.duration} s has no two steps of {self.step} s")
            check_steps(self.duration, self.step)
        if self.frequencies is not None and self.frequencies[1] > 0.4 / self.step:
            found = f"frequencies up to {self.frequencies[1]} Hz are not seen at steps of {self.step} s"
            raise ValueError(f"{found}; take steps of {0.4 / self.frequencies[1]:.3g} s or less")
        return self


def check_steps(duration: float, step: float) -> None:
    """Refuse more steps than a scene can have.

    Parameters
    ----------
    duration, step : float
        s.

    Raises
    ------
    ValueError
    """
    if duration > MOST_STEPS * step:
        found = f"a duration of {duration:g} s has {duration / step:.3g} steps of {step:g} s"
        expected = f"at most {MOST_STEPS:g}; take longer steps, or a shorter piece of the motion"
        raise ValueError(f"{found}, expected {expected}")


class AcceptedTable(Table):
    """`[tolerance.static]`, `[tolerance.transient]`: the largest errors that are accepted.

    Attributes
    ----------
    displacement, rotation
        Relative error, below 1; over time rms of the error over rms of the motion.
        Without `rotation`, rotations are recorded only.
    displacement_absolute, rotation_absolute
        Error that is accepted in any case, m and rad.
    """

    displacement: Accepted
    displacement_absolute: float = Field(default=0.0, ge=0.0)
    rotation: Accepted | None = None
    rotation_absolute: float = Field(default=0.0, ge=0.0)


class ToleranceTable(Table):
    """`[tolerance]`."""

    static: AcceptedTable = AcceptedTable(displacement=0.01)
    transient: AcceptedTable = AcceptedTable(displacement=0.03)


class ReferenceTable(Table):
    """`[reference]`: what motion over time is compared with where a case names no results.

    Attributes
    ----------
    modes, frames, mass, tolerance
        The reduced model that transients are compared with; `tolerance` is that of its steps.
    """

    modes: Modes = 20
    frames: int = Field(default=12, ge=0, le=MOST_FRAMES)
    mass: Mass = Field(default=Mass.CONFIGURATION, strict=False)
    tolerance: float = Field(default=1e-4, gt=0.0, lt=1.0)


class SweepTable(Table):
    """`[sweep]`: the models that are tried.

    Attributes
    ----------
    basis
        Of `"normal"`, `"residual"` (with residual flexibility), `"craig_bampton"`.
    modes
        Numbers of modes, without modes of the interfaces.
    frames
        Numbers of frames. Frames given by hand are tried too.
    methods
        Names of [methods](../methods.md).
    mass
        For transients, `"constant"`; `"polynomial"` with `second_order`; `"configuration"` with it and `frames`.
        Without this key `fit` tries the last, too, where no other will do.
    internal_step
        `"single"`: one internal step per communication step; numbers: `internal_step.tolerance`.
    finite_elements
        Whether equilibria of the whole model are timed.
    """

    basis: list[Annotated[BasisChoice, Field(strict=False)]] = Field(default=list(BasisChoice), min_length=1)
    modes: list[Modes] = Field(default=[5, 10, 20], min_length=1)
    frames: list[Frames] = Field(default=[1, 2, 4, 8], min_length=1)
    methods: list[Annotated[Method, Field(strict=False)]] = Field(
        default=[m for m in Method if m not in (Method.MODAL_ROTATION, Method.HALF_ROTATION, Method.STIFFNESS_BY_MODE)],
        min_length=1,
    )
    mass: list[Annotated[Mass, Field(strict=False)]] = Field(default=[Mass.CONSTANT, Mass.POLYNOMIAL], min_length=1)
    internal_step: list[Literal["single"] | Annotated[float, Field(gt=0.0, lt=1.0)]] = Field(
        default=["single", 1e-4], min_length=1
    )
    finite_elements: bool = True


class StabilityTable(Table):
    """`[stability]`: the map of `chart --stability`, of the methods and frames of `[sweep]`.

    Attributes
    ----------
    factors
        Fractions of each static case's loads.
    tolerance
        Error up to which a run counts as accurate.
    """

    factors: Numbers = [0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 1.25, 1.5, 2.0]
    tolerance: float = Field(default=0.1, gt=0.0, lt=1.0)


class SceneFile(Table):
    """A whole scene file.

    Attributes
    ----------
    loaded
        Interfaces that may be loaded. Models omit interfaces that are neither read nor loaded.
        Default: those of the cases
    read
        Interfaces whose motion is compared. Default: all
    """

    loaded: list[Name] | None = None
    read: list[Name] | None = Field(default=None, min_length=1)
    static: list[StaticTable] = []
    transient: list[TransientTable] = []
    tolerance: ToleranceTable = ToleranceTable()
    reference: ReferenceTable = ReferenceTable()
    sweep: SweepTable = SweepTable()
    stability: StabilityTable = StabilityTable()

    @model_validator(mode="after")
    def _consistent(self) -> "SceneFile":
        names = [*(case.name for case in self.static), *(case.name for case in self.transient)]
        if not names:
            raise ValueError("nothing happens in the scene: give a [[static]] or a [[transient]] table")
        different(names, "cases have the name")
        return self


def read_scene_file(path: Path) -> SceneFile:
    """Read and check a scene file; paths in it come out relative to the working directory.

    Parameters
    ----------
    path : Path

    Returns
    -------
    SceneFile

    Raises
    ------
    SceneError
        Every wrong key at once, with what was found and what would do.
    """
    data = read_toml(path, SceneError, Kind.SCENE)
    scene = validated(SceneFile, data, SceneError, "docs/reference/scene-file.md", path)

    def placed(case: Any) -> Any:
        results = case.results and path.parent / case.results
        loads = str(path.parent / case.loads) if isinstance(case.loads, str) else case.loads
        return case.model_copy(update={"results": results, "loads": loads})

    return scene.model_copy(
        update={kind: [placed(c) for c in getattr(scene, kind)] for kind in ("static", "transient")}
    )
