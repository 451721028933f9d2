"""What a step costs, as `flexfmu info --cost` tells it."""

import pytest

from flexfmu.files.outputs import Reporter
from flexfmu.model.methods import Method, Variant, needs
from flexfmu.study.cost import step_costs
from references import BEAM


@pytest.mark.slow
def test_every_method_whose_data_the_body_holds_is_timed(bodies):
    costs = step_costs(bodies.beam().model, Reporter())
    assert set(costs) == {Variant(method) for method in Method if not needs(method)}
    assert all(0.0 < cost.fastest <= cost.median for cost in costs.values())
    # Linear methods have nothing to iterate; those whose loads move with the body do.
    assert costs[Variant(Method.LINEAR)].iterations == 0
    assert costs[Variant(Method.FRAMES)].iterations > 1


@pytest.mark.slow
def test_geometric_stiffness_that_the_body_holds_is_timed_too(bodies):
    table = bodies.config(BEAM).reduction.model_copy(update={"geometric_stiffness": ["by_load"]})
    found = {variant.method for variant in step_costs(bodies.beam(reduction=table).model, Reporter())}
    assert {Method.STIFFNESS_BY_LOAD, Method.FRAMES_STIFFNESS} <= found
    assert Method.STIFFNESS_BY_MODE not in found
