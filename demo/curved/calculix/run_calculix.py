"""Reference results of the curved bars with CalculiX (decks and CSV files beside this file).

Dead tip forces grow from zero in ten equal increments. ``arc_90_shaken``: undamped transient of the quarter arc near
its first frequency (24.4 Hz) from rest, 0.15 s. Run from the repository's root, with ``ccx`` on the PATH, for all bars
or those named: ``python -m demo.curved.calculix.run_calculix [case ...]``. Columns: see `demo.references`.
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
# Of the quarter arc near its first frequency; the sine is drawn by straight lines.
SHAKEN_FORCE, SHAKEN_HERTZ, SHAKEN_DRAWN = (0.0, 300.0, 600.0), 22.0, 5e-4
SHAKEN_STEP = 6.25e-5  # s


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
    cases["arc_90_shaken"] = lambda name: reference_body("arc_90").shaken(
        name,
        {"tip": SHAKEN_FORCE},
        hertz=SHAKEN_HERTZ,
        step=SHAKEN_STEP,
        duration=0.15,
        keep_every=round(SHAKEN_DRAWN / SHAKEN_STEP),
        drawn=SHAKEN_DRAWN,
    )
    run_cases(cases, "CalculiX reference results of the curved bars")


if __name__ == "__main__":
    main()
