"""The error that the core tells, against an independent account of the body and of its shadow."""

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given, settings, strategies as st

from bodies import body_of_everything, random_ties
from flexfmu.body.flexible_body import FlexibleBody, State
from flexfmu.core.library import Core
from flexfmu.model.methods import Method
from flexfmu.model.reduced_body import Shadow
from flexfmu.model.variants import missing
from flexfmu.program.compile import compile_draft, shadow_draft
from reference import Reference
from reference.mechanics import slopes

BODIES = {"held": ({"modes": 4, "frames": 2}, {"modes": 6}), "free": ({"modes": 9, "free": True}, {"modes": 11})}


def with_shadow(kind, seed):
    """A random body, and another one as its shadow, in which elastic modes are any orthonormal combinations."""
    own, finer = BODIES[kind]
    rng = np.random.default_rng(seed)
    body = body_of_everything(seed, **own)
    shadow = body_of_everything(seed + 1, **(own | finer | {"frames": 4}))
    rigid = body.rigid_count
    embedding = np.zeros((shadow.mode_count, body.mode_count))
    embedding[:rigid, :rigid] = np.eye(rigid)
    elastic = rng.standard_normal((shadow.mode_count - rigid, body.mode_count - rigid))
    embedding[rigid:, rigid:] = np.linalg.qr(elastic)[0]
    return replace(body, shadow=Shadow(shadow, embedding))


def angle(turn):
    return np.arccos(np.clip(0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0), -1.0, 1.0))


@pytest.mark.slow
@pytest.mark.parametrize("kind", BODIES)
@pytest.mark.parametrize("method", [Method.LINEAR, Method.FRAMES, Method.SECOND_ORDER, Method.MODAL_ROTATION])
@settings(max_examples=2, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**31), size=st.sampled_from([1e-3, 0.02, 0.2]))
# So far that what moves by second order counts.
@example(seed=5, size=0.05)
def test_the_error_is_a_step_or_two_of_newton_s_method_of_the_shadow_under_the_same_inertia(kind, method, seed, size):
    model = with_shadow(kind, seed)
    assert missing(model, method) is None
    body, own, finer = (
        FlexibleBody(model, method),
        Reference(model, method),
        Reference(model.shadow.body, Method.SECOND_ORDER),
    )
    rng, span = np.random.default_rng(seed + 2), model.shadow.embedding
    q, inputs = size * rng.standard_normal(own.modes), rng.standard_normal(6 * model.interface_count + 3)
    found, share, _ = body.core.error(Core(shadow_draft(body.model).image()), inputs, q)
    inertia = span @ (own.force(inputs, q) - own.stiffness * q)
    shadow, elastic = FlexibleBody(model.shadow.body, Method.SECOND_ORDER), slice(model.rigid_count, None)
    scale, moved = 1.0 / np.sqrt(finer.stiffness[elastic]), span @ q
    # What moves by second order along shapes that one of both keeps, and the other does not.
    moved = moved + span @ own.shift(q) - finer.shift(moved)
    # From a motion of first order, which stretches the shadow, one step leads back little of the way; so it may
    # where the shadow has shapes of its own.
    kept = model.shadow.body.membrane is not None and np.any(model.shadow.body.membrane.linear)
    for number in range(1 if method is Method.SECOND_ORDER and not kept else 2):
        left, change = finer.force(inputs, moved) - finer.stiffness * moved - inertia, np.zeros(finer.modes)
        tangent = shadow.tangent(State(moved, moved), inputs)[elastic, elastic]
        stable = np.linalg.eigvals(tangent * np.outer(scale, scale)).real.min() > 0.0
        assert stable or number
        assume(stable)
        change[elastic] = np.linalg.solve(tangent, left[elastic])
        along = finer.tangent(inputs, moved, change)[elastic]
        np.testing.assert_allclose(along, left[elastic], atol=1e-9 * np.abs(left).max())
        moved = moved + change
    (there, turned), (here, now) = finer.places(moved), own.places(q)
    there, turned = there[finer.interfaces].real, turned[finer.interfaces].real
    here, now = here[own.interfaces].real, now[own.interfaces].real
    # Curvatures of the shadow's program are of single precision.
    np.testing.assert_allclose(found[:, 0], np.linalg.norm(there - here, axis=1), rtol=2e-7, atol=1e-12)
    np.testing.assert_allclose(found[:, 1], angle(turned @ now.swapaxes(1, 2)), rtol=1e-6, atol=1e-9)
    assert share > 0.0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", BODIES)
def test_an_error_does_not_feel_that_its_shadow_is_of_single_precision(kind, seed):
    model = with_shadow(kind, seed)
    own, other = BODIES[kind]
    exact = compile_draft(body_of_everything(seed + 1, **(own | other | {"frames": 4})), Method.SECOND_ORDER)
    rounded = shadow_draft(model)
    assert not np.array_equal(np.ravel(exact.arrays["curvature"]), np.ravel(rounded.arrays["curvature"]))
    exact.sizes["embedded"], exact.arrays["embedding"] = model.mode_count, model.shadow.embedding
    rng, body = np.random.default_rng(seed + 2), FlexibleBody(model, Method.FRAMES)
    q, inputs = 0.02 * rng.standard_normal(model.mode_count), rng.standard_normal(6 * model.interface_count + 3)
    told, known = (body.core.error(Core(draft.image()), inputs, q)[0] for draft in (rounded, exact))
    np.testing.assert_allclose(told, known, rtol=1e-6, atol=1e-7 * np.abs(known).max())


def stretched_joints(body, q):
    """How far each spring of the ties is stretched, (T, 4, 3)."""
    (position, rotation), ties = body.places(q), body.ties
    a, b = np.arange(len(body.nodes) - 2 * len(ties.stiffness), len(body.nodes)).reshape(2, -1)
    gap = position[a] - position[b] - (ties.point[:, 0] - ties.point[:, 1])
    return np.concatenate([gap[:, None], ((rotation[a] - rotation[b]) @ ties.lever).swapaxes(1, 2)], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "stretches"),
    [(0, False), (0, True), *(pytest.param(seed, False, marks=pytest.mark.long) for seed in (1, 2))],
)
def test_joints_that_turned_are_as_stiff_as_before_in_the_bound_of_a_cut_body(seed, stretches):
    """The softest direction of the tangent, over the stiffness of the material and of joints where they now are.

    The material has that of its stretch, too, but for what flattens sections.
    """
    plain = {"watched_strain": None} if stretches else {"membrane": None, "watched_strain": None}
    cut, shadow = (
        replace(random_ties(body_of_everything(seed + n, frames=2 * n + 2, modes=2 * n + 4), seed), **plain)
        for n in (0, 1)
    )
    rng = np.random.default_rng(seed)
    span = np.linalg.qr(rng.standard_normal((shadow.mode_count, cut.mode_count)))[0]
    model = replace(cut, shadow=Shadow(shadow, span))
    body, own = FlexibleBody(model, "frames"), Reference(model, Method.FRAMES)
    finer = Reference(shadow, Method.SECOND_ORDER)
    q, inputs = 0.1 * rng.standard_normal(own.modes), 30.0 * rng.standard_normal(6 * model.interface_count + 3)
    _, share, bound = body.core.error(Core(shadow_draft(model).image()), inputs, q)
    stiff = finer.ties.stiffness[:, None, :]
    tension, free = own.ties.stiffness[:, None, :] * stretched_joints(own, q), copy(finer)
    free.ties, moved = None, span @ q
    # What moves by second order along shapes that the shadow keeps.
    moved = moved - finer.shift(moved)
    inertia, scale = span @ (own.force(inputs, q) - own.stiffness * q), 1.0 / np.sqrt(finer.stiffness)

    def pulled(at):
        return free.force(inputs, at) - slopes(lambda here: np.sum(tension * stretched_joints(finer, here)), at)

    for _ in range(2):
        gaps = slopes(lambda at: stretched_joints(finer, at), moved)
        joints = np.einsum("tcia,tci,tcib->ab", gaps, np.broadcast_to(stiff, gaps.shape[:3]), gaps) - finer.joined()
        material = np.diag(finer.stiffness) + joints
        ways = 1e-5 * np.eye(finer.modes)
        slope = np.stack([pulled(moved + way) - pulled(moved - way) for way in ways], axis=1) / 2e-5
        tangent = (material - slope) * np.outer(scale, scale)
        if stretches:
            membrane = shadow.membrane
            now = (membrane.linear + 2.0 * membrane.quadratic @ moved)[membrane.sign > 0.0]
            rest = membrane.linear[membrane.sign > 0.0]
            material += 2.0 * (now.T @ now - rest.T @ rest)
        material *= np.outer(scale, scale)
        shape = moved / scale
        for _ in range(8):
            shape = np.linalg.solve(tangent, material @ shape / np.sqrt(shape @ material @ shape))
        left = finer.force(inputs, moved) - finer.stiffness * moved - inertia
        moved = moved + scale * np.linalg.solve(tangent, scale * left)
    assert np.sqrt(shape @ material @ shape) > 1.02
    np.testing.assert_allclose(bound, 1.25 * share * np.sqrt(shape @ material @ shape), rtol=1e-5)
