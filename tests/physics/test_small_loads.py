"""Loads too small to do anything: what is watched for says nothing of them, whatever the body's symmetry."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.model import Material
from flexfmu.study.stability import BodyPrograms, DrivenSlave
from meshes import bars, body_file, box, with_sets

WIDTH = 2e-3
RUBBER = Material("RUBBER", 1e7, 0.45, 1100.0)
DISCARD = {"watch.stability.on_limit": "discard", "watch.rotation.on_limit": "discard"}


@pytest.fixture(scope="module")
def cross(tmp_path_factory):
    """Four arms on a stem; modes in which arms move against each other leave the tip of the stem where it is."""
    runs = [((0, 0, 0), (7, 0, 0)), ((7, -5, 0), (7, 5, 0)), ((7, 0, -5), (7, 0, 5))]
    mesh = replace(bars(ElementType.C3D20, runs, WIDTH), materials=(RUBBER,))

    def end(points):
        aside = np.abs(points[:, 1:] - 0.5 * WIDTH).max(axis=1)
        return np.hypot(points[:, 0] - 8.0 * WIDTH, np.maximum(aside - 0.5001 * WIDTH, 0.0))

    mesh = with_sets(mesh, ROOT=lambda points: points[:, 0], TIP=end)
    tables = {"frames": 1, "reduction": {"modes": 12}, "formulation": {"method": "second_order"}}
    folder = tmp_path_factory.mktemp("cross")
    return reduce_body(body_file(mesh, folder, interface=["TIP"], **tables), Reporter())


def test_the_cross_has_modes_that_its_interface_does_not_see(cross):
    size = np.abs(cross.interface_displacement).max(axis=(0, 1))
    assert np.sum(size < 1e-9 * size.max()) >= 2


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_millinewton_is_no_critical_load_of_a_symmetric_body(cross, axis):
    inputs = np.zeros(6)
    inputs[axis] = 1e-3
    with BodyPrograms(cross) as aboard:
        told = DrivenSlave(aboard, DISCARD, inputs)
        assert told._slave.do_step(0.0, 1e-3)
        assert told.words == ""
        assert not told.warned
        assert told.real("diagnostics.stability") > 0.99


@pytest.fixture(scope="module")
def held_twice(tmp_path_factory):
    """A beam clamped at both ends, its interface in the middle: where the centre of its supports is."""
    mesh = with_sets(box(ElementType.C3D20, (8, 1, 1), (1.0, 0.06, 0.02)), MIDDLE=lambda points: points[:, 0] - 0.5)
    tables = {"frames": 1, "reduction": {"modes": 12}, "formulation": {"method": "second_order"}}
    ends = [{"nodes": name, "fix": ["x", "y", "z"]} for name in ("ROOT", "TIP")]
    folder = tmp_path_factory.mktemp("held")
    config = body_file(mesh, folder, interface=["MIDDLE"], **tables)
    return reduce_body(type(config).model_validate(config.model_dump() | {"support": ends}), Reporter())


@pytest.mark.parametrize("share", [0.5, 0.9, 1.1])
@pytest.mark.parametrize("name", ["cross", "held_twice"])
def test_the_quick_look_at_stability_agrees_with_the_tangent_itself(request, name, share):
    """Pressed to a share of the load at which the tangent is down to a tenth."""
    body = FlexibleBody(request.getfixturevalue(name))
    state, unit = body.rest(), np.array([-1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    load = brentq(
        lambda load: body.stability(state, load * unit)[0] - 0.1, 0.0, 1.0 / (1.0 - body.stability(state, unit)[0])
    )
    assert body.is_stable(state, share * load * unit, 0.1) == (share < 1.0)
