"""Bodies that supports hold in some directions only: on rollers, and cut by planes of symmetry."""

import numpy as np
import pytest
import scipy.integrate

from flexfmu import Body, Support
from flexfmu.fe.nonlinear import load_path
from flexfmu.files.basics import BodyFileError
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.elements import ElementType
from flexfmu.reduction.bodies import fit_interface
from flexfmu.reduction.model import assemble_model
from flexfmu.study.scene.whole_model import finite_motion
from meshes import STEEL, arc, box, with_sets

LENGTH, SIDE = 0.4, 0.008


def elastica(factor):
    """Shortening and deflection over the length of a cantilever under a dead force `factor` EI/l² across its tip."""
    s = np.linspace(0.0, 1.0, 101)
    found = scipy.integrate.solve_bvp(
        lambda _, y: [y[1], -factor * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])],
        lambda a, b: [a[0], b[1], a[2], a[3]],
        s,
        np.array([0.3 * factor * s, 0.3 * factor * (1.0 - s), s, 0.1 * factor * s**2]),
        tol=1e-8,
    )
    assert found.success
    return 1.0 - found.y[2, -1], found.y[3, -1]


def on_rollers(side, **options):
    """A straight beam of square section; its axis is held at ROOT, and rolls at TIP where nodes are held in `side`."""
    ends = {
        "PIN": lambda p: np.abs(p[:, 0]) + np.abs(p[:, 2] - 0.5 * SIDE),
        "ROLLER": lambda p: np.abs(p[:, 0] - LENGTH) + np.abs(p[:, 2] - 0.5 * SIDE),
        "ONE": lambda p: np.linalg.norm(p - [0.0, 0.5 * SIDE, 0.5 * SIDE], axis=1),
        "MIDDLE": lambda p: p[:, 0] - 0.5 * LENGTH,
        "QUARTER": lambda p: p[:, 0] - 0.25 * LENGTH,
    }
    mesh = with_sets(box(ElementType.C3D20, (32, 1, 2), (LENGTH, SIDE, SIDE)), **ends)
    supports = [Support("PIN", fix=["x", "z"]), Support("ONE", fix=["y"]), Support("ROLLER", fix=["z", *side])]
    return Body(mesh, supports=supports, interfaces={"middle": "MIDDLE", "roller": "ROLLER"}, **options)


def amidst(factor):
    """Loads of a beam by which either half is a cantilever from the middle under `factor` EI/l²."""
    half, stiffness = 0.5 * LENGTH, STEEL.youngs_modulus * SIDE**4 / 12.0
    return {"middle": (0.0, 0.0, 2.0 * factor * stiffness / half**2, 0.0, 0.0, 0.0)}


@pytest.fixture(scope="module")
def cut_beam():
    body = on_rollers([], cuts="auto").build(surface=False)
    assert body.model.ties is not None
    return body


def test_a_beam_on_a_pin_and_a_roller_bends_as_the_elastica(cut_beam):
    """Either half is a cantilever from the middle: the roller comes closer by twice its shortening."""
    body, half = cut_beam, 0.5 * LENGTH
    for factor in (0.5, 1.5):
        loads = amidst(factor)
        state = body.static(loads)
        middle, roller = body.response(state).displacement
        shorter, deflection = half * np.array(elastica(factor))
        np.testing.assert_allclose(middle, [-shorter, 0.0, deflection], atol=2e-3 * deflection)
        np.testing.assert_allclose(roller, [-2.0 * shorter, 0.0, 0.0], atol=2e-3 * deflection)
        assert body.error(state, loads).bound < 0.01


def test_the_roller_of_a_bow_stays_on_the_ground_however_its_part_turns():
    ends = {
        "PIN": lambda p: np.abs(p[:, 1]) + np.abs(p[:, 0] - 0.096),
        "ROLLER": lambda p: np.abs(p[:, 0]) + np.abs(p[:, 1] - 0.096),
        "ONE": lambda p: np.linalg.norm(p - [0.096, 0.0, 0.004], axis=1),
    }
    mesh = with_sets(arc(ElementType.C3D20, (12, 1, 1), 0.1, 0.008), **ends)
    supports = [Support("PIN", fix=["x", "y"]), Support("ONE", fix=["z"]), Support("ROLLER", fix=["x"])]
    bow = Body(mesh, supports=supports, interfaces={"roller": "ROLLER"}, cuts="auto").build(surface=False)
    off, along, _ = bow.response(bow.static({"roller": [0.0, -4e3, 0.0, 0.0, 0.0, 0.0]})).displacement[0]
    assert abs(along) > 0.01
    assert abs(off) < 1e-5 * abs(along)


def test_a_beam_in_one_piece_knows_how_far_its_roller_drifts():
    """Two frames, of which the outer one lifts off: turned by 0.4 rad it tells three quarters of what it misses."""
    cut, one = (on_rollers([], **how).build(surface=False) for how in ({"cuts": "auto"}, {"tables": {"frames": 2}}))
    loads = {"middle": [0.0, 0.0, 3e3, 0.0, 0.0, 0.0]}
    state = one.static(loads)
    expected = cut.response(cut.static(loads)).displacement
    missed = np.linalg.norm(one.response(state).displacement - expected, axis=1).max()
    assert missed > 2e-3 * np.abs(expected).max()
    assert one.error(state, loads).displacement.max() == pytest.approx(missed, rel=0.3)


def test_a_roller_line_held_along_itself_is_not_cut():
    """It turns aside a little, but not far: the part beyond a cut would."""
    assert on_rollers(["y"]).build(surface=False).model.shadow.body.ties is None
    with pytest.raises(BodyFileError, match="turns freely, but not far: hold nodes on a line"):
        on_rollers(["y"], cuts=["QUARTER"]).build(surface=False)


def test_a_quarter_of_a_ring_between_planes_of_symmetry_knows_its_error_and_may_be_cut():
    """A third plane goes along the whole of it, and holds no place of it."""
    mesh = with_sets(arc(ElementType.C3D20, (12, 1, 1), 0.1, 0.008), FLOOR=lambda p: p[:, 2] + 0.004)
    supports = [Support("ROOT", fix=["y"]), Support("TIP", fix=["x"]), Support("FLOOR", fix=["z"])]
    config = Body(mesh, supports=supports, interfaces={"top": "TIP"})
    options, loads = config.spec.options, {"top": [0.0, -7e3, 0.0, 0.0, 0.0, 0.0]}
    model, top = assemble_model(mesh, options), fit_interface(options.interfaces[0], mesh, [])
    nodal = top.nodal_loads(len(mesh.points)) @ loads["top"]
    path = load_path(mesh, model.unknowns, model.spring, nodal, [1.0], Reporter())
    expected = finite_motion(top, mesh.points, path.displacement[0])[:3]

    body = config.build(surface=False)
    state = body.static(loads)
    missed = np.linalg.norm(body.response(state).displacement[0] - expected)
    assert body.model.frame_count == 1
    assert missed > 0.01 * np.linalg.norm(expected)
    assert body.error(state, loads).displacement[0] == pytest.approx(missed, rel=0.15)

    cut = Body(mesh, supports=supports, interfaces={"top": "TIP"}, cuts="auto").build(surface=False)
    assert cut.model.ties is not None
    found = cut.response(cut.static(loads)).displacement[0]
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.linalg.norm(expected))


def test_joints_of_an_opened_shadow_have_the_tension_that_its_first_step_finds():
    """A beam from a clamp to a plane of symmetry, drawn aside: without tension nothing is stable."""
    mesh = with_sets(box(ElementType.C3D20, (16, 1, 1), (0.4, 0.02, 0.01)), MIDDLE=lambda p: p[:, 0] - 0.2)
    config = Body(mesh, supports=["ROOT", Support("TIP", fix=["x"])], interfaces={"middle": "MIDDLE"})
    body, loads = config.build(surface=False), {"middle": [0.0, 2e4, 0.0, 0.0, 0.0, 0.0]}
    assert body.model.ties is None
    assert body.model.shadow.body.ties is not None
    assert body.error(body.static(loads), loads).relative < 0.01
