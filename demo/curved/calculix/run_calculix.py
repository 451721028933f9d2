"""Reference results of the curved bars with CalculiX (decks and CSV files beside this file).

Dead tip forces grow from zero in ten equal increments. Run from the repository's root, with ``ccx`` on the PATH, for
all bars or those named: ``python -m demo.curved.calculix.run_calculix [case ...]``. Columns: see `demo.references`.
"""

from __future__ import annotations

from pathlib import Path

from demo.calculix_tools import Model
from demo.curved import make_mesh
from demo.references import ReferenceBody, run_cases
from demo.tip_face import TipFace

# Tip force at the end, N: across the plane of the flat bars, and in it.
FORCES = {
    "arc_20": (0.0, 0.0, 10e3),
    "arc_45": (0.0, 0.0, 25e3),
    "arc_90": (0.0, 8e3, 11e3),
    "s_curve": (0.0, 0.0, 10e3),
    "helix": (0.0, 0.0, 16e3),
    "s_curve_tetrahedra": (0.0, 0.0, 10e3),
}
INCREMENTS = 10


def reference_body(name: str) -> ReferenceBody:
    """A bar as CalculiX sees it."""
    mesh, sets = make_mesh.build(name)
    kind = "C3D10" if name.endswith("tetrahedra") else "C3D20R, 30 x 2 x 2"
    return ReferenceBody(
        model=Model(file=make_mesh.HERE / f"{name}.inp", faces={"tip": TipFace.of(mesh, sets["TIP"])}),
        folder=Path(__file__).parent,
        mesh_note=f"{kind}, {len(mesh.points)} nodes",
    )


def main() -> None:
    """Write the model decks anew and run the cases."""
    make_mesh.main()
    cases = {
        name: lambda name, force=force: reference_body(name).static(name, {"tip": force}, INCREMENTS)
        for name, force in FORCES.items()
    }
    run_cases(cases, "CalculiX reference results of the curved bars")


if __name__ == "__main__":
    main()
