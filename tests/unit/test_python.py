"""Bodies in scripts, without files."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

import flexfmu
from flexfmu.files.basics import BodyFileError, MeshError, ModelError, SimulationError
from flexfmu.mesh.elements import ElementType
from flexfmu.model.modal_file import modal_bytes
from meshes import box, with_sets
from scene_tools import Listening

DOCS = Path(__file__).parents[2] / "docs" / "python.md"
LENGTH, SIDE = 1.0, 0.1
E_STEEL = (2.0e11, 0.3, 7850.0)
# Neither the error's estimate nor pictures, which take most of a build.
PLAIN = {"output": {"error": False, "surface": False}}
# Timoshenko's cantilever under a force at its end, shear coefficient 5/6; an end that cannot contract is 1 % stiffer.
BENDING = LENGTH**3 / (3.0 * E_STEEL[0] * SIDE**4 / 12.0)
SHEAR = LENGTH / (5.0 / 6.0 * E_STEEL[0] / (2.0 * (1.0 + E_STEEL[1])) * SIDE**2)


def bricks():
    """Points and 20-node bricks of a square cantilever along x."""
    mesh = box(ElementType.C3D20R, (8, 2, 2), (LENGTH, SIDE, SIDE))
    return np.array(mesh.points), np.array(mesh.blocks[0].connectivity)


def at_end(points, end):
    """Mask of the points of one end."""
    return np.isclose(points[:, 0], end)


def tip(body):
    """Displacement of the tip along y for a small force, by a method with frames."""
    return body.response(body.static({"tip": [0.0, 1.0, 0.0]})).displacement[0, 1]


@pytest.fixture(scope="module")
def cantilever():
    points, cells = bricks()
    return flexfmu.Body(
        (points, cells),
        material=E_STEEL,
        supports=[at_end(points, 0.0)],
        interfaces={"tip": at_end(points, LENGTH)},
        name="cantilever",
    )


@pytest.fixture(scope="module")
def built(cantilever):
    return cantilever.build("second_order", modes=6, residual_flexibility=["tip.force.y"])


def test_a_build_takes_what_an_earlier_one_has_kept_as_the_command_does(tmp_path, monkeypatch):
    monkeypatch.setenv("FLEXFMU_CACHE", str(tmp_path))
    first, second, third = Listening(), Listening(), Listening()
    points, cells = bricks()
    ends = [at_end(points, 0.0)], {"tip": at_end(points, LENGTH)}
    every = [flexfmu.Body((points, cells), E_STEEL, *ends, tables=PLAIN).build(report=one) for one in (first, second)]
    assert any(tmp_path.iterdir())
    assert not any("earlier build" in text for text in first.notes)
    assert second.notes == ["body: taken from an earlier build", *first.notes]
    assert len({modal_bytes(one.reduced) for one in every}) == 1
    # Of another body of the same mesh the modes.
    flexfmu.Body((points, cells), E_STEEL, *ends, tables=PLAIN, damping=0.02).build(report=third)
    assert any("normal modes: taken from an earlier build" in text for text in third.notes)


def test_arrays_alone_make_a_cantilever_as_soft_as_beam_theory_has_it(built):
    assert tip(built) == pytest.approx(BENDING + SHEAR, rel=1.5e-2)


@pytest.mark.slow
def test_bodies_of_meshio_of_arrays_and_in_millimetres_are_the_same(built):
    points, cells = bricks()
    by_name = meshio.Mesh(
        1000.0 * points, [("hexahedron20", cells)], point_sets={"ROOT": np.flatnonzero(at_end(points, 0.0))}
    )
    body = flexfmu.Body(
        by_name,
        material={"youngs_modulus": 2.0e5, "poissons_ratio": 0.3, "density": 7.85e-9},
        supports=[flexfmu.Support("ROOT")],
        interfaces={"tip": flexfmu.Interface(lambda x: x[:, 0] > 999.0)},
        units="mm-t-s",
        tables=PLAIN,
    ).build(modes=6, residual_flexibility=["tip.force.y"])
    assert tip(body) == pytest.approx(tip(built), rel=1e-9)
    np.testing.assert_allclose(body.model.angular_frequency, built.model.angular_frequency, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "tolerance"), [("MeshHex", 0.15), ("MeshTet2", 0.02)])
def test_meshes_of_scikit_fem_bring_their_boundaries_and_subdomains(kind, tolerance):
    skfem = pytest.importorskip("skfem")
    grid = (np.linspace(0.0, LENGTH, 21), np.linspace(0.0, SIDE, 5), np.linspace(0.0, SIDE, 5))
    mesh = getattr(skfem, kind.removesuffix("2")).init_tensor(*grid)
    mesh = mesh.with_boundaries({"root": lambda x: x[0] == 0.0, "end": lambda x: x[0] == LENGTH})
    mesh = mesh.with_subdomains({"half": lambda x: x[0] > 0.5})
    if kind == "MeshTet2":
        from dataclasses import replace

        straight = skfem.MeshTet2.from_mesh(mesh)
        mesh = replace(straight, _boundaries=mesh.boundaries, _subdomains=mesh.subdomains)
    body = flexfmu.Body(mesh, E_STEEL, supports=["root"], interfaces={"tip": "end"}, tables=PLAIN)
    # Mid-side nodes of a boundary belong to it.
    x = body.mesh.points[body.mesh.node_sets["end"]]
    assert len(x) == np.isclose(body.mesh.points[:, 0], LENGTH).sum()
    assert len(body.mesh.element_sets["half"]) == body.mesh.element_count // 2
    assert tip(body.build(modes=4, residual_flexibility=["tip.force.y"])) == pytest.approx(
        BENDING + SHEAR, rel=tolerance
    )


@pytest.mark.slow
def test_a_simulation_settles_where_statics_says_and_becomes_a_table(built, tmp_path):
    loads = {"tip": [0.0, 2.0e4, 0.0]}
    result = built.simulate(
        {"time": [0.0, 0.2], "tip.force.y": [2.0e4, 2.0e4]}, step=1e-3, parameters={"initialization": "static"}
    )
    expected = built.response(built.static(loads)).displacement[0]
    np.testing.assert_allclose(result["tip.displacement.y"], expected[1], rtol=1e-6)
    constant = built.simulate(loads, stop=0.2, step=1e-3, parameters={"initialization": "static"})
    np.testing.assert_array_equal(constant.values, result.values)
    frame = pytest.importorskip("pandas") and result.to_dataframe()
    assert frame.index.name == "time"
    assert frame["tip.displacement.y"].iloc[-1] == result["tip.displacement.y"][-1]
    again = built.simulate(
        frame[[]].assign(**{"tip.force.y": 2.0e4}), step=1e-3, parameters={"initialization": "static"}
    )
    np.testing.assert_allclose(again["tip.displacement.y"], expected[1], rtol=1e-6)
    result.to_csv(tmp_path / "result.csv")
    assert (tmp_path / "result.csv").read_text().startswith("time [s],tip.displacement.x [m]")


@pytest.mark.slow
def test_an_fmu_and_a_modal_file_of_a_script_are_read_back_as_the_same_body(built, tmp_path):
    for path in (built.fmu(tmp_path / "cantilever.fmu"), built.save(tmp_path / "cantilever.h5")):
        back = flexfmu.load(path)
        assert tip(back) == tip(built)
        assert back.fmu(tmp_path / "again.fmu").read_bytes() == (tmp_path / "cantilever.fmu").read_bytes()


@pytest.mark.slow
def test_the_method_that_a_body_is_read_with_is_the_one_its_fmu_starts_with(built, tmp_path):
    linear = flexfmu.load(built.save(tmp_path / "body.h5"), "linear")
    assert flexfmu.load(linear.fmu(tmp_path / "linear.fmu")).method is flexfmu.Method.LINEAR


def test_everything_public_tells_what_it_is_in_a_line_or_two(cantilever, built):
    result = built.simulate({"tip": [0.0, 1.0, 0.0]}, stop=2e-3, step=1e-3)
    state = built.rest()
    for thing in (cantilever, cantilever.mesh, built, built.reduced, result, state, flexfmu.Support("A")):
        assert len(repr(thing)) < 300, type(thing)
        assert "array(" not in repr(thing)
    assert "8" not in repr(state)
    assert "interfaces tip" in repr(cantilever)
    assert "tip.displacement.x" in repr(result)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"supports": [np.arange(3) + 10_000]}, "support 1 run from 10000 to 10002, expected 0 to"),
        ({"supports": [np.ones(4, dtype=bool)]}, r"support 1 are an array of shape \(4,\)"),
        ({"material": (1.0, 0.3)}, "expected three numbers: youngs_modulus"),
        ({"units": "mm"}, "units are 'mm', expected one of 'm-kg-s'"),
        ({"interfaces": {"1": [0, 1, 2]}}, r"interface\[1\].name"),
        ({"interfaces": {}}, "interface: found .*at least 1"),
    ],
)
def test_what_is_wrong_with_a_body_is_said(change, message):
    points, cells = bricks()
    good = {"material": E_STEEL, "supports": [[0, 1, 2]], "interfaces": {"tip": [3, 4, 5]}}
    with pytest.raises(BodyFileError, match=message):
        flexfmu.Body((points, cells), **(good | change))


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        ("body.inp", "a file is read by flexfmu.read_mesh"),
        ((np.zeros((4, 3)), [[0, 1, 2]]), r"have 3 nodes, expected 4 \(tetra\)"),
        ((np.zeros((4, 3)), np.zeros((2, 4))), "expected whole numbers"),
        ((np.zeros((4, 3)), [[0, 1, 2, 4]]), "of points that it does not define"),
    ],
)
def test_what_is_no_mesh_is_refused(mesh, message):
    with pytest.raises(MeshError, match=message):
        flexfmu.Body(mesh, E_STEEL)


def test_loads_that_make_no_table_are_refused(built):
    with pytest.raises(SimulationError, match='no column "time"'):
        built.simulate({"tip": [0.0, 1.0, 0.0]})
    with pytest.raises(SimulationError, match="expected that of time"):
        built.simulate({"time": [0.0, 1.0], "tip.force.y": [0.0]})
    with pytest.raises(SimulationError, match="a time that goes back"):
        built.simulate({"time": [1.0, 0.0], "tip.force.y": [0.0, 0.0]})


@pytest.mark.slow
def test_the_example_of_the_docs_runs(tmp_path):
    (example,) = re.findall(r"^```python\n(.*?)^```$", DOCS.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", example], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "arm.fmu").is_file()
    assert float(done.stdout.split()[-1]) == pytest.approx(0.0245, rel=0.2)


def test_a_body_that_is_held_everywhere_is_refused_in_words():
    mesh = with_sets(box(ElementType.C3D8, (1, 1, 1), (0.1, 0.1, 0.1)), ALL=lambda p: 0.0 * p[:, 0])
    with pytest.raises(ModelError, match="hold every node in all directions: nothing moves"):
        flexfmu.Body(mesh, supports=["ALL"], interfaces={"tip": "TIP"}, name="brick").build()


def test_nodes_that_a_set_lists_twice_count_once():
    """They counted twice in the body alone: its shadow told 500 % of nothing."""
    mesh = box(ElementType.C3D20R, (8, 1, 1), (LENGTH, SIDE, SIDE))
    end = np.asarray(mesh.node_sets["TIP"])
    meshes = (replace(mesh, node_sets={**mesh.node_sets, "TIP": one}) for one in (end[:4], end[[0, 0, 0, 1, 1, 2, 3]]))
    bodies = [flexfmu.Body(one, supports=["ROOT"], interfaces={"tip": "TIP"}, tables=PLAIN) for one in meshes]
    first, second = (replace(body.build().reduced, provenance={}) for body in bodies)
    assert modal_bytes(first) == modal_bytes(second)
