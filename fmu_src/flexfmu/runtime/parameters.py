"""The FMU's parameters: values by name, checked when set, as numbers in the FMU's state."""

import math
from collections.abc import Sequence

from .errors import OptionError
from .reduced_body import Division, Evaluation, Formulation, Kinematics, LoadPlacement, Mass, Stiffness
from .stepping import StepLimits
from .variables import (
    CHOICES,
    DAMPING_SCALE,
    DIVISION,
    EVALUATION,
    FEED_LIMIT,
    FIXED,
    INITIALIZATION,
    INTERPOLATION,
    KINEMATICS,
    LOADS,
    MASS,
    MISSED_LIMIT,
    MOMENTUM_LIMIT,
    ON_FEED,
    ON_MISSED,
    ON_MOMENTUM,
    ON_ROTATION,
    ON_SPIN,
    ON_STABILITY,
    ON_STEP,
    ROTATION_LIMIT,
    SPIN_LIMIT,
    STABILITY_LIMIT,
    STEP_FEWEST,
    STEP_LIMIT,
    STEP_MOST,
    STEP_TOLERANCE,
    STIFFNESS,
    TUNABLE,
    Group,
    Initialization,
    Interpolation,
    Variable,
)
from .watch import Limits, OnLimit, OnRefusal


class Parameters:
    """Values of the parameters in the table of variables.

    Parameters
    ----------
    table : sequence of Variable
    """

    def __init__(self, table: Sequence[Variable]):
        self._values = {v.name: v.start for v in table if v.group is Group.PARAMETER}
        self.tunable = frozenset(v.name for v in table if v.variability == TUNABLE)

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __getitem__(self, name: str) -> float | int | bool | str:
        value = self._values[name]
        return 0.0 if value is None else value

    @staticmethod
    def check(name: str, value: float | int | bool | str) -> None:
        """Refuse a choice that is not offered with OptionError."""
        if name in CHOICES:
            offered = [choice.value for choice in CHOICES[name]]
            if value not in offered:
                raise OptionError(f"{name} is {value!r}, expected one of {offered}")

    def set(self, name: str, value: float | int | bool | str) -> None:
        """Set a parameter; OptionError for a choice that is not offered."""
        self.check(name, value)
        self._values[name] = value

    def numbers(self) -> list[float]:
        """All values as numbers: choices by their place, Booleans as 0 and 1."""
        return [
            float([choice.value for choice in CHOICES[name]].index(str(value)) if name in CHOICES else value or 0.0)
            for name, value in self._values.items()
        ]

    def restore(self, numbers: Sequence[float]) -> bool:
        """Take the values back from `numbers`; whether any changed that is fixed while the body runs."""
        before = dict(self._values)
        for (name, value), number in zip(before.items(), numbers, strict=True):
            if name in CHOICES:
                self._values[name] = list(CHOICES[name])[int(number)].value
            else:
                self._values[name] = bool(number) if isinstance(value, bool) else float(number)
        return any(self._values[name] != value for name, value in before.items() if name not in self.tunable)

    @property
    def formulation(self) -> Formulation:
        """The formulation chosen; a combination without meaning raises OptionError."""
        return Formulation(
            Kinematics(self[KINEMATICS]),
            LoadPlacement(self[LOADS]),
            Stiffness(self[STIFFNESS]),
            Mass(self[MASS]),
            Division(self[DIVISION]),
            Evaluation(self[EVALUATION]),
        )

    @property
    def step_limits(self) -> StepLimits:
        """Bounds of the internal step."""
        return StepLimits(float(self[STEP_LIMIT]), float(self[STEP_TOLERANCE]), float(self[STEP_MOST]))

    @property
    def fewest_substeps(self) -> int:
        """Internal steps that a step has at least; OptionError for what is no such number."""
        fewest = float(self[STEP_FEWEST])
        if not 1.0 <= fewest < float("inf"):
            raise OptionError(f"{STEP_FEWEST} is {fewest}, expected a finite number of internal steps ≥ 1")
        return math.ceil(fewest)

    @property
    def damping_scale(self) -> float:
        """Factor on all modal damping ratios."""
        return float(self[DAMPING_SCALE])

    @property
    def fixed(self) -> list[str]:
        """Names of the interfaces that the scene fixes."""
        return [name.removesuffix(FIXED) for name, value in self._values.items() if name.endswith(FIXED) and value]

    @property
    def initialization(self) -> Initialization:
        """How the body starts."""
        return Initialization(self[INITIALIZATION])

    @property
    def interpolation(self) -> Interpolation:
        """How inputs are taken over a step."""
        return Interpolation(self[INTERPOLATION])

    @property
    def limits(self) -> Limits:
        """What the body is watched for."""
        turning: tuple[float, OnLimit, float, OnLimit] | tuple[()] = ()
        if SPIN_LIMIT in self:
            momentum = float(self[MOMENTUM_LIMIT]), OnLimit(self[ON_MOMENTUM])
            turning = float(self[SPIN_LIMIT]), OnLimit(self[ON_SPIN]), *momentum
        return Limits(
            float(self[ROTATION_LIMIT]),
            OnLimit(self[ON_ROTATION]),
            float(self[STABILITY_LIMIT]),
            OnLimit(self[ON_STABILITY]),
            float(self[MISSED_LIMIT]),
            OnLimit(self[ON_MISSED]),
            float(self[FEED_LIMIT]),
            OnLimit(self[ON_FEED]),
            *turning,
        )

    @property
    def on_refusal(self) -> OnRefusal:
        """What happens when a step has no result."""
        return OnRefusal(self[ON_STEP])
