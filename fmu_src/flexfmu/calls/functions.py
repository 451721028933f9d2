"""The functions of `flexfmu` for scripts; each imports what it needs. `commands` says in words what they give."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..files import outputs
from ..files.basics import IntArray, OutputError, unit_system
from ..files.outputs import SCRIPT, Reporter
from ..files.store import Store, default_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..master import Result
    from ..mesh.model import Mesh
    from ..study.chart.draw import Drawn
    from ..study.fitted import Fit
    from ..study.records import Run
    from ..view.shown import Shown

__all__ = ["chart", "check", "couple", "fit", "init", "show", "stability"]
Name = str | Path


@dataclass(frozen=True, slots=True)
class Checked:
    """What a mesh holds, and what a body file chooses of it.

    Attributes
    ----------
    mesh : Mesh
    chosen : dict of str to (k,) int
        Nodes of supports, interfaces and the like of a body file.
    lines : list of str
        All of it in words.
    """

    mesh: "Mesh"
    chosen: dict[str, IntArray]
    lines: list[str]

    def __repr__(self) -> str:
        """The words."""
        return "\n".join(self.lines)

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame, one row a choice: its name, number of nodes, mean place (m)."""
        rows = ((name, len(of), *self.mesh.points[of].mean(axis=0)) for name, of in self.chosen.items())
        return outputs.table_frame(dict(zip(("name", "nodes", *"xyz"), row, strict=True)) for row in rows)


@dataclass(frozen=True, slots=True)
class StabilityMap:
    """Up to which loads each method is right.

    Attributes
    ----------
    runs : list of Run
    finding : str
        How many runs came to which verdict.
    records : Path
    """

    runs: "list[Run]"
    finding: str
    records: Path

    def plot(self) -> "Figure":
        """Draw the map, a matplotlib figure."""
        from ..study.pictures import map_figure

        return map_figure(self.records)

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame, one row a run."""
        return outputs.records_frame(self.runs)

    def _repr_html_(self) -> str:
        return f"<p>{self.finding}</p>{outputs.picture_html(self.plot())}"


def check(file: Name, units: str = "m-kg-s") -> Checked:
    """List what a mesh holds: mass, sets, materials, plane ends, bores; of a body file its supports and interfaces.

    Parameters
    ----------
    file : path
        Body file (TOML), or a mesh alone.
    units : str
        Of a mesh alone.

    Returns
    -------
    Checked

    Examples
    --------
    >>> flexfmu.check("body.toml").chosen["interface tip"].size  # doctest: +SKIP
    33
    """
    from ..build.config import read_body_file
    from ..build.reduce import body_model
    from ..build.suggest import chosen_nodes, mass_lines, mesh_lines
    from ..mesh.checks import checked
    from ..mesh.formats import read_mesh

    file = Path(file)
    config = read_body_file(file) if file.suffix.lower() == ".toml" else None
    system = unit_system(units) if config is None else config.mesh.units
    mesh = checked(read_mesh(file, system) if config is None else config.read_mesh(outputs.SILENT))
    lines, chosen = mesh_lines(mesh, system), {}
    if config is not None:
        chosen = chosen_nodes(mesh, config)
        lines += [f"{title}: {len(rows)} nodes" for title, rows in chosen.items()]
        model = body_model(mesh, config).model
        mesh = model.mesh
        lines += [one.words for one in mesh.springs]
        lines.append(f"{model.free.size} free degrees of freedom")
    return Checked(mesh, chosen, [*lines, *mass_lines(mesh)])


def init(mesh: Name, output: Name | None = None, units: str = "") -> Path:
    """Write a body file to start from: supports and interfaces at reference points and plane ends of a mesh.

    Parameters
    ----------
    mesh : path
    output : path, optional
        Body file; default: beside the mesh.
    units : str
        Of the mesh; default: those in which the body is likely.

    Returns
    -------
    Path
        The body file.

    Examples
    --------
    >>> flexfmu.init("bracket.msh")  # doctest: +SKIP
    PosixPath('bracket.toml')
    """
    from ..build.suggest import likely_mesh, starting_body_file
    from ..mesh.checks import checked

    mesh = Path(mesh)
    target = Path(output) if output else mesh.with_suffix(".toml")
    if target.exists():
        raise OutputError(f"{target} is there already: name another with --output")
    found, system, thickness = likely_mesh(mesh, unit_system(units) if units else None)
    named = Path(mesh.name) if target.parent.resolve() == mesh.parent.resolve() else mesh.resolve()
    target.write_text(starting_body_file(checked(found), named, system, thickness), encoding="utf-8")
    return target


def couple(file: Name, output: Name | None = None, report: Reporter = SCRIPT) -> "Result":
    """Run several FMUs together, linked by connections and by springs between interfaces.

    Parameters
    ----------
    file : path
        Coupling file (TOML).
    output : path, optional
        Results to write (CSV or HDF5).
    report : Reporter, optional

    Returns
    -------
    Result

    Examples
    --------
    >>> flexfmu.couple("coupling.toml").to_dataframe()  # doctest: +SKIP
    """
    from ..master import couple as march, read_coupling_file, run

    return march(read_coupling_file(Path(file)), report) if output is None else run(Path(file), Path(output), report)


def chart(
    body: Name | None,
    scene: Name | None,
    records: Name | Sequence[Name],
    *,
    picture: Name | None = None,
    page: Name | None = None,
    bare: bool = False,
    every: bool = False,
    jobs: int = 1,
    report: Reporter = SCRIPT,
) -> "Drawn":
    """Try models of a body on a scene, and find those that nothing beats in error and cost.

    Parameters
    ----------
    body, scene : path or None
        Without them the records are drawn as they are.
    records : path or sequence of path
        CSV, one row a model; what is in it is not run again. Others are drawn beside the first.
    picture, page : path, optional
        What to write.
    bare, every : bool
        Time models without their FMUs; try every combination.
    jobs : int
        Processes that measure errors.
    report : Reporter, optional

    Returns
    -------
    Drawn
        `named` and `finding` say which to take, `to_dataframe()` has all, `plot()` draws them.

    Examples
    --------
    >>> flexfmu.chart("body.toml", "scene.toml", "records.csv").finding  # doctest: +SKIP
    """
    from ..study.chart.draw import chart as draw, check_targets
    from ..study.chart.sweep import sweep
    from ..study.scene.scene import read_scene
    from ..study.workshop import Crew

    paths = [Path(records)] if isinstance(records, str | Path) else list(map(Path, records))
    picture, page = (None if one is None else Path(one) for one in (picture, page))
    check_targets(paths, picture, page)
    drawn: list[Drawn] = []
    if body is not None and scene is not None:
        found = read_scene(Path(scene), Path(body))

        def look(extent: str) -> None:
            # The page takes a hundredth of the picture's time.
            early = extent.startswith("coarse")
            drawn[:] = [draw(paths, None if early and page else picture, page, extent if len(paths) == 1 else "")]
            if early:
                report.note(f"{extent}: {drawn[0].finding}")

        with Crew(jobs) as crew:
            sweep(found, paths[0], report, Store(default_folder()), not bare, crew, every, look)
    return drawn[0] if drawn else draw(paths, picture, page)


def stability(
    body: Name | None,
    scene: Name | None,
    records: Name,
    *,
    picture: Name | None = None,
    jobs: int = 1,
    report: Reporter = SCRIPT,
) -> StabilityMap:
    """Map up to which loads each method is right.

    Parameters
    ----------
    body, scene : path or None
        Without them the records are taken as they are.
    records : path
        CSV, one row a run; what is in it is not run again.
    picture : path, optional
        What to write.
    jobs : int
        Processes that make the runs.
    report : Reporter, optional

    Returns
    -------
    StabilityMap

    Examples
    --------
    >>> flexfmu.stability("body.toml", "scene.toml", "runs.csv").plot()  # doctest: +SKIP
    """
    from ..study.records import RUNS
    from ..study.scene.scene import read_scene
    from ..study.stability import map_stability
    from ..study.workshop import Crew

    finding = ""
    records = Path(records)
    picture = None if picture is None else Path(picture)
    outputs.check_target(picture, outputs.PICTURE_SUFFIXES, inputs=(records,))
    if body is not None and scene is not None:
        found = read_scene(Path(scene), Path(body))
        with Crew(jobs) as crew:
            finding = map_stability(found, records, report, Store(default_folder()), crew)
    if picture is not None:
        from ..study.pictures import draw_map

        draw_map(records, picture)
    return StabilityMap(RUNS.read(records), finding, records)


def fit(
    body: Name,
    scene: Name,
    output: Name,
    *,
    fmu: Name | None = None,
    verify: bool = False,
    jobs: int = 1,
    report: Reporter = SCRIPT,
) -> "Fit":
    """Find the smallest, fastest model of a body within a scene's tolerance; write its body file and FMU.

    Parameters
    ----------
    body, scene : path
    output : path
        Body file to write (TOML).
    fmu : path, optional
        Default: beside the body file.
    verify : bool
        Whether what was found is compared with the whole finite element model.
    jobs : int
        Processes that measure errors.
    report : Reporter, optional

    Returns
    -------
    Fit

    Examples
    --------
    >>> flexfmu.fit("body.toml", "scene.toml", "lean.toml").met  # doctest: +SKIP
    True
    """
    from ..study.fit import fit as find
    from ..study.scene.scene import read_scene
    from ..study.workshop import Crew

    target = Path(output)
    beside = Path(fmu) if fmu else target.with_suffix(".fmu")
    with Crew(jobs) as crew:
        found = read_scene(Path(scene), Path(body))
        return find(found, target, report, Store(default_folder()), beside, crew, verify)


def show(
    file: Name,
    output: Name | None = None,
    *,
    loads: Mapping[str, str] | None = None,
    modes: int = 0,
    live: bool = False,
    report: Reporter = SCRIPT,
) -> "Shown":
    """Show a mesh, a body, its modes or an equilibrium: in a notebook as a page, and in a file.

    Parameters
    ----------
    file : path
        FMU, modal file, body file or mesh.
    output : path, optional
        Page (.html), ParaView (.vtu, .pvd) or picture (.png, .pdf, .svg).
    loads : mapping of str to str, optional
        That hold still, such as {"tip.force.y": "5kN"}.
    modes : int
        How many mode shapes.
    live : bool
        Whether the page's body answers to the pointer.
    report : Reporter, optional

    Returns
    -------
    Shown

    Examples
    --------
    >>> flexfmu.show("arm.fmu", "arm.html", loads={"tip.force.y": "5kN"})
    <Shown 'arm': tip.force.y = 5 kN>
    """
    from .showing import Request, show as make

    held = tuple(f"{name}={value}" for name, value in (loads or {}).items())
    return make(Request(Path(file), None if output is None else Path(output), None, held, modes, live=live), report)
