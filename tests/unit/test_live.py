"""The live page: its core beside the native one, a pull with a pointer in Chromium."""

import base64
import gzip
import json
import re
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import flexfmu.view.shown
from chromium import Tab, browser
from driven import Driven
from flexfmu.build.reduce import reduce_body
from flexfmu.commands.cli import app
from flexfmu.files.outputs import Reporter
from flexfmu.fmu.built_body import load
from flexfmu.mesh.elements import ElementType
from flexfmu.model.modal_file import write_modal_file
from flexfmu.program.variable_table import variable_table
from meshes import body_file, box

MASTER = Path(flexfmu.view.shown.__file__).with_name("fmu.js")
STEPS, STEP, CLOSE = 10_000, 1e-4, 1e-12
MOST_BYTES = 600_000
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def modal_file(tmp_path_factory):
    """A clamped bar with its own error estimate."""
    folder = tmp_path_factory.mktemp("live")
    mesh = box(ElementType.C3D20R, (16, 2, 2), (1.0, 0.03, 0.03))
    model = reduce_body(
        body_file(mesh, folder, interface=["TIP"], name="bar", output={"error": True, "surface": True}), Reporter()
    )
    write_modal_file(model, folder / "bar.h5")
    return model, folder / "bar.h5"


@pytest.fixture(scope="module")
def bar(modal_file):
    """The bar and its live page."""
    model, path = modal_file
    page = path.with_suffix(".html")
    result = CliRunner().invoke(app, ["view", str(path), "--live", str(page)])
    assert result.exit_code == 0, result.output
    return model, page


def data_of(page):
    return json.loads(re.search(r"const DATA = (.*);\n", page.read_text()).group(1))


def loads(step):
    return 4e3 * np.sin(0.003 * step), 2e3 * np.cos(0.0071 * step)


def test_the_core_of_the_page_gives_the_outputs_of_the_native_one(bar, tmp_path):
    if shutil.which("node") is None:
        pytest.skip("no node to run WebAssembly with")
    model, page = bar
    live = data_of(page)["live"]
    for name, text in live["parts"].items():
        (tmp_path / name).write_bytes(gzip.decompress(base64.b64decode(text)))
    names = [v.name for v in variable_table(model)]
    force = [names.index(f"tip.force.{axis}") for axis in "yz"]
    outputs = [f"tip.{kind}.{axis}" for kind in ("displacement", "rotation") for axis in "xyz"]
    files = [name for name in live["parts"] if name.endswith(".prog")]
    words = [live[name] for name in ("sizes", "on")]
    script = f"""{MASTER.read_text()}
    const fs = require("fs"), read = name => fs.readFileSync({json.dumps(str(tmp_path))} + "/" + name);
    (async () => {{
      const files = Object.fromEntries({json.dumps(files)}.map(name => [name, read(name)]));
      const core = await Core.open(read("core"), files, (name, status, text) => console.error(text));
      const body = new Body(core, "body", "live", []);
      body.watch(...{json.dumps(words)}, new Float32Array(new Uint8Array(read("numbers")).buffer));
      const found = [];
      for (let k = 0; k < {STEPS}; k++) {{
        body.set({force}, [4e3 * Math.sin(0.003 * k), 2e3 * Math.cos(0.0071 * k)]);
        if (!body.step({STEP})) throw new Error("refused");
        found.push(Array.from(body.get({[names.index(name) for name in outputs]})));
      }}
      console.log(JSON.stringify([found, Array.from(body.places())]));
    }})();"""
    done = subprocess.run(["node", "-e", script], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    found, places = (np.array(part) for part in json.loads(done.stdout))
    driven = Driven(model, tmp_path)
    expected = np.empty((STEPS, 6))
    for k in range(STEPS):
        driven.set(**dict(zip(("tip.force.y", "tip.force.z"), loads(k), strict=True)))
        assert driven.taken(STEP)
        expected[k] = driven.get(*outputs)
    assert np.abs(expected[:, 1]).max() > 0.03
    assert np.abs(found - expected).max() < CLOSE
    # The page's surface is in single precision; the mean of the tip's points moves nearly as the interface.
    surface = model.surface
    moved = (places.reshape(-1, 3) - surface.points)[surface.interface == 0].mean(axis=0)
    assert np.abs(moved - expected[-1, :3]).max() < 1e-2 * np.abs(expected[-1, :3]).max()


@pytest.mark.parametrize(("width", "dark"), [(1400, False), (400, True)])
def test_a_pull_with_the_pointer_bends_the_body(bar, tmp_path, width, dark):
    browser()
    page = bar[1]
    content = data_of(page)
    surface = [content[name] for name in ("points", "faces", "regions")] + [content["live"]["parts"]["numbers"]]
    assert len(page.read_bytes()) - len(json.dumps(surface)) < MOST_BYTES
    with Tab(page, width, 800, dark) as tab:
        tab.until("document.body.dataset.live === 'yes'")
        assert tab.value("live.body.time") == 0.0
        x, y = tab.pull(-10, 200, moves=5)
        tab.until("Math.hypot(...live.motion.slice(0, 3)) > 0.02")
        # The load points from the tip to the pointer, in the plane of the screen.
        tab.until("live.load && Math.hypot(...live.load) > 100")
        assert abs(tab.value("dot(live.load, turn[2])")) < 1e-6 * tab.value("Math.hypot(...live.load)")
        tab.until("live.error > 0 && live.error < 0.01")
        # The linear body beside it does not shorten.
        tab.until("live.motion[0] < -1e-3")
        assert abs(tab.value("live.lineMotion[0]")) < 1e-4
        tab.picture(tmp_path / "bent.png")
        tab.pointer("mouseReleased", x, y)
        tab.until("live.pull === null")
        tab.value("$('reset').click()")
        tab.until("live.body.time === 0 && live.motion.every(u => u === 0)")
        # By the keyboard, with a pause.
        for _ in range(5):
            tab.ask("Input.dispatchKeyEvent", type="keyDown", key="ArrowUp", code="ArrowUp", windowsVirtualKeyCode=38)
        tab.until("Math.hypot(...live.motion.slice(0, 3)) > 0.005")
        tab.value("$('pause').click()")
        still = tab.value("live.body.time")
        time.sleep(0.2)
        assert tab.value("live.body.time") == still
        assert tab.value("document.documentElement.scrollWidth") <= width
        assert tab.said == []


def test_a_notebook_shows_the_body_alive(modal_file, tmp_path):
    browser()
    notebook = tmp_path / "notebook.html"
    notebook.write_text(f"<!DOCTYPE html><title>a notebook</title>{load(modal_file[1]).view(live=True)._repr_html_()}")
    inside = "document.querySelector('iframe').contentDocument"
    with Tab(notebook) as tab:
        tab.until(f"{inside}.body?.dataset.live === 'yes'")
        width, height = (tab.value(f"document.querySelector('iframe').offset{side}") for side in ("Width", "Height"))
        assert min(width, height) > 500
        tab.picture(tmp_path / "notebook.png")
        assert tab.said == []


def test_a_body_that_refuses_says_so_and_goes_on(bar):
    browser()
    with Tab(bar[1]) as tab:
        tab.until("document.body.dataset.live === 'yes'")
        tab.value("live.interfaces[0].stiffness *= 1e6")
        x, y = tab.pull(0, 300)
        tab.until("live.refused !== ''")
        assert "bend" in tab.value("live.refused") or "step" in tab.value("live.refused")
        assert not tab.value("$('refused').hidden")
        tab.pointer("mouseReleased", x, y)
        assert tab.value("live.motion.every(Number.isFinite)")
        tab.value("$('refused').querySelector('button').click()")
        tab.until("$('refused').hidden && live.body.time === 0")
        tab.value("live.interfaces[0].stiffness /= 1e6")
        tab.pull(0, 150)
        tab.until("Math.hypot(...live.motion.slice(0, 3)) > 0.01")
        assert tab.said == []
