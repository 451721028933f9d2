"""`[stability]` of a scene file: what the maps of stability vary; docs/stability.md describes it."""

from enum import Enum
from typing import Annotated

from pydantic import Field

from ...files.limits import MOST_FRAMES
from ...files.toml_files import Positive, Table, Vector


class Map(Enum):
    """What is mapped."""

    BUCKLING = "buckling"
    """Axial load against the critical one, per method."""
    ROTATION = "rotation"
    """Rotation against the number of frames."""
    COUPLING = "coupling"
    """Coupling step against stiffness and mass of what hangs on an interface."""


class StabilityTable(Table):
    """`[stability]`: every key has a default, found from the scene's first static case or from the body."""

    maps: list[Annotated[Map, Field(strict=False)]] = Field(default=list(Map), min_length=1)
    interface: str | None = None
    tolerance: float = Field(default=0.1, gt=0.0, lt=1.0)
    axial: Vector | None = None
    shares: list[Positive] = Field(
        default=[0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 1.0, 1.05, 1.2, 1.5], min_length=1
    )
    axis: Vector | None = None
    angles: list[Positive] = Field(
        default=[5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0, 105.0, 120.0], min_length=1
    )
    frames: list[Annotated[int, Field(ge=1, le=MOST_FRAMES)]] = Field(default=[1, 2, 4, 8], min_length=1)
    direction: Vector | None = None
    mass_ratios: list[Positive] = Field(default=[0.1, 1.0, 10.0], min_length=1)
    stiffness_ratios: list[Positive] = Field(default=[0.01, 0.1, 1.0, 10.0, 100.0, 1000.0], min_length=1)
    coupling_steps_per_period: list[Positive] = Field(default=[160.0, 40.0, 10.0, 2.5], min_length=1)
