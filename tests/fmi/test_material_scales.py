"""An FMU whose material is scaled by parameters is the FMU of a body that is built of that material."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bodies import random_body
from driven import Driven
from flexfmu import Body, Interface, Support
from flexfmu.body.replay import body_with, replay
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.elements import ElementType
from flexfmu.model.reduced_body import Properties
from flexfmu.program.variable_table import variable_table
from meshes import bars, box, with_sets

# Powers of two, which leave no round-off; what is scaled runs four times as fast.
STIFFER, DENSER = 4.0, 0.25
SCALES = {"stiffness.scale": STIFFER, "density.scale": DENSER}


def strip(**more):
    """A clamped strip, default model: second order, membrane energy, mass polynomial, weight, stress, compliance."""
    mesh = box(ElementType.C3D20, (8, 2, 1), (0.4, 0.02, 0.01))
    mesh = replace(mesh, element_sets={"ALL": np.arange(mesh.element_count)})
    return {"mesh": mesh, "supports": ["ROOT"], "interfaces": {"tip": Interface("TIP", compliance=True)}, **more}


def slab():
    """Nothing holds it."""
    return strip(supports=[], free=True)


def portal():
    """Cut in two parts, joined by springs."""
    mesh = bars(ElementType.C3D20, [((0, 0, 0), (0, 0, 5)), ((1, 0, 5), (6, 0, 5)), ((6, 0, 0), (6, 0, 4))], 0.02)
    mesh = with_sets(mesh, ROOT=lambda p: p[:, 2])
    mesh = replace(mesh, element_sets={"ALL": np.arange(mesh.element_count)})
    tip = np.flatnonzero((mesh.points[:, 2] > 0.119) & (mesh.points[:, 0] < 0.021))
    return strip(mesh=mesh, interfaces={"tip": Interface(tip, compliance=True)}, cuts="auto")


@cache
def built(make, stiffer=1.0, denser=1.0):
    arguments = make()
    mesh = arguments["mesh"]
    steel = [replace(m, youngs_modulus=stiffer * m.youngs_modulus, density=denser * m.density) for m in mesh.materials]
    body = Body(**{**arguments, "mesh": replace(mesh, materials=tuple(steel))}, damping=0.02, stress={"all": "ALL"})
    return body.build(acceleration=True, velocities=True).reduced


def motion(model, folder, loads, **start):
    """Every number that the FMU shows after each step, and its log."""
    one = Driven(model, folder, **{"watch.error.limit": 1e-5, "watch.rotation.limit": 1e-6}, **start)
    shown = [v.name for v in variable_table(model) if v.type == "Real" and v.causality in ("output", "local")]
    # Before a step a compliance is of the step that the model suggests, a round number.
    rows = []
    for k in range(12):
        one.set(**{name: load * min(k / 6.0, 1.0) for name, load in loads.items()})
        assert one.taken(2e-4), one.log
        rows.append(one.get(*shown))
    return shown, np.array(rows), [text for _, text in one.log], one


@pytest.mark.slow
@pytest.mark.parametrize("make", [strip, slab, portal])
@pytest.mark.parametrize("start", ["rest", "static"])
def test_scales_of_the_material_are_as_if_the_body_were_built_of_it(make, start, tmp_path):
    """Motion, rates, stress, compliance, energies, its error and every other number, and what it warns of."""
    if make is slab and start == "static":
        pytest.skip("it has no equilibrium")
    # The portal is stiff: under less its error is round-off.
    loads = {"tip.force.y": 3e4 if make is portal else 300.0, "tip.moment.x": -3.0, "body.acceleration.z": 9.81}
    before = {"initialization": start, "internal_step.limit": 1e-4}
    if start == "static":
        before |= {"tip.force.x": 50.0, "body.acceleration.z": -200.0}
    names, rows, log, one = motion(built(make), tmp_path, loads, **before, **SCALES)
    _, expected, words, other = motion(built(make, STIFFER, DENSER), tmp_path, loads, **before)
    size = np.abs(expected).max(axis=0)
    units = {variable.name: variable.unit for variable in variable_table(one.model)}
    kinds = [units[name] if "compliance" in name else re.sub(r"\.[xyz]$", "", name) for name in names]
    size = np.array([max(size[j] for j, other in enumerate(kinds) if other == kind) for kind in kinds])
    # Softness of 1e-11 is round-off.
    size = np.where([name.endswith("softness_missed") for name in names], np.maximum(size, 1e-9), size)
    off = np.abs(rows - expected) / np.where(size > 0.0, size, 1.0)
    # Errors are small differences; joints of a cut body are a billion times as stiff as the body.
    small = (".error", "_error", "momentum", "inertia_missed", "softness_missed")
    tight = np.array([not any(part in name for part in small) for name in names])
    # What the mass leaves out is found at build by differences.
    assert off[:, [name.endswith("inertia_missed") for name in names]].max(initial=0.0) < 1e-6
    limit = 1e-5 if make is portal else 1e-8
    assert off[:, tight].max() < limit, {names[j]: off[:, j].max() for j in np.flatnonzero(off.max(axis=0) > limit)}
    assert off.max() < 1e-2
    assert log == words
    assert len(log) >= 1
    if make is strip:
        inputs = [list(loads)] * 2
        slopes = [
            run.derivative(["tip.displacement.y", "tip.rotation.x"], given, [1.0, 2.0, 3.0])[1]
            for run, given in zip((one, other), inputs, strict=True)
        ]
        np.testing.assert_allclose(*slopes, rtol=1e-8)


@pytest.mark.slow
def test_scales_change_what_they_should(tmp_path):
    """The linear deflection goes with 1 over the stiffness, the first frequency with its root."""
    model = built(strip)
    given = {"initialization": "static", "method": "linear", "tip.force.y": 1.0}
    plain, stiff = (
        Driven(model, tmp_path, **given, **more).motion("tip")[1] for more in ({}, {"stiffness.scale": 2.0})
    )
    assert stiff == pytest.approx(0.5 * plain, rel=1e-12)


@pytest.mark.slow
def test_a_picture_of_a_run_knows_the_scales(tmp_path):
    model = built(strip)
    loads = np.zeros((2, 10))
    loads[:, 0], loads[:, 2], loads[:, 9] = (0.0, 2e-3), 300.0, 9.81
    parameters = {name: str(value) for name, value in SCALES.items()}
    body = body_with(model, parameters)
    _, states = replay(body, loads, np.linspace(0.0, 2e-3, 11), parameters, Reporter())
    one = Driven(model, tmp_path, **SCALES)
    one.set(**{"tip.force.y": 300.0, "body.acceleration.z": 9.81})
    for _ in range(10):
        assert one.taken(2e-4)
    np.testing.assert_allclose(body.core.motion(states[-1]), one.motion("tip"), rtol=1e-9, atol=1e-15)


@pytest.mark.slow
def test_a_body_with_springs_or_masses_of_their_own_offers_no_such_scale():
    free = {variable.name for variable in variable_table(built(strip))}
    assert set(SCALES) <= free
    sprung = built(lambda: strip(supports=[Support("ROOT", stiffness=[1e6, 1e6, 1e6])]))
    names = {variable.name for variable in variable_table(sprung)}
    assert "stiffness.scale" not in names
    assert "density.scale" in names
    laden = replace(random_body(), properties=_with_mass())
    names = {variable.name for variable in variable_table(laden)}
    assert "stiffness.scale" in names
    assert "density.scale" not in names


def _with_mass():
    one = np.ones(1)
    return Properties(np.array([[0.0] * 3, [1.0] * 3]), ("STEEL",), one, one, 0.3 * one, one, point_mass=one)
