"""Reference results of the plate with CalculiX (decks and CSV files beside this file).

- ``static_bend``: dead forces up on both corners, 0 to 440 N each in eight equal steps.
- ``static_twist``: dead forces up on the left and down on the right corner, 0 to 1 kN each in eight equal steps.
- ``linear_bend``, ``linear_twist``: linear statics, 100 N on each corner.
- ``frequencies``: the lowest 12 eigenfrequencies.

One layer of elements is right here, as the plate is many elements wide: no zero-energy modes. Two layers, with
``make_mesh.build(layers=2)``, give 0.40 % more displacement in ``static_bend``, 0.14 % more in ``static_twist``
(linear: 0.44 % and 0.22 %) and frequencies lower by 0.07 to 0.32 %.

Run from the repository's root, with ``ccx`` on the PATH, for all cases or those named:
``python -m demo.plate.calculix.run_calculix [case ...]``. Columns: see `demo.references`.
"""

from __future__ import annotations

from pathlib import Path

from demo.calculix_tools import Model
from demo.plate import make_mesh
from demo.references import Forces, ReferenceBody, run_cases
from demo.tip_face import TipFace

MESH_NOTE = "C3D20R 24 x 16 x 1 (2891 nodes)"


def on_corners(left: float, right: float) -> Forces:
    """Forces (N) along z on the two corners."""
    return {"corner_left": (0.0, 0.0, left), "corner_right": (0.0, 0.0, right)}


def main() -> None:
    """Write the model deck anew and run the cases."""
    make_mesh.main()
    mesh, sets = make_mesh.build()
    body = ReferenceBody(
        model=Model(
            file=make_mesh.MODEL_FILE,
            faces={name: TipFace.of(mesh, sets[name.upper()]) for name in ("corner_left", "corner_right")},
        ),
        folder=Path(__file__).parent,
        mesh_note=MESH_NOTE,
    )
    cases = {
        "static_bend": lambda name: body.static(name, on_corners(440.0, 440.0), increments=8),
        "static_twist": lambda name: body.static(name, on_corners(1e3, -1e3), increments=8),
        "linear_bend": lambda name: body.linear(name, on_corners(100.0, 100.0)),
        "linear_twist": lambda name: body.linear(name, on_corners(100.0, -100.0)),
        "frequencies": lambda name: body.frequencies(name, count=12),
    }
    run_cases(cases, "CalculiX reference results of the plate")


if __name__ == "__main__":
    main()
