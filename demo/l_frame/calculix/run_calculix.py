"""Reference results of the L-frame with CalculiX (decks and CSV files beside this file).

- ``static_z``: dead tip force out of the plane, 0 to 2 kN in steps of 200 N; linear statics are then 9 % off.
- ``static_x``: dead tip force in the plane, across leg 2, 0 to 3 kN in steps of 300 N; linear statics: 11 %.
- ``linear_z``, ``linear_x``: linear statics under 1 kN in each of these directions.
- ``frequencies``: the lowest 12 eigenfrequencies.
- ``sudden_load``: undamped transient under a sudden dead tip force of 1.7 kN out of the plane, from rest, 0.1 s.

Run from the repository's root, with ``ccx`` on the PATH, for all cases or those named:
``python -m demo.l_frame.calculix.run_calculix [case ...]``. Columns: see `demo.references`.
"""

from __future__ import annotations

from pathlib import Path

from demo.calculix_tools import Model
from demo.l_frame import make_mesh
from demo.references import ReferenceBody, run_cases
from demo.tip_face import TipFace

MESH_NOTE = "C3D20R, 2 x 2 over the section, 28 and 16 along the legs, corner 2 x 2 x 2 (1401 nodes)"

SUDDEN_STEP = 5e-5  # s


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
        "static_z": lambda name: body.static(name, {"tip": (0.0, 0.0, 2e3)}, increments=10),
        "linear_z": lambda name: body.linear(name, {"tip": (0.0, 0.0, 1e3)}),
        "static_x": lambda name: body.static(name, {"tip": (3e3, 0.0, 0.0)}, increments=10),
        "linear_x": lambda name: body.linear(name, {"tip": (1e3, 0.0, 0.0)}),
        "frequencies": lambda name: body.frequencies(name, count=12),
        "sudden_load": lambda name: body.sudden_load(
            name, {"tip": (0.0, 0.0, 1.7e3)}, step=SUDDEN_STEP, duration=0.1, keep_every=round(5e-4 / SUDDEN_STEP)
        ),
    }
    run_cases(cases, "CalculiX reference results of the L-frame")


if __name__ == "__main__":
    main()
