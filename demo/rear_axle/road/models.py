"""Every model of the axle's chart (../scene.toml) as the road's cut axle: which ones there are, and their FMUs."""

from __future__ import annotations

from pathlib import Path

from demo.rear_axle.road.scene import AXLE_CUT, HERE

from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.files.store import Store, default_folder
from flexfmu.fmu.package import package_fmu
from flexfmu.model.reduced_body import ReducedBody
from flexfmu.study.candidates import Candidate, Reduction, candidates, reduction_config
from flexfmu.study.scene.scene import read_scene

CHARTED = HERE.parent / "body.toml"


def chart_models() -> list[tuple[Reduction, list[Candidate]]]:
    """The models of the chart, by the reduction that serves them."""
    found = candidates(read_scene(HERE.parent / "scene.toml", CHARTED))
    return [(one, [c for c in found if c.reduction == one]) for one in dict.fromkeys(c.reduction for c in found)]


def build_model(reduction: Reduction, models: list[Candidate], folder: Path, report: Reporter) -> ReducedBody:
    """Build the FMU of the road's cut axle with the modes and the frames of models of the chart."""
    road = read_body_file(HERE / "body_cut.toml")
    # The frames that the chart calls the body's own are those of the charted body file.
    road = road.model_copy(update={"frame": read_body_file(CHARTED).frame})
    config = reduction_config(road, reduction, [model.variant for model in models])
    body = reduce_body(config, report, Store(default_folder()))
    folder.mkdir(parents=True, exist_ok=True)
    package_fmu(body, folder / AXLE_CUT)
    return body


def parameters(model: Candidate) -> dict[str, float | str]:
    """Parameters of the FMU that make it a model of the chart."""
    return {
        "method": model.variant.method.value,
        "internal_step.tolerance": model.limits.tolerance,
    }
