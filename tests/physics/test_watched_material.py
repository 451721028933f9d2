"""Watches see the material: how far chosen elements turn within their frame, and how much frames are strained."""

from dataclasses import replace

import numpy as np
import pytest

import flexfmu
import meshes
from driven import Driven
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.mesh.elements import ElementType
from flexfmu.model.methods import Method
from flexfmu.reduction.watched import watched_material

RUBBER = meshes.Material("RUBBER", 2e6, 0.4, 1100.0)
LENGTH, STEP = 0.06, 1e-3


def parallelogram(frames):
    """Two leaves, 60 mm long and 1 mm thick, that guide a block at their far end."""
    leaves = [(x, y, 0) for x in range(24) for y in (0, 9)]
    block = [(x, y, 0) for x in range(24, 28) for y in range(10)]
    mesh = meshes.lattice(ElementType.C3D8I, leaves + block, lambda p: p * np.array([LENGTH / 24, 1e-3, 8e-3]))
    ends = {"root": mesh.points[:, 0] < 1e-9, "block": mesh.points[:, 0] > LENGTH - 1e-9}
    sets = {name: np.flatnonzero(held) for name, held in ends.items()}
    body = flexfmu.Body(mesh, supports=[sets["root"]], interfaces={"block": sets["block"]}, name="guide")
    return body.build(frames=frames).reduced


def bar(**options):
    mesh = meshes.box(ElementType.C3D8I, (12, 2, 2), (0.12, 0.02, 0.02), materials=(RUBBER,))
    body = flexfmu.Body(mesh, supports=["ROOT"], interfaces={"tip": "TIP"}, name="bar")
    return body.build(**options).reduced


@pytest.fixture(scope="module")
def guide():
    with pytest.warns(UserWarning, match=r"loop|cut"):
        return parallelogram(4)


@pytest.mark.slow
def test_leaves_of_a_guide_turn_though_neither_block_nor_clamps_do(guide):
    """Guided leaves have the slope 1.5 u/L halfway, and that of the mean, u/L, at no end."""
    one = FlexibleBody(guide, Method.LINEAR)
    state = one.static({"block": [0.0, 5.0, 0.0]})
    sideways = one.response(state).displacement[0][1]
    assert np.abs(one.response(state).rotation[0]).max() < 0.1 * sideways / LENGTH
    assert one.core.largest_rotation(state.q) == pytest.approx(1.5 * sideways / LENGTH, rel=0.05)


def test_elements_that_turn_most_are_among_those_watched():
    """Curl of known fields: bending, u = (-3 x²y, x³, 0), turns by 3x²; torsion, (0, -xz, xy), by x."""
    mesh = meshes.box(ElementType.C3D20, (10, 2, 2), (1.0, 0.1, 0.1))
    x, y, z = mesh.points.T
    none = np.zeros_like(x)
    fields = np.stack([np.stack([-3 * x**2 * y, x**3, none], 1), np.stack([none, -x * z, x * y], 1)], axis=2)
    shapes = fields.reshape(-1, 2)
    frame, rotation, strain = watched_material(mesh, shapes, np.ones(2), shapes, (), np.zeros((0, 3, 2)))
    assert set(frame) == {-1}
    largest = np.linalg.norm(rotation, axis=1).max(axis=0)
    # The mean over the last element, from 0.9 to 1 m.
    assert largest[0] == pytest.approx(10.0 * (1.0 - 0.9**3), rel=1e-9)
    # Torsion turns about y and z, too, by half of z and y.
    assert largest[1] == pytest.approx(np.hypot(0.95, 0.5 * np.hypot(0.075, 0.075)), rel=1e-9)
    # Mean squares of 6xy; and, of torsion, of (y² + z²)/2.
    square = (strain[0] ** 2).sum(axis=0)
    assert square[0] == pytest.approx(36.0 / 3.0 * 0.1**2 / 3.0, rel=1e-3)
    assert square[1] == pytest.approx(0.1**2 / 3.0, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("known", [False, True])
def test_strain_of_a_bar_that_is_pulled_is_told_at_its_limit(tmp_path, known):
    """ε = F/EA, with νε twice across: its norm is ε √(1 + 2ν²). A shadow knows what it makes of a deflection."""
    model = replace(bar(frames=3), **{} if known else {"shadow": None})
    driven = Driven(model, tmp_path, initialization="static", **{"tip.force.x": 12.0})
    norm = 12.0 / (2e6 * 4e-4) * np.sqrt(1.0 + 2.0 * 0.4**2)
    assert driven.get("diagnostics.strain") == [pytest.approx(norm, rel=0.03)]
    for force, limits, times in ((24.0, (0.0, 0.05), 0), (60.0, (0.05, 0.15), not known), (180.0, (0.15, 1.0), 1)):
        driven.set(**{"tip.force.x": force})
        assert driven.taken()
        assert limits[0] < driven.get("diagnostics.strain")[0] < limits[1]
        assert sum("strained by" in text for _, text in driven.log) == times


@pytest.mark.slow
def test_strain_of_a_bar_that_bends_is_that_of_its_fibres(tmp_path):
    """Over the third of a bar at its clamp (1 - x/L)² is 19/27 in the mean, and over its height (2z/h)² is 1/3."""
    driven = Driven(bar(frames=3), tmp_path, initialization="static", **{"tip.force.y": 0.3})
    fibre = 6.0 * 0.3 * 0.12 / (2e6 * 0.02**3)
    norm = fibre * np.sqrt(19.0 / 27.0 / 3.0 * (1.0 + 2.0 * 0.4**2))
    assert driven.get("diagnostics.strain") == [pytest.approx(norm, rel=0.05)]


@pytest.mark.slow
@pytest.mark.parametrize("load", [{"tip.force.y": 1.2}, {"tip.moment.x": 0.02, "tip.force.z": 0.5}])
def test_a_turn_is_told_in_the_step_that_takes_it_beyond_the_limit(tmp_path, load):
    """Steps far below the limit are not looked at in full: none is missed."""
    driven = Driven(bar(frames=2), tmp_path, **{"watch.rotation.limit": 0.1}, **load)
    turned, told = [], []
    for _ in range(60):
        assert driven.taken(2e-3)
        turned += driven.get("diagnostics.rotation_within_frame")
        told.append(any("material turns by" in text for _, text in driven.log))
    beyond = np.maximum.accumulate(turned) > 0.1
    assert beyond.any()
    assert not beyond[0]
    assert told == beyond.tolist()
