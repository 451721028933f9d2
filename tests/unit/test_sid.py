"""SID_FEM: what is written is the body's mechanics, and what is read is a linear body."""

import numpy as np
import pytest
from typer.testing import CliRunner

import flexfmu
from flexfmu.commands.cli import app
from flexfmu.given.linear import SidError, mass_integrals
from flexfmu.given.modes import checked_modes
from given_bars import LENGTH, SIDE

DENSITY = 7850.0
MASS = DENSITY * LENGTH * SIDE**2


@pytest.fixture(scope="module")
def integrals(clamped):
    given, _, _ = checked_modes(clamped)
    return given, *mass_integrals(given)


def test_mass_centre_and_inertia_are_those_of_a_box(integrals):
    _, mass, found = integrals
    assert mass == pytest.approx(MASS, rel=1e-12)
    centre = np.array([LENGTH, SIDE, SIDE]) / 2.0
    np.testing.assert_allclose(found["mdCM"].zero[:, 0], MASS * centre, rtol=1e-10)
    side = np.array([LENGTH, SIDE, SIDE])
    about = np.diag(MASS / 12.0 * (np.sum(side**2) - side**2))
    steiner = MASS * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    np.testing.assert_allclose(found["J"].zero, about + steiner, rtol=1e-10)
    np.testing.assert_allclose(found["Me"].zero, np.eye(len(found["Me"].zero)), atol=1e-9)


def test_energy_and_inertial_forces_are_those_of_the_moving_mass(integrals, random):
    given, mass, found = integrals
    number = len(given.modes)
    q, rate = 1e-3 * random.standard_normal((2, number))
    spin, speed = random.standard_normal((2, 3))
    scalar = given.mass[::3][:, ::3]
    place = given.nodes + np.tensordot(q, given.modes, axes=1)
    drift = np.tensordot(rate, given.modes, axes=1)
    velocity = speed + np.cross(spin, place) + drift

    def at(name, state=q):
        series = found[name]
        return series.zero + (0.0 if series.first is None else np.einsum("rqc,q->rc", series.first, state))

    # Energy: exact but for the second order of J in q.
    second = np.cross(spin, place - given.nodes)
    exact = 0.5 * np.sum(velocity * (scalar @ velocity)) - 0.5 * np.sum(second * (scalar @ second))
    by_parts = 0.5 * mass * speed @ speed + speed @ np.cross(spin, at("mdCM")[:, 0]) + speed @ at("Ct").T @ rate
    by_parts += 0.5 * spin @ at("J") @ spin + spin @ at("Cr").T @ rate + 0.5 * rate @ at("Me") @ rate
    assert by_parts == pytest.approx(exact, rel=1e-10)
    # Centrifugal and Coriolis forces of the modes, ∫ Φᵀ (ω × (ω × r) + 2 ω × v).
    pull = np.cross(spin, np.cross(spin, place))
    whirl = 2.0 * np.cross(spin, drift)
    forces = [np.einsum("kni,ni->k", given.modes, scalar @ field) for field in (pull, whirl)]
    squares = [*spin**2, spin[0] * spin[1], spin[1] * spin[2], spin[0] * spin[2]]
    np.testing.assert_allclose(at("Oe") @ squares, forces[0], rtol=1e-9, atol=1e-9)
    blocks = at("Ge").reshape(number, number, 3)
    np.testing.assert_allclose(np.einsum("lki,k,i->l", blocks, rate, spin), forces[1], rtol=1e-9, atol=1e-9)
    # The same force's moment about the origin, of the undeformed places.
    moment = np.cross(given.nodes, scalar @ whirl).sum(axis=0)
    blocks = at("Gr").reshape(3, number, 3)
    np.testing.assert_allclose(np.einsum("akb,k,b->a", blocks, rate, spin), moment, rtol=1e-9, atol=1e-12)


def test_a_file_that_is_written_and_read_bends_as_the_linear_body(clamped, tmp_path):
    path = flexfmu.write_sid(clamped, {"tip": "TIP", "root": "ROOT"}, tmp_path / "bar.SID_FEM")
    linear = flexfmu.pack(clamped, {"node_1": flexfmu.Interface("TIP", weights="node")}, frames=0)
    body = flexfmu.FlexibleBody(flexfmu.read_sid(path))
    load = {"node_1": [0.0, 100.0, 50.0, 0.0, 0.0, 2.0]}
    assert body.method is flexfmu.Method.LINEAR
    expected = linear.response(linear.static(load))
    found = body.response(body.static(load))
    np.testing.assert_allclose(found.displacement[0], expected.displacement[0], rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(found.rotation[0], expected.rotation[0], rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(found.displacement[1], 0.0, atol=1e-12)


def test_modes_of_any_size_are_read_with_their_masses(clamped, tmp_path):
    path = flexfmu.write_sid(clamped, {"tip": "TIP"}, tmp_path / "bar.SID_FEM")
    body = flexfmu.read_sid(path)
    text = path.read_text()
    # Half the unit of the first coordinate: its mass, stiffness and motion per unit.
    for key, factor in (("Me", 4.0), ("Ke", 4.0), ("phi", 2.0), ("psi", 2.0)):
        head, _, rest = text.partition(f"{key}\n")
        block, end, tail = rest.partition(f"end {key}")
        lines = []
        for line in block.split("\n"):
            place = line.partition("=")[0].replace(" ", "")
            first = place == "m0(1,1)" if key in ("Me", "Ke") else place.startswith("m0(") and place.endswith(",1)")
            name, _, value = line.partition("=")
            lines.append(f"{name}= {factor * float(value.replace('D', 'E'))!r}" if first else line)
        text = head + f"{key}\n" + "\n".join(lines) + end + tail
    path.write_text(text)
    other = flexfmu.read_sid(path)
    np.testing.assert_allclose(other.angular_frequency, body.angular_frequency, rtol=1e-12)
    np.testing.assert_allclose(
        np.abs(other.interface_displacement), np.abs(body.interface_displacement), rtol=1e-9, atol=1e-15
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("part\nend part\n", "it has no Ke"),
        ("Ke\n nrow = 99999\n ncol = 99999\nend Ke\n", "expected at most"),
        ("Ke\n nrow = 1\n ncol = 1\n m0( 2, 1) = 1.0D+00\nend Ke\n", r"entry m0\(2, 1\) beyond its size"),
    ],
)
def test_a_file_that_is_no_body_is_refused(text, message, tmp_path):
    (tmp_path / "bad.sid_fem").write_text(text)
    with pytest.raises(SidError, match=message):
        flexfmu.read_sid(tmp_path / "bad.sid_fem")


def test_the_command_packs_a_file_as_an_fmu(clamped, tmp_path):
    path = flexfmu.write_sid(clamped, {"tip": "TIP"}, tmp_path / "bar.SID_FEM")
    run = CliRunner().invoke(app, ["pack", str(path), "-o", str(tmp_path / "bar.fmu")])
    assert run.exit_code == 0, run.output
    assert flexfmu.load(tmp_path / "bar.fmu").model.interface_names == ("node_1",)
    run = CliRunner().invoke(app, ["pack", str(path), "--frames=4"])
    assert "a linear body as it is" in run.output
