"""The ride over the bump with every model of the axle's chart: the coupling settles, and the road is followed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from demo.rear_axle.road.models import chart_models

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
MARK = "RESULT "
STOP = 0.1
MODELS = dict(chart_models())
# FMUs end up in the process that runs them.
BEGIN = """
import sys
from pathlib import Path
from demo.rear_axle.road.scene import Ride, build_axle, build_wheel, coil_preload
from flexfmu.progress import Reporter

folder = Path(sys.argv[1])
body = build_axle(folder, Reporter())
build_wheel(folder)
print("RESULT", coil_preload(body, Ride()))
"""
RIDES = """
import json, shutil, sys
from pathlib import Path
from benchmarks.axle_ride import ride
from demo.rear_axle.road.models import build_model, chart_models, parameters
from demo.rear_axle.road.scene import WHEEL
from flexfmu.progress import Reporter

folder, preload, place, stop = Path(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
reduction, models = chart_models()[place]
here = folder / str(place)
build_model(reduction, models, here, Reporter())
shutil.copy(folder / WHEEL, here / WHEEL)
found = [
    [model.variant.method.value, model.internal_step_word, ride(here, preload, parameters(model), stop=stop)]
    for model in models
]
print("RESULT", json.dumps(found))
"""


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """Run code; modes that it finds are kept from one to the next."""
    cache = tmp_path_factory.mktemp("cache")

    def run(code, *arguments):
        command = [sys.executable, "-c", code, *map(str, arguments)]
        environment = {**os.environ, "FLEXFMU_CACHE": str(cache)}
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=600, check=False, cwd=ROOT, env=environment
        )
        lines = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
        assert lines, done.stderr
        return json.loads(lines[-1].removeprefix(MARK))

    return run


@pytest.fixture(scope="module")
def scene(python, tmp_path_factory):
    """Folder of the wheel's FMU, and what the coil springs bear before."""
    folder = tmp_path_factory.mktemp("road")
    return folder, python(BEGIN, folder)


def words(reduction):
    frames = "own" if reduction.frames == -1 else reduction.frames
    return f"{reduction.modes} modes, {frames} frames"


def test_the_chart_has_models_of_all_kinds():
    models = [model for group in MODELS.values() for model in group]
    assert len(models) == 75
    assert {model.internal_step_word for model in models} == {"single", "0.01", "0.0001", "exact"}


@pytest.mark.parametrize("place", range(len(MODELS)), ids=[words(reduction) for reduction in MODELS])
def test_the_ride_over_the_bump_settles_within_a_few_rounds_a_step(python, scene, place):
    rides = python(RIDES, *scene, place, STOP)
    assert len(rides) == len(list(MODELS.values())[place])
    for method, internal_step, found in rides:
        case = f"{method}, {internal_step}: {found}"
        assert found["note"] == "", case
        assert found["steps"] == round(STOP / 1e-3), case
        assert found["rounds"] < 5.0, case
        assert found["most_rounds"] <= 8, case
        # The road prescribes the travel: 80 mm and what the wheel leaves it by.
        assert 0.08 < found["travel"] < 0.1, case
        assert 0.2 < found["toe"] < 1.0, case
