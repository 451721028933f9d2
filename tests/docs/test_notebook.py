"""The tutorial's notebook: its cells run in order, and each last value shows itself."""

import ast
import json
import shutil
from pathlib import Path

import pytest

from flexfmu.core.building import zig_compiler
from flexfmu.mesh.elements import ElementType
from meshes import BAR, box, write_deck

ROOT = Path(__file__).parents[2]
NOTEBOOK = ROOT / "demo" / "tutorial.ipynb"
# In place of the bracket where models are compared, for the sake of time.
SCENE = """
[[static]]
name = "bend"
loads = { "tip.force.y" = 2e3 }
[tolerance.static]
displacement = 0.05
[sweep]
methods = ["linear", "frames"]
modes = [4]
frames = [1, 2]
basis = ["normal"]
"""


def run(source, names):
    """What a cell's last expression gives, as notebooks do."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    return None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)


@pytest.mark.slow
def test_the_cells_of_the_tutorial_run_and_show(tmp_path, monkeypatch):
    for name in ("body.toml", "bracket.msh"):
        shutil.copy(ROOT / "demo" / "bracket" / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    book = json.loads(NOTEBOOK.read_text())
    code = [cell for cell in book["cells"] if cell["cell_type"] == "code"]
    assert len(code) > 8
    # What a cell shows is not kept.
    assert not any(cell["outputs"] for cell in code)
    names, shown = {}, []
    for source in ("".join(cell["source"]) for cell in code):
        if "live=True" in source and zig_compiler() is None:
            continue
        if "flexfmu.chart" in source:
            write_deck(box(ElementType.C3D20R, (6, 2, 2), (1.0, 0.1, 0.13)), tmp_path / "bar.inp")
            (tmp_path / "body.toml").write_text(BAR)
            (tmp_path / "scene.toml").write_text(SCENE)
        value = run(source, names)
        shown.append(value._repr_html_() if hasattr(value, "_repr_html_") else repr(value))
    assert "interface tip: " in shown[0]
    assert "0.09203 kg" in shown[2]
    assert "54.6 Hz" in shown[2]
    assert any("iframe" in text and "tip.force.x = 60 N" in text for text in shown)
    assert sum("<svg" in text for text in shown) >= 2
    assert 0.02 < names["motion"]["tip.displacement.x"].max() < 0.03
    assert names["lean"].met
    assert (tmp_path / "lean.fmu").exists()
