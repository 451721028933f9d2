"""Reference results of the shallow arch with CalculiX (decks and CSV files beside this file).

- ``static_y``: dead force downwards on the crown, 0 to 37.5 kN in ten equal steps: 90 % of the limit load.
- ``path_y``: the way through the limit points, led by the crown's displacement, 0 to 75 mm in steps of 1.5 mm.
  Limit load 41.63 kN at 22.7 mm, and 33.21 kN at 49.2 mm on the way back. Up to the first no eigenvalue of the
  loaded arch but that of the symmetric shape in the plane comes near zero.
- ``linear_y``: linear statics under 1 kN downwards.
- ``frequencies``: the lowest 12 eigenfrequencies.

Run from the repository's root, with ``ccx`` on the PATH, for all cases or those named:
``python -m demo.shallow_arch.calculix.run_calculix [case ...]``. Columns: see `demo.references`.
"""

from __future__ import annotations

from pathlib import Path

from demo.calculix_tools import Model
from demo.references import ReferenceBody, run_cases
from demo.shallow_arch import make_mesh
from demo.tip_face import TipFace

MESH_NOTE = "C3D20R 40 x 2 x 2 (1221 nodes)"


def main() -> None:
    """Write the model deck anew and run the cases."""
    make_mesh.main()
    mesh, sets = make_mesh.build()
    body = ReferenceBody(
        model=Model(
            file=make_mesh.MODEL_FILE,
            faces={"crown": TipFace.of(mesh, sets["CROWN"])},
            supports=("ROOT", "FAR"),
        ),
        folder=Path(__file__).parent,
        mesh_note=MESH_NOTE,
    )
    cases = {
        "static_y": lambda name: body.static(name, {"crown": (0.0, -37.5e3, 0.0)}, increments=10),
        "path_y": lambda name: body.path(name, "crown", axis=1, displacement=-0.075, increments=50),
        "linear_y": lambda name: body.linear(name, {"crown": (0.0, -1e3, 0.0)}),
        "frequencies": lambda name: body.frequencies(name, count=12),
    }
    run_cases(cases, "CalculiX reference results of the shallow arch")


if __name__ == "__main__":
    main()
