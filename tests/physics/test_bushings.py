"""A body on a bushing: closed forms of a rigid body on six springs, a beam's own bending, and what is refused."""

import numpy as np
import pytest
import scipy.optimize
from scipy.linalg import eigh

import flexfmu
from flexfmu.files.errors import BodyFileError, ModelError
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.model import Mesh
from flexfmu.model.rotations import exponential
from meshes import box

STIFFNESS, TURNING = np.array([2e4, 5e4, 9e4]), np.array([30.0, 70.0, 110.0])
# Axes of the bushing in its columns.
AXES = exponential(np.array([0.4, -0.7, 0.3]))
LENGTH = 0.3
BUSHING = flexfmu.Support("ROOT", stiffness=STIFFNESS, rotational_stiffness=TURNING, axes=AXES.T[:2])
TENSORS = [AXES @ np.diag(k) @ AXES.T for k in (STIFFNESS, TURNING)]
LOAD = np.array([60.0, -90.0, 40.0, 3.0, 2.0, -4.0])


def bar() -> Mesh:
    """Bar of steel, as good as rigid, of which the first face is ROOT and the last TIP."""
    return box(ElementType.C3D20R, (3, 1, 1), (LENGTH, 0.04, 0.04))


def built(support=BUSHING, **options):
    body = flexfmu.Body(bar(), supports=[support], interfaces={"tip": "TIP"})
    return body.build(surface=False, **options)


def equilibrium(load: np.ndarray) -> np.ndarray:
    """Tip's displacement and rotation of a rigid bar on the bushing whose axes stay, (6,)."""
    arm, (pull, turn) = np.array([LENGTH, 0.0, 0.0]), TENSORS

    def residual(rotation: np.ndarray) -> np.ndarray:
        # Virtual rotations about fixed axes: the moment of a rotation vector is conjugate by the right Jacobian.
        turned = exponential(rotation) @ arm
        return moment_of(turn, rotation) - load[3:] - np.cross(turned, load[:3])

    rotation = scipy.optimize.fsolve(residual, np.linalg.solve(turn, load[3:] + np.cross(arm, load[:3])), xtol=1e-8)
    return np.append(np.linalg.solve(pull, load[:3]) + exponential(rotation) @ arm - arm, rotation)


def moment_of(turn: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Moment whose work on every further turn is that of the energy ½ θᵀKθ of the rotation vector."""
    gradient, size = turn @ rotation, 1e-6
    further = [log(exponential(size * axis) @ exponential(rotation)) - rotation for axis in np.eye(3)]
    return np.array([gradient @ each for each in further]) / size


def log(matrix: np.ndarray) -> np.ndarray:
    angle = np.arccos(np.clip((np.trace(matrix) - 1.0) / 2.0, -1.0, 1.0))
    skew = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
    return 0.5 * angle / np.sin(angle) * skew


def tip(body, load) -> np.ndarray:
    found = body.response(body.static({"tip": load}))
    return np.append(found.displacement[0], found.rotation[0])


def test_a_small_load_moves_a_rigid_body_as_its_bushing_yields():
    size, found = 1e-4, tip(built(), 1e-4 * LOAD)
    np.testing.assert_allclose(found, equilibrium(size * LOAD), rtol=2e-3, atol=2e-4 * np.abs(found).max())


@pytest.mark.parametrize("factor", [0.3, 1.0])
def test_large_turns_on_a_bushing_are_those_of_a_rigid_body(factor):
    expected, found = equilibrium(factor * LOAD), tip(built(), factor * LOAD)
    np.testing.assert_allclose(found[:3], expected[:3], atol=1e-3 * np.linalg.norm(expected[:3]))
    np.testing.assert_allclose(found[3:], expected[3:], atol=1e-3 * np.linalg.norm(expected[3:]))


def test_frequencies_are_those_of_a_rigid_body_on_six_springs():
    mesh, body = bar(), built()
    rho = mesh.materials[0].density
    sides = np.array([LENGTH, 0.04, 0.04])
    mass = rho * sides.prod()
    inertia = mass / 12.0 * np.diag(sides @ sides - sides**2)
    away = np.array([-0.5 * LENGTH, 0.0, 0.0])
    skew = np.array([[0.0, -away[2], away[1]], [away[2], 0.0, -away[0]], [-away[1], away[0], 0.0]])
    at_root = np.block([[np.eye(3), -skew], [np.zeros((3, 3)), np.eye(3)]])
    stiff = at_root.T @ np.block([[TENSORS[0], np.zeros((3, 3))], [np.zeros((3, 3)), TENSORS[1]]]) @ at_root
    weight = np.block([[mass * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), inertia]])
    expected = np.sqrt(eigh(stiff, weight)[0])
    np.testing.assert_allclose(body.reduced.angular_frequency[:6], expected, rtol=2e-3)


REFUSED = {
    "axes alone": ({"stiffness": STIFFNESS, "axes": np.eye(3)[:2]}, BodyFileError, "take rotational_stiffness"),
    "parallel": ({"rotational_stiffness": TURNING, "axes": np.ones((2, 3))}, BodyFileError, "not parallel"),
    "negative": ({"rotational_stiffness": -TURNING}, BodyFileError, "three numbers"),
    "free": ({"stiffness": STIFFNESS, "rotational_stiffness": (0.0, 1.0, 1.0)}, ModelError, "free to move in 1 rigid"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bushings_that_cannot_be_are_refused(name):
    keys, kind, text = REFUSED[name]
    with pytest.raises(kind, match=text):
        built(flexfmu.Support("ROOT", **keys))


def test_nodes_on_a_line_take_no_moment_and_a_body_on_bushings_is_not_cut_nor_scaled():
    line = flexfmu.Support(lambda p: (p[:, 0] < 1e-9) & (p[:, 1] < p[:, 1].min() + 1e-9), rotational_stiffness=TURNING)
    with pytest.raises(ModelError, match="on a line"):
        built(line)
    assert built().reduced.properties.spring.min() > 0.0
    body = flexfmu.Body(bar(), supports=[BUSHING], interfaces={"tip": "TIP"}, cuts=["TIP"])
    with pytest.raises(BodyFileError, match="cannot be cut"):
        body.build(surface=False)
