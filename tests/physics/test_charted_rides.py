"""The ride over the bump with every model of the axle's chart: the coupling settles, and the road is followed."""

import pytest
from demo.rear_axle.road.models import chart_models

from road import built, python

pytestmark = pytest.mark.long

STOP = 0.1
MODELS = dict(chart_models())
RIDES = """
import json, shutil, sys
from pathlib import Path
from benchmarks.axle_ride import ride
from demo.rear_axle.road.models import build_model, chart_models, parameters
from demo.rear_axle.road.scene import WHEEL
from flexfmu.files.outputs import Reporter

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
def cache(tmp_path_factory):
    """Folder of modes that one reduction keeps for the next."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def scene(cache, tmp_path_factory):
    """Folder of the wheel's FMU, and what the coil springs bear before."""
    folder = tmp_path_factory.mktemp("road")
    return folder, built(folder, cache)


def words(reduction):
    frames = "own" if reduction.frames == -1 else reduction.frames
    return f"{reduction.modes} modes, {frames} frames"


def test_the_chart_has_models_of_all_kinds():
    models = [model for group in MODELS.values() for model in group]
    assert len(models) == 75
    assert {model.internal_step_word for model in models} == {"single", "0.01", "0.0001", "exact"}


@pytest.mark.parametrize("place", range(len(MODELS)), ids=[words(reduction) for reduction in MODELS])
def test_the_ride_over_the_bump_settles_within_a_few_rounds_a_step(cache, scene, place):
    rides = python(RIDES, *scene, place, STOP, cache=cache)
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
