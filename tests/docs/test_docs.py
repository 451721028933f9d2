"""Pages of docs/ hold what they show: code runs, TOML is valid, commands exist, links and pictures are there."""

import importlib.util
import re
import shutil
import subprocess
import sys
import tomllib
import unicodedata
from pathlib import Path

import meshio
import pytest
import typer
from docs.generators.reference_pages import filled

import flexfmu as flexfmu_package
from bodies import beam_body
from flexfmu.build.config import BodyFile
from flexfmu.commands.cli import app
from flexfmu.fmu.package import package_fmu
from flexfmu.master.config import CouplingFile
from flexfmu.mesh.elements import ElementType
from flexfmu.model.arrays import ARRAYS
from flexfmu.model.reduced_body import GROUPS
from flexfmu.study.scene.config import SceneFile
from meshes import lattice
from references import BEAM

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = {str(path.relative_to(DOCS)): path.read_text(encoding="utf-8") for path in sorted(DOCS.rglob("*.md"))}
# Beside the programs that measure.
RESULTS = (
    "demo/RESULTS.md",
    "demo/fit/README.md",
    "demo/rear_axle/README.md",
    "benchmarks/README.md",
    "benchmarks/defaults/README.md",
    "benchmarks/field/README.md",
)
LINKED = {**{f"docs/{name}": text for name, text in PAGES.items()}}
LINKED |= {
    name: (ROOT / name).read_text(encoding="utf-8")
    for name in ("README.md", "CHANGELOG.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "demo/README.md", *RESULTS)
}
BLOCK = re.compile(r"(?:^<!-- (?P<mark>[^\n]*) -->\n)?^```(?P<kind>\w*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
# What the code says of itself.
MADE = re.compile(r"<!-- generated: .*?<!-- end -->", re.DOTALL)
UNTESTED = "not tested: "
# Bodies small enough for every command and script of the pages.
BODY = """
name = "arm"
frames = 2
[mesh]
file = "arm.inp"
[[support]]
nodes = "CLAMP"
fix = ["x", "y", "z"]
[[interface]]
name = "tip"
nodes = "FLANGE"
compliance = true
[reduction]
modes = 3
[damping]
ratio = 0.01
[output]
error = false
"""
LINK = BODY.replace('name = "arm"\n', 'name = "link"\nfree = true\nroot = "root"\n').replace(
    '[[support]]\nnodes = "CLAMP"\nfix = ["x", "y", "z"]\n', '[[interface]]\nname = "root"\nnodes = "CLAMP"\n'
)
SCENE = """
[[static]]
name = "bend"
loads = { "tip.force.y" = 1e3 }
factors = [1.0]
[tolerance.static]
displacement = 0.5
[sweep]
modes = [2]
frames = [1]
methods = ["linear"]
basis = ["normal"]
internal_step = ["single"]
finite_elements = false
"""


def blocks(kind, page=None):
    """Fenced code blocks of a kind: page, mark of the comment above, text."""
    for name, text in PAGES.items():
        for found in BLOCK.finditer(text):
            if found["kind"] == kind and page in (None, name):
                yield name, found["mark"] or "", found["text"]


def commands(page=None):
    """`flexfmu` commands of the pages' shell blocks: page, mark, words."""
    for name, mark, text in blocks("sh", page):
        for line in text.splitlines():
            words = line.split("#")[0].split()
            if words[:1] == ["flexfmu"]:
                yield name, mark, words[1:]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with the files that pages name."""
    folder = tmp_path_factory.mktemp("files")
    deck = (BEAM / "beam.inp").read_text(encoding="utf-8").replace("NSET=ROOT", "NSET=CLAMP").replace("=TIP", "=FLANGE")
    (folder / "arm.inp").write_text(deck, encoding="utf-8")
    (folder / "body.toml").write_text(BODY, encoding="utf-8")
    (folder / "link.toml").write_text(LINK, encoding="utf-8")
    (folder / "weighty.toml").write_text(BODY + "[input]\nacceleration = true\n", encoding="utf-8")
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")
    (folder / "loads.csv").write_text("time,tip.force.y\n0,0\n0.05,5000\n", encoding="utf-8")
    (folder / "weight.csv").write_text("time,body.acceleration.z\n0,9.81\n0.1,9.81\n", encoding="utf-8")
    for body in ("body", "link", "weighty"):
        flexfmu(folder, "build", f"{body}.toml", "--output", f"{'arm' if body == 'body' else body}.fmu")
    flexfmu(folder, "simulate", "arm.fmu", "--input", "loads.csv", "--output", "result.csv")
    (folder / "coupling.toml").write_text(next(text for _, _, text in blocks("toml", "master.md")), encoding="utf-8")
    for name in ("beam", "lean"):
        package_fmu(beam_body(3, modes=3), folder / f"{name}.fmu")
    # An angle of 60 mm by 120.
    cells = [(k, 0, 0) for k in range(3)] + [(2, 0, k) for k in range(1, 6)]
    angle = lattice(ElementType.C3D10, cells, lambda p: 20.0 * p)
    meshio.Mesh(angle.points, [("tetra10", angle.blocks[0].connectivity)]).write(folder / "model.vtu")
    return folder


def flexfmu(folder, *words):
    return run(folder, [str(Path(sys.executable).with_name("flexfmu")), *words])


def run(folder, command):
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout}\n{done.stderr}"
    return done.stdout


# That of python.md runs in test_python.py.
@pytest.mark.slow
@pytest.mark.parametrize("page", sorted({name for name, _, _ in blocks("python")} - {"python.md"}))
def test_python_of_a_page_runs(page, files, tmp_path):
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    for _, mark, text in blocks("python", page):
        if mark.startswith(("file: ", UNTESTED)):
            continue
        needed = re.findall(r"^(?:import|from) (\w+)", text, re.MULTILINE)
        # Not imported here: the page loads what a package's library needs.
        for package in needed:
            if importlib.util.find_spec(package) is None:
                pytest.skip(f"{package} is not installed")
        run(tmp_path, [sys.executable, "-W", "ignore::DeprecationWarning", "-c", text])


@pytest.mark.slow
@pytest.mark.parametrize("page", sorted({name for name, mark, _ in commands() if not mark.startswith(UNTESTED)}))
def test_commands_of_a_page_run(page, files, tmp_path):
    if page == "tutorial.md":
        shutil.copytree(ROOT / "demo" / "bracket", tmp_path, dirs_exist_ok=True)
        # Fewer cases and models than the page has.
        scene = (tmp_path / "scene.toml").read_text(encoding="utf-8").split("[[transient]]")[0]
        tables = SCENE.split("factors = [1.0]")[1].replace('["linear"]', '["second_order"]')
        (tmp_path / "scene.toml").write_text(scene + tables, encoding="utf-8")
        with (tmp_path / "body.toml").open("a", encoding="utf-8") as file:
            file.write("\n[output]\nerror = false\n")
    elif page == "bushings.md":
        shutil.copytree(ROOT / "demo" / "wishbone", tmp_path, dirs_exist_ok=True)
        # Neither pictures nor the error's estimate, which take most of the build.
        with (tmp_path / "body.toml").open("a", encoding="utf-8") as file:
            file.write("\n[output]\nsurface = false\nerror = false\n")
    else:
        shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    for _, mark, words in commands(page):
        if not mark.startswith(UNTESTED):
            flexfmu(tmp_path, *words)


def test_every_command_of_the_pages_parses():
    group = typer.main.get_command(app)
    seen = list(commands())
    assert len(seen) > 15
    for page, _, (name, *words) in seen:
        assert name in group.commands, f"{page}: flexfmu {name}"
        group.commands[name].make_context(name, list(words))


def test_blocks_that_show_a_file_are_that_file():
    shown = [(page, mark, text) for kind in ("python", "toml", "csv", "yaml") for page, mark, text in blocks(kind)]
    shown = [(page, mark.removeprefix("file: "), text) for page, mark, text in shown if mark.startswith("file: ")]
    assert len(shown) >= 4
    for page, name, text in shown:
        assert text == (ROOT / name).read_text(encoding="utf-8"), f"{page}: {name}"


def test_toml_of_the_pages_is_valid():
    base = tomllib.loads(BODY)
    found = 0
    for page, mark, text in blocks("toml"):
        if mark.startswith(UNTESTED):
            continue
        data = tomllib.loads(text)
        if "experiment" in data:
            CouplingFile.model_validate(data)
        elif data.keys() & {"static", "transient", "stability", "sweep", "reference"}:
            SceneFile.model_validate(data)
        else:
            # A fragment extends a body file.
            missing = {key: value for key, value in base.items() if key not in data}
            if data.get("free"):
                missing.pop("support")
            BodyFile.model_validate({**missing, **data})
        found += 1
        assert page
    assert found >= 8


def test_the_site_lists_every_dataset_and_every_option():
    datasets, commands_page = (filled(PAGES[f"reference/{name}.md"]) for name in ("modal-file", "commands"))
    for entry in (*ARRAYS["body"], *(entry for part in GROUPS for entry in ARRAYS[part])):
        assert f"`{entry.path}`" in datasets, entry.path
    for name, command in typer.main.get_command(app).commands.items():
        assert f"`flexfmu {name}`" in commands_page
        for option in (option for parameter in command.params for option in parameter.opts):
            assert option.strip("-") in commands_page, option
    # Brackets of units are not taken for markup.
    assert "time [s]" in commands_page


def test_the_site_describes_all_that_the_package_exports():
    for name in set(flexfmu_package.__all__) - {"__version__"}:
        assert f"::: flexfmu.{name}\n" in filled(PAGES["api.md"]), name


def test_sections_and_equations_that_code_cites_are_in_the_theory():
    theory = PAGES["theory.md"]
    sections = set(re.findall(r"^## (\d+[a-z]?) ", theory, re.MULTILINE))
    equations = set(re.findall(r"^    .*\((\d+[a-z]?)\)[.,]?$", theory, re.MULTILINE))
    cited = 0
    for path in (ROOT / "fmu_src").rglob("*.*"):
        if path.suffix in (".py", ".c", ".h", ".def"):
            for line in path.read_text(encoding="utf-8").splitlines():
                found = re.findall(r"sections? (\d+[a-z]?)(?:,? and (\d+[a-z]?))?", line) if "theory.md" in line else []
                names = {name for pair in found for name in pair if name}
                assert names <= sections, f"{path.name}: {line}"
                numbers = {
                    n for pair in re.findall(r"equations? \((\w+)\)(?: and \((\w+)\))?", line) for n in pair if n
                }
                assert numbers <= equations, f"{path.name}: {line}"
                cited += len(names) + len(numbers)
    assert cited > 20


def anchors(text):
    """Anchors of a page's headings, as Python-Markdown makes them."""
    for line in re.findall(r"^#+ (.*)$", text, re.MULTILINE):
        plain = unicodedata.normalize("NFKD", re.sub(r"[`*]", "", line)).encode("ascii", "ignore").decode()
        yield re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())


@pytest.mark.parametrize("page", LINKED)
def test_links_and_pictures_of_a_page_are_there(page):
    here = (ROOT / page).parent
    for target in re.findall(r"\]\(([^)\s]+)\)", LINKED[page]):
        if target.startswith(("http:", "https:")):
            continue
        name, _, anchor = target.partition("#")
        path = (here / name).resolve() if name else ROOT / page
        assert path.exists(), f"{page}: {target}"
        if path.suffix == ".png":
            assert path.read_bytes().startswith(b"\x89PNG"), target
        if page.startswith("docs/"):
            assert path.is_relative_to(DOCS), f"{page}: {target} is not on the site"
        if anchor:
            assert anchor in list(anchors(path.read_text(encoding="utf-8"))), f"{page}: {target}"


def test_every_picture_is_on_a_page():
    shown = set(re.findall(r"figures/([\w-]+\.png)", "".join(LINKED.values())))
    assert {path.name for path in (DOCS / "figures").glob("*.png")} <= shown


def test_every_page_is_in_the_navigation():
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:", 1)[1]
    listed = re.findall(r"([\w/-]+\.md)", navigation)
    assert len(set(listed)) == len(listed)
    assert set(listed) == set(PAGES)


# Pages whose prose has not been rewritten yet.
LONG = {
    "python.md",
    "theory.md",
}


def test_lines_of_prose_are_short():
    for page in PAGES.keys() - LONG:
        for line in BLOCK.sub("", PAGES[page]).splitlines():
            assert len(line) <= 120 or line.startswith(("|", "![")), f"{page}: {line}"


@pytest.mark.parametrize("page", LINKED)
def test_no_table_is_torn(page):
    """A row after an empty line begins a table, or is none."""
    for row in re.finditer(r"\n\n\|.*\|\n(.*)", BLOCK.sub("", LINKED[page])):
        assert re.match(r"\| ?---", row[1]), row[0]


# Words that say something else than they mean here.
AVOIDED = re.compile(r"\b(aboard|bare|brought|lookout|judge|placement|told|beyond)\b", re.IGNORECASE)


def test_prose_uses_plain_words():
    for page, text in LINKED.items():
        if page != "CHANGELOG.md":
            prose = re.sub(r"`[^`]*`", "", MADE.sub("", BLOCK.sub("", text)))
            assert not AVOIDED.findall(prose), page


# What a user reads, without what the code writes (docs/reference, generated tables), pages for those who change code
# and the changelog.
OTHERS = (*RESULTS, "CHANGELOG.md", "ARCHITECTURE.md", "CONTRIBUTING.md")
READ = [page for page in LINKED if page not in OTHERS and "reference/" not in page]


def test_what_a_user_reads_holds_at_most_20000_words():
    words = {page: len(MADE.sub("", LINKED[page]).split()) for page in READ}
    assert sum(words.values()) <= 20_000
    assert words["README.md"] <= 900
    assert words["docs/accuracy.md"] <= 3000


def test_theory_names_files_that_are_there():
    table = PAGES["theory.md"].split("| section | equations | code |")[1].split("\n\n")[0]
    named = re.findall(r"`([\w/.]+)`", table)
    assert len(named) > 30
    for name in named:
        assert (ROOT / name if name.startswith(("tests", "demo")) else ROOT / "fmu_src" / "flexfmu" / name).exists(), (
            name
        )


def test_the_package_is_found_by_what_it_is():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert {"FMI", "finite elements"} <= set(project["keywords"])
    kinds = project["classifiers"]
    # A licence stands as an expression; beside it, no classifier may name one.
    assert not [kind for kind in kinds if kind.startswith("License")]
    assert f"Programming Language :: Python :: {project['requires-python'].lstrip('>=')}" in kinds


def test_the_file_for_citations_names_this_version():
    number = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert f"version: {number}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
