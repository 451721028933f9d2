"""Reference results of the beam clamped at both ends with CalculiX (decks and CSV files beside this file).

- ``static_y``: dead force across the beam at its middle, 0 to 200 kN in ten equal steps; in the end the middle
  has moved by 1.24 times the section's height, less than half of what linear statics say.
- ``linear_y``: linear statics under 10 kN.
- ``frequencies``: the lowest 12 eigenfrequencies.

Run from the repository's root, with ``ccx`` on the PATH, for all cases or those named:
``python -m demo.clamped_clamped.calculix.run_calculix [case ...]``. Columns: see `demo.references`.
"""

from __future__ import annotations

from pathlib import Path

from demo.calculix_tools import Model
from demo.clamped_clamped import make_mesh
from demo.references import ReferenceBody, run_cases
from demo.tip_face import TipFace

MESH_NOTE = "C3D20R 40 x 2 x 2 (1221 nodes)"


def main() -> None:
    """Write the model deck anew and run the cases."""
    make_mesh.main()
    mesh, sets = make_mesh.build()
    body = ReferenceBody(
        model=Model(
            file=make_mesh.MODEL_FILE,
            faces={"middle": TipFace.of(mesh, sets["MIDDLE"])},
            supports=("ROOT", "FAR"),
        ),
        folder=Path(__file__).parent,
        mesh_note=MESH_NOTE,
    )
    cases = {
        "static_y": lambda name: body.static(name, {"middle": (0.0, 200e3, 0.0)}, increments=10),
        "linear_y": lambda name: body.linear(name, {"middle": (0.0, 10e3, 0.0)}),
        "frequencies": lambda name: body.frequencies(name, count=12),
    }
    run_cases(cases, "CalculiX reference results of the beam clamped at both ends")


if __name__ == "__main__":
    main()
