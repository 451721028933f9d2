"""The plainest model of a body within a tolerance, at a scene's loads or reference loads: `flexfmu build --tolerance`.

Linear kinematics are tried first, then more and more frames; modes are those of the body file.
"""

from collections.abc import Iterator
from pathlib import Path

from ..body.flexible_body import FlexibleBody
from ..body.reference_loads import reference_loads
from ..build.config import BodyFile, read_body_file
from ..build.tables import FormulationTable
from ..files.basics import BodyFileError, plural
from ..files.outputs import Reporter
from ..files.store import Store
from ..model.variants import chosen
from .candidates import times
from .scene.config import AcceptedTable, SceneError, SceneFile, StaticTable, ToleranceTable, read_scene_file
from .scene.scene import AXES, made_scene
from .workshop import Workshop, build

_FRAMES = (0, 1, 2, None, 8, 16)
"""Numbers of frames in the order of the search; None: the build decides, of cuts too."""


def smallest(
    body: Path, tolerance: float, scene_file: Path | None, report: Reporter, store: Store
) -> tuple[BodyFile, float]:
    """Find the plainest model within a tolerance of displacement; twice as much is allowed of rotation.

    Parameters
    ----------
    body : Path
    tolerance : float
        Relative error.
    scene_file : Path or None
        Of the loads; default: reference loads.
    report : Reporter
    store : Store

    Returns
    -------
    config : BodyFile
        Of the first that is within it, else of the best.
    share : float
        Its error over the tolerance.
    """
    given = read_body_file(body)
    file = reference_scene(given, store) if scene_file is None else read_scene_file(scene_file)
    accepted = AcceptedTable(displacement=tolerance, rotation=min(2.0 * tolerance, 0.99))
    file = file.model_copy(update={"tolerance": ToleranceTable(static=accepted, transient=accepted)})
    workshop = Workshop(made_scene(file, scene_file or body, body), report, store, solve=False)
    # References are told of before the search.
    _ = workshop.known
    found: list[tuple[BodyFile, float]] = []
    for config in _growing(given):
        try:
            reduced = build(config.without_pictures, store).body
        except BodyFileError:
            continue
        share = workshop.errors(reduced, chosen(reduced)).share
        found.append((config, share))
        report.note(f"{chosen(reduced).words}, {plural(reduced.frame_count, 'frame')}: {times(share)} of the tolerance")
        if share <= 1.0:
            break
    config, share = min(found, key=lambda one: one[1])
    return config.accepting(workshop.accepted(build(config.certified, store).body, share <= 1.0)), share


def _growing(given: BodyFile) -> Iterator[BodyFile]:
    """The body with linear kinematics where that goes, then with more and more frames."""
    for frames in _FRAMES:
        if frames == 0 and given.cut:
            continue
        method = FormulationTable(mass=given.formulation.mass) if frames != 0 else FormulationTable()
        yield given.model_copy(update={"frames": frames, "frame": [], "branch": [], "formulation": method})


def reference_scene(given: BodyFile, store: Store) -> SceneFile:
    """Forces on each interface across the directions in which it is stiff, as far as the body bears them.

    Parameters
    ----------
    given : BodyFile
    store : Store

    Returns
    -------
    SceneFile

    Raises
    ------
    SceneError
        Nothing holds the body.
    """
    body = build(given.without_pictures, store).body
    if body.rigid_count or body.properties is None:
        raise SceneError("a body that is free to move has no equilibrium: give loads over time by --scene")
    cases = [
        StaticTable(name=name, loads=dict(zip((f"{of}.force.{axis}" for axis in AXES), force.tolist(), strict=True)))
        for name, of, force, _ in reference_loads(FlexibleBody(body), back=False)
    ]
    return SceneFile(static=cases)
