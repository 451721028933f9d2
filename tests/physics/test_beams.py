"""Beams: patch tests, slender bars, published problems, frames that bend far as the whole model, supports, refusals."""

import re
from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse.linalg as spla
from benchmarks.field.frames_of_beams import lee
from scipy.linalg import eigh

import flexfmu
from decks import read
from flexfmu.fe.assembly import mass, stiffness
from flexfmu.fe.nonlinear import load_path
from flexfmu.files.basics import AccuracyError, DeckError, FlexfmuError, MeshError, ModelError
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.beams import box, ellipse, pipe, rectangle
from flexfmu.reduction.model import assemble_model
from flexfmu.reduction.options import BodyOptions

E, NU, RHO = 2.1e11, 0.3, 7850.0
SECTION = "*BEAM SECTION, ELSET=B, MATERIAL=S, SECTION={}\n{}\n{}\n"
MATERIAL = f"*MATERIAL, NAME=S\n*ELASTIC\n{E}, {{nu}}\n*DENSITY\n{RHO}\n"


def along(*corners, count=10):
    """Points along a line of several legs."""
    legs = [np.linspace(one, other, count + 1)[1:] for one, other in pairwise(corners)]
    return np.concatenate([np.array(corners[:1], dtype=float), *legs])


def deck(points, elements=None, shape="RECT", sizes="0.02, 0.02", axis="0, 1, 0", kind="B31", more="", nu=NU, **sets):
    """A deck of beams between points; sets by rows of these."""
    rows = np.column_stack([np.arange(len(points) - 1), np.arange(1, len(points))]) if elements is None else elements
    text = "*NODE\n" + "".join(f"{k}, {x!r}, {y!r}, {z!r}\n" for k, (x, y, z) in enumerate(points.tolist(), 1))
    text += f"*ELEMENT, TYPE={kind}, ELSET=B\n"
    text += "".join(
        f"{k}, {', '.join(str(n + 1) for n in row)}\n" for k, row in enumerate(np.asarray(rows).tolist(), 1)
    )
    for name, nodes in sets.items():
        text += f"*NSET, NSET={name}\n" + "".join(f"{node % len(points) + 1}\n" for node in nodes)
    return text + MATERIAL.format(nu=nu) + SECTION.format(shape, sizes, axis) + more


def clamped(points, *, ends=(0,), tip=(-1,), more="", **options):
    """The same held at some nodes in all directions."""
    return deck(points, more=f"*BOUNDARY\nROOT, 1, 6\n{more}", ROOT=ends, TIP=tip, **options)


def loads(mesh, force, moment=(0.0, 0.0, 0.0)):
    """Nodal forces (n, 3) at the tip."""
    nodes = mesh.node_sets["TIP"]
    arm = mesh.points[nodes] - mesh.points[nodes].mean(axis=0)
    found = np.zeros_like(mesh.points)
    found[nodes] = np.array(force) / nodes.size + np.cross(np.linalg.solve(_inertia(arm), moment), arm)
    return found


def motion(mesh, u):
    """Displacement and small rotation of the tip."""
    nodes = mesh.node_sets["TIP"]
    arm = mesh.points[nodes] - mesh.points[nodes].mean(axis=0)
    moved = u.reshape(-1, 3)[nodes]
    return moved.mean(axis=0), np.linalg.solve(_inertia(arm), np.cross(arm, moved - moved.mean(axis=0)).sum(axis=0))


def _inertia(arm):
    return np.eye(3) * np.sum(arm**2) - arm.T @ arm


def linear(mesh, forces):
    """Displacements (n, 3)."""
    model = assemble_model(mesh, BodyOptions("beam", ()))
    matrix = model.unknowns.matrix(stiffness(model.mesh)).tocsc()
    return model.unknowns.whole(spla.spsolve(matrix, model.unknowns.forces(forces.ravel())))


def far(mesh, force):
    """Displacement of the tip, all terms."""
    model = assemble_model(mesh, BodyOptions("beam", ()))
    path = load_path(model.mesh, model.unknowns, model.spring, loads(mesh, force).ravel(), [0.5, 1.0], Reporter())
    return motion(mesh, path.displacement[-1])[0]


@pytest.mark.parametrize("count", [1, 7])
@pytest.mark.parametrize("thickness", [0.1, 1e-4])
def test_few_beams_stretch_bend_shear_and_twist_exactly(tmp_path, count, thickness):
    mesh = read(tmp_path, clamped(along((0, 0, 0), (1, 0, 0), count=count), sizes=f"{thickness}, {0.5 * thickness}"))
    area, first, second, torsion, shear, _ = rectangle(thickness, 0.5 * thickness).constants
    modulus = 0.5 * E / (1.0 + NU)
    moved, _ = motion(mesh, linear(mesh, loads(mesh, (1.0, 1.0, 1.0))))
    bent = [1.0 / (3.0 * E * second) + 1.0 / (modulus * shear) for second in (first, second)]
    np.testing.assert_allclose(moved, [1.0 / (E * area), *bent], rtol=1e-6)
    _, turned = motion(mesh, linear(mesh, loads(mesh, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))))
    np.testing.assert_allclose(turned, [1.0 / (modulus * torsion), 1.0 / (E * second), 1.0 / (E * first)], rtol=1e-3)


def test_a_frame_with_corners_carries_bending_into_torsion(tmp_path):
    mesh = read(tmp_path, clamped(along((0, 0, 0), (1, 0, 0), (1, 1, 0), count=2), axis="0, 0, 1"))
    area, first, _, torsion, shear, _ = rectangle(0.02, 0.02).constants
    modulus = 0.5 * E / (1.0 + NU)
    moved, _ = motion(mesh, linear(mesh, loads(mesh, (1.0, 0.0, 1.0))))
    down = 2.0 / (3.0 * E * first) + 1.0 / (modulus * torsion) + 2.0 / (modulus * shear)
    aside = 4.0 / (3.0 * E * first) + 1.0 / (modulus * shear) + 1.0 / (E * area)
    assert moved[2] == pytest.approx(down, rel=1e-4)
    assert moved[0] == pytest.approx(aside, rel=1e-4)


@pytest.mark.parametrize("shape", ["RECT", "CIRC", "PIPE", "BOX"])
def test_cantilevers_have_the_frequencies_of_theory(tmp_path, shape):
    sizes, section = {
        "RECT": ("0.02, 0.01", rectangle(0.02, 0.01).constants),
        "CIRC": ("0.01", ellipse(0.02, 0.02).constants),
        "PIPE": ("0.01, 0.001", pipe(0.01, 0.001).constants),
        "BOX": ("0.02, 0.01, 0.001, 0.001, 0.001, 0.001", box(0.02, 0.01, 0.001, 0.001).constants),
    }[shape]
    mesh = read(tmp_path, clamped(along((0, 0, 0), (1, 0, 0), count=24), shape=shape, sizes=sizes))
    assert mesh.volumes.sum() == pytest.approx(section[0])
    model = assemble_model(mesh, BodyOptions("beam", ()))
    whole = mass(model.mesh)
    matrices = stiffness(model.mesh), model.unknowns.in_means(whole)
    found = np.sqrt(eigh(*(model.unknowns.matrix(one).toarray() for one in matrices), eigvals_only=True)[:2])
    # The roots of cos x cosh x = -1; of both directions of bending.
    expected = 1.8751**2 * np.sqrt(E * np.array(sorted(section[1:3])) / (RHO * section[0]))
    np.testing.assert_allclose(found, expected, rtol=2e-3)


def test_a_bar_bends_as_the_elastica(tmp_path):
    # P L² / E I = 3 (K. Mattiasson, Int. J. Numer. Meth. Engng. 17 (1981) 145).
    mesh = read(tmp_path, clamped(along((0, 0, 0), (1, 0, 0), count=16), sizes="0.01, 0.01"))
    moved = far(mesh, (0.0, 3.0 * E * 1e-8 / 12.0, 0.0))
    np.testing.assert_allclose(moved[:2], [-0.25442, 0.60325], rtol=2e-3)


def test_a_curved_bar_bends_out_of_its_plane_as_published(tmp_path):
    # K.-J. Bathe, S. Bolourchi 1979, with the tip of J. C. Simo, L. Vu-Quoc 1986; radius 100, section 1 × 1, E = 1e7.
    angle = np.linspace(0.0, 0.25 * np.pi, 17)
    points = np.column_stack([1.0 - np.cos(angle), np.sin(angle), 0.0 * angle])
    more = clamped(points, shape="RECT", sizes="0.01, 0.01", axis="0, 0, 1", nu=0.0)
    # J = 1/6, as there.
    numbers = "1e-4, 8.333333e-10, 0, 8.333333e-10, 1.666667e-9"
    general = f"*BEAM GENERAL SECTION, ELSET=B, DENSITY={RHO}\n{numbers}\n0, 0, 1\n{E}, {0.5 * E}\n"
    mesh = read(tmp_path, more.replace(SECTION.format("RECT", "0.01, 0.01", "0, 0, 1"), general))
    tip = 100.0 * (far(mesh, (0.0, 0.0, 600.0 * E / 1e7 * 1e-4)) + points[-1])
    np.testing.assert_allclose(tip, [15.79, 47.23, 53.37], atol=0.25)


@pytest.mark.parametrize(("sense", "published"), [(1.0, 1.088), (-1.0, 0.680)])
def test_argyris_frame_goes_sideways_at_the_published_loads(tmp_path, sense, published):
    # J. H. Argyris et al., Comput. Methods Appl. Mech. Eng. 17/18 (1979) 1: legs of 240 mm, 30 × 0.6 mm, in N.
    points = along((0, 0, 0), (0.24, 0, 0), (0.24, 0.24, 0), count=12)
    text = clamped(points, sizes="0.03, 0.0006", nu=0.31).replace(str(E), "7.124e10")
    # The second leg's height is along x.
    rows = text.splitlines(keepends=True)
    start = rows.index("*ELEMENT, TYPE=B31, ELSET=B\n") + 13
    text = "".join([*rows[:start], "*ELEMENT, TYPE=B31, ELSET=C\n", *rows[start:]])
    second = SECTION.format("RECT", "0.03, 0.0006", "1, 0, 0").replace("ELSET=B", "ELSET=C")
    mesh = read(tmp_path, text + second)
    body = flexfmu.Body(mesh, interfaces={"tip": flexfmu.Interface("TIP")}).build(surface=False, frames=1)
    for part, stable in ((0.99, True), (1.01, False)):
        loads = {"tip": [sense * part * published, 0.0, 0.0, 0.0, 0.0, 0.0]}
        packed = body.loads(loads).packed(with_acceleration=False)
        assert body.is_stable(body.rest(), packed, 0.0) == stable


@pytest.mark.slow
def test_lees_frame_snaps_at_the_published_load(tmp_path):
    # S.-L. Lee, F. S. Manuel, E. C. Rossow, J. Eng. Mech. Div. ASCE 94 (1968) 521: 18.55 E I / L².
    file = tmp_path / "lee.inp"
    file.write_text(lee(along((0, 0, 0), (0, 1.2, 0), (1.2, 1.2, 0), count=20)))
    mesh = flexfmu.read_mesh(file)
    model, forces = assemble_model(mesh, BodyOptions("lee", ())), np.zeros_like(mesh.points)
    nodes = mesh.node_sets["LOAD"]
    forces[nodes, 1] = -1.1 * 18.55 * 72e9 * 0.12 * 0.02**3 / 12.0 / 1.2**2 / nodes.size
    with pytest.raises(AccuracyError, match="limit or critical load") as refusal:
        load_path(model.mesh, model.unknowns, model.spring, forces.ravel(), [0.5, 1.0], Reporter())
    reached = float(re.search(r"beyond ([\d.]+) %", str(refusal.value))[1]) / 100.0
    assert 1.1 * reached == pytest.approx(1.0, abs=0.01)


FRAMES = {
    "bar": (along((0, 0, 0), (1, 0, 0)), {"sizes": "0.02, 0.01"}, (0.0, 0.0, 300.0)),
    "corner": (along((0, 0, 0), (1, 0, 0), (1, 1, 0)), {"shape": "PIPE", "sizes": "0.02, 0.002"}, (0.0, 0.0, 1000.0)),
    "portal": (along((0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0)), {"ends": (0, -1), "tip": (10,)}, (6e3, 0.0, 0.0)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FRAMES)
def test_frames_bend_far_as_the_whole_model(tmp_path, name):
    points, options, force = FRAMES[name]
    axis = "0, 1, 0" if name != "corner" else "0, 0, 1"
    mesh = read(tmp_path, clamped(points, axis=axis, **options))
    body = flexfmu.Body(mesh, interfaces={"pin": flexfmu.Interface("TIP")}).build(surface=False)
    found = body.response(body.static({"pin": [*force, 0.0, 0.0, 0.0]})).displacement[0]
    expected = far(mesh, force)
    assert np.linalg.norm(expected) > 0.1
    np.testing.assert_allclose(found, expected, atol=5e-3 * np.linalg.norm(expected))


def test_hinges_and_rollers_hold_translations_alone(tmp_path):
    text = deck(
        along((0, 0, 0), (1, 0, 0), count=8),
        more="*BOUNDARY\nA, 1, 4\nB, 2, 3\n",
        A=(0,),
        B=(-1,),
        TIP=(4,),
    )
    mesh = read(tmp_path, text)
    moved, turned = motion(mesh, linear(mesh, loads(mesh, (0.0, 0.0, 1.0))))
    _, first, _, _, shear, _ = rectangle(0.02, 0.02).constants
    assert moved[2] == pytest.approx(1.0 / (48.0 * E * first) + 0.5 * (1.0 + NU) / (E * shear), rel=1e-5)
    assert np.abs(turned).max() < 1e-12


def test_beams_of_three_nodes_are_two_of_two(tmp_path):
    points = along((0, 0, 0), (1, 0, 0), count=4)
    three = read(tmp_path, clamped(points, elements=[[0, 1, 2], [2, 3, 4]], kind="B32R"))
    two = read(tmp_path, clamped(points))
    assert three.element_sets["B"].tolist() == [0, 1, 2, 3]
    assert "5 nodes of beams" in two.notes
    forces = loads(two, (1.0, 2.0, 3.0))
    np.testing.assert_allclose(linear(three, forces), linear(two, forces), atol=1e-20)


def test_a_mass_at_a_node_of_beams_turns_with_it(tmp_path):
    more = "*ELEMENT, TYPE=MASS, ELSET=M\n90, 11\n*ELEMENT, TYPE=ROTARYI, ELSET=I\n91, 11\n*MASS, ELSET=M\n1.0\n"
    mesh = read(tmp_path, clamped(along((0, 0, 0), (1, 0, 0)), more=more + "*ROTARY INERTIA, ELSET=I\n1, 2, 3\n"))
    assert mesh.masses[0].nodes.tolist() == mesh.node_sets["TIP"].tolist()
    assert np.diag(mesh.masses[0].inertia).tolist() == [1.0, 2.0, 3.0]
    assert not any("does nothing" in note for note in mesh.notes)


def test_a_beam_bends_the_plate_that_it_stands_on(tmp_path):
    """A post on a plate of shells, pushed aside at its top: the plate turns with its foot."""
    text = "*NODE\n" + "".join(f"{5 * j + i + 1}, {0.1 * i}, {0.1 * j}, 0\n" for j in range(5) for i in range(5))
    text += "90, 0.2, 0.2, 0.3\n*ELEMENT, TYPE=S4, ELSET=P\n"
    text += "".join(
        f"{4 * j + i + 1}, {(k := 5 * j + i + 1)}, {k + 1}, {k + 6}, {k + 5}\n" for j in range(4) for i in range(4)
    )
    text += "*ELEMENT, TYPE=B31, ELSET=B\n50, 13, 90\n*NSET, NSET=TIP\n90\n*NSET, NSET=ROOT\n"
    text += "1, 2, 3, 4, 5, 21, 22, 23, 24, 25\n" + MATERIAL.format(nu=NU)
    text += "*SHELL SECTION, ELSET=P, MATERIAL=S\n0.005\n" + SECTION.format("RECT", "0.02, 0.02", "0, 1, 0")
    mesh = read(tmp_path, text + "*BOUNDARY\nROOT, 1, 6\nTIP, 6, 6\n")
    assert any(note.startswith("2 nodes of beams; shells turn with 1 of them") for note in mesh.notes)
    moved, turned = motion(mesh, linear(mesh, loads(mesh, (1.0, 0.0, 0.0))))
    bending = E * 0.02**4 / 12.0
    post = 0.3**3 / (3.0 * bending)
    foot = turned[1] - 0.3**2 / (2.0 * bending)
    assert moved[0] > 3.0 * post
    assert moved[0] == pytest.approx(0.3 * foot + post, rel=0.02)


def test_offsets_of_beams_put_their_faces_where_calculix_has_them(tmp_path):
    """Which ccx 2.20 writes with OUTPUT=3D: nodes on the upper face across the first axis, a quarter up the second."""
    text = clamped(along((0, 0, 0), (1, 0, 0), count=1), sizes="0.1, 0.2")
    mesh = read(tmp_path, text.replace("SECTION=RECT", "SECTION=RECT, OFFSET1=0.5, OFFSET2=0.25"))
    corners = mesh.points[mesh.blocks[0].connectivity[0]]
    np.testing.assert_allclose(corners.min(axis=0), (0.0, -0.1, -0.15), atol=1e-9)
    np.testing.assert_allclose(corners.max(axis=0), (1.0, 0.0, 0.05), atol=1e-9)
    circle = read(tmp_path, text.replace("SECTION=RECT", "SECTION=CIRC, OFFSET1=0.5, OFFSET2=0.25"))
    middle = circle.points[circle.blocks[0].connectivity[0]].mean(axis=0)
    np.testing.assert_allclose(middle, corners.mean(axis=0), atol=1e-9)


def test_one_width_is_that_of_a_square(tmp_path):
    one, two = (read(tmp_path, clamped(along((0, 0, 0), (1, 0, 0)), sizes=text)) for text in ("0.1", "0.1, 0.1"))
    np.testing.assert_array_equal(one.points, two.points)


REFUSED = {
    "hexagon": (("RECT\n0.02", "HEX\n0.02"), "SECTION=HEX is not supported"),
    "numbers": (("RECT\n0.02, 0.02", "PIPE\n0.02"), "2 positive numbers"),
    "direction": (("0, 1, 0", "1, 0, 0"), "direction"),
    "two": (("0, 1, 0", "0, 1"), "three of the first axis"),
    "kind": (("TYPE=B31", "TYPE=T3D2"), "holds others"),
    "parameter": (("SECTION=RECT", "SECTION=RECT, DENSITY=1."), "DENSITY"),
    "offset": (("RECT\n0.02, 0.02", "L, OFFSET2=0.5\n1, 1, .1, .1"), "offsets of a section L"),
    "box": (("RECT\n0.02, 0.02", "BOX\n1, 1, .1, .1, .2, .1"), "opposite ones alike"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_beams_that_are_not_supported_are_refused_with_words(tmp_path, name):
    change, words = REFUSED[name]
    with pytest.raises((DeckError, MeshError), match=words):
        read(tmp_path, clamped(along((0, 0, 0), (1, 0, 0))).replace(*change))


def test_the_stress_of_beams_is_refused(tmp_path):
    mesh = read(tmp_path, clamped(along((0, 0, 0), (1, 0, 0))))
    body = flexfmu.Body(mesh, interfaces={"pin": flexfmu.Interface("TIP")}, stress={"s": "B"})
    with pytest.raises((FlexfmuError, ModelError), match="stress of beams"):
        body.build(surface=False)
