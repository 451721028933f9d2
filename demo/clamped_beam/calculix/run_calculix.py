"""Reference results of the clamped beam with CalculiX (decks and CSV files beside this file).

- ``static_y``: dead tip force in y, 0 to 20 kN in steps of 1 kN; ``linear_y``: linear statics under 1 kN.
- ``static_combined``: dead tip force growing to (-5, 4, 3) kN in ten equal steps.
- ``frequencies``: the lowest 12 eigenfrequencies.
- ``axial_frequencies``: the lowest 6 about the equilibrium under a dead axial tip force, -0.5 to 1 times Euler's
  load π²EI/(4L²), 33310 N; pull is positive.
- ``buckling``: the lowest 6 axial tip forces at which the straight beam buckles, pairs as the section is square.
- ``sudden_load``: undamped transient under a sudden dead tip force of 5 kN in y, from rest, 0.25 s.
  Step 6.25e-5 s, about ten minutes; a step of 1.25e-4 s gives tip positions 0.36 % (rms) away from it, and one
  of 5e-4 s diverges: the trapezoidal rule does not conserve the energy of a nonlinear system.

Run from the repository's root, with ``ccx`` on the PATH, for all cases or those named:
``python -m demo.clamped_beam.calculix.run_calculix [case ...]``. Columns: see `demo.references`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from demo.calculix_tools import Model
from demo.clamped_beam import make_mesh
from demo.mesh_tools import STEEL
from demo.references import ReferenceBody, run_cases
from demo.tip_face import TipFace

EULER_LOAD = np.pi**2 * STEEL.youngs_modulus * make_mesh.SIDE**4 / 12 / (4 * make_mesh.LENGTH**2)  # N
AXIAL_FORCES = EULER_LOAD * np.array([-0.5, -0.25, 0.0, 0.25, 0.5, 1.0])

MESH_NOTE = "C3D20R 40 x 2 x 2 (1221 nodes)"


def main() -> None:
    """Write the model deck anew and run the cases."""
    make_mesh.main()
    mesh, sets = make_mesh.build()
    body = ReferenceBody(
        model=Model(file=make_mesh.MODEL_FILE, faces={"tip": TipFace.of(mesh, sets["TIP"])}),
        folder=Path(__file__).parent,
        mesh_note=MESH_NOTE,
    )
    cases = {
        "static_y": lambda name: body.static(name, {"tip": (0.0, 20e3, 0.0)}, increments=20),
        "linear_y": lambda name: body.linear(name, {"tip": (0.0, 1e3, 0.0)}),
        "static_combined": lambda name: body.static(name, {"tip": (-5e3, 4e3, 3e3)}, increments=10),
        "frequencies": lambda name: body.frequencies(name, count=12),
        "axial_frequencies": lambda name: body.preloaded_frequencies(name, "tip", axis=0, sizes=AXIAL_FORCES, count=6),
        "buckling": lambda name: body.buckling(name, "tip", axis=0, size=-EULER_LOAD, count=6),
        "sudden_load": lambda name: body.sudden_load(
            name, {"tip": (0.0, 5e3, 0.0)}, step=6.25e-5, duration=0.25, keep_every=8
        ),
    }
    run_cases(cases, "CalculiX reference results of the clamped beam")


if __name__ == "__main__":
    main()
