"""Reference results of the thin tube with CalculiX (decks and CSV files beside this file).

- ``static_y``: dead force across on the tip, 0 to 4.6 kN in six equal steps: the tip moves by a quarter of the length.

Run from the repository's root, with ``ccx`` on the PATH, for all cases or those named:
``python -m demo.thin_tube.calculix.run_calculix [case ...]``. Columns: see `demo.references`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from demo.calculix_tools import Model
from demo.references import ReferenceBody, run_cases
from demo.thin_tube import make_mesh
from demo.tip_face import TipFace

MESH_NOTE = "C3D20R 20 x 16 x 1"


def main() -> None:
    """Write the model deck anew and run the cases."""
    make_mesh.main()
    mesh, sets = make_mesh.build()
    # Equal weights of all nodes, as the body file has it: the faces are no parallelograms.
    nodes = sets["TIP"]
    tip = TipFace(nodes=nodes, points=mesh.points[nodes], weights=np.full(nodes.size, 1.0 / nodes.size))
    body = ReferenceBody(
        model=Model(file=make_mesh.MODEL_FILE, faces={"tip": tip}),
        folder=Path(__file__).parent,
        mesh_note=MESH_NOTE,
    )
    cases = {"static_y": lambda name: body.static(name, {"tip": (0.0, 4.6e3, 0.0)}, increments=6)}
    run_cases(cases, "CalculiX reference results of the thin tube")


if __name__ == "__main__":
    main()
