"""Small bodies for tests: random trees of frames, a rigid rotation, and a beam whose modes have a closed form."""

from contextlib import contextmanager
from dataclasses import dataclass, replace

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from flexfmu.core.interface import read_image
from flexfmu.model import modal_file
from flexfmu.model.inertia import LumpedMass, MassPolynomial, Membrane
from flexfmu.model.methods import Method
from flexfmu.model.reduced_body import GROUND, Masses, ReducedBody, SecondOrder, Ties, WholeFrame
from flexfmu.program.compile import compile_program

FloatArray = NDArray[np.float64]

LINEAR = Method.LINEAR
COROTATED = Method.FRAMES

# A branched tree, a second root, and three interfaces on different branches.
BRANCHED = (GROUND, 0, 1, 1, GROUND)
BRANCHED_INTERFACES = (2, 3, 4)


def random_body(
    seed: int = 1,
    parents: tuple[int, ...] = BRANCHED,
    interface_frame: tuple[int, ...] = BRANCHED_INTERFACES,
    modes: int = 6,
    **changes: object,
) -> ReducedBody:
    """Body of random shape functions: every term of the kinematics is there."""
    rng = np.random.default_rng(seed)
    frames, interfaces = len(parents), len(interface_frame)

    def shapes(count: int) -> FloatArray:
        return rng.standard_normal((count, 3, modes))

    values: dict[str, object] = {
        "name": f"random_{seed}",
        "angular_frequency": np.sort(rng.uniform(20.0, 300.0, modes)),
        "damping_ratio": rng.uniform(0.002, 0.05, modes),
        "interface_names": tuple(f"port_{k}" for k in range(interfaces)),
        "interface_point": rng.uniform(-1.0, 1.0, (interfaces, 3)),
        "interface_displacement": shapes(interfaces),
        "interface_rotation": shapes(interfaces),
        "interface_frame": np.array(interface_frame),
        "frame_names": tuple(f"frame_{k}" for k in range(frames)),
        "frame_parent": np.array(parents, dtype=np.int64),
        "joint_point": rng.uniform(-1.0, 1.0, (frames, 3)),
        "joint_displacement": shapes(frames),
        "joint_rotation": shapes(frames),
        "frame_rotation": shapes(frames),
        "provenance": {"seed": str(seed)},
    }
    return ReducedBody(**(values | changes))  # type: ignore[arg-type]


def with_second_order(body: ReducedBody, size: float = 1.0) -> ReducedBody:
    """The body with second-order parts of any shape."""
    masses = 0 if body.masses is None else len(body.masses.mass)
    ties = 0 if body.ties is None else 2 * len(body.ties.stiffness)
    count, modes = body.frame_count + body.interface_count + masses + ties, body.mode_count
    rng = np.random.default_rng(1000)
    displacement, rotation = size * rng.standard_normal((2, count, 3, modes, modes))
    parts = displacement + displacement.swapaxes(2, 3), rotation + rotation.swapaxes(2, 3)
    return replace(body, second=SecondOrder(*parts))


def with_membrane(body: ReducedBody, size: float = 1.0) -> ReducedBody:
    """The body with five stretches of any form, two of them with a linear part."""
    modes, elastic = body.mode_count, body.angular_frequency > 0.0
    rng = np.random.default_rng(1001)
    quadratic = size * rng.standard_normal((5, modes, modes)) * np.outer(elastic, elastic)
    linear = 30.0 * rng.standard_normal((5, modes)) * elastic
    linear[:3] = 0.0
    sign = np.array([1.0, 1.0, -1.0, 1.0, 1.0])
    return replace(body, membrane=Membrane.of(np.eye(modes), quadratic + quadratic.swapaxes(1, 2), linear, sign, sign))


def with_polynomial(body: ReducedBody, size: float = 0.02) -> ReducedBody:
    """The body with a mass polynomial of four terms of any form."""
    rng, modes = np.random.default_rng(1002), body.mode_count
    form, square = size * rng.standard_normal((2, 4, modes, modes))
    linear = rng.standard_normal((4, modes))
    terms = MassPolynomial(form + form.swapaxes(1, 2), linear, (square + square.swapaxes(1, 2)) / size)
    return replace(body, polynomial=terms)


def turning_body(axis: FloatArray, pivot: FloatArray) -> ReducedBody:
    """Mode 0 is the rigid rotation of a whole tree of frames about its root joint; mode 1 is elastic."""
    body = random_body(7, parents=(GROUND, 0, 1, 1), interface_frame=(0, 2, 3), modes=2)
    joint_point = np.array(body.joint_point)
    joint_point[0] = pivot

    def with_rotation(displacement: FloatArray, point: FloatArray) -> FloatArray:
        result = 0.1 * displacement
        result[:, :, 0] = np.cross(axis, point - pivot)
        return result

    def turned(rotation: FloatArray) -> FloatArray:
        result = 0.1 * rotation
        result[:, :, 0] = axis
        return result

    joint_displacement = with_rotation(body.joint_displacement, joint_point)
    frame_rotation = turned(body.frame_rotation)
    # The root itself neither moves nor turns elastically, so that the rigid rotation acts on all of it.
    joint_displacement[0, :, 1] = 0.0
    frame_rotation[0, :, 1] = 0.0
    return replace(
        body,
        name="turning",
        joint_point=joint_point,
        interface_displacement=with_rotation(body.interface_displacement, body.interface_point),
        interface_rotation=turned(body.interface_rotation),
        joint_displacement=joint_displacement,
        joint_rotation=turned(body.joint_rotation),
        frame_rotation=frame_rotation,
    )


@dataclass(frozen=True, slots=True)
class Beam:
    """A slender beam along x, clamped at the origin (Euler-Bernoulli, no shear, no stretching)."""

    length: float = 1.0
    width: float = 0.03
    modulus: float = 2e11
    density: float = 7850.0

    @property
    def bending_stiffness(self) -> float:
        """EI, N m²."""
        return self.modulus * self.width**4 / 12.0

    @property
    def mass_per_length(self) -> float:
        """ρA, kg/m."""
        return self.density * self.width**2

    @property
    def critical_load(self) -> float:
        """Euler's load of the clamped-free column, N."""
        return np.pi**2 * self.bending_stiffness / (4.0 * self.length**2)


def clamped_free_roots(count: int) -> FloatArray:
    """The first roots of cos a cosh a = −1."""
    return np.array(
        [
            brentq(lambda a: np.cos(a) + 1.0 / np.cosh(a), (k - 0.9) * np.pi, (k - 0.1) * np.pi, xtol=1e-14)
            for k in range(1, count + 1)
        ]
    )


def clamped_free_shapes(roots: FloatArray, x: FloatArray, length: float) -> tuple[FloatArray, FloatArray]:
    """Shapes with ∫φ²dx = L and slopes, (points, modes); without hyperbolic functions, which would cancel."""
    a, s = roots, np.asarray(x)[:, None] / length
    decay = np.exp(-a)
    denominator = 1.0 + decay**2 + 2.0 * np.cos(a) * decay
    growing = (decay + np.cos(a) + np.sin(a)) / denominator * np.exp(a * (s - 1.0))
    sigma = (1.0 - decay**2 - 2.0 * np.sin(a) * decay) / denominator
    falling = 0.5 * (1.0 + sigma) * np.exp(-a * s)
    shape = growing + falling - np.cos(a * s) + sigma * np.sin(a * s)
    slope = (growing - falling + np.sin(a * s) + sigma * np.cos(a * s)) * a / length
    return shape, slope


def beam_body(
    frames: int,
    modes: int = 6,
    beam: Beam | None = None,
    planes: str = "yz",
    damping: float = 0.0,
    **changes: object,
) -> ReducedBody:
    """Beam with `modes` bending modes in each plane, equal frames, and the interface "tip".

    A frame's averaged rotation is that of its chord: the mean of w' over it.
    """
    beam = beam or Beam()
    roots = clamped_free_roots(modes)
    omega = roots**2 * np.sqrt(beam.bending_stiffness / (beam.mass_per_length * beam.length**4))
    ends = np.linspace(0.0, beam.length, frames + 1) if frames else np.array([0.0, beam.length])
    shape, slope = clamped_free_shapes(roots, ends, beam.length)
    mass = np.sqrt(beam.mass_per_length * beam.length)
    shape, slope = shape / mass, slope / mass
    mean_slope = np.diff(shape, axis=0) / np.diff(ends)[:, None]
    count = len(planes) * modes

    def displacement(w: FloatArray) -> FloatArray:
        result = np.zeros((len(w), 3, count))
        for k, plane in enumerate(planes):
            result[:, "xyz".index(plane), k :: 2 if len(planes) == 2 else 1] = w
        return result

    def rotation(w: FloatArray) -> FloatArray:
        result = np.zeros((len(w), 3, count))
        for k, plane in enumerate(planes):
            row, sign = (2, 1.0) if plane == "y" else (1, -1.0)
            result[:, row, k :: 2 if len(planes) == 2 else 1] = sign * w
        return result

    points = np.zeros((len(ends), 3))
    points[:, 0] = ends
    values: dict[str, object] = {
        "name": f"beam_{frames}",
        "angular_frequency": np.repeat(omega, len(planes)),
        "damping_ratio": np.full(count, damping),
        "interface_names": ("tip",),
        "interface_point": points[-1:],
        "interface_displacement": displacement(shape[-1:]),
        "interface_rotation": rotation(slope[-1:]),
        "interface_frame": np.array([frames - 1 if frames else GROUND]),
        "frame_names": tuple(f"segment_{k}" for k in range(frames)),
        "frame_parent": np.arange(frames) - 1,
        "joint_point": points[:frames],
        "joint_displacement": displacement(shape[:frames]),
        "joint_rotation": rotation(slope[:frames]),
        "frame_rotation": rotation(mean_slope[:frames]) if frames else np.zeros((0, 3, count)),
    }
    return ReducedBody(**(values | changes))  # type: ignore[arg-type]


def random_lumps(rng: np.random.Generator, frames: int, modes: int) -> LumpedMass:
    """Two lumps a frame, with turning inertia and curvature."""
    count = 2 * frames
    arms = 0.3 * rng.standard_normal((frames, 6, 3))
    square = np.einsum("sni,snj->sij", arms, arms)
    curvature = 0.1 * rng.standard_normal((count, 3, modes, modes))
    return LumpedMass(
        np.repeat(np.arange(frames), 2),
        rng.uniform(1.0, 6.0, count),
        rng.standard_normal((count, 3)),
        0.3 * rng.standard_normal((count, 3, modes)),
        np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(3) - square,
        0.1 * rng.standard_normal((frames, 3, modes)),
        curvature + curvature.swapaxes(2, 3),
    )


def body_of_everything(
    seed: int, modes: int = 5, frames: int = 4, interfaces: int = 2, free: bool = False
) -> ReducedBody:
    """A random tree with the data of every method; parents and carriers are random, the ground among them.

    Each frame carries two lumps.
    """
    rng = np.random.default_rng(seed)
    parents = tuple(int(rng.integers(GROUND, s)) for s in range(frames))
    carriers = tuple(int(s) for s in rng.integers(GROUND, frames, interfaces))
    body = random_body(seed, parents, carriers, modes)
    masses = Masses(
        rng.uniform(0.5, 2.0, frames),
        rng.standard_normal((frames, 3)),
        rng.standard_normal((frames, 3, modes)),
        np.arange(frames),
    )
    by_load = rng.standard_normal((6 * interfaces + 3, modes, modes))
    by_mode = 30.0 * rng.standard_normal((modes, modes, modes))
    inertia = random_lumps(rng, frames, modes)
    whole = WholeFrame(rng.uniform(-1.0, 1.0, 3), *rng.standard_normal((3, 3, modes)))
    body = replace(
        body,
        masses=masses,
        stiffness_by_load=by_load + by_load.transpose(0, 2, 1),
        stiffness_by_mode=by_mode + by_mode.transpose(0, 2, 1),
        inertia=inertia,
        whole=whole,
        frequency_spread=np.where(np.arange(modes) > modes // 2, 0.3, 0.0),
    )
    if free:
        body = _floating(body)
    body = with_second_order(body, 0.1)
    if free and body.second is not None:
        elastic = (np.arange(body.mode_count) >= body.rigid_count).astype(float)
        still = [part * np.outer(elastic, elastic) for part in (body.second.displacement, body.second.rotation)]
        still = [np.concatenate([0.0 * part[:1], part[1:]]) for part in still]
        body = replace(body, second=SecondOrder(*still))
    return with_membrane(body, 3.0)


def _floating(body: ReducedBody) -> ReducedBody:
    """The body with six rigid motions, which alone move and turn its first frame."""
    rigid, start, turn = 6, np.array(body.joint_displacement[0, :, :6]), np.array(body.frame_rotation[0, :, :6])
    omega = np.array(body.angular_frequency)
    omega[:rigid] = 0.0

    def moved(operator: FloatArray, point: FloatArray, frames: bool = False) -> FloatArray:
        result = np.array(operator)
        arm = point - body.joint_point[0]
        result[:, :, :rigid] = start + np.cross(turn[None], arm[:, :, None], axis=1)
        result[: int(frames), :, rigid:] = 0.0
        return result

    def turned(operator: FloatArray, frames: bool = False) -> FloatArray:
        result = np.array(operator)
        result[:, :, :rigid] = turn
        result[: int(frames), :, rigid:] = 0.0
        return result

    assert body.masses is not None
    assert body.inertia is not None
    elastic = (np.arange(body.mode_count) >= rigid).astype(float)
    inertia = replace(
        body.inertia,
        displacement=moved(body.inertia.displacement, body.inertia.point),
        sweep=body.inertia.sweep * elastic,
        curvature=body.inertia.curvature * np.outer(elastic, elastic),
    )
    return replace(
        body,
        angular_frequency=omega,
        floating=True,
        frame_parent=np.maximum(body.frame_parent, np.minimum(np.arange(body.frame_count) - 1, 0)),
        interface_frame=np.maximum(body.interface_frame, 0),
        joint_displacement=moved(body.joint_displacement, body.joint_point, True),
        joint_rotation=turned(body.joint_rotation),
        frame_rotation=turned(body.frame_rotation, True),
        interface_displacement=moved(body.interface_displacement, body.interface_point),
        interface_rotation=turned(body.interface_rotation),
        masses=replace(body.masses, displacement=moved(body.masses.displacement, body.masses.point)),
        inertia=inertia,
        # What balances a load is not known before.
        stiffness_by_load=None,
    )


def random_ties(body: ReducedBody, seed: int, count: int = 2) -> ReducedBody:
    """The body with springs between random frames, the last one to the ground, with second-order parts."""
    rng = np.random.default_rng(seed)
    ends = rng.integers(0, body.frame_count, (count, 2))
    ends[-1, 1] = GROUND
    moves = (ends >= 0)[:, :, None, None]
    ties = Ties(
        ends,
        rng.uniform(-1.0, 1.0, (count, 2, 3)),
        moves * rng.standard_normal((count, 2, 3, body.mode_count)),
        moves * rng.standard_normal((count, 2, 3, body.mode_count)),
        rng.uniform(50.0, 500.0, (count, 1)) * np.ones(3),
        rng.uniform(0.05, 0.3, (count, 1, 1)) * np.eye(3),
    )
    cut = replace(
        body, ties=ties, stiffness_by_load=None, stiffness_by_mode=None, inertia=None, whole=None, second=None
    )
    return with_second_order(cut, 0.1)


def source_of_judgement(body, method):
    """What a program says that its second opinion on stiffness comes from."""
    advice = read_image(compile_program(body, method)).arrays["advice"].tobytes().decode()
    return advice.split("\0")[2]


@contextmanager
def unsealed(path):
    """A modal file open to be altered; its seal comes off, so that readers look at its contents."""
    with h5py.File(path, "r+") as content:
        yield content
    with path.open("r+b") as file:
        file.write(bytes(modal_file._BLOCK))
