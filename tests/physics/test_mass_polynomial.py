"""The mass of the deformed body to second order: against lumps on a fine tree, conservation laws and CalculiX."""

from dataclasses import replace
from functools import cache
from itertools import accumulate, repeat

import numpy as np
import pytest
from benchmarks.defaults.bodies import angle, folded_flexure
from benchmarks.defaults.published import twisted_cantilever

from driven import Driven
from flexfmu.body.flexible_body import FlexibleBody, State, StepLimits
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.build.tables import FormulationTable, OutputTable
from flexfmu.files.basics import OptionError, StepError
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.model import Material
from flexfmu.model.methods import Mass, Method
from flexfmu.model.modal_file import read_modal_file, write_modal_file
from flexfmu.program import mass_polynomial
from meshes import body_file, box
from references import BEAM, L_FRAME, calculix, displacement, relative
from scene_tools import Listening
from turns import exponential

ONE_STEP = StepLimits(0.0, 1e300)


@pytest.fixture(scope="module")
def built(bodies):
    """A demo body to second order, undamped, with its lumps, and nothing that only pictures or its error need."""

    @cache
    def make(folder, frames, modes=8):
        config = bodies.config(folder)
        stored = {"modes": modes, "inertia": True, "second_order": True, "membrane": False}
        changes = {"frames": frames, "reduction": config.reduction.model_copy(update=stored)}
        changes["output"] = OutputTable(surface=False, error=False)
        body = reduce_body(config.model_copy(update=changes), Reporter())
        return replace(body, damping_ratio=np.zeros(body.mode_count), method=Method.SECOND_ORDER)

    return make


def of(model, mass, limits=None):
    return FlexibleBody(model, Method.SECOND_ORDER, mass, limits=limits)


@pytest.mark.slow
def test_it_is_the_mass_of_lumps_on_eight_frames_to_second_order_whatever_the_body_s_own_frames(built, monkeypatch):
    """Of the size of the displacement the error is of third order; forms of low rank are left out for its own sake."""
    monkeypatch.setattr(mass_polynomial, "_SMALL", 1e-12)
    fine, coarse = built(L_FRAME, 8), built.__wrapped__(L_FRAME, 1)
    slow, rng = 6, np.random.default_rng(2)
    way = np.where(np.arange(fine.mode_count) < slow, rng.standard_normal(fine.mode_count), 0.0)
    way /= fine.angular_frequency
    errors, change = [], 0.0
    for size in (2.0, 4.0):
        state = State(size * way, way)
        exact, found = of(fine, Mass.CONFIGURATION).mass(state), of(coarse, Mass.POLYNOMIAL).mass(state)
        change = np.linalg.norm(exact - np.eye(len(exact)))
        errors.append(np.linalg.norm(found - exact) / change)
    assert change > 0.1
    assert errors[1] < 0.05
    assert errors[0] < 0.4 * errors[1]


def test_a_mode_that_stretches_and_turns_nothing_has_its_mass_too(tmp_path, monkeypatch):
    monkeypatch.setattr(mass_polynomial, "_SMALL", 1e-12)
    mesh = box(ElementType.C3D20, (8, 1, 1), (1.0, 0.1, 0.13))
    tables = {"frames": 8, "reduction": {"modes": 6, "residual_flexibility": False, "inertia": True}}
    model = reduce_body(body_file(mesh, tmp_path, interface=["TIP"], **tables), Reporter())
    still = np.linalg.norm(model.frame_rotation, axis=1).max(axis=0) < 1e-9
    assert np.count_nonzero(still) == 1
    state = State(np.where(still, 0.05 / model.interface_displacement[0, 0], 0.0), np.zeros(model.mode_count))
    exact, found = (
        of(model, mass).mass(state) - np.eye(model.mode_count) for mass in (Mass.CONFIGURATION, Mass.POLYNOMIAL)
    )
    assert np.linalg.norm(exact) > 0.01
    assert np.linalg.norm(found - exact) < 0.05 * np.linalg.norm(exact)


@pytest.mark.slow
def test_few_forms_hold_it(built):
    """Weighed by what slow coordinates and rates move, each twice the less for half the frequency."""
    model = built(L_FRAME, 2)
    slow = np.count_nonzero(np.any(model.polynomial.form != 0.0, axis=(0, 1)))
    assert slow == 6
    assert len(model.polynomial.linear) < slow * (slow + 1) // 2
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mass_polynomial, "_SMALL", 1e-12)
        whole = built.__wrapped__(L_FRAME, 2)
    state = of(model, Mass.CONSTANT).static({"tip": [0.0, 0.0, 1.7e3]})
    found, expected = (of(one, Mass.POLYNOMIAL).mass(state) for one in (model, whole))
    weight = model.angular_frequency[0] / model.angular_frequency
    off, change = ((part * weight * weight[:, None]) for part in (found - expected, expected - np.eye(len(expected))))
    assert 0.0 < np.linalg.norm(off) < 0.01 * np.linalg.norm(change)


@pytest.mark.slow
@pytest.mark.parametrize("step", [2e-4, 1e-3, 5e-3])
def test_a_sudden_dead_load_changes_no_energy_at_any_step_length(built, step):
    body = of(built(BEAM, 2), Mass.POLYNOMIAL, ONE_STEP)
    state, force, largest, worst = body.rest(), np.array([0.0, 5e3, 1e3]), 0.0, 0.0
    for _ in range(200):
        state = body.step(state, {"tip": force}, step)
        total = sum(body.energies(state))
        largest = max(largest, total)
        worst = max(worst, abs(total - force @ body.response(state).displacement[0]))
    assert largest > 500.0
    assert worst < 4e-11 * largest


# Displacement (m) of the heavy end along and across the bar under a sudden force of 300 N, by CalculiX.
HEAVY_END = [
    (-0.006609, 0.073309), (-0.041993, 0.182091), (-0.035990, 0.169737),
    (-0.003479, 0.053251), (-0.000007, 0.002480), (-0.010873, 0.094333),
]  # fmt: skip

# Folder, force (N), error in % of constant mass at least, and of the polynomial at most.
TRANSIENTS = {"beam": (BEAM, (0.0, 5e3, 0.0), 1.2, 0.5), "L-frame": (L_FRAME, (0.0, 0.0, 1.7e3), 2.0, 0.8)}


@pytest.mark.slow
@pytest.mark.parametrize("body", ["beam", "L-frame"])
def test_two_frames_follow_the_sudden_load_of_calculix(built, body):
    folder, force, constant, most = TRANSIENTS[body]
    table = calculix(folder / "calculix" / "sudden_load.csv")
    expected, model = displacement(table), built(folder, 2, 20)
    errors = {}
    for mass in (Mass.CONSTANT, Mass.POLYNOMIAL):
        one = of(model, mass)
        state, found = one.rest(), [np.zeros(3)]
        for step in np.diff(table["time_s"]):
            state = one.step(state, {"tip": force}, step)
            found.append(one.response(state).displacement[0])
        errors[mass] = 100.0 * relative(np.array(found), expected)
    assert errors[Mass.CONSTANT] > constant
    assert errors[Mass.POLYNOMIAL] < most


@pytest.mark.slow
def test_slow_motion_is_right_beside_stiff_modes_whose_mass_changes_by_many_times(tmp_path):
    """A thin-walled angle: 45 combinations count by the mass, 40 by the largest, the others slow ones of 4 %."""
    config = read_body_file(angle().write(tmp_path))
    changes = {
        "reduction": config.reduction.model_copy(update={"inertia": True}),
        "formulation": config.formulation.model_copy(update={"mass": Mass.POLYNOMIAL}),
        "output": OutputTable(surface=False, error=False),
    }
    found = reduce_body(config.model_copy(update=changes), Reporter())
    step, paths = 0.04 * np.pi / found.angular_frequency[0], []
    for mass in (Mass.POLYNOMIAL, Mass.CONFIGURATION):
        one = of(replace(found, damping_ratio=np.zeros(found.mode_count)), mass, StepLimits(0.0, 1e-5))
        state, path = one.rest(), []
        for _ in range(60):
            state = one.step(state, {"tip": [0.0, 250.0, 250.0]}, step)
            path.append(one.response(state).displacement[0])
        paths.append(np.array(path))
    assert relative(*paths) < 1e-3


@pytest.mark.slow
def test_it_is_the_default_of_bodies_in_one_piece_that_are_held_or_turn_freely(bodies):
    quick = {"modes": 2, "residual_flexibility": False, "membrane": False}
    config, output = bodies.config(BEAM), OutputTable(surface=False, error=False)
    changes = {"reduction": config.reduction.model_copy(update=quick), "output": output, "frames": 1, "frame": []}
    changes["formulation"] = FormulationTable()
    held = reduce_body(config.model_copy(update=changes), Reporter())
    assert (held.method, held.mass) == (Method.SECOND_ORDER, Mass.POLYNOMIAL)
    free = reduce_body(config.model_copy(update=changes | {"free": True, "support": []}), Reporter())
    assert free.mass is Mass.POLYNOMIAL
    # It slides along x, and turns about nothing.
    support = config.support[0].model_copy(update={"fix": ["y", "z"]})
    rail = reduce_body(config.model_copy(update=changes | {"free": True, "support": [support]}), Reporter())
    assert rail.mass is Mass.CONSTANT
    with pytest.raises(OptionError, match="held or free to turn"):
        of(rail, Mass.POLYNOMIAL)


CERTIFIED = "Reduce the body once more, finer, to know its error"


def heavy_end(folder, **tables):
    """A bar of 0.5 m whose last tenth has five times the mass of the rest, built quickly; and how often it says so.

    Whatever its mass, what is said of its interface is said once, and its error is found once where it is asked for.
    """
    light, heavy = (Material(name, 7e10, 0.3, density) for name, density in (("ARM", 540.0), ("END", 24300.0)))

    def material(centre):
        return (centre[:, 0] > 36.0).astype(int)

    mesh = box(ElementType.C3D8I, (40, 2, 2), (0.5, 0.02, 0.01), materials=(light, heavy), material=material)
    said = Listening()
    body = reduce_body(body_file(mesh, folder, interface=["TIP"], damping={"ratio": 0.0}, **tables), said)
    assert len([text for text in said.notes if "interface 'tip'" in text]) == 1
    assert said.stages.count(CERTIFIED) == bool(tables.get("output"))
    return body, [text for text in said.notes if "range of its mass polynomial" in text]


def test_a_body_that_sudden_loads_bend_beyond_it_takes_the_mass_of_its_lumps(tmp_path):
    """An arm with a heavy end, against CalculiX (same mesh, 180 steps of its trapezoidal rule)."""
    body, notes = heavy_end(tmp_path)
    assert body.mass is Mass.CONFIGURATION
    assert len(notes) == 1
    assert body.frame_count == 8

    def path(steps, mass=None):
        one = FlexibleBody(body, mass=mass)
        states = accumulate(
            repeat(3.6762e-4, steps), lambda s, h: one.step(s, {"tip": [0, 0, 300]}, h), initial=one.rest()
        )
        return np.array([one.response(state).displacement[0, [0, 2]] for state in states])

    np.testing.assert_allclose(path(180)[30::30], HEAVY_END, rtol=0.0, atol=0.006 * 0.2)
    # The polynomial is there for who asks for it, and does not get as far.
    with pytest.raises(StepError, match="beyond the range of its mass polynomial"):
        path(60, Mass.POLYNOMIAL)


@pytest.mark.slow
def test_of_the_body_that_is_given_up_no_error_is_found(tmp_path):
    body, notes = heavy_end(tmp_path, output={"error": True}, frames=6)
    assert len(notes) == 1
    assert body.mass is Mass.CONFIGURATION
    assert body.shadow is not None


@pytest.mark.slow
def test_lumps_that_lack_what_the_polynomial_has_near_rest_do_not_take_its_place(tmp_path):
    """Of a folded flexure under half of a load aside: 1.8 % off by lumps on six frames, 0.9 by the polynomial."""
    said = Listening()
    body = reduce_body(read_body_file(replace(folded_flexure(), frames=4).write(tmp_path)), said)
    assert body.mass is Mass.POLYNOMIAL
    assert body.inertia is None
    (note,) = (text for text in said.notes if "lumps on its frames are too coarse" in text)
    assert "more frames" in note
    assert said.stages.count(CERTIFIED) == 1
    assert len({*said.warnings}) == len(said.warnings) == 2


@pytest.mark.parametrize("tables", [{"formulation": {"mass": "polynomial"}}, {"reduction": {"inertia": False}}])
def test_who_asks_for_it_has_it_however_far_loads_bend_the_body(tables, tmp_path):
    body, notes = heavy_end(tmp_path, **tables)
    assert body.mass is Mass.POLYNOMIAL
    assert notes == []


def test_it_comes_back_from_its_file(built, tmp_path):
    model = replace(built(BEAM, 2), mass=Mass.POLYNOMIAL)
    write_modal_file(model, tmp_path / "body.h5")
    back = read_modal_file(tmp_path / "body.h5")
    assert back.mass is Mass.POLYNOMIAL
    for name in ("form", "linear", "square"):
        np.testing.assert_array_equal(getattr(back.polynomial, name), getattr(model.polynomial, name))


def test_static_equilibria_know_nothing_of_it(built):
    model = built(BEAM, 2)
    both = [of(model, mass).static({"tip": [0.0, 10e3, 0.0]}).q for mass in (Mass.CONSTANT, Mass.POLYNOMIAL)]
    np.testing.assert_array_equal(*both)


def test_a_body_bent_beyond_its_range_is_refused_and_stays_where_it_was(built, tmp_path):
    """At eight static deflections the polynomial is no mass any more."""
    driven = Driven(replace(built(L_FRAME, 8), mass=Mass.POLYNOMIAL), tmp_path)
    driven.set(**{"tip.force.z": 14e3})
    before = []
    for _ in range(200):
        before = driven.get("tip.displacement.z")
        if not driven.taken(5e-4):
            break
    assert "beyond the range of its mass polynomial" in driven.log[-1][1]
    assert driven.get("tip.displacement.z") == before
    driven.set(**{"tip.force.z": 0.0})
    # Hardly farther: it may be at its range and on its way.
    assert driven.taken(1e-8)


@pytest.fixture(scope="module")
def loose(tmp_path_factory):
    """A free cranked strip of 1 m, undamped, with its lumps on eight frames; its polynomial holds all forms."""
    mesh = box(ElementType.C3D20, (12, 1, 1), (1.0, 0.01, 0.03))
    tables = {"frames": 8, "free": True, "damping": {"ratio": 0.0}, "output": {"error": False, "surface": False}}
    tables["reduction"] = {"modes": 6, "residual_flexibility": False, "inertia": True, "membrane": False}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mass_polynomial, "_SMALL", 1e-12)
        body = body_file(mesh, tmp_path_factory.mktemp("loose"), interface=["ROOT", "TIP"], support=None, **tables)
        return reduce_body(body, Reporter())


def bent(model, size, seed):
    """A state that moves and turns (1 rad) as a whole and bends by some radians in its softest modes."""
    rng, omega, rigid = np.random.default_rng(seed), model.angular_frequency, model.rigid_count
    first = omega[rigid]
    turn = np.linalg.norm(model.frame_rotation[:, :, rigid : rigid + 2], axis=1).max()
    q, v = np.zeros(len(omega)), np.zeros(len(omega))
    q[rigid:] = size / turn * rng.uniform(-1.0, 1.0, len(omega) - rigid) * first / omega[rigid:]
    v[rigid:] = first * size / turn * rng.uniform(-1.0, 1.0, len(omega) - rigid) * first / omega[rigid:]
    motion = np.concatenate([model.joint_displacement[0], model.frame_rotation[0]])[:, :6]
    q[:6] = np.linalg.solve(motion, [0.1, 0.2, 0.0, 0.3, -0.5, 0.8])
    v[:6] = np.linalg.solve(motion, [1.0, -2.0, 3.0, *(0.3 * first * rng.uniform(-1.0, 1.0, 3))])
    return State(q, v)


def test_of_a_free_body_it_is_that_of_lumps_in_the_root_s_axes_however_far_it_has_turned(loose):
    """Of turns and elastic rates: the centre of mass is known to second order, as places are."""
    way = np.diag(np.concatenate([np.ones(6), loose.angular_frequency[6] / loose.angular_frequency[6:]]))
    way[:6, :6] = np.linalg.inv(np.concatenate([loose.joint_displacement[0], loose.frame_rotation[0]])[:, :6])
    heavy, light = (of(loose, mass) for mass in (Mass.CONFIGURATION, Mass.POLYNOMIAL))
    for seed in range(3):
        off = []
        for size in (0.1, 0.2):
            state = bent(loose, size, seed)
            straight = State(np.where(np.arange(state.q.size) < 6, state.q, 0.0), state.v)
            found = [heavy.mass(state), light.mass(state), heavy.mass(straight)]
            exact, own, before = ((way.T @ one @ way)[3:, 3:] for one in found)
            off.append(np.linalg.norm(own - exact) / np.linalg.norm(exact - before))
        assert off[1] < 0.03
        assert off[0] < 0.4 * off[1]


def test_a_free_body_keeps_its_momenta_and_energy_to_round_off(loose):
    """While it bends by 0.2 rad and turns about all axes."""
    body = of(loose, Mass.POLYNOMIAL, ONE_STEP)
    state = bent(loose, 0.2, 5)
    motion = np.concatenate([loose.joint_displacement[0], loose.frame_rotation[0]])[:, :6]

    def kept(state):
        linear, own = np.split(np.linalg.solve(motion.T, (body.mass(state) @ state.v)[:6]), 2)
        place, angle = np.split(motion @ state.q[:6], 2)
        return linear, exponential(angle) @ own + np.cross(place, linear), sum(body.energies(state))

    first, most = kept(state), 0.0
    assert 0.5 * state.v @ body.mass(state) @ state.v == pytest.approx(body.energies(state)[1], rel=1e-12)
    for _ in range(200):
        state = body.step(state, {}, 0.02 / loose.angular_frequency[6])
        most = max(most, float(np.abs(loose.angular_frequency[6:] * state.q[6:]).max()))
    now = kept(state)
    assert most**2 > 0.02 * first[2]
    for before, after in zip(first, now, strict=True):
        np.testing.assert_allclose(after, before, atol=2e-10 * np.linalg.norm(before))


def test_it_knows_of_stiff_rates_where_frequencies_of_the_bent_body_need_them(tmp_path):
    """Of a twisted cantilever: by six coordinates alone the motion is 3.5 % off in silence within three periods."""
    body = twisted_cantilever()
    given = {"output": OutputTable(surface=False, error=False)}
    whole = {"frames": 16, "formulation": FormulationTable(method=Method.SECOND_ORDER, mass=Mass.CONFIGURATION)}
    config = read_body_file(body.write(tmp_path)).model_copy(update=given)
    found = reduce_body(config.model_copy(update={"formulation": FormulationTable(mass=Mass.POLYNOMIAL)}), Reporter())
    fine = reduce_body(config.model_copy(update=whole), Reporter())
    fine = replace(fine, mass_modes=fine.mode_count)
    assert found.mass is Mass.POLYNOMIAL
    models = [FlexibleBody(found), FlexibleBody(fine, limits=StepLimits(0.0, 1e-4))]
    loads = {name: [0.2 * one for one in force] for name, force in body.cases["down"].items()}
    step, states, moved = 2.0 * np.pi / (50.0 * found.angular_frequency[0]), [one.rest() for one in models], []
    for _ in range(150):
        states = [one.step(state, loads, step) for one, state in zip(models, states, strict=True)]
        moved.append([one.response(state).displacement[0] for one, state in zip(models, states, strict=True)])
    own, exact = np.swapaxes(moved, 0, 1)
    assert np.abs(exact).max() > 1.0
    assert relative(own, exact) < 0.01
