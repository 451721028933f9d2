"""Coupled FMUs: frequencies, balance, orders, stability, rollback. Masses are point masses integrated exactly."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root

from bodies import beam_body
from coupling_core import loads
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.tables import InterfaceTable
from flexfmu.files.outputs import progress_words
from flexfmu.fmu.package import package_fmu
from flexfmu.master.layout import Springs
from flexfmu.reduction.options import Basis
from references import BEAM

pytestmark = pytest.mark.slow

MARK = "RESULT "

# A mass on a spring of its own, exact under a load held over the step.
MASS = """
import ctypes
import math

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

# The library gives up a reference to this namespace that it only borrowed.
ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))

KNOWN = ("mass", "stiffness", "limit", "x0", "v0", "origin")
STATE = ("x", "v", "f", "h")


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.p = dict.fromkeys(KNOWN, 0.0) | {{"mass": 1.0, "limit": 1e300}}
        self.x, self.v, self.f = [0.0] * 3, [0.0] * 3, [0.0] * 3
        self.h, self.begun = 0.0, False
        for key in KNOWN:
            self.offer(key, lambda key=key: self.p[key], lambda x, key=key: self.p.update({{key: x}}))
        for i, axis in enumerate("xyz"):
            self.offer(f"tip.force.{{axis}}", lambda i=i: self.f[i], lambda x, i=i: self.push(i, x), "input")
            # As the difference of two places.
            get = lambda i=i: (self.p["origin"] + self.moved()[i]) - self.p["origin"]
            self.offer(f"tip.displacement.{{axis}}", get, None, "output")
            if {velocities}:
                self.offer(f"tip.velocity.{{axis}}", lambda i=i: self.v[i], None, "output")
        for i, row in enumerate(("ux", "uy", "uz", "rx", "ry", "rz") if {compliance} else ()):
            for j, column in enumerate(("fx", "fy", "fz", "mx", "my", "mz")):
                get = lambda i=i, j=j: self.given() if i == j < 3 else 0.0
                self.offer(f"tip.compliance.{{row}}.{{column}}", get, None, "local")

    def offer(self, name, getter, setter, causality="parameter"):
        variability = Fmi2Variability.fixed if causality == "parameter" else Fmi2Variability.continuous
        start = 0.0 if causality == "input" else None
        variable = Real(name, causality=Fmi2Causality[causality], variability=variability, start=start,
                        getter=getter, setter=setter or (lambda x: None))
        self.register_variable(variable, nested=False)

    def push(self, i, value):
        self.f[i] = value

    def moved(self):
        return self.x if self.begun else [self.p["x0"], 0.0, 0.0]

    def given(self):
        k, m = self.p["stiffness"], self.p["mass"]
        return (1.0 - math.cos(math.sqrt(k / m) * self.h)) / k if k else 0.5 * self.h**2 / m

    def exit_initialization_mode(self):
        self.begun, self.x, self.v = True, [self.p["x0"], 0.0, 0.0], [self.p["v0"], 0.0, 0.0]

    def do_step(self, time, h):
        if max(map(abs, self.f)) > self.p["limit"]:
            self.log(f"load beyond {{self.p['limit']}} N", self.status_discard(), "logStatusDiscard")
            return False
        k, m, self.h = self.p["stiffness"], self.p["mass"], h
        for i in range(3):
            x, v, f = self.x[i], self.v[i], self.f[i]
            if k:
                w = math.sqrt(k / m)
                c, s, r = math.cos(w * h), math.sin(w * h), f / k
                self.x[i], self.v[i] = r + (x - r) * c + v / w * s, v * c - (x - r) * w * s
            else:
                self.x[i], self.v[i] = x + v * h + 0.5 * f / m * h * h, v + f / m * h
        return True

    def status_discard(self):
        from pythonfmu.enums import Fmi2Status

        return Fmi2Status.discard

    def _get_fmu_state(self):
        return {{"h": self.h, "begun": self.begun}} | {{key: list(getattr(self, key)) for key in "xvf"}}

    def _set_fmu_state(self, state):
        for key, value in state.items():
            setattr(self, key, list(value) if isinstance(value, list) else value)
"""
BUILD = """
import sys
from pythonfmu.builder import FmuBuilder
FmuBuilder.build_FMU(sys.argv[1], dest=sys.argv[2], canGetAndSetFMUstate=sys.argv[3] == "True")
"""
# Couples one file after the other, as their names come in.
RUN = """
import json, sys
from pathlib import Path
from flexfmu.files.basics import FlexfmuError
from flexfmu.master import couple, read_coupling_file
from flexfmu.files.outputs import Reporter


class Words(Reporter):
    def __init__(self):
        self.said = []

    def warning(self, text):
        self.said.append(text)


for line in sys.stdin:
    words, error = Words(), None
    try:
        result = couple(read_coupling_file(Path(line.strip())), words)
    except FlexfmuError as caught:
        error, result = str(caught), getattr(caught, "result", None)
    columns = {} if result is None else {name: result[name].tolist() for name in result.names}
    times = [] if result is None else result.time.tolist()
    print("RESULT " + json.dumps({"error": error, "time": times, "columns": columns, "said": words.said}), flush=True)
"""
SEARCHED = os.pathsep.join(filter(None, [os.environ.get("PYTHONPATH"), str(Path(__file__).parents[1])]))
ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": SEARCHED}


def python(folder, code, *arguments):
    """Run Python in a process of its own, in a folder."""
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        cwd=folder,
        env=ENVIRONMENT,
    )


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """Masses without velocities, with them, with their compliance, and one that cannot save its state."""
    path = tmp_path_factory.mktemp("masses")
    for name, velocities, compliance in (
        ("mass", False, False),
        ("mass_v", True, False),
        ("mass_c", False, True),
        ("mass_vc", True, True),
        ("mass_s", False, False),
    ):
        script = path / f"{name}.py"
        script.write_text(MASS.format(name=name, velocities=velocities, compliance=compliance), encoding="utf-8")
        done = python(path, BUILD, script, path / f"{name}.fmu", name != "mass_s")
        assert (path / f"{name}.fmu").is_file(), done.stderr
    return path


class Run:
    """What a run gave."""

    def __init__(self, found):
        self.error, self.said, self.time = found["error"], found["said"], np.array(found["time"])
        self.columns = {name: np.array(values) for name, values in found["columns"].items()}

    def __getitem__(self, name):
        return self.columns[name]

    @property
    def iterations(self):
        return self.columns["master.iterations"][1:]


class Worker:
    """A process that couples; a run is judged by what it prints."""

    def __init__(self, folder):
        self.folder = folder
        with (folder / "errors.txt").open("w", encoding="utf-8") as errors:
            self.process = subprocess.Popen(
                [sys.executable, "-c", RUN],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                cwd=folder,
                env=ENVIRONMENT,
            )

    def __call__(self, text):
        """Couple what a TOML text says."""
        (self.folder / "coupling.toml").write_text(text, encoding="utf-8")
        self.process.stdin.write("coupling.toml\n")
        self.process.stdin.flush()
        for line in self.process.stdout:
            if line.startswith(MARK):
                return Run(json.loads(line[len(MARK) :]))
        raise AssertionError((self.folder / "errors.txt").read_text(encoding="utf-8"))

    def close(self):
        self.process.kill()
        self.process.communicate()


@pytest.fixture(scope="module")
def run(folder):
    """Couple what a TOML text says, in a process that lives as long as the module's tests."""
    worker = Worker(folder)
    yield worker
    worker.close()


def experiment(scheme, step, stop, **more):
    lines = [f'scheme = "{scheme}"', f"step = {float(step)!r}", f"stop = {float(stop)!r}"]
    lines += [f"{key} = {json.dumps(value)}" for key, value in more.items()]
    return "[experiment]\n" + "\n".join(lines) + "\n"


def fmu(name, file, **start):
    values = ", ".join(f'"{key}" = {json.dumps(value)}' for key, value in start.items())
    return f'[[fmu]]\nname = "{name}"\nfile = "{file}.fmu"\nstart = {{ {values} }}\n'


def spring(a, b=None, k=0.0, d=0.0):
    other = "" if b is None else f'b = "{b}"\n'
    zero = [0.0] * 3
    return f'[[spring]]\na = "{a}"\n{other}stiffness = {[float(k)] * 3 + zero}\ndamping = {[float(d)] * 3 + zero}\n'


# Two masses, each on a spring to the ground, joined by a third.

MASSES, OWN, JOINT, START = np.array([1.0, 2.0]), np.array([1000.0, 500.0]), 4000.0, 0.01


def pair(file="mass", joint=JOINT, damping=0.0, own=OWN):
    a = fmu("a", file, mass=MASSES[0], stiffness=own[0], x0=START)
    b = fmu("b", file, mass=MASSES[1], stiffness=own[1])
    return a + b + spring("a.tip", "b.tip", joint, damping)


def positions(found):
    return np.column_stack([found[f"{name}.tip.displacement.x"] for name in "ab"])


def exact(time, joint=JOINT, damping=0.0, own=OWN):
    """Displacements (T, 2) of the two masses in continuous time."""
    link = np.array([[1.0, -1.0], [-1.0, 1.0]])
    stiffness, damper = np.diag(own) + joint * link, damping * link
    system = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness / MASSES[:, None], -damper / MASSES[:, None]]])
    values, vectors = np.linalg.eig(system)
    weights = np.linalg.solve(vectors, np.array([START, 0.0, 0.0, 0.0], dtype=complex))
    return np.real((np.exp(values * np.asarray(time)[:, None]) * weights) @ vectors[:2].T)


def monolithic(steps, size, share=1.0, joint=JOINT):
    """Displacements of two free masses whose joint's force is held over each step, all in one linear solve."""
    x, v, held = np.array([START, 0.0]), np.zeros(2), np.array([-joint, joint])
    rows = [x]
    give = size**2 / (2.0 * MASSES) * held
    for _ in range(steps):
        far = x + size * v
        # s = (1 − share) (x_a − x_b) + share (x_a⁺ − x_b⁺), x⁺ = far + give s.
        strain = ((1.0 - share) * (x[0] - x[1]) + share * (far[0] - far[1])) / (1.0 - share * (give[0] - give[1]))
        x, v = far + give * strain, v + size / MASSES * held * strain
        rows.append(x)
    return np.array(rows)


def last_error(run, scheme, step, file="mass", damping=0.0, **more):
    found = run(experiment(scheme, step, 0.1, tolerance=1e-9, **more) + pair(file, damping=damping))
    assert found.error is None
    truth = exact(found.time, damping=damping)
    return np.max(np.abs(positions(found) - truth)[found.time > 0.05]) / START


@pytest.mark.parametrize(
    ("scheme", "more", "order"),
    [
        ("jacobi", {}, 1),
        ("gauss_seidel", {}, 1),
        ("iterated", {"held": "end"}, 1),
        ("iterated", {"held": "mean"}, 2),
    ],
    ids=["jacobi", "gauss_seidel", "end", "mean"],
)
def test_halving_the_step_divides_the_error_by_two_or_where_the_mean_is_held_by_four(run, scheme, more, order):
    coarse, fine = (last_error(run, scheme, step, **more) for step in (4e-4, 2e-4))
    assert coarse / fine == pytest.approx(2.0**order, rel=0.1)
    assert fine < (0.05 if order == 1 else 5e-4)


@pytest.mark.parametrize("scheme", ["gauss_seidel", "iterated"])
@pytest.mark.parametrize("file", ["mass", "mass_v"], ids=["differences", "velocities"])
def test_a_damper_works_from_velocities_and_from_differences(run, file, scheme):
    """Differences over one step, also of the body that has stepped already: over two of them the damper is double."""
    coarse, fine = (last_error(run, scheme, step, file, damping=20.0) for step in (4e-4, 2e-4))
    assert coarse / fine == pytest.approx(2.0, rel=0.15)
    assert fine < 0.05


def test_the_pair_swings_with_its_exact_frequency(run):
    # The slower of two modes, by the roots of the characteristic polynomial; the start is its shape.
    stiffness = np.diag(OWN) + JOINT * np.array([[1.0, -1.0], [-1.0, 1.0]])
    squares, shapes = np.linalg.eigh(stiffness / np.sqrt(np.outer(MASSES, MASSES)))
    shape = shapes[:, 0] / np.sqrt(MASSES)
    shape *= START / shape[0]
    period = 2.0 * np.pi / np.sqrt(squares[0])
    a = fmu("a", "mass", mass=MASSES[0], stiffness=OWN[0], x0=shape[0])
    b = fmu("b", "mass", mass=MASSES[1], stiffness=OWN[1], x0=shape[1])
    text = experiment("iterated", period / 400, period, held="mean", tolerance=1e-9)
    found = run(text + a + b + spring("a.tip", "b.tip", JOINT))
    np.testing.assert_allclose(positions(found)[-1], shape, rtol=1e-4)
    np.testing.assert_allclose(positions(found)[200], -shape, rtol=1e-4)


@pytest.mark.parametrize(("held", "share"), [("end", 1.0), ("mean", 0.5)])
@pytest.mark.parametrize("file", ["mass", "mass_c"], ids=["quasi-Newton", "compliance"])
@pytest.mark.parametrize("joint", [1e4, 1e9])
def test_the_iterated_scheme_gives_the_monolithic_answer(run, held, share, file, joint):
    text = experiment("iterated", 1e-3, 0.05, held=held, tolerance=1e-10)
    found = run(text + pair(file, joint, own=(0.0, 0.0)))
    assert found.error is None
    np.testing.assert_allclose(positions(found), monolithic(50, 1e-3, share, joint), rtol=0, atol=1e-9 * START)


# Stability.


def growth(found):
    """Factor of the amplitude of the relative motion per step, from the envelope of free masses."""
    relative = np.diff(positions(found), axis=1)[:, 0]
    half = len(relative) // 2
    return (np.max(np.abs(relative[half:])) / np.max(np.abs(relative[:half]))) ** (1.0 / half)


@pytest.mark.parametrize("kappa", [0.1, 1.0])
def test_jacobi_grows_by_the_square_root_of_one_plus_half_kappa_a_step(run, kappa):
    # κ = h² k (1/m_a + 1/m_b): the determinant of a step of the relative motion is 1 + κ/2.
    joint = kappa / 1e-6 / np.sum(1.0 / MASSES)
    found = run(experiment("jacobi", 1e-3, 0.2) + pair("mass", joint, own=(0.0, 0.0)))
    relative = np.diff(positions(found), axis=1)[:, 0]
    # x₊ = trace x − determinant x₋
    (_, determinant), *_ = np.linalg.lstsq(np.column_stack([relative[1:-1], -relative[:-2]]), relative[2:], rcond=None)
    assert np.sqrt(determinant) == pytest.approx(np.sqrt(1.0 + 0.5 * kappa), rel=1e-6)
    # Warned of, and stopped when the motion is some ten times what it was.
    assert "the coupling itself fed the motion" in found.said[0]
    assert "the motion grows without bound" in found.error
    assert 8.0 < np.max(np.abs(relative)) / START < 50.0


def test_a_coupling_that_diverges_from_the_first_step_is_stopped_after_a_few(run):
    found = run(experiment("jacobi", 1e-3, 0.2) + pair("mass", 1e9, own=(0.0, 0.0)))
    assert "the motion grows without bound" in found.error
    assert len(found.time) < 12


def test_numerical_damping_of_the_iterated_scheme_is_told(run):
    joint = 0.1 / 1e-6 / np.sum(1.0 / MASSES)
    for held, told in (("end", True), ("mean", False)):
        found = run(experiment("iterated", 1e-3, 0.2, held=held) + pair("mass", joint, own=(0.0, 0.0)))
        assert found.error is None
        assert any("the coupling itself damped the motion" in said for said in found.said) == told


@pytest.mark.parametrize("kappa", [0.1, 1.0, 100.0, 1e4])
def test_the_iterated_scheme_does_not_grow_and_with_the_mean_held_keeps_the_energy(run, kappa):
    joint = kappa / 1e-6 / np.sum(1.0 / MASSES)
    damped = run(experiment("iterated", 1e-3, 0.2, tolerance=1e-9) + pair("mass", joint, own=(0.0, 0.0)))
    assert growth(damped) < 1.0
    text = experiment("iterated", 1e-3, 0.2, held="mean", tolerance=1e-9)
    kept = run(text + pair("mass_v", joint, own=(0.0, 0.0)))
    speed = np.column_stack([kept[f"{name}.tip.velocity.x"] for name in "ab"])
    energy = 0.5 * speed**2 @ MASSES + 0.5 * joint * np.diff(positions(kept), axis=1)[:, 0] ** 2
    np.testing.assert_allclose(energy, energy[0], rtol=1e-5)


def test_explicit_coupling_is_warned_of_where_the_compliance_tells(run):
    stiff = pair("mass_c", 1e6, own=(0.0, 0.0))
    for scheme in ("jacobi", "gauss_seidel"):
        said = run(experiment(scheme, 1e-3, 0.002) + stiff).said[0]
        # κ/2 = h² k (1/m_a + 1/m_b) / 2.
        assert "0.75-fold" in said
        assert '"iterated"' in said
        assert run(experiment(scheme, 1e-4, 0.0002) + stiff).said == []
    assert run(experiment("iterated", 1e-3, 0.002) + stiff).said == []


@pytest.mark.parametrize(("file", "fold"), [("mass_vc", "1.5-fold"), ("mass_c", "0.75-fold")])
def test_a_damper_answers_by_the_velocity_at_the_step_s_end_twice_as_much_as_by_the_mean_one(run, file, fold):
    """A load held over the step h turns h/m of it into velocity at its end, half of that into the mean one."""
    damper = 1.0 / 1e-3
    text = pair(file, 0.0, damping=damper, own=(0.0, 0.0))
    # d h (1/m_a + 1/m_b), or half of it.
    assert damper * 1e-3 * np.sum(1.0 / MASSES) == pytest.approx(1.5)
    assert fold in run(experiment("jacobi", 1e-3, 0.002) + text).said[0]


@pytest.mark.parametrize(
    ("scheme", "held", "sign"),
    [("jacobi", "end", 1), ("gauss_seidel", "end", 1), ("iterated", "end", -1), ("iterated", "mean", 0)],
)
def test_the_energy_that_the_coupling_creates_is_what_the_masses_and_the_spring_gain(run, scheme, held, sign):
    text = experiment(scheme, 1e-3, 0.2, held=held, tolerance=1e-9) + pair("mass_v", JOINT, own=(0.0, 0.0))
    found = run(text)
    speed = np.column_stack([found[f"{name}.tip.velocity.x"] for name in "ab"])
    energy = 0.5 * speed**2 @ MASSES + 0.5 * JOINT * np.diff(positions(found), axis=1)[:, 0] ** 2
    np.testing.assert_allclose(found["master.created_energy"], energy - energy[0], rtol=0, atol=1e-10 * energy[0])
    assert np.sign(np.round(found["master.created_energy"][-1] / energy[0], 6)) == sign
    assert any("the coupling itself fed the motion" in said for said in found.said) == (sign > 0)


@pytest.mark.parametrize("file", ["mass", "mass_v"])
def test_a_coupling_whose_mean_is_held_creates_nothing_beside_what_its_damper_takes(run, file):
    """What masses and springs lose is the damper's."""
    found = run(experiment("iterated", 1e-3, 0.1, held="mean", tolerance=1e-9) + pair(file, damping=8.0))
    ahead = exact([0.1, 0.1 + 1e-7], damping=8.0)
    speed, strain = np.diff(ahead, axis=0)[0] / 1e-7, ahead[0]
    energy = 0.5 * speed**2 @ MASSES + 0.5 * OWN @ strain**2 + 0.5 * JOINT * np.diff(strain)[0] ** 2
    lost = 0.5 * (OWN[0] + JOINT) * START**2 - energy
    assert lost > 0.3 * 0.5 * JOINT * START**2
    assert np.max(np.abs(found["master.created_energy"])) < 1e-6 * lost


# Iterations.


def test_with_compliance_a_linear_coupling_settles_at_the_second_iteration(run):
    for joint in (1e4, 1e7, 1e10):
        plain, told = (run(experiment("iterated", 1e-3, 0.03) + pair(file, joint)) for file in ("mass", "mass_c"))
        assert np.max(told.iterations) <= 2
        assert np.max(plain.iterations) > 2
        np.testing.assert_allclose(positions(told), positions(plain), atol=2e-5 * START)


@pytest.mark.parametrize("scheme", [{"held": "end"}, {"held": "mean"}], ids=["end", "mean"])
def test_with_compliance_a_linear_coupling_by_connections_settles_at_the_second_iteration(run, scheme):
    links = "".join(
        f'[[connection]]\nfrom = "{source}.tip.displacement.x"\nto = "{target}.tip.force.x"\n'
        f"factor = {JOINT if source != target else -JOINT}\n"
        for source in "ab"
        for target in "ab"
    )
    joined = pair("mass_c").partition("[[spring]]")[0] + links
    found = run(experiment("iterated", 0.01, 0.2, **scheme) + joined)
    assert found.error is None
    assert np.max(found.iterations) == 2
    # As by the spring that the connections stand for, where quasi-Newton finds the way.
    expected = run(experiment("iterated", 0.01, 0.2, tolerance=1e-9, **scheme) + pair("mass"))
    np.testing.assert_allclose(positions(found), positions(expected), atol=1e-6 * START)


@pytest.mark.parametrize("file", ["mass", "mass_c"])
def test_loads_that_grow_from_zero_settle_however_far_from_the_origin_the_masses_are(run, folder, file):
    """A place 300 m away is known to 6e-14 m, the spring's first load to 6e-7 N, which is all but nothing as yet."""
    (folder / "slow.csv").write_text("time,tip.force.x\n0,0\n1,1\n", encoding="utf-8")
    far = "".join(
        fmu(name, file, mass=1.0, origin=300.0) + more for name, more in (("a", 'input = "slow.csv"\n'), ("b", ""))
    )
    found = run(experiment("iterated", 1e-3, 0.05, held="mean") + far + spring("a.tip", "b.tip", 1e7))
    assert found.error is None
    # Both masses together: x = t³ / 6 / 2 kg.
    assert np.mean(positions(found)[-1]) == pytest.approx(0.05**3 / 12.0, rel=1e-3)


def test_what_rests_needs_no_iterations(run):
    a, b = fmu("a", "mass", mass=1.0), fmu("b", "mass", mass=1.0)
    found = run(experiment("iterated", 1e-3, 0.01) + a + b + spring("a.tip", "b.tip", 1e9))
    np.testing.assert_array_equal(found.iterations, 1)
    np.testing.assert_array_equal(positions(found), 0.0)


def test_what_is_not_coupled_is_stepped_once(run):
    alone = run(experiment("iterated", 1e-3, 0.05) + fmu("a", "mass_s", mass=1.0, stiffness=1000.0, x0=START))
    np.testing.assert_array_equal(alone.iterations, 1)
    expected = START * np.cos(np.sqrt(1000.0) * alone.time)
    np.testing.assert_allclose(alone["a.tip.displacement.x"], expected, atol=1e-12)


def test_inputs_that_do_not_settle_stop_the_run_and_are_named(run):
    found = run(experiment("iterated", 1e-3, 0.1, max_iterations=1) + pair(joint=1e7))
    assert "do not settle in the step from 0 s" in found.error
    assert "a.tip.force.x" in found.error
    assert len(found.time) == 1


def test_a_step_refused_at_trial_inputs_is_tried_with_smaller_changes(run):
    # The first trial asks for far more than the load that settles.
    limit = 2000.0
    a = fmu("a", "mass", mass=1.0, v0=1.0, limit=limit)
    b = fmu("b", "mass", mass=1.0, limit=limit)
    text = experiment("iterated", 1e-3, 0.01, relaxation=1.0) + a + b + spring("a.tip", "b.tip", 1e7)
    found = run(text)
    free = run(text.replace(f'"limit" = {limit}', '"limit" = 1e300'))
    assert found.error is None
    np.testing.assert_allclose(positions(found), positions(free), rtol=1e-5, atol=1e-12)


# Balance.


def momentum(found):
    return np.column_stack([found[f"{name}.tip.velocity.x"] for name in "ab"]) @ MASSES


def test_a_spring_pulls_both_masses_alike(run):
    start = fmu("a", "mass_v", mass=MASSES[0], v0=1.0) + fmu("b", "mass_v", mass=MASSES[1])
    link = spring("a.tip", "b.tip", 1e4, 3.0)
    for scheme in ("jacobi", "iterated"):
        found = run(experiment(scheme, 1e-3, 0.05) + start + link)
        np.testing.assert_allclose(momentum(found), MASSES[0], rtol=1e-12)
    # One after the other they feel the spring at different moments.
    staggered = run(experiment("gauss_seidel", 1e-3, 0.05) + start + link)
    assert np.max(np.abs(momentum(staggered) - MASSES[0])) > 1e-3


def test_a_spring_to_the_ground_is_a_spring_of_the_mass(run):
    alone = fmu("a", "mass", mass=1.0, x0=START) + spring("a.tip", None, 1000.0)
    found = run(experiment("iterated", 4e-4, 0.1, held="mean", tolerance=1e-9) + alone)
    expected = START * np.cos(np.sqrt(1000.0) * found.time)
    np.testing.assert_allclose(found["a.tip.displacement.x"], expected, atol=1e-4 * START)


# Connections and tables.


def connection(source, target, factor):
    return f'[[connection]]\nfrom = "{source}"\nto = "{target}"\nfactor = {factor}\n'


@pytest.mark.parametrize("scheme", ["jacobi", "gauss_seidel", "iterated"])
def test_connections_add_up_to_the_same_as_a_spring(run, scheme):
    masses = fmu("a", "mass", mass=1.0, x0=START) + fmu("b", "mass", mass=2.0)
    head = experiment(scheme, 1e-3, 0.05, tolerance=1e-10)
    by_spring = run(head + masses + spring("a.tip", "b.tip", JOINT))
    links = [
        connection(f"{giver}.tip.displacement.x", f"{taker}.tip.force.x", JOINT if giver != taker else -JOINT)
        for giver in "ab"
        for taker in "ab"
    ]
    by_links = run(head + masses + "".join(links))
    np.testing.assert_allclose(positions(by_links), positions(by_spring), rtol=0, atol=1e-10 * START)


def test_a_table_is_held_from_the_beginning_of_each_step_and_jumps_count_from_their_time(run, folder):
    (folder / "loads.csv").write_text("time,tip.force.x\n0,0\n0.01,10\n0.01,4\n0.02,4\n", encoding="utf-8")
    text = fmu("a", "mass", mass=1.0) + 'input = "loads.csv"\n'
    found = run(experiment("jacobi", 1e-3, 0.03) + text + '[output]\nvariables = ["a.tip.force.x"]\n')
    expected = np.where(np.arange(30) < 10, np.arange(30) * 1.0, 4.0)
    np.testing.assert_allclose(found["a.tip.force.x"][1:], expected, atol=1e-6)


def test_a_table_whose_mean_is_held_gives_two_joined_masses_its_impulse(run, folder):
    """Their momentum is the area under the table, jump included: what the spring between them does adds nothing."""
    (folder / "impulse.csv").write_text("time,tip.force.x\n0,0\n0.01,10\n0.01,4\n0.02,-3\n", encoding="utf-8")
    a, b = fmu("a", "mass_v", mass=MASSES[0]), fmu("b", "mass_v", mass=MASSES[1])
    text = a + 'input = "impulse.csv"\n' + b + spring("a.tip", "b.tip", JOINT)
    found = run(experiment("iterated", 1e-3, 0.02, held="mean", tolerance=1e-9) + text)
    momentum = sum(m * found[f"{name}.tip.velocity.x"] for m, name in zip(MASSES, "ab", strict=True))
    time = found.time
    expected = np.where(time < 0.01 + 1e-9, 500.0 * time**2, 0.05 + 4.0 * (time - 0.01) - 350.0 * (time - 0.01) ** 2)
    np.testing.assert_allclose(momentum, expected, atol=1e-9)


def test_a_constant_start_load_and_a_springs_load_add_up(run):
    text = fmu("a", "mass", mass=1.0, **{"tip.force.x": 10.0}) + spring("a.tip", None, 1000.0)
    found = run(experiment("iterated", 1e-3, 0.1, held="mean", tolerance=1e-9) + text)
    expected = 0.01 * (1.0 - np.cos(np.sqrt(1000.0) * found.time))
    np.testing.assert_allclose(found["a.tip.displacement.x"], expected, atol=2e-5)


def test_results_keep_every_nth_point_and_the_last(run):
    found = run(experiment("jacobi", 1e-3, 0.01) + pair() + "[output]\nevery = 4\n")
    np.testing.assert_allclose(found.time, [0.0, 0.004, 0.008, 0.01])


# Failures.


@pytest.mark.parametrize("scheme", ["jacobi", "gauss_seidel", "iterated"])
def test_a_step_that_an_fmu_refuses_stops_the_run_with_its_words_and_keeps_what_came_before(run, folder, scheme):
    (folder / "ramp.csv").write_text("time,tip.force.x\n0,0\n0.1,100\n", encoding="utf-8")
    text = fmu("a", "mass", mass=1.0) + fmu("b", "mass", mass=1.0, limit=20.5) + 'input = "ramp.csv"\n'
    found = run(experiment(scheme, 1e-3, 0.1) + text + spring("a.tip", "b.tip", 1.0))
    assert "fmu 'b' refused the step from 0.021 s" in found.error
    assert "load beyond 20.5 N" in found.error
    np.testing.assert_allclose(found.time[-1], 0.021)
    assert len(found.time) == 22


def test_an_fmu_without_saved_states_is_refused_for_the_iterated_scheme_only(run):
    found = run(experiment("iterated", 1e-3, 0.01) + pair("mass_s"))
    assert "fmu 'a' (mass_s.fmu) cannot save its state" in found.error
    assert '"jacobi"' in found.error
    assert run(experiment("jacobi", 1e-3, 0.01) + pair("mass_s")).error is None
    # One that nothing is fed back to need not.
    lone = fmu("c", "mass_s", mass=1.0)
    assert run(experiment("iterated", 1e-3, 0.01) + pair() + lone).error is None


# Flexible bodies.

BEAM_STEP, PUSH = 5e-4, {"tip.force.y": 4000.0, "tip.force.z": 1500.0, "tip.moment.x": 200.0}
BUSHING = [2e7, 1e7, 3e7, 1e5, 2e5, 1e5]


def bushing(a, b=None, stiffness=BUSHING):
    other = "" if b is None else f'b = "{b}"\n'
    return f'[[spring]]\na = "{a}"\n{other}stiffness = {stiffness}\n'


@pytest.fixture(scope="module")
def beams(folder):
    """Two cantilevers of different modes, also with their compliance, and their bodies."""
    bodies = beam_body(3, modes=3, damping=0.01), beam_body(2, modes=2, damping=0.02)
    for name, body in zip(("long", "short"), bodies, strict=True):
        package_fmu(body, folder / f"{name}.fmu")
        package_fmu(replace(body, compliance_interfaces=("tip",)), folder / f"{name}_c.fmu")
    return tuple(FlexibleBody(body) for body in bodies)


def beam_pair(held="end", scheme="iterated", size=BEAM_STEP, stop=20 * BEAM_STEP, **more):
    names = [
        f"{name}.tip.{q}.{axis}"
        for q in ("displacement", "rotation", "force", "moment")
        for name in "ab"
        for axis in "xyz"
    ]
    text = experiment(scheme, size, stop, held=held, **more) + fmu("a", "long", **PUSH) + fmu("b", "short")
    return text + bushing("a.tip", "b.tip") + f"[output]\nvariables = {json.dumps(names)}\n"


def vectors(found, quantity):
    """Values (T, 2, 3) of a vector at both tips."""
    return np.stack([np.stack([found[f"{n}.tip.{quantity}.{x}"] for x in "xyz"], axis=-1) for n in "ab"], axis=1)


def test_coupled_beams_move_as_by_one_solve_for_both(run, beams):
    found = run(beam_pair(tolerance=1e-8))
    assert found.error is None
    joint = Springs(np.array([0]), np.array([1]), np.array([BUSHING]), np.zeros((1, 6)), np.eye(3)[None])
    still, scale = np.zeros((2, 6)), 1e3
    push = np.array([0.0, *list(PUSH.values())[:2], PUSH["tip.moment.x"], 0.0, 0.0])
    states, wrench = [beam.rest() for beam in beams], np.zeros((2, 6))

    def stepped(held):
        inputs = scale * held.reshape(2, 6) + np.stack([push, np.zeros(6)])
        return [
            beam.step(state, {"tip": load}, BEAM_STEP) for beam, state, load in zip(beams, states, inputs, strict=True)
        ]

    def motion(after):
        responses = [beam.response(state) for beam, state in zip(beams, after, strict=True)]
        return np.stack([np.concatenate([r.displacement[0], r.rotation[0]]) for r in responses])

    for number in range(1, 11):
        solved = root(
            lambda held: loads(joint, motion(stepped(held)), still).ravel() / scale - held,
            wrench.ravel() / scale,
            tol=1e-11,
        )
        wrench = scale * solved.x.reshape(2, 6)
        states = stepped(solved.x)
        at = np.concatenate([vectors(found, "displacement")[number], vectors(found, "rotation")[number]], axis=-1)
        np.testing.assert_allclose(at, motion(states), rtol=0, atol=1e-8)
    assert np.max(np.abs(motion(states))) > 0.01


@pytest.mark.parametrize("held", ["end", "mean"])
@pytest.mark.usefixtures("beams")
def test_the_loads_of_a_bushing_balance(run, held):
    found = run(beam_pair(held, tolerance=1e-7))
    push = np.array([[0.0, 4000.0, 1500.0], [0.0, 0.0, 0.0]])
    force, moment = vectors(found, "force")[1:] - push, vectors(found, "moment")[1:] - [[200.0, 0.0, 0.0], [0.0] * 3]
    assert np.max(np.abs(force)) > 1000.0
    np.testing.assert_allclose(np.sum(force, axis=1), 0.0, atol=1e-9 * np.max(np.abs(force)))
    if held == "end":
        # About a point, with the arms of the step's end; loads are at the tolerance of the iteration from those there.
        arms = vectors(found, "displacement")[1:]
        total = np.sum(moment + np.cross(arms, force), axis=1)
        np.testing.assert_allclose(total, 0.0, atol=1e-5 * np.max(np.abs(moment)))


@pytest.mark.usefixtures("beams")
def test_a_stiff_bushing_holds_bodies_together_where_explicit_coupling_grows_without_sense(run):
    stiff = [1e9] * 3 + [1e7] * 3
    found = run(beam_pair().replace(str(BUSHING), str(stiff)))
    assert found.error is None
    assert np.mean(found.iterations) < 12
    gap = vectors(found, "displacement")
    assert np.max(np.abs(gap[:, 0] - gap[:, 1])) < 1e-3 * np.max(np.abs(gap))
    # Explicitly the loads grow until they mean nothing, or until a body refuses them.
    explicit = run(beam_pair(scheme="jacobi").replace(str(BUSHING), str(stiff)))
    refused = explicit.error is not None and "refused the step" in explicit.error
    assert refused or np.max(np.abs(vectors(explicit, "force"))) > 100.0 * np.max(np.abs(vectors(found, "force")))


def told(text):
    """The same with the compliance of both beams."""
    return text.replace("long.fmu", "long_c.fmu").replace("short.fmu", "short_c.fmu")


@pytest.mark.usefixtures("beams")
@pytest.mark.parametrize("held", ["end", "mean"])
def test_with_compliance_bodies_need_fewer_iterations_for_the_same_motion(run, held):
    stiff = beam_pair(held).replace(str(BUSHING), str([1e9] * 3 + [1e7] * 3))
    plain, fewer = run(stiff), run(told(stiff))
    assert np.mean(fewer.iterations) < 0.7 * np.mean(plain.iterations)
    size = np.max(np.abs(vectors(plain, "displacement")))
    np.testing.assert_allclose(vectors(fewer, "displacement"), vectors(plain, "displacement"), atol=1e-5 * size)


@pytest.mark.usefixtures("beams")
def test_with_compliance_bodies_settle_at_the_second_iteration_where_a_step_is_nearly_linear(run):
    found = run(told(beam_pair(size=0.1 * BEAM_STEP, stop=2 * BEAM_STEP)))
    assert np.mean(found.iterations) < 2.2
    assert np.max(found.iterations) <= 3


def test_connections_reach_a_static_start(run, beams):
    load = '[[connection]]\nfrom = "m.tip.displacement.x"\nto = "a.tip.force.y"\nfactor = 1e5\n'
    bodies = fmu("m", "mass", mass=1.0, x0=START) + fmu("a", "long", initialization="static")
    found = run(experiment("jacobi", 1e-3, 0.01) + bodies + load)
    state = beams[0].static({"tip": (0.0, 1e5 * START, 0.0)})
    expected = beams[0].response(state).displacement[0, 1]
    np.testing.assert_allclose(found["a.tip.displacement.y"], expected, rtol=1e-9)


@pytest.mark.usefixtures("beams")
def test_a_status_that_is_no_failure_is_told_once_and_the_run_goes_on(run):
    text = beam_pair().replace('"tip.moment.x"', '"watch.rotation.limit" = 1e-4, "tip.moment.x"')
    found = run(text)
    assert found.error is None
    (status,) = (said for said in found.said if "status.code" in said)
    assert status.startswith("a: status.code is 2 from 0.0005 s on")
    # Of the trials in between nothing is said.
    (words,) = (said for said in found.said if "beyond the limit" in said)
    assert words.startswith("a: material turns by")


@pytest.mark.usefixtures("beams")
def test_the_same_coupling_gives_the_same_bits(run):
    first, second = run(beam_pair()), run(beam_pair())
    for name, values in first.columns.items():
        np.testing.assert_array_equal(second[name], values)


# Free bodies.

HINGE, SOFTER_HINGE, WELD = [1e8] * 3 + [1e6, 1e6, 0.0], [1e6] * 3 + [1e4, 1e4, 0.0], [1e6] * 3 + [1e5] * 3


@pytest.fixture(scope="module")
def rods(folder, bodies):
    """The clamped beam without its clamp, with and without the compliance of its ends; its mass (kg) and length (m)."""
    reduction = bodies.config(BEAM).reduction.model_copy(update={"basis": Basis.CRAIG_BAMPTON, "modes": 8})
    ends = [InterfaceTable(name="root", nodes="ROOT"), InterfaceTable(name="tip", nodes="TIP")]
    model = bodies.beam(free=True, support=[], interface=ends, reduction=reduction, frames=4).model
    package_fmu(model, folder / "rod.fmu")
    package_fmu(replace(model, compliance_interfaces=("root", "tip")), folder / "rod_c.fmu")
    return 7850.0 * 0.03**2, 1.0


def swing(force, mass, length, stop):
    """Angle (rad) of a rigid rod on a hinge at one end, under a force of fixed direction at the other."""
    inertia = mass * length**2 / 3.0
    found = solve_ivp(lambda _, y: [y[1], force * length * np.cos(y[0]) / inertia], (0.0, stop), [0.0, 0.0], rtol=1e-9)
    return found.y[0, -1]


@pytest.mark.parametrize(("file", "most"), [("rod", 20), ("rod_c", 3)], ids=["quasi-Newton", "compliance"])
def test_a_free_rod_on_a_hinge_of_springs_swings_like_a_rigid_one(run, rods, file, most):
    rod = fmu("a", file, **{"tip.force.y": 100.0}) + bushing("a.root", None, HINGE)
    found = run(experiment("iterated", 2e-3, 0.3, held="mean") + rod)
    assert found.error is None
    expected = swing(100.0, *rods, 0.3)
    assert expected > 1.5
    x, y = (found[f"a.tip.displacement.{axis}"][-1] for axis in "xy")
    assert np.arctan2(y, rods[1] + x) == pytest.approx(expected, rel=1e-3)
    assert np.max(found.iterations) <= most


def test_compliance_between_interfaces_settles_stiff_joints_and_long_steps(run, rods):  # noqa: ARG001
    stiff, turning = 1e8, [1e7] * 3
    pair_of_rods = fmu("a", "rod_c") + fmu("b", "rod_c", **{"tip.force.y": 200.0})
    joints = bushing("a.root", None, HINGE) + bushing("b.root", "a.tip", [stiff] * 3 + turning)
    found = run(experiment("iterated", 2e-3, 0.1, held="mean") + pair_of_rods + joints)
    assert found.error is None
    assert np.max(found.iterations) <= 5


@pytest.mark.parametrize("file", ["rod", "rod_c"], ids=["quasi-Newton", "compliance"])
def test_two_rods_joined_by_springs_swing_far_as_one_of_twice_the_length(run, rods, file):
    # The joint's axes turn with the first rod, by more than a radian.
    pair_of_rods = fmu("a", file) + fmu("b", file, **{"tip.force.y": 200.0})
    joints = bushing("a.root", None, SOFTER_HINGE) + bushing("b.root", "a.tip", WELD)
    found = run(experiment("iterated", 1e-3, 0.36, held="mean") + pair_of_rods + joints)
    assert found.error is None
    mass, length = rods
    expected = swing(200.0, 2.0 * mass, 2.0 * length, 0.36)
    assert expected > 1.0
    x, y = (found[f"b.tip.displacement.{axis}"][-1] for axis in "xy")
    assert np.arctan2(y, 2.0 * length + x) == pytest.approx(expected, rel=1e-2)
    gap = [found[f"a.tip.displacement.{axis}"] - found[f"b.root.displacement.{axis}"] for axis in "xyz"]
    assert np.max(np.abs(gap)) < 2e-3


ROLLBACK = """
import json, sys
from pathlib import Path
from coupling_core import Driven
from flexfmu.master import read_coupling_file
from flexfmu.master.wiring import wire

wiring = wire(read_coupling_file(Path(sys.argv[1])))
one = Driven(wiring)
for number in range(3):
    one.step(number * 1e-3, 1e-3)
one.save()
before = one.give()
ends = []
for load in (100.0, -5e3, 100.0, 7.0, 100.0):
    one.take(0.0 * wiring.base + load)
    one.step(3e-3, 1e-3)
    ends.append(one.give())
    one.restore()
    assert one.give() == before
one.close()
print("RESULT " + json.dumps(ends), flush=True)
"""


@pytest.mark.parametrize("file", ["mass_v", "long"])
@pytest.mark.usefixtures("beams")
def test_a_step_taken_back_and_repeated_gives_the_same_bits(folder, file):
    stiffness = [1.0] * 3 + [0.0] * 3
    (folder / "rollback.toml").write_text(
        experiment("iterated", 1e-3, 1.0) + fmu("a", file) + bushing("a.tip", None, stiffness), encoding="utf-8"
    )
    done = python(folder, ROLLBACK, "rollback.toml")
    lines = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    assert lines, done.stderr
    first, other, second, _, third = json.loads(lines[-1][len(MARK) :])
    assert first == second == third
    assert first != other


HOLD = """
import json, sys
from pathlib import Path
from coupling_core import Driven
from flexfmu.master import read_coupling_file
from flexfmu.master.wiring import wire

wiring = wire(read_coupling_file(Path(sys.argv[1])))
one = Driven(wiring)
one.save()

def tried(load):
    one.take(0.0 * wiring.base + load)
    one.step(0.0, 2e-3)
    found = one.tried, one.give()
    one.restore(hold=True)
    return found

def fresh(load):
    one.save()
    return tried(load)

# Two loads next to each other, of which one needs more internal steps than the other.
few, many = 1.0, 2e4
while many - few > 1e-9 * few:
    middle = 0.5 * (few + many)
    few, many = (middle, many) if fresh(middle)[0] == fresh(1.0)[0] else (few, middle)
first, second = fresh(few), fresh(many)
one.save()
repeated = [tried(many), tried(few)]
one.save()
after = tried(few)
one.close()
print("RESULT " + json.dumps([first, second, repeated, after]), flush=True)
"""


@pytest.mark.usefixtures("beams")
def test_tries_of_a_step_answer_alike_to_loads_that_are_nearly_alike(folder):
    """Where one try takes more internal steps than another, the motion would jump by the error of an internal step."""
    (folder / "hold.toml").write_text(
        experiment("iterated", 2e-3, 1.0) + fmu("a", "long") + bushing("a.tip", None, [1.0] * 6), encoding="utf-8"
    )
    done = python(folder, HOLD, "hold.toml")
    lines = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    assert lines, done.stderr
    first, second, (many, few), after = json.loads(lines[-1][len(MARK) :])
    apart = np.max(np.abs(np.subtract(first[1], second[1]))) / np.max(np.abs(first[1]))
    assert second[0] > first[0]
    assert apart > 1e-7
    assert many == second
    assert few[0] == second[0]
    np.testing.assert_allclose(few[1], many[1], atol=1e-8 * np.max(np.abs(many[1])))
    # The next step is free again.
    assert after == first


# Files.

WRITE = """
import sys
from pathlib import Path
from flexfmu.files.basics import FlexfmuError
from flexfmu.master import run
from flexfmu.files.console import ConsoleReporter

try:
    run(Path(sys.argv[1]), Path(sys.argv[2]), ConsoleReporter())
    print("RESULT done", flush=True)
except FlexfmuError as error:
    print("RESULT " + str(error).replace(chr(10), " | "), flush=True)
"""


def write(folder, text, target):
    (folder / "coupling.toml").write_text(text, encoding="utf-8")
    done = python(folder, WRITE, "coupling.toml", target)
    lines = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    assert lines, done.stderr
    return lines[-1][len(MARK) :], done.stderr


def test_a_run_writes_its_results_and_says_how_many_iterations_it_took(folder):
    text = experiment("iterated", 1e-3, 0.05) + pair("mass_c")
    assert write(folder, text, "motion.csv")[0] == "done"
    said, shown = write(folder, text, "motion.h5")
    assert said == "done"
    assert "iterations a step" in shown
    header, *rows = (folder / "motion.csv").read_text(encoding="utf-8").splitlines()
    assert header.startswith("time [s],a.tip.displacement.x,")
    assert header.endswith(",master.iterations,master.created_energy [J]")
    with h5py.File(folder / "motion.h5") as file:
        assert len(file["time"]) == len(rows) == 51
        np.testing.assert_allclose(file["time"][:], [float(row.split(",")[0]) for row in rows], rtol=1e-11)
    assert not list(folder.glob("motion.partial*"))


def test_a_run_that_stops_leaves_an_earlier_result_alone_and_its_own_beside_it(folder):
    (folder / "kept.csv").write_text("what was there", encoding="utf-8")
    (folder / "ramp.csv").write_text("time,tip.force.x\n0,0\n0.1,100\n", encoding="utf-8")
    text = experiment("jacobi", 1e-3, 0.1) + fmu("b", "mass", mass=1.0, limit=20.5) + 'input = "ramp.csv"\n'
    said, _ = write(folder, text, "kept.csv")
    assert "fmu 'b' refused the step from 0.021 s" in said
    assert "kept.partial.csv" in said
    assert (folder / "kept.csv").read_text(encoding="utf-8") == "what was there"
    assert len((folder / "kept.partial.csv").read_text(encoding="utf-8").splitlines()) == 23


INTERRUPTED = """
import os, signal, sys, threading
from flexfmu.commands import cli
from flexfmu.files.console import ConsoleReporter

# Jobs in the background are started deaf to it.
signal.signal(signal.SIGINT, signal.default_int_handler)
told = ConsoleReporter.counted

# Presses Ctrl-C from outside once ten steps are done, so that it comes amid any code.
def counted(self, title, total, unit=""):
    from contextlib import contextmanager

    @contextmanager
    def wrapped():
        with told(self, title, total, unit) as tell:
            threads = []

            def heard(done):
                tell(done)
                if done > 0.0095 and not threads:
                    threads.append(threading.Thread(target=os.kill, args=(os.getpid(), signal.SIGINT)))
                    threads[0].start()

            yield heard

    return wrapped()


ConsoleReporter.counted = counted
sys.argv = ["flexfmu", "couple", "coupling.toml", "--output", "ended.csv"]
cli.app()
"""


def test_ctrl_c_ends_a_coupling_between_two_steps_and_keeps_the_motion_so_far(folder):
    whole = experiment("iterated", 1e-3, 0.05) + pair("mass_c")
    assert write(folder, whole, "motion.csv")[0] == "done"
    (folder / "coupling.toml").write_text(experiment("iterated", 1e-3, 50.0) + pair("mass_c"), encoding="utf-8")
    done = python(folder, INTERRUPTED)
    assert done.returncode == 130, done.stderr
    assert re.search(r"stopped at [\d.]+ s of 50 s: ended by Ctrl-C", done.stderr), done.stderr
    assert "ended.partial.csv" in done.stderr
    assert not (folder / "ended.csv").exists()
    kept = (folder / "ended.partial.csv").read_text(encoding="utf-8").splitlines()
    expected = (folder / "motion.csv").read_text(encoding="utf-8").splitlines()
    assert len(kept) >= 11
    assert kept[:11] == expected[:11]


TOLD = """
import json, sys
from contextlib import contextmanager
from pathlib import Path
from flexfmu.master import couple, read_coupling_file
from flexfmu.files.outputs import Reporter


class Words(Reporter):
    @contextmanager
    def counted(self, title, total, unit=""):
        said = []
        yield said.append
        print("RESULT " + json.dumps([total, unit, said]), flush=True)


couple(read_coupling_file(Path(sys.argv[1])), Words())
"""


def test_a_long_coupling_says_how_far_it_is_and_how_long_it_takes(folder):
    (folder / "told.toml").write_text(experiment("jacobi", 1e-3, 0.02) + pair(), encoding="utf-8")
    done = python(folder, TOLD, "told.toml")
    lines = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    assert lines, done.stderr
    total, unit, said = json.loads(lines[-1][len(MARK) :])
    assert (total, unit) == (0.02, "s")
    assert said[0] == 1e-3
    assert said[-1] == pytest.approx(0.02)
    assert np.all(np.diff(said) > 0.0)
    assert progress_words(5.0 * said[0], total, unit, 10.0) == "0.005 of 0.02 s, 30 s left"
