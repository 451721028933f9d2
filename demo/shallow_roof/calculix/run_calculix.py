"""Reference results of the shallow roof with CalculiX (decks and CSV files beside this file).

- ``static_z``: dead force down on the crown, 0 to 8.8 kN in eight equal steps: 90 % of the limit load.
- ``path_z``: the way through the limit points, led by the crown's displacement, 0 to 16 mm in steps of 0.4 mm. Limit
  load 9.8 kN at 6.4 mm.

Run from the repository's root, with ``ccx`` on the PATH, for all cases or those named:
``python -m demo.shallow_roof.calculix.run_calculix [case ...]``. Columns: see `demo.references`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from demo.calculix_tools import Model
from demo.references import ReferenceBody, run_cases
from demo.shallow_roof import make_mesh
from demo.tip_face import TipFace

MESH_NOTE = "C3D20R 20 x 12 x 1 (1843 nodes)"


def main() -> None:
    """Write the model deck anew and run the cases."""
    make_mesh.main()
    mesh, sets = make_mesh.build()
    # Equal weights of all nodes, as the body file has it.
    nodes = sets["CROWN"]
    crown = TipFace(nodes=nodes, points=mesh.points[nodes], weights=np.full(nodes.size, 1.0 / nodes.size))
    body = ReferenceBody(
        model=Model(
            file=make_mesh.MODEL_FILE,
            faces={"crown": crown},
            supports=("ROOT", "FAR"),
        ),
        folder=Path(__file__).parent,
        mesh_note=MESH_NOTE,
    )
    cases = {
        "static_z": lambda name: body.static(name, {"crown": (0.0, 0.0, -8.8e3)}, increments=8),
        "path_z": lambda name: body.path(name, "crown", axis=2, displacement=-0.016, increments=40),
    }
    run_cases(cases, "CalculiX reference results of the shallow roof")


if __name__ == "__main__":
    main()
