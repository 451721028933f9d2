"""Condensed matrices make a linear body."""

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

import flexfmu
from flexfmu.given.linear import MatrixError

E, SIDE, LENGTH, DENSITY = 2.1e11, 0.02, 1.0, 7850.0
EA, EI, GJ = E * SIDE**2, E * SIDE**4 / 12.0, E / 2.6 * 0.1406 * SIDE**4


def beam():
    """Stiffness and mass of the tip of a clamped Euler beam along x, six degrees of freedom."""
    a, b, c = 12.0 * EI / LENGTH**3, 6.0 * EI / LENGTH**2, 4.0 * EI / LENGTH
    k = np.diag([EA / LENGTH, a, a, GJ / LENGTH, c, c])
    k[1, 5] = k[5, 1] = -b
    k[2, 4] = k[4, 2] = b
    m = DENSITY * SIDE**2 * LENGTH * np.diag([0.3, 0.25, 0.25, 1e-4, 1e-2, 1e-2])
    return k, m


def test_a_beam_of_matrices_bends_by_the_textbook_linearly_however_far(tmp_path):
    k, m = beam()
    scipy.io.mmwrite(tmp_path / "k.mtx", sp.coo_array(k), symmetry="symmetric")
    body = flexfmu.linear_body(tmp_path / "k.mtx", m, {"tip": (LENGTH, 0.0, 0.0)}, damping=0.01)
    for force in (1.0, 1e4):
        response = body.response(body.static({"tip": [0.0, force, 0.0]}))
        assert response.displacement[0, 1] == pytest.approx(force * LENGTH**3 / (3.0 * EI), rel=1e-9)
        assert response.rotation[0, 2] == pytest.approx(force * LENGTH**2 / (2.0 * EI), rel=1e-9)
    result = body.simulate({"tip": [0.0, 1.0, 0.0]}, stop=2e-3, step=1e-3)
    assert result["tip.displacement.y"][-1] > 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda k, m: (np.triu(k), m), "stiffness is not symmetric: one triangle alone"),
        (lambda k, m: (k[:5, :5], m), "expected the same of both"),
        (lambda k, m: (k, m * np.diag([1.0, 1, 1, 0, 1, 1])), "mass is not positive definite"),
        (lambda k, m: (k * np.diag([0.0, 1, 1, 1, 1, 1]), m), "stiffness is not positive definite: the body is free"),
        (lambda _, m: ("gone.mtx", m), "cannot be read as a Matrix Market file"),
    ],
)
def test_matrices_of_no_held_body_are_refused(change, message):
    with pytest.raises(MatrixError, match=message):
        flexfmu.linear_body(*change(*beam()), {"tip": (LENGTH, 0.0, 0.0)})


def test_a_substructure_s_text_holds_mass_beside_stiffness(tmp_path):
    k, m = beam()
    text = "** ANY NAME\n*USER ELEMENT, NODES=6, LINEAR\n** ELEMENT NODES\n1, 2, 3\n"
    for kind, matrix in (("STIFFNESS", k), ("MASS", m)):
        rows = [", ".join(f"{value!r}" for value in row[: i + 1]) for i, row in enumerate(matrix.tolist())]
        text += f"*MATRIX, TYPE={kind}\n" + ",\n".join(rows) + "\n"
    (tmp_path / "sub.mtx").write_text(text)
    expected = flexfmu.linear_body(k, m, {"tip": (LENGTH, 0.0, 0.0)})
    found = flexfmu.linear_body(tmp_path / "sub.mtx", str(tmp_path / "sub.mtx"), {"tip": (LENGTH, 0.0, 0.0)})
    np.testing.assert_allclose(found.reduced.angular_frequency, expected.reduced.angular_frequency, rtol=1e-12)
    for spoiled, message in (
        (text.rpartition(",")[0], "20 numbers are no triangle"),
        (text.partition("*MATRIX, TYPE=MASS")[0], "it holds stiffness, no mass"),
    ):
        (tmp_path / "sub.mtx").write_text(spoiled)
        with pytest.raises(MatrixError, match=message):
            flexfmu.linear_body(k, tmp_path / "sub.mtx", {"tip": (LENGTH, 0.0, 0.0)})
