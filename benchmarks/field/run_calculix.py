"""Results of CalculiX for the bodies of published static problems; decks and results are kept in ``calculix/``.

Run from the repository's root, with ``ccx`` on the PATH, for all cases or those named:
``python -m benchmarks.field.run_calculix [case ...]``. Columns: see `demo.references`.
"""

from __future__ import annotations

from demo.calculix_tools import Model
from demo.references import ReferenceBody, run_cases
from demo.tip_face import TipFace

from benchmarks.field import bodies
from benchmarks.field.bodies import FOLDER, POUND, Body

# Load of the Princeton beam, N, at 45 degrees.
PRINCETON = 13.345 * 0.5**0.5


def calculix(body: Body) -> ReferenceBody:
    """A body as CalculiX sees it; writes its model deck."""
    face = TipFace.of(body.mesh, body.mesh.nodes_where(body.sets[body.interface]))
    model = Model(body.write(), {body.interface.lower(): face}, body.supports)
    (FOLDER / "calculix").mkdir(exist_ok=True)
    return ReferenceBody(model, FOLDER / "calculix", body.title)


def main() -> None:
    """Write the model decks anew and run the cases."""
    known = {make.__name__: calculix(make()) for make in bodies.BODIES}
    run_cases(
        {
            "bend": lambda name: known["bend"].static(name, {"tip": (0.0, 0.0, 600.0 * POUND)}, 12),
            "strip": lambda name: known["strip"].static(name, {"tip": (0.0, 10.0 * bodies.STRIP, 0.0)}, 20),
            "princeton": lambda name: known["princeton"].static(name, {"tip": (0.0, PRINCETON, PRINCETON)}, 6),
            "right_angle_pull": lambda name: known["right_angle"].buckling(name, "tip", 0, 1.0, 2),
            "right_angle_push": lambda name: known["right_angle"].buckling(name, "tip", 0, -1.0, 2),
            "lee": lambda name: known["lee"].path(name, "load", 1, -0.6, 40),
            "hinged_arch": lambda name: known["hinged_arch"].path(name, "crown", 1, -0.036, 36),
            "hinged_roof": lambda name: known["hinged_roof"].path(name, "crown", 2, -0.024, 24),
        },
        "CalculiX results of published static problems",
    )


if __name__ == "__main__":
    main()
