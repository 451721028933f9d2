"""Reference results of the portal frame and the ring with CalculiX (decks and CSV files beside this file).

- ``portal``: dead force along the beam at the left corner, 0 to 30 kN in ten equal steps.
- ``portal_across``: dead force out of the portal's plane at the same place, 0 to 8 kN.
- ``ring``: dead force downward and sideways at the highest point, 0 to 60 kN and 30 kN.

Run from the repository's root, with ``ccx`` on the PATH, for all cases or those named:
``python -m demo.loops.calculix.run_calculix [case ...]``. Columns: see `demo.references`.
"""

from __future__ import annotations

from pathlib import Path

from demo.calculix_tools import Model
from demo.loops import make_mesh
from demo.references import ReferenceBody, run_cases
from demo.tip_face import TipFace

FEET = ("FOOT_LEFT", "FOOT_RIGHT")
INTERFACES = {"portal": "corner", "ring": "top"}
FORCES = {
    "portal": ("portal", (30e3, 0.0, 0.0)),
    "portal_across": ("portal", (0.0, 8e3, 0.0)),
    "ring": ("ring", (30e3, 0.0, -60e3)),
}


def reference(name: str) -> ReferenceBody:
    """A body with its interface's face."""
    mesh, sets = make_mesh.BODIES[name]()
    interface = INTERFACES[name]
    faces = {interface: TipFace.of(mesh, sets[interface.upper()])}
    model = Model(file=make_mesh.HERE / f"{name}.inp", faces=faces, supports=FEET)
    note = f"C3D20R, 2 x 2 over the section ({len(mesh.points)} nodes)"
    return ReferenceBody(model=model, folder=Path(__file__).parent, mesh_note=note)


def main() -> None:
    """Write the model decks anew and run the cases."""
    make_mesh.main()
    cases = {
        case: lambda name, body=body, force=force: reference(body).static(
            name, {INTERFACES[body]: force}, increments=10
        )
        for case, (body, force) in FORCES.items()
    }
    run_cases(cases, "CalculiX reference results of bodies whose supports close a loop")


if __name__ == "__main__":
    main()
