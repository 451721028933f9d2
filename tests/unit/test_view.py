"""What `flexfmu view` shows: pages that draw, numbers that ParaView reads, pictures for reports."""

import base64
import json
import re
import xml.etree.ElementTree as ET

import matplotlib.image
import meshio
import numpy as np
import pytest
from typer.testing import CliRunner

from chromium import look
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.reduce import reduce_body
from flexfmu.commands.cli import app
from flexfmu.files.outputs import Reporter
from flexfmu.files.tables import read_table
from flexfmu.mesh.elements import ElementType
from flexfmu.model.modal_file import write_modal_file
from flexfmu.view.model import shown_factor
from meshes import body_file, box

FORCE = 8e3


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Modal file, body file and deck of a clamped bar, with the stress of its surface."""
    place = tmp_path_factory.mktemp("view")
    mesh = box(ElementType.C3D20R, (16, 2, 2), (1.0, 0.03, 0.03))
    tables = {
        "frames": 2,
        "output": {"stress": True, "surface": True},
        "reduction": {"modes": 6, "residual_flexibility": True},
    }
    config = body_file(mesh, place, interface=["TIP"], name="bar", **tables)
    write_modal_file(reduce_body(config, Reporter()), place / "bar.h5")
    (place / "bar.toml").write_text(
        'name = "bar"\nframes = 2\n[mesh]\nfile = "bar.inp"\n[[support]]\nnodes = "ROOT"\nfix = ["x", "y", "z"]\n'
        '[[interface]]\nname = "tip"\nnodes = "TIP"\n'
    )
    return place


def view(*arguments):
    """Run `flexfmu view`; standard output."""
    result = CliRunner().invoke(app, ["view", *map(str, arguments)])
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.fixture(scope="module")
def bent(folder):
    """The bar under a tip force, by the body itself: places, stress, undeformed points."""
    from flexfmu import load
    from flexfmu.body.recovery import surface_von_mises

    body = load(folder / "bar.h5")
    state = body.static({"tip": [0.0, FORCE, 0.0]})
    return body.surface_positions(state), surface_von_mises(body.model, state.q), body.model.surface.points


def content(page):
    """The data inside a page."""
    return json.loads(re.search(r"const DATA = (.*);\n", page.read_text()).group(1))


def test_a_page_holds_the_places_of_the_bent_body(folder, bent):
    said = view(folder / "bar.h5", "--load", f"tip.force.y={FORCE}", "-o", folder / "bent.html")
    assert "largest displacement" in said
    data = content(folder / "bent.html")
    case = data["cases"][0]
    assert case["name"] == f"tip.force.y = {FORCE} N"
    moved = np.frombuffer(base64.b64decode(case["moved"]), "<i2").reshape(len(case["position"]), -1, 3)
    places, _, points = bent
    np.testing.assert_allclose(moved[-1] * case["quantum"], places - points, atol=case["quantum"])
    assert case["top"] == pytest.approx(np.linalg.norm(places - points, axis=1).max())
    assert case["factor"] == 1.0
    assert not moved[0].any()


def test_a_page_fetches_nothing(folder):
    view(folder / "bar.h5", "--modes", 2, "-o", folder / "modes.html")
    text = (folder / "modes.html").read_text()
    assert not re.search(r"""(src|href)\s*=|@import|fetch\(|XMLHttp|https?://""", text)


@pytest.mark.slow
@pytest.mark.parametrize("width", [1400, 400])
@pytest.mark.parametrize("name", ["bent", "modes", "mesh"])
def test_a_page_draws_the_body_on_desk_and_phone(folder, name, width):
    arguments = {
        "bent": (folder / "bar.h5", "--load", f"tip.force.y={FORCE}"),
        "modes": (folder / "bar.h5", "--modes", 2),
        "mesh": (folder / "bar.toml",),
    }[name]
    page = folder / f"{name}_{width}.html"
    view(*arguments, "-o", page)
    pixels, said = look(page, folder / f"{name}_{width}.png", width)
    assert said == []
    assert pixels.shape[1] == width
    # In the middle of the page there are colours, which neither words nor background have.
    middle = pixels[200:700]
    coloured = np.ptp(middle, axis=2) > 0.2
    assert coloured.mean() > (0.005 if name != "mesh" else 0.002)
    # The body reaches over most of the width, and not beyond it.
    columns = np.flatnonzero(coloured.any(axis=0))
    assert np.ptp(columns) > 0.5 * width
    assert not coloured[:, -3:].any()


def test_paraview_reads_the_same_numbers(folder, bent):
    view(folder / "bar.h5", "--load", f"tip.force.y={FORCE}", "-o", folder / "bent.vtu")
    read = meshio.read(folder / "bent.vtu")
    places, stress, points = bent
    np.testing.assert_array_equal(read.points, points)
    np.testing.assert_array_equal(read.point_data["displacement"], places - points)
    np.testing.assert_array_equal(read.point_data["von_mises"], stress)
    assert set(read.point_data["frames"]) == {0, 1}
    assert sum(len(block.data) for block in read.cells) == 16 * 2 * 4 + 8


def test_a_series_for_paraview_has_a_file_for_each_step(folder, bent):
    view(folder / "bar.h5", "--load", f"tip.force.y={FORCE}", "-o", folder / "series.pvd")
    steps = ET.parse(folder / "series.pvd").getroot().findall("Collection/DataSet")
    assert [float(step.get("timestep")) for step in steps] == pytest.approx(np.linspace(0.0, 100.0, 11))
    last = meshio.read(folder / steps[-1].get("file"))
    np.testing.assert_array_equal(last.point_data["displacement"], bent[0] - bent[2])


@pytest.mark.slow
@pytest.mark.parametrize("colour", ["displacement", "von_mises", "frames"])
def test_a_picture_for_reports_shows_a_coloured_body(folder, colour):
    target = folder / f"{colour}.png"
    view(folder / "bar.h5", "-l", f"tip.force.y={FORCE / 1e3}kN", "--colour", colour, "-o", target)
    pixels = matplotlib.image.imread(target)[:, :, :3]
    assert (np.ptp(pixels, axis=2) > 0.2).mean() > 0.01


def test_small_displacements_are_drawn_larger_by_a_round_factor():
    assert shown_factor(0.0, 1.0) == 1.0
    assert shown_factor(0.04, 1.0) == 1.0
    assert shown_factor(1e-3, 1.0) == 100.0
    assert shown_factor(3e-3, 1.0) == 20.0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("bar.h5", "--load", "tip.force.q=1"), "tip.force.x"),
        (("bar.h5", "--load", "tip.force.y=5 kg"), "kN"),
        (("bar.h5", "--load", "tip.force.y"), "NAME=VALUE"),
        (("bar.h5", "--colour", "heat"), "displacement"),
        (("bar.inp", "--modes", "2"), "body file"),
        (("bar.h5", "-o", "picture.gif"), ".html"),
    ],
)
def test_what_cannot_be_shown_is_told_with_what_can(folder, arguments, words, monkeypatch):
    monkeypatch.chdir(folder)
    result = CliRunner().invoke(app, ["view", *arguments])
    assert result.exit_code == 1
    assert words in result.stderr


def test_a_mesh_is_seen_with_its_node_sets(folder):
    view(folder / "bar.inp", "-o", folder / "sets.html")
    data = content(folder / "sets.html")
    assert {name: len(rows) for name, rows in data["sets"].items()} == {"ROOT": 9, "TIP": 9}


def test_before_it_is_built_a_body_is_seen_with_its_frames_as_they_will_be(folder):
    view(folder / "bar.toml", "-o", folder / "before.html")
    data = content(folder / "before.html")
    frames = next(region for region in data["regions"] if region["title"] == "frames")
    from flexfmu import load

    surface = load(folder / "bar.h5").model.surface
    np.testing.assert_array_equal(np.frombuffer(base64.b64decode(frames["number"]), "<i4"), surface.frame)


def test_a_body_built_without_its_surface_says_how_to_build_it(folder, tmp_path):
    from dataclasses import replace

    from flexfmu.fmu.reading import read_packaged_body

    write_modal_file(replace(read_packaged_body(folder / "bar.h5"), surface=None), tmp_path / "bare.h5")
    result = CliRunner().invoke(app, ["view", str(tmp_path / "bare.h5"), "-o", str(tmp_path / "bare.html")])
    assert result.exit_code == 1
    assert "surface = true" in result.stderr
    assert not (tmp_path / "bare.html").exists()


def test_linear_kinematics_are_seen_to_stretch(folder, bent):
    view(folder / "bar.h5", "-l", f"tip.force.y={FORCE}", "--method", "linear", "-o", folder / "straight.vtu")
    read = meshio.read(folder / "straight.vtu")
    body = FlexibleBody(__import__("flexfmu").load(folder / "bar.h5").model, "linear")
    expected = body.model.surface.modes @ body.static({"tip": [0.0, FORCE, 0.0]}).q
    np.testing.assert_allclose(read.point_data["displacement"], expected, atol=1e-12)
    assert not np.allclose(expected, bent[0] - bent[2], atol=1e-3)


@pytest.fixture(scope="module")
def fmu(folder):
    from flexfmu.fmu.package import package_fmu
    from flexfmu.fmu.reading import read_packaged_body

    package_fmu(read_packaged_body(folder / "bar.h5"), folder / "bar.fmu")
    return folder / "bar.fmu"


# A force that jumps, between communication points and at one.
LOADS = "time,tip.force.y,tip.moment.x\n0,0,0\n0.0043,500,0\n0.0043,3000,10\n0.01,3000,-20\n0.01,-1000,0\n0.02,0,0\n"


def tip_of(case):
    """Motion of the mark at the tip, (T, 3)."""
    return np.array(case["marks"])[:, 0]


@pytest.mark.parametrize(
    "settings",
    [(), ("initialization=static",), ("input.interpolation=linear",), ("input.interpolation=ramp", "damping.scale=5")],
)
def test_a_simulation_is_shown_as_its_fmu_moved(folder, fmu, settings):
    (folder / "loads.csv").write_text(LOADS)
    options = [word for setting in settings for word in ("--set", setting)]
    arguments = ["simulate", str(fmu), "-i", str(folder / "loads.csv"), "-o", str(folder / "result.csv"), *options]
    result = CliRunner().invoke(app, [*arguments, "--step", "5e-4", "--view", str(folder / "moving.html")])
    assert result.exit_code == 0, result.output
    assert "differs" not in result.stderr
    case = content(folder / "moving.html")["cases"][0]
    names, table = read_table(folder / "result.csv")
    moved = table[:, [1 + names.index(f"tip.displacement.{axis}") for axis in "xyz"]]
    assert np.abs(moved).max() > 0.01
    np.testing.assert_allclose(case["position"], table[:, 0], atol=1e-9)
    tip = tip_of(case) - np.array(content(folder / "moving.html")["markPoints"])[0]
    np.testing.assert_allclose(tip, moved, atol=1e-6 * np.abs(moved).max())


def test_a_table_of_loads_is_for_a_simulation(folder, fmu):
    (folder / "loads.csv").write_text(LOADS)
    result = CliRunner().invoke(app, ["view", str(fmu), str(folder / "loads.csv"), "-o", str(folder / "no.html")])
    assert result.exit_code == 1
    assert "simulate --view" in result.stderr


def test_a_shape_is_found_from_the_motion_of_interfaces_alone(folder, fmu, bent):
    # A force at the tip leaves no other shape of less energy.
    from flexfmu import load

    body = load(fmu)
    row = body.motion(body.static({"tip": [0.0, FORCE, 0.0]}))
    names = [f"arm.tip.{kind}.{axis}" for kind in ("displacement", "rotation") for axis in "xyz"]
    rows = [["time", *names, "other.x"], [0] * 8, [1, *map(repr, row.tolist()), 5]]
    (folder / "coupled.csv").write_text("\n".join(",".join(map(str, cells)) for cells in rows) + "\n")
    view(fmu, folder / "coupled.csv", "-o", folder / "coupled.vtu")
    found = meshio.read(folder / "coupled.vtu").point_data["displacement"]
    assert np.abs(found - (bent[0] - bent[2])).max() < 1e-3 * np.abs(bent[0] - bent[2]).max()


# Every control of the page, as a user would touch it; what goes wrong in it ends up in the console.
TOUCH = """<script>
{
  const all = (id, act) => [...$(id).options].forEach(o => act($(id), o.value));
  const change = (select, value) => { select.value = value; select.onchange({ target: select }); render(); };
  const first = () => { if (DATA.cases.length) change($("case"), "0"); };
  all("case", change); first(); all("colour", change); all("set", change);
  for (const b of document.querySelectorAll("button")) { b.click(); render(); }
  for (const r of document.querySelectorAll("input[type=range]")) { r.value = 0.5; r.oninput({ target: r }); render(); }
  const at = (type, id, x) => area.dispatchEvent(new PointerEvent(type, { pointerId: id, clientX: x, clientY: 300 }));
  area.setPointerCapture = () => {};
  const seen = JSON.stringify(turn);
  at("pointerdown", 1, 300); at("pointermove", 1, 340);
  if (JSON.stringify(turn) === seen) console.error("one finger does not turn the body");
  const near = zoom;
  at("pointerdown", 2, 200); at("pointermove", 2, 100);
  if (!(zoom > near)) console.error("two fingers do not zoom");
  at("pointerup", 1, 0); at("pointerup", 2, 0);
  area.dispatchEvent(new WheelEvent("wheel", { deltaY: -100, cancelable: true })); render();
  if (DATA.cases.length) {
    first(); stop();
    const from = position;
    $("play").click(); tick(1000); tick(1500);
    if (position === from) console.error("nothing plays");
  }
  if (gl.getError()) console.error("WebGL complains");
}
</script></body>"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["modes", "mesh"])
def test_every_control_of_a_page_works(folder, name):
    view(*{"modes": (folder / "bar.h5", "-m", 2), "mesh": (folder / "bar.toml",)}[name], "-o", folder / "touched.html")
    text = (folder / "touched.html").read_text()
    (folder / "touched.html").write_text(text.replace("</body>", TOUCH))
    _, said = look(folder / "touched.html", folder / "touched.png", 600)
    assert said == []
