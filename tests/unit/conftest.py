"""Fixtures that several of these files share."""

import pytest

import flexfmu
from given_bars import bar, eigenmodes


@pytest.fixture(scope="module")
def clamped():
    mesh = bar()
    modes, frequency, mass = eigenmodes(mesh, mesh.node_sets["ROOT"])
    cells = {"hexahedron20": mesh.blocks[0].connectivity}
    return flexfmu.GivenModes(mesh.points, modes, frequency, mass, mesh.node_sets, cells, name="bar")
