"""What commands do, as functions, and what notebooks show of their results."""

import html
import json
import re
import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure

import flexfmu
from flexfmu.mesh.elements import ElementType
from meshes import BAR, box, write_deck

SCENE = """
read = ["tip"]
[[static]]
name = "bend"
loads = { "tip.force.y" = 2e3 }
[tolerance.static]
displacement = 0.05
rotation = 0.1
[sweep]
methods = ["linear", "frames"]
modes = [4]
frames = [1, 2]
basis = ["normal"]
"""


@pytest.fixture
def folder(tmp_path):
    mesh = box(ElementType.C3D20R, (6, 2, 2), (1.0, 0.1, 0.13))
    write_deck(mesh, tmp_path / "bar.inp")
    (tmp_path / "body.toml").write_text(BAR)
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


@pytest.mark.slow
def test_check_and_init_give_data_and_files(folder):
    found = flexfmu.check(folder / "body.toml")
    assert {len(rows) for rows in found.chosen.values()} == {21}
    assert found.mesh.element_count == 24
    assert "mass" in repr(found)
    table = found.to_dataframe().set_index("name")
    assert table.loc["interface tip", ["nodes", "x"]].tolist() == [21, 1.0]
    written = flexfmu.init(folder / "bar.inp", folder / "new.toml")
    assert flexfmu.Body.read(written).spec.interface
    with pytest.raises(flexfmu.FlexfmuError, match="is there already"):
        flexfmu.init(folder / "bar.inp", written)


@pytest.mark.slow
def test_a_chart_is_a_table_and_a_picture(folder):
    drawn = flexfmu.chart(folder / "body.toml", folder / "scene.toml", folder / "records.csv", bare=True, every=True)
    assert len(drawn.records) == len(drawn.to_dataframe()) >= 3
    assert drawn.finding
    assert isinstance(drawn.plot(), Figure)
    assert "<svg" in drawn._repr_html_()
    again = flexfmu.chart(None, None, folder / "records.csv")
    assert [one.key for one in again.records] == [one.key for one in drawn.records]


@pytest.mark.slow
def test_fit_gives_what_it_found(folder):
    found = flexfmu.fit(folder / "body.toml", folder / "scene.toml", folder / "lean.toml")
    assert found.met
    assert (folder / "lean.fmu").exists()
    assert found.verdict in found._repr_html_()
    table = found.to_dataframe().set_index("body")
    assert table.loc["written", "share"] <= 1.0
    assert table.loc["written", "modes"] == found.mode_count


@pytest.mark.slow
def test_a_map_of_stability_is_a_table_and_a_picture(folder):
    (folder / "scene.toml").write_text(SCENE + "[stability]\nfactors = [0.5, 1.0]\n")
    found = flexfmu.stability(folder / "body.toml", folder / "scene.toml", folder / "runs.csv")
    assert len(found.to_dataframe()) == len(found.runs) >= 4
    assert "<svg" in found._repr_html_()


@pytest.mark.slow
def test_bodies_runs_and_couplings_show_themselves(folder):
    body = flexfmu.Body.read(folder / "body.toml")
    assert "interface tip" in body._repr_html_()
    built = body.build()
    built.fmu(folder / "bar.fmu")
    assert "first frequency" in built._repr_html_()
    result = built.simulate({"time": [0.0, 0.01], "tip.force.y": [0.0, 500.0]}, step=1e-3)
    assert "<svg" in result._repr_html_()
    assert len(result.plot().axes) == 2
    flexfmu.show(folder / "bar.fmu", folder / "bar.html", loads={"tip.force.y": "5kN"})
    assert "tip.force.y = 5 kN" in (folder / "bar.html").read_text()
    (folder / "coupling.toml").write_text(
        "[experiment]\nstop = 0.01\nstep = 1e-3\n[[fmu]]\nname = 'one'\nfile = 'bar.fmu'\n"
        "start = { 'tip.force.y' = 500.0 }\n"
    )
    motion = flexfmu.couple(folder / "coupling.toml")
    assert motion.to_dataframe()["one.tip.displacement.y"].iloc[-1] == pytest.approx(
        motion["one.tip.displacement.y"][-1]
    )
    assert "<svg" in motion._repr_html_()
    assert np.abs(motion["one.tip.displacement.y"]).max() > 0.0


def data_of(shown):
    """The data of the page within a notebook's frame."""
    frame = re.search(r'<iframe srcdoc="(.*?)" style', shown._repr_html_(), re.S).group(1)
    return json.loads(re.search(r"const DATA = (.*);\n", html.unescape(frame)).group(1))


@pytest.mark.slow
def test_bodies_are_seen_from_a_script(folder):
    body = flexfmu.Body.read(folder / "body.toml")
    seen = data_of(body.view())
    assert seen["marks"] == [{"kind": "interface", "name": "tip"}, *seen["marks"][1:]]
    assert seen["cases"] == []
    built = body.build(frames=1, modes=4)
    assert [case["name"][:7] for case in data_of(built.view(modes=2))["cases"]] == ["mode 1,", "mode 2,"]
    bent = built.view({"tip": [0.0, 5e3, 0.0]})
    case = data_of(bent)["cases"][0]
    assert case["name"] == "tip.force.y = 5000 N"
    # F L³ / 3 E I, and some shear; the bar is 0.1 m by 0.13 m.
    beam = 5e3 / (3 * 2.1e11 * 0.13 * 0.1**3 / 12)
    assert case["top"] == pytest.approx(beam, rel=0.05)
    for picture in (body.plot(), built.plot(), built.plot({"tip": [0.0, 5e3, 0.0]}), bent.plot()):
        assert isinstance(picture, Figure)
        assert picture._repr_png_()[1:4] == b"PNG"
    assert bent.save(folder / "bent.svg").read_text().count("<path") > 100
    for shown in (body, built):
        assert "data:image/png;base64," in shown._repr_html_()


@pytest.mark.slow
def test_pictures_leave_the_way_of_the_notebook_alone():
    """No choice of a backend for the figures of others, and no matplotlib before something is drawn."""
    code = "import flexfmu, sys; flexfmu.Body, flexfmu.chart; import flexfmu.study.stability; "
    code += "assert 'matplotlib' not in sys.modules; "
    code += "import flexfmu.fmu.curves, flexfmu.study.pictures, flexfmu.view.picture; "
    code += "assert 'matplotlib.pyplot' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
