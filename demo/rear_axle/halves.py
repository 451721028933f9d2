"""Rear axle as two flexible bodies: cut in the middle of the cross-beam and joined again as a master would join them.

In one body the arms hang on their own bushings, the cross-beam closes a loop between them, and the tree cannot know it:
however the arms turn, the strain energy stays that of the linear modes. Cut in the middle, each half is a tree without
a loop, from its bushing along the arm and the half of the cross-beam to the section of the cut. The weld that holds the
two sections together, displacement and rotation of the interfaces, is nonlinear and closes the loop exactly. Interfaces
are fits and leave the section free to warp, as it is in the middle of a beam that is twisted from both ends alike.

The coil springs are loads at the seats here, not supports: so they follow the seats' true rise, where springs in a
body's stiffness are linear in its modal coordinates, and a half by itself is free to turn about its bushing.

Run from the repository's root: ``python -m demo.rear_axle.halves``.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from demo.mesh_tools import BrickMesh
from demo.rear_axle import make_mesh
from demo.rear_axle.alignment import FloatArray
from demo.rear_axle.calculix.run_calculix import SEAT_STIFFNESS
from demo.rear_axle.run import CASES, HERE, WHEELS, Reference, print_table, read_reference

from flexfmu.build import reduce_body
from flexfmu.config import BodyFile, FrameTable, InterfaceTable, MeshTable, ReductionTable, read_body_file
from flexfmu.progress import Reporter
from flexfmu.runtime.dynamics import build_dynamics, configuration_at, modal_force, spread, tangent_stiffness
from flexfmu.runtime.loads import loads_from_mapping
from flexfmu.runtime.reduced_body import ReducedBody
from flexfmu.runtime.rotations import rotation_vector
from flexfmu.runtime.tree import jacobians

TOLERANCE = 1e-9  # of the weld's gap, m and rad, and of a Newton step, kg^1/2 m
MAX_ITERATIONS = 60

# Interfaces of a half, in this order.
WHEEL, MIDDLE, SEAT = range(3)


def half_mesh(axle: make_mesh.AxleMesh, side: str) -> make_mesh.AxleMesh:
    """Half of the axle, "L" or "R"; the node set CUT is the section in the middle of the cross-beam."""
    names = [f"ARM_{side}", *(f"BEAM_{side}{k + 1}" for k in range(make_mesh.PIECES))]
    elements = np.sort(np.concatenate([axle.element_sets[name] for name in names]))
    nodes = np.unique(axle.mesh.bricks[elements])
    mesh = BrickMesh(axle.mesh.points[nodes], np.searchsorted(nodes, axle.mesh.bricks[elements]))
    inside = {
        name: np.searchsorted(nodes, members)
        for name, members in axle.node_sets.items()
        if name.endswith(side) or name in names
    }
    inside["CUT"] = mesh.nodes_where(mesh.points[:, 1] == 0.0)
    return make_mesh.AxleMesh(mesh, inside, {}, axle.quality)


def half_config(whole: BodyFile, deck: Path, side: str) -> BodyFile:
    """Body file of a half: held at its bushing, without the coil spring, one frame for each piece of the cross-beam."""
    chain = [FrameTable(name="arm", nodes=f"ARM_{side}")]
    for k in range(make_mesh.PIECES):
        chain.append(FrameTable(name=f"beam_{k + 1}", nodes=f"BEAM_{side}{k + 1}", parent=chain[-1].name))
    wheel = InterfaceTable(name=WHEELS["LR".index(side)], nodes=f"FLANGE_{side}")
    return whole.model_copy(
        update={
            "free": True,
            "mesh": MeshTable(file=deck),
            "support": [s for s in whole.support if s.nodes.endswith(side) and not s.nodes.startswith("SEAT")],
            "interface": [
                wheel,
                InterfaceTable(name="middle", nodes="CUT"),
                InterfaceTable(name="seat", nodes=f"SEAT_{side}", weights="node"),
            ],
            "frame": chain,
            "reduction": ReductionTable(modes=20, residual_flexibility=True),
        }
    )


@dataclass(frozen=True, slots=True)
class Weld:
    """Two halves and the weld between their middle sections.

    Attributes
    ----------
    halves : (ReducedBody, ReducedBody)
        Left and right.
    spread : ndarray, shape (2,)
        Mean squares of the seat's nodes about its centre in y and x, m²: springs under all of them resist its tilting.
    """

    halves: tuple[ReducedBody, ReducedBody]
    spread: FloatArray

    def solve(self, reference: Reference) -> FloatArray:
        """Motion (n, 2, 6) of both wheels in equilibrium under the loads of a reference, each from the one before."""
        dynamics = [build_dynamics(half, half.formulation) for half in self.halves]
        modes = [d.stiffness.size for d in dynamics]
        q = [np.zeros(m) for m in modes]
        weld = np.zeros(6)
        result = []
        for loads in reference.loads():
            for _ in range(MAX_ITERATIONS):
                rows, tangents, constraint, states = [], [], [], []
                for i, (d, half) in enumerate(zip(dynamics, self.halves, strict=True)):
                    state = configuration_at(d, q[i])
                    at = d.tree.interfaces.start
                    translation, spin = jacobians(d.tree, state)
                    rise = state.position[at + SEAT, 2] - d.tree.point[at + SEAT, 2]
                    tilt = rotation_vector(state.rotation[at + SEAT][None])[0, :2]
                    seat = [0.0, 0.0, -SEAT_STIFFNESS * rise, *(-SEAT_STIFFNESS * self.spread * tilt), 0.0]
                    moved = np.vstack([translation[at + SEAT, 2], np.sqrt(self.spread)[:, None] * spin[at + SEAT, :2]])
                    sign = 1.0 - 2.0 * i
                    acting = {WHEELS[i]: loads[WHEELS[i]], "middle": list(sign * weld), "seat": seat}
                    nodes = spread(d, loads_from_mapping(half.interface_names, acting, (0.0, 0.0, 0.0)))
                    rows.append(d.stiffness * q[i] - modal_force(d, nodes, state))
                    tangents.append(tangent_stiffness(d, nodes, state) + SEAT_STIFFNESS * moved.T @ moved)
                    constraint.append(sign * np.concatenate([translation[at + MIDDLE], spin[at + MIDDLE]]))
                    states.append((state.position[at + MIDDLE], state.rotation[at + MIDDLE]))
                (x, turn), (other, other_turn) = states
                gap = np.concatenate([x - other, rotation_vector((turn @ other_turn.T)[None])[0]])
                jacobian = np.hstack(constraint)
                size, first = sum(modes), modes[0]
                matrix = np.zeros((size + 6, size + 6))
                matrix[:first, :first], matrix[first:size, first:size] = tangents
                matrix[:size, size:], matrix[size:, :size] = -jacobian.T, jacobian
                step = np.linalg.solve(matrix, -np.concatenate([*rows, gap]))
                q = [q[0] + step[:first], q[1] + step[first:size]]
                weld = weld + step[size:]
                if np.linalg.norm(step[:size]) <= TOLERANCE and np.abs(gap).max() <= TOLERANCE:
                    break
            else:
                raise RuntimeError("the weld does not converge")
            motion = []
            for d, own in zip(dynamics, q, strict=True):
                state, wheel = configuration_at(d, own), d.tree.interfaces.start + WHEEL
                turned = rotation_vector(state.rotation[wheel][None])[0]
                motion.append(np.concatenate([state.position[wheel] - d.tree.point[wheel], turned]))
            result.append(motion)
        return np.array(result)


def weld_halves(body_file: Path) -> Weld:
    """Reduce both halves of the axle of a body file."""
    axle, whole = make_mesh.build(make_mesh.SIZES["coarse"]), read_body_file(body_file)
    bodies = []
    with tempfile.TemporaryDirectory() as folder:
        for side in "LR":
            deck = Path(folder) / f"half_{side}.inp"
            make_mesh.write(deck, half_mesh(axle, side))
            bodies.append(reduce_body(half_config(whole, deck, side), Reporter()))
    seat = axle.mesh.points[axle.node_sets["SEAT_L"]]
    return Weld((bodies[0], bodies[1]), seat.var(axis=0)[[1, 0]])


def main() -> None:
    """Compare the welded halves with CalculiX."""
    welds = {body_file: weld_halves(HERE / body_file) for body_file in dict.fromkeys(c[0] for c in CASES.values())}
    for case, (body_file, axis, words) in CASES.items():
        reference = read_reference(HERE / "calculix" / f"{case}.csv", axis)
        print(f"\n### {words}")
        print_table(reference, {"two halves, welded": welds[body_file].solve(reference)})


if __name__ == "__main__":
    main()
