"""Thin bodies, whose stiffness spans so many decades that round-off shows: sound ones pass, others are told why not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.fe.assembly import mass, stiffness, unknowns
from flexfmu.fe.gradients import stress_jumps
from flexfmu.files.basics import AccuracyError
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.elements import ElementType
from flexfmu.reduction.modes import normal_modes
from flexfmu.reduction.supported import eliminated, supported
from meshes import STEEL, body_file, box, held

LENGTH, WIDTH = 0.3, 0.03
COUNTS = (40, 4, 1)


class Heard(Reporter):
    """Keeps warnings."""

    def __init__(self):
        self.warnings = []

    def warning(self, text):
        self.warnings.append(text)


def strip(folder, thickness, kind=ElementType.C3D20R, turn=(0.0, 0.0, 0.0), **reduction):
    """A clamped strip, turned in space, and the direction across it."""
    axes = Rotation.from_rotvec(turn).as_matrix()
    mesh = box(kind, COUNTS, (LENGTH, WIDTH, thickness))
    mesh = replace(mesh, points=mesh.points @ axes.T)
    tables = {"frames": 2, "reduction": {"modes": 6} | reduction}
    return reduce_body(body_file(mesh, folder, interface=["TIP"], **tables), Reporter()), axes[:, 2]


@pytest.mark.slow
@pytest.mark.parametrize("reduction", [{}, {"residual_flexibility": True}, {"basis": "craig_bampton"}])
@pytest.mark.parametrize("kind", [ElementType.C3D20R, ElementType.C3D10])
@pytest.mark.parametrize("thickness", [1e-3, 0.6e-3])
def test_a_steel_strip_swings_and_bends_as_beam_theory_says(tmp_path, thickness, kind, reduction):
    body, across = strip(tmp_path, thickness, kind, **reduction)
    wave = np.sqrt(STEEL.youngs_modulus / 12.0 / STEEL.density) * thickness / LENGTH**2
    # Held against lateral contraction at its root, a strip is up to 2 % stiffer than a beam.
    assert body.angular_frequency[0] == pytest.approx(3.5160 * wave, rel=0.02)
    force, bending = 1e-6, STEEL.youngs_modulus * WIDTH * thickness**3 / 12.0
    model = FlexibleBody(body)
    moved = model.response(model.static({"tip": force * across})).displacement[0] @ across
    assert moved == pytest.approx(force * LENGTH**3 / (3.0 * bending), rel=0.03)


@pytest.mark.slow
def test_round_off_moves_a_frequency_by_about_what_is_told(tmp_path):
    """The frequency of a strip does not depend on where it points, but for round-off."""
    told = []

    class Notes(Reporter):
        def note(self, text):
            told.extend(text.split("frequencies to ")[1:])

    turns = np.random.default_rng(1).uniform(-1.0, 1.0, (4, 3))
    mesh = box(ElementType.C3D20R, COUNTS, (LENGTH, WIDTH, 0.3e-3))
    frequency = []
    for turn in turns:
        turned = replace(mesh, points=mesh.points @ Rotation.from_rotvec(turn).as_matrix().T)
        reduction = {"modes": 6, "residual_flexibility": False}
        config = body_file(turned, tmp_path, interface=["TIP"], frames=1, reduction=reduction)
        frequency.append(reduce_body(config, Notes()).angular_frequency)
    changes = np.ptp(frequency, axis=0) / np.mean(frequency, axis=0)
    bounds = [float(words.split()[0]) for words in told]
    assert len(bounds) == len(turns)
    # Round-off of the stiffness itself, which the residual does not see, is of the size of that of the solution.
    assert 0.1 * max(bounds) < changes.max() < 10.0 * max(bounds)
    assert 1e-6 < max(bounds) < 1e-3


@pytest.mark.parametrize("basis", ["normal", "craig_bampton"])
def test_a_foil_whose_stiffness_double_precision_cannot_hold_is_refused_with_advice(tmp_path, basis):
    with pytest.raises(AccuracyError, match=r"%.*round-off.*one layer of elements across"):
        strip(tmp_path, 0.06e-3, basis=basis)


@pytest.mark.slow
def test_one_layer_of_elements_leaves_a_thin_strip_more_digits_than_two():
    """What the refusal advises helps: twice as many layers of half the thickness are an order of magnitude worse."""
    told = []
    for layers in (1, 2):
        mesh = held(box(ElementType.C3D20R, (40, 4, layers), (LENGTH, WIDTH, 0.3e-3)), "ROOT")
        k, m = stiffness(mesh), mass(mesh)
        told.append(
            normal_modes(
                supported(eliminated(k, m, unknowns(mesh.fixed, mesh.equations)), np.zeros((k.shape[0], 0))), 6
            ).frequency_error
        )
    assert told[1] > 3.0 * told[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "counts"),
    [
        ("C3D4", (10, 2, 2)),
        pytest.param("C3D4", (20, 4, 2), marks=pytest.mark.long),
        ("C3D8", (10, 1, 1)),
        ("C3D8", (20, 2, 1)),
    ],
)
def test_a_mesh_of_linear_solids_tells_how_much_of_the_deflection_it_lacks(tmp_path, kind, counts):
    """Against a beam of Euler and Bernoulli, whose frequency the other elements meet without a word."""
    length, height = 1.0, 0.05
    first = 3.5160 * np.sqrt(STEEL.youngs_modulus / 12.0 / STEEL.density) * height / length**2

    def built(kind):
        report = Heard()
        mesh = box(ElementType[kind], counts, (length, 0.1, height))
        body = reduce_body(body_file(mesh, tmp_path, interface=["TIP"], frames=1, reduction={"modes": 2}), report)
        return (first / body.angular_frequency[0]) ** 2, [text for text in report.warnings if "too stiff" in text]

    reached, said = built(kind)
    told = float(said[0].split(" % too small")[0].split()[-1]) / 100.0
    assert told == pytest.approx(1.0 - reached, rel=0.35)
    assert 0.1 < told < 1.0 - reached + 0.02
    for good in ("C3D8I", "C3D10", "C3D20R"):
        reached, said = built(good)
        assert said == []
        assert reached == pytest.approx(1.0, abs=0.05)


def skew(kind, slope, thickness):
    """A strip of elements whose nodes lie aside of a grid's, up to so much of their distances."""
    mesh = box(ElementType[kind], (20, 2, 1), (1.0, 0.1, thickness))
    x, y, _ = mesh.points.T
    inside = np.sin(np.pi * x) * np.sin(10.0 * np.pi * y)
    aside = slope * inside * np.array([np.sin(40.0 * y + 9.0 * x) / 20.0, 0.05 * np.cos(33.0 * x + y)])
    return replace(mesh, points=mesh.points + np.vstack([aside, 0.0 * x]).T)


MIDDLES = "mid-side nodes off the middle of an edge stiffen it, too"


def gutter():
    """A thin piece of a tube, one element across it, with its mid-side nodes in the middle of the arc."""
    mesh = box(ElementType.C3D20R, (4, 1, 1), (1.0, 0.1, 0.002))
    x, y, z = mesh.points.T
    turn, radius = y / 0.1 - 0.5, 0.1 + z
    return replace(mesh, points=np.stack([x, radius * np.sin(turn), radius * np.cos(turn)], axis=1))


@pytest.mark.parametrize(
    ("kind", "advice"),
    [
        ("C3D8", "take quadratic elements or a finer mesh, or shells instead of thin solids"),
        ("C3D8I", "take a finer mesh, or shells instead of thin solids"),
        pytest.param(
            "C3D20R", f"take a finer mesh, or shells instead of thin solids; {MIDDLES}", marks=pytest.mark.slow
        ),
        ("gutter", f"take a finer mesh, or shells instead of thin solids; {MIDDLES}"),
    ],
)
def test_what_is_advised_for_a_mesh_that_is_too_stiff_is_not_so_already(tmp_path, kind, advice):
    mesh, said = gutter() if kind == "gutter" else skew(kind, 0.25, 0.0005), Heard()
    reduce_body(body_file(mesh, tmp_path, interface=["TIP"], frames=1, reduction={"modes": 2}), said)
    (text,) = (text for text in said.warnings if "too stiff" in text)
    assert text.split("% too small; ")[1] == advice


@pytest.mark.parametrize("kind", ["C3D8I", "C3D10", "C3D15", "C3D20", "C3D20R"])
@pytest.mark.parametrize(("slope", "thickness"), [(0.0, 0.002), (0.25, 0.05), (0.25, 0.0005)])
def test_quadratic_solids_that_are_too_thin_for_their_shape_tell_how_much_of_the_deflection_they_lack(
    kind, slope, thickness
):
    """Skew ones, a hundred times as long as thick, lock; straight or thick ones do not, and say nothing."""
    mesh = held(skew(kind, slope, thickness), "ROOT")
    free = np.flatnonzero(~mesh.fixed.ravel())
    force = np.zeros_like(mesh.points)
    force[mesh.node_sets["TIP"], 2] = 1.0 / mesh.node_sets["TIP"].size
    moved = np.zeros(force.size)
    moved[free] = spsolve(stiffness(mesh).tocsc()[free][:, free], force.ravel()[free])
    reached = moved.reshape(-1, 3)[mesh.node_sets["TIP"], 2].mean() * 3.0 * 2e11 * 0.1 * thickness**3 / 12.0
    told = stress_jumps(mesh, moved)
    if slope and thickness < 0.01:
        assert reached < 0.7
        assert 0.5 * (1.0 - reached) < told < 1.5 * (1.0 - reached)
    else:
        assert reached > 0.92
        assert told < 0.02
