"""What a step costs, as `flexfmu info --cost` tells it."""

from flexfmu.cost import step_costs
from flexfmu.model.reduced_body import Formulation, Kinematics, LoadPlacement, Stiffness
from flexfmu.progress import Reporter
from references import BEAM


def test_every_formulation_whose_data_is_aboard_is_timed(bodies):
    costs = {cost.formulation: cost for cost in step_costs(bodies.beam().model, Reporter())}
    aboard = [kinematics for kinematics in Kinematics if kinematics is not Kinematics.SECOND_ORDER]
    assert set(costs) == {Formulation(k, p) for k in aboard for p in LoadPlacement}
    assert all(0.0 < cost.fastest <= cost.median for cost in costs.values())
    # Linear formulations have nothing to iterate; those whose loads move with the body do.
    assert costs[Formulation(Kinematics.LINEAR, LoadPlacement.REFERENCE)].iterations == 0
    assert costs[Formulation()].iterations > 1


def test_geometric_stiffness_aboard_is_timed_too(bodies):
    table = bodies.config(BEAM).reduction.model_copy(update={"geometric_stiffness": ["by_load"]})
    costs = step_costs(bodies.beam(reduction=table).model, Reporter())
    assert Stiffness.BY_LOAD in {cost.formulation.stiffness for cost in costs}
    assert Stiffness.BY_MODE not in {cost.formulation.stiffness for cost in costs}
