"""Exudyn's geometrically exact beam on the same problems; its results are kept in ``exudyn.csv``.

Run from the repository's root in an environment with ``exudyn`` (pip install exudyn): python -m
benchmarks.field.exudyn_beams. Exudyn is no dependency of the project.
"""

from __future__ import annotations

import csv
import sys
import time
from itertools import pairwise
from pathlib import Path

import exudyn
import numpy as np
from exudyn.utilities import (
    CoordinateConstraint,
    Force,
    MarkerNodeCoordinate,
    MarkerNodeRigid,
    NodePointGround,
    NodeRigidBody2D,
    ObjectBeamGeometricallyExact2D,
    SensorNode,
    Torque,
)


def elements_along(system, start, length, elements, bending, axial, shear, mass, inertia):
    """Nodes of geometrically exact elements along x; stiffnesses and masses as of `Beam`."""
    part = length / elements
    nodes = [
        system.AddNode(NodeRigidBody2D(referenceCoordinates=[start + k * part, 0, 0])) for k in range(elements + 1)
    ]
    for pair in pairwise(nodes):
        system.AddObject(
            ObjectBeamGeometricallyExact2D(
                nodeNumbers=list(pair), length=part, massPerLength=mass, crossSectionInertia=inertia,
                bendingStiffness=bending, axialStiffness=axial, shearStiffness=shear, includeReferenceRotations=False,
            )
        )  # fmt: skip
    return nodes


def displacement_of(system, node):
    """A sensor that keeps a node's displacement."""
    kind = exudyn.OutputVariableType.Displacement
    return system.AddSensor(SensorNode(nodeNumber=node, outputVariableType=kind, storeInternal=True, writeToFile=False))


class Beam:
    """A plane beam of geometrically exact elements along x, its first node at the origin.

    Stiffnesses are of bending (N m²), of stretch and of shear (N), masses per length kg/m and kg m.
    """

    def __init__(self, length, elements, bending, axial, shear, mass, inertia, turn=None, free=False):
        self.container = exudyn.SystemContainer()
        self.system = system = self.container.AddSystem()
        self.nodes = elements_along(system, 0.0, length, elements, bending, axial, shear, mass, inertia)
        ground = system.AddMarker(MarkerNodeCoordinate(nodeNumber=system.AddNode(NodePointGround()), coordinate=0))
        for coordinate in () if free else range(3):
            own = system.AddMarker(MarkerNodeCoordinate(nodeNumber=self.nodes[0], coordinate=coordinate))
            more = {} if coordinate < 2 or turn is None else {"offsetUserFunction": lambda _, t, *__: turn(t)}
            system.AddObject(CoordinateConstraint(markerNumbers=[ground, own], **more))
        self.sensors = [displacement_of(system, node) for node in (self.nodes[-1], self.nodes[0])]

    def push(self, force):
        """Add a dead force across the tip."""
        marker = self.system.AddMarker(MarkerNodeRigid(nodeNumber=self.nodes[-1]))
        self.system.AddLoad(Force(markerNumber=marker, loadVector=[0, force, 0]))

    @staticmethod
    def settings():
        """Quiet ones, without files."""
        settings = exudyn.SimulationSettings()
        settings.solution.file.write = False
        settings.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse
        return settings

    def statics(self):
        """Displacement of the tip and the time that it took, s."""
        self.system.Assemble()
        settings = self.settings()
        settings.staticSolver.numberOfLoadSteps = 5
        start = time.perf_counter()
        self.system.SolveStatic(settings)
        cost = time.perf_counter() - start
        return np.array(self.system.GetNodeOutput(self.nodes[-1], exudyn.OutputVariableType.Displacement)), cost

    def motion(self, stop, step):
        """Times and displacements of the tip, and the time that a simulated second took, s."""
        self.system.Assemble()
        settings = self.settings()
        settings.timeIntegration.numberOfSteps = round(stop / step)
        settings.timeIntegration.endTime = stop
        settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
        settings.timeIntegration.newton.useModifiedNewton = True
        settings.solution.sensors.writePeriod = step
        start = time.perf_counter()
        self.system.SolveDynamic(settings)
        cost = (time.perf_counter() - start) / stop
        tip, root = (self.system.GetSensorStoredData(sensor) for sensor in self.sensors)
        return tip[:, 0], tip[:, 1:3], root[:, 1:3], cost


def root_turn(t):
    """Turn of the root in Simo and Vu-Quoc's spin-up, rad."""
    w = 2.0 * np.pi / 15.0
    return 0.4 * (0.5 * t * t + (np.cos(w * t) - 1.0) / w**2) if t < 15.0 else 6.0 * t - 45.0


def spun(beam, length, problem, elements):
    """Lag at some times and the steady stretch, m."""
    times, moved, _, cost = beam.motion(20.0, 0.02)
    angle = np.array([root_turn(t) for t in times])
    place = moved + np.array([length, 0.0])
    along = np.cos(angle) * place[:, 0] + np.sin(angle) * place[:, 1] - length
    across = np.cos(angle) * place[:, 1] - np.sin(angle) * place[:, 0]
    for at in (5.0, 7.5, 10.0, 12.5):
        yield problem, f"lag at {at:g} s, m", elements, across[np.argmin(abs(times - at))], cost
    yield problem, "steady stretch, m", elements, along[times > 15.0].mean(), cost


def spin_up(elements):
    """Simo and Vu-Quoc's beam."""
    return spun(Beam(10.0, elements, 1.4e4, 2.8e7, 1e7, 1.2, 6e-4, root_turn), 10.0, "spin_up", elements)


def flight(elements):
    """Both ends of a free beam of 10 m that is thrown by a force and a moment on its first end for 2.5 s."""
    beam = Beam(10.0, elements, 500.0, 1e4, 1e4 / 2.4, 1.0, 0.05, free=True)
    marker = beam.system.AddMarker(MarkerNodeRigid(nodeNumber=beam.nodes[0]))
    for kind, load in ((Force, [-4.8, -6.4, 0.0]), (Torque, [0.0, 0.0, 80.0])):

        def course(_, t, __, load=load):
            return load if t <= 2.5 else [0.0, 0.0, 0.0]

        beam.system.AddLoad(kind(markerNumber=marker, loadVector=load, loadVectorUserFunction=course))
    times, tip, root, cost = beam.motion(8.0, 0.01)
    for at in np.arange(1.0, 8.5, 0.5):
        row = np.argmin(abs(times - at))
        for name, moved in (("tip", tip), ("root", root)):
            for axis in range(2):
                yield "flight", f"{name} u{'xy'[axis]} at {at:g} s, m", elements, moved[row, axis], cost


def elastica(elements):
    """Displacement of a cantilever over its length, along and across, at PL²/EI = 4 and 10."""
    for load in (4.0, 10.0):
        beam = Beam(1.0, elements, 500.0, 6e7, 2.5e7, 2.355, 2e-5)
        beam.push(load * 500.0)
        moved, cost = beam.statics()
        for axis, name in enumerate(("along", "across")):
            yield "elastica", f"{name}, PL²/EI = {load:g}", elements, moved[axis], cost


def sudden(elements):
    """Tip of the demo's clamped beam under a sudden force of 5 kN, m, every 12.5 ms of 0.25 s."""
    side = 0.03
    area, second = side**2, side**4 / 12.0
    beam = Beam(1.0, elements, 2e11 * second, 2e11 * area, 5 / 6 * 2e11 / 2.6 * area, 7850 * area, 7850 * second)
    beam.push(5e3)
    times, moved, _, cost = beam.motion(0.25, 2.5e-4)
    for at in np.linspace(0.0125, 0.25, 20):
        row = moved[np.argmin(abs(times - at))]
        for axis, name in enumerate("xy"):
            yield "sudden", f"u{name} at {at:.4f} s, m", elements, row[axis], cost


def chain(elements, links, gravity=0.0, slider=False, torque=0.0):
    """Bars along x, hinged to each other and to the origin; `links`: length and the arguments of elements."""
    container = exudyn.SystemContainer()
    system = container.AddSystem()
    ground = system.AddMarker(MarkerNodeCoordinate(nodeNumber=system.AddNode(NodePointGround()), coordinate=0))

    def hold(node, coordinate, other=None):
        own = system.AddMarker(MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
        at = (
            ground if other is None else system.AddMarker(MarkerNodeCoordinate(nodeNumber=other, coordinate=coordinate))
        )
        system.AddObject(CoordinateConstraint(markerNumbers=[at, own]))

    start, last, ends = 0.0, None, []
    for length, bending, axial, mass in links:
        inertia = mass * bending / axial
        nodes = elements_along(system, start, length, elements, bending, axial, axial / 2.4, mass, inertia)
        for k, node in enumerate(nodes):
            weight = gravity * mass * length / elements * (0.5 if k in (0, elements) else 1.0)
            marker = system.AddMarker(MarkerNodeRigid(nodeNumber=node))
            system.AddLoad(Force(markerNumber=marker, loadVector=[0, -weight, 0]))
        hold(nodes[0], 0, last)
        hold(nodes[0], 1, last)
        start, last = start + length, nodes[-1]
        ends.append(last)
    if slider:
        hold(last, 1)
        marker = system.AddMarker(MarkerNodeRigid(nodeNumber=ends[0]))
        system.AddLoad(Torque(markerNumber=marker, loadVector=[0, 0, torque]))
    yield from moved_ends(system, ends, elements, slider)


def moved_ends(system, ends, elements, slider):
    """Displacements of a chain's hinge and end, every 0.1 s of 1.2 s; of one on a slider its end's alone, along."""
    sensors = [displacement_of(system, node) for node in ends]
    system.Assemble()
    settings = Beam.settings()
    step, stop = 1e-3, 1.2
    settings.timeIntegration.numberOfSteps = round(stop / step)
    settings.timeIntegration.endTime = stop
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.9
    settings.solution.sensors.writePeriod = step
    begun = time.perf_counter()
    system.SolveDynamic(settings)
    cost = (time.perf_counter() - begun) / stop
    stored = [system.GetSensorStoredData(sensor) for sensor in sensors]
    for at in np.arange(0.1, stop + 1e-9, 0.1):
        row = np.argmin(abs(stored[0][:, 0] - at))
        columns = [1] if slider else [1, 2]
        for name, data in list(zip(("hinge", "end"), stored, strict=True))[1 if slider else 0 :]:
            for column in columns:
                yield f"{name} u{'xy'[column - 1]} at {at:g} s, m", elements, data[row, column], cost


SOFT = (5.0, 12.0 * 5.0 / 0.04**2, 1.0)
STEEL = (2e11 * 0.02**4 / 12.0, 2e11 * 0.02**2, 7850.0 * 0.02**2)


def pendulum(elements):
    """Two soft bars of 1 m that fall from the horizontal."""
    for row in chain(elements, [(1.0, *SOFT), (1.0, *SOFT)], gravity=9.81):
        yield "pendulum", *row


def crank(elements):
    """A crank of steel, 0.3 m, that a moment of 2 N m turns, and a soft rod of 1 m."""
    for row in chain(elements, [(0.3, *STEEL), (1.0, *SOFT)], slider=True, torque=2.0):
        yield "crank", *row


# Elements of each problem.
PROBLEMS = {
    spin_up: (4, 8),
    elastica: (4, 8),
    sudden: (4, 8),
    flight: (16, 32),
    pendulum: (8, 16),
    crank: (16, 32),
}
COLUMNS = ["problem", "quantity", "elements", "value", "cost_s", "version"]


def main():
    """Run the problems named on the command line, or all, and write the file; rows of others stay."""
    file = Path(__file__).with_name("exudyn.csv")
    chosen = {run: counts for run, counts in PROBLEMS.items() if run.__name__ in sys.argv[1:] or not sys.argv[1:]}
    new = {run.__name__: [row for n in counts for row in run(n)] for run, counts in chosen.items()}
    rows = []
    if file.exists():
        with file.open(encoding="utf-8", newline="") as old:
            rows = [row for row in list(csv.reader(old))[1:] if row[0] not in new]
    for found in new.values():
        rows += [[*row[:3], f"{row[3]:.8g}", f"{row[4]:.3g}", exudyn.config.Version()] for row in found]
    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(rows)
    print(f"{len(rows)} rows")


if __name__ == "__main__":
    main()
