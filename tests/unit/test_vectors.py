"""Loops in wide vectors of the processor find the same bits as in those that every processor has."""

import ctypes
import platform

import numpy as np
import pytest

from bodies import random_body, with_second_order
from flexfmu.body.flexible_body import FlexibleBody, StepLimits
from flexfmu.core import building, library
from flexfmu.model.methods import Method

pytestmark = pytest.mark.slow


def built_with(flags, folder):
    """The core compiled with more flags, loaded."""
    compiler = building.system_compiler()
    if compiler is None:
        pytest.skip("no C compiler")
    path = folder / library.library_path().name
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(building, "FLAGS", (*building.FLAGS, *flags))
        building.compile_core(path, compiler)
        patch.undo()
        patch.setattr(library, "library_path", lambda: path)
        return library.library.__wrapped__()


@pytest.fixture(scope="module")
def narrow(tmp_path_factory):
    """The core without wide vectors; compiled with less care, which changes no bit either."""
    return built_with(["-DFLEX_NARROW", "-O0"], tmp_path_factory.mktemp("narrow"))


def swing(body):
    """All that thirty steps under moving loads find, as bytes."""
    model = FlexibleBody(body, Method.SECOND_ORDER, limits=StepLimits(tolerance=1.0))
    state, found = model.rest(), []
    for number in range(30):
        force = [30.0 * np.sin(0.2 * number), 20.0, -10.0 * np.cos(0.1 * number), 1.0, -2.0, 3.0]
        state = model.step(state, {"port_0": force, "port_2": force[:3]}, 1e-3)
        found += [state.q, state.v, model.motion(state)]
    assert np.abs(state.q).max() > 1e-3
    return np.concatenate(found).tobytes()


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="one kind of vectors only")
@pytest.mark.parametrize("modes", [1, 5, 6, 8, 20])
def test_the_processors_vectors_change_no_bit_of_a_motion(narrow, monkeypatch, modes):
    body = with_second_order(random_body(modes=modes), 0.1)
    expected = swing(body)
    monkeypatch.setattr(library, "library", lambda: narrow)
    assert swing(body) == expected


@pytest.mark.long
def test_curvature_costs_operations_with_the_square_of_the_modes(monkeypatch, tmp_path):
    counting = built_with(["-DFLEX_COUNT"], tmp_path)
    counter = ctypes.c_int64.in_dll(counting, "flex_operations")
    monkeypatch.setattr(library, "library", lambda: counting)

    def cost(modes, method):
        body = with_second_order(random_body(modes=modes), 1e-3)
        model = FlexibleBody(body, method, limits=StepLimits(tolerance=1.0))
        inputs = model.loads({"port_0": [1e-6, 2e-6, 3e-6]}).packed(False)
        before = counter.value
        _, work = model.step_packed(model.rest(), inputs, 1e-3)
        assert work.iterations == 2
        return counter.value - before

    few, many = (cost(modes, Method.SECOND_ORDER) - cost(modes, Method.FRAMES) for modes in (20, 80))
    # Four products of some 20 rows of curvature with the modes, two operations a number.
    assert 4 * 20 * 2 * 20**2 < few < 4 * 48 * 2 * 20**2
    assert many / few == pytest.approx(16.0, rel=0.15)
