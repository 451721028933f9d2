"""The axle between car and road: FMUs, springs and loads of the co-simulation, as a coupling file's contents."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from demo.rear_axle.alignment import FloatArray
from pythonfmu.builder import FmuBuilder

from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store, default_folder
from flexfmu.fmu.package import package_fmu
from flexfmu.master import CouplingFile, Result, parse_coupling
from flexfmu.model.reduced_body import ReducedBody

HERE = Path(__file__).parent
SIDES = ("left", "right")
GRAVITY = 9.81
AXLE, AXLE_CUT, WHEEL = "axle.fmu", "axle_cut.fmu", "RoadWheel.fmu"

# Wheel bearings, and coil springs between the seats and the car, N/m.
BEARING, COIL = 1e7, 20e3


@dataclass(frozen=True, slots=True)
class Ride:
    """A ride over a bump.

    Attributes
    ----------
    bump : dict of str to float
        Height of the bump under the wheels of a side, m.
    length, speed : float
        Of the bump, m, and of the car, m/s.
    begin, stop : float
        When the wheels reach the bump, and the end, s.
    step : float
        Communication step, s.
    wheel_load, wheel_mass : float
        Force between a tyre and the flat road, N, and mass, kg.
    damper : float
        Between each wheel's hub and the car, N s/m.
    damper_at_seat : bool
        Between each spring seat and the car instead; of the axle in one piece.
    axle : dict of str to float or str
        Parameters of the axle's FMU.
    cut : bool
        Take the axle that is cut in the middle; it has its coil springs aboard.
    """

    bump: dict[str, float] = field(default_factory=lambda: {"left": 0.08, "right": 0.0})
    length: float = 0.5
    speed: float = 8.0
    begin: float = 0.4
    stop: float = 0.8
    step: float = 1e-3
    wheel_load: float = 3000.0
    wheel_mass: float = 20.0
    damper: float = 1000.0
    damper_at_seat: bool = False
    axle: dict[str, float | str] = field(default_factory=dict)
    cut: bool = False


def build_axle(folder: Path, report: Reporter, cut: bool = False) -> ReducedBody:
    """Build the axle's FMU, in one piece or cut in the middle."""
    body = reduce_body(
        read_body_file(HERE / ("body_cut.toml" if cut else "body.toml")), report, Store(default_folder())
    )
    package_fmu(body, folder / (AXLE_CUT if cut else AXLE))
    return body


def build_wheel(folder: Path) -> None:
    """Build the wheels' FMU."""
    FmuBuilder.build_FMU(HERE / "road_wheel.py", dest=folder, canGetAndSetFMUstate=True)


def coil_preload(body: ReducedBody, ride: Ride) -> float:
    """Force of a coil spring in the undeformed axle, N, that leaves the wheels' load: moments about the bushings."""
    at = dict(zip(body.interface_names, body.interface_point, strict=True))
    wheel, seat = at["wheel_left"][0], at["seat_left"][0]
    own = GRAVITY * float(body.masses.mass @ body.masses.point[:, 0]) / 2.0
    return ((ride.wheel_load - GRAVITY * ride.wheel_mass) * wheel - own) / seat


def coupling(ride: Ride, preload: float, folder: Path) -> CouplingFile:
    """Coupling of the axle, two wheels, coil springs and dampers; the car is held."""
    start = {f"seat_{side}.force.z": -preload for side in SIDES} | {"body.acceleration.z": GRAVITY} | ride.axle
    fmus, springs, links = [{"name": "axle", "file": AXLE_CUT if ride.cut else AXLE, "start": start}], [], []
    for side in SIDES:
        wheel = {
            "mass": ride.wheel_mass,
            "tyre.preload": ride.wheel_load,
            "road.speed": ride.speed,
            "bump.start": ride.speed * ride.begin,
            "bump.length": ride.length,
            "bump.height": ride.bump[side],
        }
        fmus.append({"name": side, "file": WHEEL, "start": wheel})
        bearing = [BEARING, BEARING, BEARING, 0.0, 0.0, 0.0]
        springs.append({"a": f"axle.wheel_{side}", "b": f"{side}.hub", "stiffness": bearing})
        if not ride.cut:
            springs.append({"a": f"axle.seat_{side}", "stiffness": [0.0, 0.0, COIL, 0.0, 0.0, 0.0]})
        place = f"axle.seat_{side}" if ride.damper_at_seat else f"{side}.hub"
        springs.append({"a": place, "stiffness": [0.0] * 6, "damping": [0.0, 0.0, ride.damper, 0.0, 0.0, 0.0]})
        # The wheel's turn about the vertical, and the moment of the side force that the hub does not bear itself.
        links.append({"from": f"axle.wheel_{side}.rotation.z", "to": f"{side}.steer", "factor": 1.0})
        links.append({"from": f"{side}.tyre.moment.x", "to": f"axle.wheel_{side}.moment.x", "factor": 1.0})
    # The bearings are stiff against what the flange weighs within a step: h² k / m is about 4.
    experiment = {"stop": ride.stop, "step": ride.step, "scheme": "iterated", "held": "mean"}
    return parse_coupling({"experiment": experiment, "fmu": fmus, "connection": links, "spring": springs}, folder)


def motion(result: Result, side: str) -> FloatArray:
    """Displacement and rotation vector (t, 6) of a wheel's flange."""
    names = [f"axle.wheel_{side}.{kind}.{axis}" for kind in ("displacement", "rotation") for axis in "xyz"]
    return np.stack([result[name] for name in names], axis=1)
