"""The body file: defaults, and errors that name the key, what was found and what would do."""

import re

import pytest

from flexfmu.build.config import read_body_file
from flexfmu.files.basics import BodyFileError, UnitSystem
from flexfmu.model.methods import Data, Mass, Method, Variant, needs
from flexfmu.reduction.options import Basis

LEAST = """
name = "body"
{top}
[mesh]
file = "mesh.inp"
{mesh}
[[interface]]
name = "tip"
nodes = "TIP"
{interface}
{rest}
"""
SUPPORT = '[[support]]\nnodes = "ROOT"\nfix = '
MATERIAL = "[material]\nyoungs_modulus = {e}\npoissons_ratio = {nu}\ndensity = {rho}"
TWO_FRAMES = '[[frame]]\nname = "a"\nnodes = "A"\n[[frame]]\nname = "{second}"\nnodes = "B"\nparent = "{parent}"'


def content(top="", mesh="", interface="", rest=""):
    return LEAST.format(top=top, mesh=mesh, interface=interface, rest=rest)


def read(folder, text):
    path = folder / "body.toml"
    path.write_text(text, encoding="utf-8")
    return read_body_file(path)


def message(folder, text):
    with pytest.raises(BodyFileError) as caught:
        read(folder, text)
    assert str(folder / "body.toml") in str(caught.value)
    return str(caught.value)


def test_defaults_are_those_of_the_documentation(tmp_path):
    body = read(tmp_path, content())
    assert body.mesh.file == tmp_path / "mesh.inp"
    assert body.mesh.units is UnitSystem.SI
    assert (body.material, body.support, body.frame, body.frames) == (None, [], [], None)
    assert (body.interface[0].point, body.interface[0].weights) == (None, "auto")
    assert (body.reduction.basis, body.reduction.modes) == (Basis.NORMAL, 8)
    assert (body.options.levels, body.residual) == (4, True)
    assert body.damping.ratio == 0.0
    assert body.variant == Variant(Method.SECOND_ORDER, Mass.POLYNOMIAL)
    assert body.stored == {Data.SECOND_ORDER}
    assert (body.output.velocities, body.output.surface, body.input.acceleration) == (False, True, False)


def test_the_method_is_frames_where_second_order_is_ruled_out(tmp_path):
    assert read(tmp_path, content(rest="[reduction]\nsecond_order = false")).variant.method is Method.FRAMES


def test_the_method_is_second_order_with_the_deformed_body_s_mass_too(tmp_path):
    found = read(tmp_path, content(rest='[formulation]\nmass = "configuration"')).variant
    assert found == Variant(Method.SECOND_ORDER, Mass.CONFIGURATION)


def test_the_mass_is_the_polynomial_of_bodies_in_one_piece_to_second_order(tmp_path):
    def mass(**parts):
        return read(tmp_path, content(**parts)).variant.mass

    assert mass(rest='[formulation]\nmass = "constant"') is Mass.CONSTANT
    assert mass(rest='[formulation]\nmethod = "second_order"') is Mass.POLYNOMIAL
    assert mass(rest='[formulation]\nmethod = "frames"') is Mass.CONSTANT
    assert mass(top="free = true") is Mass.POLYNOMIAL
    assert mass(top='cut = "auto"') is Mass.CONSTANT
    cut = content(top='cut = "auto"', rest='[formulation]\nmass = "polynomial"')
    assert 'mass "constant" only' in message(tmp_path, cut)
    assert "second_order" in message(tmp_path, content(rest='[formulation]\nmethod = "frames"\nmass = "polynomial"'))


def test_everything_given_is_taken(tmp_path):
    rest = "\n".join(
        [
            SUPPORT + '["x", "z"]',
            MATERIAL.format(e=2e11, nu=0.3, rho=7850),
            TWO_FRAMES.format(second="b", parent="a"),
            '[reduction]\nmodes = 3\n[damping]\nratio = [0.01, 0.02, 0.0]\n[formulation]\nmethod = "linear"',
            "[output]\nvelocities = true",
        ]
    )
    interface = 'point = [1, 2.5, 3]\nweights = "node"'
    body = read(tmp_path, content(mesh='units = "mm-t-s"', interface=interface, rest=rest))
    assert body.mesh.units is UnitSystem.MM_T_S
    assert body.support[0].fix == ["x", "z"]
    assert body.material.youngs_modulus == 2e11
    assert [(f.name, f.parent) for f in body.frame] == [("a", None), ("b", "a")]
    assert (body.reduction.modes, body.damping.ratio) == (3, [0.01, 0.02, 0.0])
    assert body.variant == Variant(Method.LINEAR)
    assert (body.interface[0].point, body.interface[0].weights) == ([1.0, 2.5, 3.0], "node")
    assert body.output.velocities


def test_where_nothing_says_how_many_modes_there_are_as_many_as_listed_damping_ratios(tmp_path):
    basis = read(tmp_path, content(rest="[damping]\nratio = [0.1, 0.2, 0.3]")).options.basis
    assert (basis.numbers, basis.exact, basis.residual) == ((1, 2, 3), True, False)


WRONG = {
    "unknown key at the top": ({"top": "colour = 3"}, ["colour: unknown key", "docs/reference/body-file.md"]),
    "unknown key in a table": ({"mesh": "scale = 2.0"}, ["mesh.scale: unknown key"]),
    "unknown key in the second of two tables": (
        {"rest": SUPPORT + '["x"]\n' + SUPPORT + '["y"]\nforce = 1'},
        ["support[2].force: unknown key"],
    ),
    "unknown table": ({"rest": "[loads]\nx = 1"}, ["loads: unknown key"]),
    "text for a number": ({"rest": '[reduction]\nmodes = "ten"'}, ["reduction.modes: found 'ten'", "integer"]),
    "fraction for a count": ({"rest": "[reduction]\nmodes = 2.5"}, ["reduction.modes: found 2.5", "integer"]),
    "number for a text": ({"rest": "[[support]]\nnodes = 7\nfix = ['x']"}, ["support[1].nodes: found 7", "string"]),
    "number for a table": ({"rest": "damping = 0.01"}, ["interface[1].damping: unknown key"]),
    "one table where several may be": (
        {"rest": '[support]\nnodes = "A"'},
        ["support: found one table", "expected [[support]]"],
    ),
    "too few modes": ({"rest": "[reduction]\nmodes = 0"}, ["reduction.modes: found 0", "greater than or equal to 1"]),
    "modes out of order": (
        {"rest": "[reduction]\nmodes = [3, 1]"},
        ["reduction.modes: is [3, 1]", "ascending"],
    ),
    "mode number zero": ({"rest": "[reduction]\nmodes = [0, 1]"}, ["reduction.modes[1]: found 0", "or equal to 1"]),
    "a damping ratio too many for chosen modes": (
        {"rest": "[reduction]\nmodes = [1, 4]\n[damping]\nratio = [0.1, 0.1, 0.1]"},
        ["3 values for 2 modes"],
    ),
    "residual flexibility of no load": (
        {"rest": '[reduction]\nresidual_flexibility = ["tip.force"]'},
        ["residual_flexibility lists 'tip.force'", '"tip.force.x"', "interfaces: tip"],
    ),
    "residual flexibility that is neither": (
        {"rest": "[reduction]\nresidual_flexibility = 3"},
        ["reduction.residual_flexibility: found 3", "true or false", "list"],
    ),
    "branch to nowhere": (
        {"rest": '[[branch]]\ntoward = "top"\njoints = [0.1]'},
        ["[[branch]] leads toward 'top'", "an interface: tip"],
    ),
    "joints out of order": (
        {"rest": '[[branch]]\ntoward = "tip"\njoints = [0.2, 0.1]'},
        ["branch[1].joints: is [0.2, 0.1]", "ascending"],
    ),
    "branch and frames": (
        {"top": "frames = 2", "rest": '[[branch]]\ntoward = "tip"\njoints = [0.1]'},
        ["either frames = n", "[[branch]]"],
    ),
    "negative frames": ({"top": "frames = -1"}, ["frames: found -1", "greater than or equal to 0"]),
    "missing key": ({"rest": '[[support]]\nnodes = "ROOT"'}, ["support[1]: holds nothing", "stiffness = [kx, ky, kz]"]),
    "empty list": ({"rest": SUPPORT + "[]"}, ["support[1]: holds nothing", 'fix = ["x", "y", "z"]']),
    "unknown direction": ({"rest": SUPPORT + '["x", "w"]'}, ["support[1].fix[2]: found 'w'", "'x', 'y' or 'z'"]),
    "unknown units": ({"mesh": 'units = "inch"'}, ["mesh.units: found 'inch'", "'m-kg-s', 'mm-t-s' or"]),
    "unknown method": (
        {"rest": '[formulation]\nmethod = "exact"'},
        ["formulation.method: found 'exact'", "'linear'", "'second_order'"],
    ),
    "unknown mass": ({"rest": '[formulation]\nmass = "x"'}, ["formulation.mass: found 'x'", "'configuration'"]),
    "a mass that the method does not know": (
        {"rest": '[formulation]\nmethod = "frames_stiffness"\nmass = "configuration"'},
        ["formulation: ", 'mass "configuration" goes with methods "frames" and "second_order" only'],
    ),
    "a method without its data": (
        {"rest": '[reduction]\nsecond_order = false\n[formulation]\nmethod = "second_order"'},
        ['method "second_order" needs second_order = true', "take that key out"],
    ),
    "a method without its geometric stiffness": (
        {"rest": '[reduction]\ngeometric_stiffness = ["by_mode"]\n[formulation]\nmethod = "stiffness_by_load"'},
        ['method "stiffness_by_load" needs geometric_stiffness = ["by_load"]'],
    ),
    "a method that needs frames, and none": (
        {"top": "frames = 0", "rest": '[formulation]\nmethod = "half_rotation"'},
        ['method "half_rotation" needs frames', "frames = 1 or more", '"linear"'],
    ),
    "stress of each load of a free body": (
        {"top": "free = true", "rest": '[formulation]\nmethod = "frames_stiffness"'},
        ['method "frames_stiffness" needs the stress of each load', '"second_order"'],
    ),
    "one frame for the parts of a cut body": (
        {"rest": '[[cut]]\nnodes = "C"\n[formulation]\nmethod = "floating_frame"'},
        ["[[cut]] gives each part frames of its own", '"floating_frame"'],
    ),
    "unknown basis": ({"rest": '[reduction]\nbasis = "x"'}, ["reduction.basis: found 'x'", "'normal'"]),
    "unknown weights": ({"interface": 'weights = "mass"'}, ["interface[1].weights: found 'mass'", "'area'"]),
    "point in the plane": (
        {"interface": "point = [0.0, 1.0]"},
        ["interface[1].point: found [0.0, 1.0]", "expected 3 values, there are 2"],
    ),
    "name with a dot": (
        {"rest": '[[frame]]\nname = "a.b"\nnodes = "A"'},
        ["frame[1].name: found 'a.b'", "letters, digits and _"],
    ),
    "negative damping": (
        {"rest": "[damping]\nratio = -0.01"},
        ["damping.ratio: is -0.01, expected a share from 0 to 1"],
    ),
    "one negative damping ratio of several": (
        {"rest": "[reduction]\nmodes = 2\n[damping]\nratio = [0.1, -0.1]"},
        ["damping.ratio[2]: is -0.1, expected a share from 0 to 1"],
    ),
    "damping for another number of modes": (
        {"rest": "[reduction]\nmodes = 4\n[damping]\nratio = [0.1, 0.1]"},
        ["damping.ratio lists 2 values for 4 modes"],
    ),
    "both ways of division": (
        {"top": "frames = 2", "rest": '[[frame]]\nname = "a"\nnodes = "A"'},
        ["either frames = n", "or [[frame]] tables (node sets)"],
    ),
    "two interfaces of one name": (
        {"rest": '[[interface]]\nname = "tip"\nnodes = "B"'},
        ["two [[interface]] tables have the name 'tip'", "expected different names"],
    ),
    "two frames of one name": (
        {"rest": TWO_FRAMES.format(second="a", parent="a")},
        ["two [[frame]] tables have the name 'a'"],
    ),
    "unknown parent": (
        {"rest": TWO_FRAMES.format(second="b", parent="trunk")},
        ["frame 'b' has the parent 'trunk', which is no [[frame]]"],
    ),
    "modulus that is not positive": (
        {"rest": MATERIAL.format(e=0.0, nu=0.3, rho=1.0)},
        ["material.youngs_modulus: found 0.0", "greater than 0"],
    ),
    "incompressible": (
        {"rest": MATERIAL.format(e=1.0, nu=0.5, rho=1.0)},
        ["material.poissons_ratio: found 0.5", "less than 0.5"],
    ),
    "infinite modulus": (
        {"rest": MATERIAL.format(e="inf", nu=0.3, rho=1.0)},
        ["material.youngs_modulus: found inf", "finite number"],
    ),
    "density that is no number": (
        {"rest": MATERIAL.format(e=1.0, nu=0.3, rho="nan")},
        ["material.density: found nan", "finite number"],
    ),
    "damping that is no number": ({"rest": "[damping]\nratio = nan"}, ["damping.ratio: found nan", "finite number or"]),
    "damping by a word": ({"rest": '[damping]\nratio = "x"'}, ["damping.ratio: found 'x'", "number", "list"]),
    "a word among damping ratios": (
        {"rest": '[damping]\nratio = [0.1, "x"]'},
        ["damping.ratio[2]: found 'x'", "number"],
    ),
    "joint in the plane": (
        {"rest": '[[frame]]\nname = "a"\nnodes = "A"\njoint = [1, 2]'},
        ["frame[1].joint: found [1, 2]", "string or expected", "expected 3 values, there are 2"],
    ),
    "true for a number": ({"rest": "[damping]\nratio = true"}, ["damping.ratio: found True", "number"]),
    "true for a count": ({"top": "frames = true"}, ["frames: found True", "integer"]),
    "number in quotes": ({"rest": '[reduction]\nmodes = "12"'}, ["reduction.modes: found '12'", "integer"]),
    "coordinate in quotes": ({"interface": 'point = ["1", 2, 3]'}, ["interface[1].point[1]: found '1'", "number"]),
    "yes for true": ({"rest": '[output]\nsurface = "yes"'}, ["output.surface: found 'yes'", "true or false"]),
    "point at infinity": ({"interface": "point = [0, 0, -inf]"}, ["interface[1].point[3]: found -inf", "finite"]),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_key_is_named_with_what_was_found_and_what_would_do(case, tmp_path):
    changes, expected = WRONG[case]
    text = message(tmp_path, content(**changes))
    for part in expected:
        assert part in text
    # One line for the one mistake.
    assert len(text.splitlines()) == 2, text


def test_a_file_without_name_mesh_and_interface_is_told_all_three_at_once(tmp_path):
    text = message(tmp_path, "frames = 1")
    assert re.findall(r"^  (\w+): missing", text, re.MULTILINE) == ["name", "mesh", "interface"]


def test_an_empty_list_of_interfaces_is_refused(tmp_path):
    text = message(tmp_path, 'name = "body"\ninterface = []\n[mesh]\nfile = "m.inp"')
    assert "interface: found []" in text
    assert "at least 1 value" in text


def test_every_mistake_is_told_at_once(tmp_path):
    text = message(tmp_path, content(top="frames = -1", mesh='units = "inch"', rest="[output]\nmovie = true"))
    assert [line.split(":")[0].strip() for line in text.splitlines()[1:]] == ["mesh.units", "frames", "output.movie"]


def test_text_that_is_no_toml_is_told_with_its_place(tmp_path):
    assert re.search(r"not valid TOML: .*line 2", message(tmp_path, 'name = "body"\nframes = = 2\n'))


def test_a_file_that_is_not_there_is_told_by_its_path(tmp_path):
    path = tmp_path / "nothing.toml"
    with pytest.raises(BodyFileError, match=re.escape(f"{path}: no such file")):
        read_body_file(path)


def test_a_file_that_cannot_be_read_is_told_why(tmp_path):
    with pytest.raises(BodyFileError, match="cannot be read"):
        read_body_file(tmp_path)
    path = tmp_path / "latin.toml"
    path.write_bytes(b'name = "k\xf6rper"')
    with pytest.raises(BodyFileError, match=r"cannot be read .*utf-8"):
        read_body_file(path)


def test_an_absolute_path_of_a_mesh_stays_as_it_is(tmp_path):
    text = content().replace('"mesh.inp"', "'/data/mesh.inp'")
    assert str(read(tmp_path, text).mesh.file) == "/data/mesh.inp"


@pytest.mark.parametrize("method", Method)
def test_a_build_stores_what_the_method_needs_and_what_is_asked_for(tmp_path, method):
    config = read(tmp_path, content(rest=f'[formulation]\nmethod = "{method.value}"'))
    assert config.variant.method is method
    assert config.stored == needs(method)
    more = read(tmp_path, content(rest=f'[reduction]\ninertia = true\n[formulation]\nmethod = "{method.value}"'))
    assert more.stored == needs(method) | {Data.INERTIA}


def test_a_body_without_frames_starts_linear(tmp_path):
    assert read(tmp_path, content(top="frames = 0")).variant == Variant(Method.LINEAR)
