"""A body is the same in whatever units it is written; what no solid is like is warned of, with the likely cause."""

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from flexfmu.api import Body, Interface
from flexfmu.build.config import read_body_file
from flexfmu.build.kept import build_fmu
from flexfmu.build.reduce import body_model, distant_points, reduce_body
from flexfmu.commands.cli import app
from flexfmu.files.basics import BodyFileError, UnitSystem
from flexfmu.files.outputs import Reporter
from flexfmu.fmu.reading import read_packaged_body
from flexfmu.mesh.checks import implausible
from flexfmu.mesh.elements import ElementType
from flexfmu.mesh.model import Material
from flexfmu.reduction.options import node_set
from meshes import box, write_deck

SIZE = (0.254, 0.0127, 0.0254)
# Steel in each system by the definitions of its units, not by the factors under test.
STEEL = {"m-kg-s": (2.1e11, 7850.0), "mm-t-s": (2.1e5, 7.85e-9), "in-lbf-s": (3.045792e7, 7.3454449e-4)}
LENGTH = {"m-kg-s": 1.0, "mm-t-s": 1000.0, "in-lbf-s": 1.0 / 0.0254}
BODY = """
name = "bar"
[mesh]
file = "bar.inp"
units = "{units}"
[material]
youngs_modulus = {modulus!r}
poissons_ratio = 0.3
density = {density!r}
[[support]]
nodes = "ROOT"
fix = ["x", "y", "z"]
[[interface]]
name = "tip"
nodes = "TIP"
{interface}
[reduction]
modes = 3
"""


class Recorder(Reporter):
    """Keeps what it is told."""

    def __init__(self):
        self.notes, self.warnings = [], []

    def note(self, text):
        """Keep it."""
        self.notes.append(text)

    def warning(self, text):
        """Keep it."""
        self.warnings.append(text)


def bar_file(folder, units, *, modulus=None, density=None, interface="", materials=False):
    """Body file of a bar of SIZE whose deck is in some units; material by the body file."""
    mesh = box(ElementType.C3D20R, (4, 2, 2), SIZE)
    steel = Material("STEEL", STEEL[units][0], 0.3, STEEL[units][1])
    scaled = replace(mesh, points=LENGTH[units] * mesh.points, materials=(steel,))
    write_deck(scaled, folder / "bar.inp", materials=materials)
    path = folder / "bar.toml"
    values = {"modulus": modulus or STEEL[units][0], "density": density or STEEL[units][1]}
    path.write_text(BODY.format(units=units, interface=interface, **values), encoding="utf-8")
    return path


@pytest.mark.slow
def test_a_body_has_the_same_mass_size_and_frequencies_in_whatever_units_it_is_written(tmp_path):
    found = {}
    for units in STEEL:
        (tmp_path / units).mkdir()
        report = Recorder()
        path = bar_file(tmp_path / units, units)
        build_fmu(path, tmp_path / units / "bar.fmu", report=report)
        found[units] = read_packaged_body(tmp_path / units / "bar.fmu")
        assert report.warnings == []
    volume = np.prod(SIZE)
    for body in found.values():
        assert body.properties.mass == pytest.approx(7850.0 * volume, rel=1e-6)
        assert body.properties.volume.sum() == pytest.approx(volume, rel=1e-9)
        np.testing.assert_allclose(np.ptp(body.properties.box, axis=0), SIZE, rtol=1e-9)
        np.testing.assert_allclose(body.properties.youngs_modulus, [2.1e11], rtol=1e-6)
        np.testing.assert_allclose(body.angular_frequency, found["m-kg-s"].angular_frequency, rtol=1e-6)


PLACED = """
nodes = {{ plane = [{0!r}, 0.0, 0.0], normal = [1, 0, 0], tolerance = {1!r} }}
point = [{2!r}, 0.0, 0.0]
[[branch]]
toward = "tip"
joints = [{3!r}]
"""


def test_places_points_and_joints_are_in_the_units_of_the_mesh_in_body_files_and_in_python(tmp_path):
    for units, length in LENGTH.items():
        (tmp_path / units).mkdir()
        end, miss, point, joint = (length * x for x in (SIZE[0], 1e-5, 0.3, 0.127))
        path = bar_file(tmp_path / units, units, interface="NODES")
        text = PLACED.format(end, miss, point, joint)
        path.write_text(path.read_text(encoding="utf-8").replace('nodes = "TIP"\nNODES', text), encoding="utf-8")
        file = Body.read(path)
        tip = Interface(lambda x, end=end: np.isclose(x[:, 0], end), point=[point, 0.0, 0.0])
        branch = {"branch": [{"toward": "tip", "joints": [joint]}]}
        script = Body(
            file.mesh, (STEEL[units][0], 0.3, STEEL[units][1]), ["ROOT"], {"tip": tip}, units=units, tables=branch
        )
        for body in (file, script):
            found = body_model(body.mesh, body.spec)
            (interface,) = found.options.interfaces
            np.testing.assert_allclose(interface.point, [0.3, 0.0, 0.0], atol=1e-12)
            rows = node_set(found.model.mesh, interface.nodes, "tip")
            np.testing.assert_array_equal(rows, np.flatnonzero(np.isclose(body.mesh.points[:, 0], SIZE[0])))
            np.testing.assert_allclose(found.options.branches[0][1], [0.127], atol=1e-12)


def test_a_place_or_point_in_metres_of_a_mesh_in_millimetres_is_told(tmp_path):
    def given(words):
        path = bar_file(tmp_path, "mm-t-s", interface="NODES")
        path.write_text(path.read_text(encoding="utf-8").replace('nodes = "TIP"\nNODES', words), encoding="utf-8")
        body = Body.read(path)
        found = body_model(body.mesh, body.spec)
        return distant_points(found.model.mesh, found.options)

    with pytest.raises(BodyFileError, match="meet nodes if they are in m: give them in mm, as the mesh is"):
        given("nodes = { plane = [0.254, 0, 0], normal = [1, 0, 0] }")
    (told,) = given('nodes = "TIP"\npoint = [0.254, 0.0, 0.01]')
    assert "lies off its nodes, and among them if it were in m" in told
    assert given('nodes = "TIP"\npoint = [300.0, 0.0, 0.0]') == []


@pytest.mark.slow
def test_mass_is_that_of_each_material_s_density_times_its_volume(tmp_path):
    made = (Material("STEEL", 2.1e11, 0.3, 7850.0), Material("ALUMINIUM", 7e10, 0.33, 2700.0))
    near = box(ElementType.C3D10, (4, 2, 2), (1.0, 0.1, 0.1), materials=made, material=lambda c: 1 * (c[:, 0] > 1.0))
    write_deck(near, tmp_path / "bar.inp")
    text = BODY.format(units="m-kg-s", modulus=1e9, density=1e3, interface="")
    (tmp_path / "bar.toml").write_text(text[: text.index("[material]")] + text[text.index("[[support]]") :])
    build_fmu(tmp_path / "bar.toml", tmp_path / "bar.fmu")
    body = read_packaged_body(tmp_path / "bar.fmu")
    assert dict(zip(body.properties.material_names, body.properties.volume, strict=True)) == pytest.approx(
        {"STEEL": 0.0025, "ALUMINIUM": 0.0075}
    )
    assert body.properties.mass == pytest.approx(0.0025 * 7850.0 + 0.0075 * 2700.0)
    shown = " ".join(
        CliRunner().invoke(app, ["info", str(tmp_path / "bar.fmu")], env={"COLUMNS": "200"}).stdout.split()
    )
    for words in ("mass │ 39.8", "volume │ 0.01 m³", "1 × 0.1 × 0.1 m", "ALUMINIUM │ E 7e+10", "75 % of the vol"):
        assert words in shown
    assert f"first frequency │ {body.angular_frequency[0] / (2.0 * np.pi):.4g} Hz" in shown


@pytest.mark.slow
def test_the_build_says_mass_volume_size_material_and_first_frequency_and_info_repeats_it(tmp_path):
    path = bar_file(tmp_path, "mm-t-s")
    runner = CliRunner(env={"COLUMNS": "200"})
    built = runner.invoke(app, ["build", str(path), "-o", str(tmp_path / "bar.fmu"), "--fresh"])
    assert built.exit_code == 0, built.stderr
    words = ("0.6432 kg", "8.194e-05 m³", "0.254 × 0.0127 × 0.0254 m", "[material]", "ρ 7850 kg/m³", "first frequency")
    shown = runner.invoke(app, ["info", str(tmp_path / "bar.fmu")])
    for word in words:
        assert word in built.stderr
        assert word in shown.stdout


def solid(size, modulus, density, units):
    """A mesh as it is read when its numbers are in some units."""
    mesh = box(ElementType.C3D8, (1, 1, 1), np.array(size) * units.length)
    return replace(mesh, materials=(Material("M", modulus * units.stress, 0.3, density * units.density),))


SI, MM, INCH = UnitSystem
IMPLAUSIBLE = {
    "millimetres, the rest in SI": ((150, 20, 10), 2.1e11, 7850, SI, ["150 × 20 × 10 m", "in mm, 0.15 × 0.02 × 0.01"]),
    "millimetres, tonnes": ((150, 20, 10), 2.1e5, 7.85e-9, SI, ['set units = "mm-t-s"', "210000 N/m²", "0.15 × 0.02"]),
    "short part in millimetres": ((40, 20, 10), 2.1e5, 7.85e-9, SI, ['set units = "mm-t-s"', "0.04 × 0.02 × 0.01 m"]),
    "inches and psi": ((40, 2, 1), 3e7, 7.3e-4, SI, ['set units = "in-lbf-s"', "1.016 × 0.0508 × 0.0254 m"]),
    "psi beside kilograms": ((1, 0.1, 0.1), 3e7, 7850, SI, ["3e+07 N/m²", "in psi, 2.068e+11 N/m²"]),
    "pounds per cubic inch": ((40, 2, 1), 3e7, 0.2836, INCH, ["0.2836 lbf s²/in⁴", "in lb/in³, 0.0007345 lbf s²/in⁴"]),
    "modulus in MPa": ((1, 0.1, 0.1), 2e5, 7850, SI, ["modulus 200000 N/m²", "in MPa, 2e+11 N/m²"]),
    "modulus in GPa": ((1, 0.1, 0.1), 210, 7850, SI, ["in GPa, 2.1e+11 N/m²"]),
    "density in t/mm³": ((1, 0.1, 0.1), 2e11, 8e-9, SI, ["density 8e-09 kg/m³", "in t/mm³, 8000 kg/m³"]),
    "density in g/cm³": ((1, 0.1, 0.1), 2e11, 7.85, SI, ["density 7.85 kg/m³", "in g/cm³, 7850 kg/m³"]),
    "density in kg/mm³": ((1000, 10, 10), 2e5, 7.85e-6, MM, ["in kg/mm³, 7.85e-09 t/mm³"]),
    "material in SI beside millimetres": (
        (300, 9, 9),
        2e11,
        7850,
        MM,
        ["in kg/m³, 7.85e-09 t/mm³", "in N/m², 2e+05 MPa"],
    ),
    "metres declared as millimetres": (
        (1.2, 0.1, 0.1),
        2.1e5,
        7.85e-9,
        MM,
        ["0.0012 × 0.0001 × 0.0001 m", "in m, 1.2"],
    ),
    "all in SI declared as millimetres": ((1.2, 0.1, 0.1), 2.1e11, 7850, MM, ['set units = "m-kg-s"', "found mm-t-s"]),
}


@pytest.mark.parametrize("case", IMPLAUSIBLE)
def test_numbers_that_no_solid_has_are_warned_of_with_the_units_that_explain_them(case):
    size, modulus, density, units, words = IMPLAUSIBLE[case]
    said = implausible(solid(size, modulus, density, units), units)
    assert len(said) == 1
    for word in words:
        assert word in said[0]


@pytest.mark.parametrize(
    ("size", "modulus", "density"),
    [
        ((0.005, 0.001, 0.0002), 1.7e11, 2330),
        ((80.0, 4.0, 4.0), 4e10, 1900),
        ((0.1, 0.1, 0.1), 2e6, 1100),
        ((0.5, 0.1, 0.1), 3e8, 60),
        ((0.3, 0.01, 0.01), 1.05e12, 3520),
        ((0.1, 0.1, 0.1), 1.6e10, 11340),
    ],
    ids=["silicon hinge", "rotor blade", "rubber bush", "structural foam", "diamond", "lead"],
)
@pytest.mark.parametrize("units", UnitSystem)
def test_real_solids_are_not_warned_of_in_any_units(size, modulus, density, units):
    written = np.array(size) / units.length, modulus / units.stress, density / units.density
    assert implausible(solid(*written, units), units) == ()


@pytest.mark.slow
def test_a_material_that_nothing_uses_and_a_point_in_millimetres_are_warned_of(tmp_path):
    path = bar_file(tmp_path, "mm-t-s", interface="point = [254e3, 0.0, 0.0]", materials=True)
    report = Recorder()
    reduce_body(read_body_file(path), report)
    assert [text.partition(":")[0] for text in report.warnings] == [
        "interface 'tip'",
        "[material] is not used",
    ]
    assert "lies 2.537e+05 mm outside the body" in report.warnings[0]
    assert "points are in the mesh's units (mm-t-s)" in report.warnings[0]
