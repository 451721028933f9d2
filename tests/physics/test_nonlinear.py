"""The whole finite element model with geometric nonlinearity, against CalculiX and a limit load."""

import numpy as np
import pytest

from flexfmu.build.config import read_body_file
from flexfmu.fe.nonlinear import load_path
from flexfmu.files.basics import AccuracyError
from flexfmu.files.outputs import Reporter
from flexfmu.mesh.checks import checked
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.formats import read_mesh
from flexfmu.reduction.bodies import fit_interface
from flexfmu.reduction.model import assemble_model
from meshes import body_file, box
from references import BEAM, DEMO, L_FRAME, calculix, displacement, relative

pytestmark = pytest.mark.slow


def path(folder, direction, forces):
    """Displacement (f, 3) of the first interface of a demo body under forces (N) along a direction."""
    return path_of(read_body_file(folder / "body.toml"), direction, forces)


def path_of(config, direction, forces):
    """The same of a body file."""
    model = assemble_model(checked(read_mesh(config.mesh.file, config.mesh.units)), config.options)
    interface = fit_interface(config.options.interfaces[0], model.mesh, [])
    load = max(forces) * interface.nodal_loads(len(model.mesh.points))[:, :3] @ np.asarray(direction, dtype=float)
    factors = np.asarray(forces) / max(forces)
    found = load_path(model.mesh, model.unknowns, model.spring, load, factors.tolist(), Reporter())
    return interface.motion(found.displacement.T)[:3].T, found


@pytest.mark.parametrize(
    ("folder", "table", "direction", "column"),
    [(BEAM, "static_y", [0, 1, 0], "force_N"), (L_FRAME, "static_z", [0, 0, 1], "force_N")],
)
def test_large_deflections_are_those_of_calculix(folder, table, direction, column):
    reference = calculix(folder / "calculix" / f"{table}.csv")
    chosen = reference[[len(reference) // 3, -1]]
    moved, found = path(folder, direction, chosen[column].tolist())
    assert np.linalg.norm(moved[-1]) > 0.08
    for row, expected in zip(moved, displacement(chosen), strict=True):
        assert relative(row, expected) < 1e-6
    # Twice as many with the stress of displacements in the tangent.
    assert found.increments <= found.iterations < 15


@pytest.mark.long
def test_beyond_a_limit_load_there_is_no_equilibrium_to_be_found():
    folder = DEMO / "shallow_arch"
    limit = abs(calculix(folder / "calculix" / "static_y.csv")["force_N"][-1]) / 0.9
    with pytest.raises(AccuracyError, match=r"beyond 9[78]\.\d+ % of the load"):
        path(folder, [0, -1, 0], [1.02 * limit])


@pytest.mark.parametrize("kind", [ElementType.C3D20, ElementType.C3D10])
def test_a_nanonewton_moves_the_whole_model_as_a_newton_does(kind, tmp_path):
    config = body_file(box(kind, (4, 1, 1), (1.0, 0.1, 0.13)), tmp_path, interface=["TIP"])
    moved = [path_of(config, [0, 1, 0], [force])[0][0] / force for force in (1e-9, 1.0)]
    assert relative(moved[0], moved[1]) < 1e-6


def test_a_bar_one_reduced_element_across_moves_as_one_of_full_integration(tmp_path):
    moved = []
    for kind in (ElementType.C3D20R, ElementType.C3D20):
        config = body_file(box(kind, (4, 1, 1), (1.0, 0.1, 0.13)), tmp_path, interface=["TIP"], name=kind.name)
        moved.append(path_of(config, [0, 1, 0], [1e6])[0][0])
    assert np.linalg.norm(moved[0]) > 0.1
    np.testing.assert_array_equal(*moved)
