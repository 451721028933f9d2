"""A view for ParaView: one .vtu, or a .pvd with a .vtu for each shape of a motion."""

from pathlib import Path
from xml.sax.saxutils import quoteattr

import meshio
import numpy as np

from ..files.targets import whole_file
from .model import Case, View


def write_vtu(view: View, case: Case | None, shape: int, path: Path) -> None:
    """Write one shape of the surface: undeformed points, with the true displacement as a field.

    Parameters
    ----------
    view : View
    case : Case or None
    shape : int
        Index along the motion.
    path : Path

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    triangle = view.faces[:, 2] == view.faces[:, 3]
    cells = [
        (kind, faces)
        for kind, faces in (("quad", view.faces[~triangle]), ("triangle", view.faces[triangle, :3]))
        if len(faces)
    ]
    data = {region.title.replace(" ", "_"): region.number for region in view.regions}
    if case is not None:
        data["displacement"] = case.places[shape] - view.points
        if case.stress is not None:
            data["von_mises"] = case.stress[shape]
    with whole_file(path) as part:
        meshio.Mesh(view.points, cells, point_data=data).write(part, file_format="vtu")


def write_pvd(view: View, case: Case, path: Path) -> list[Path]:
    """Write a motion as NAME.pvd, and its shapes into the folder NAME beside it.

    Parameters
    ----------
    view : View
    case : Case
    path : Path

    Returns
    -------
    list of Path
        The .vtu files.

    Raises
    ------
    OutputError
        A file cannot be written.
    """
    folder = path.with_suffix("")
    with whole_file(path) as part:
        folder.mkdir(exist_ok=True)
        files = [folder / f"{path.stem}_{k:04d}.vtu" for k in range(len(case.position))]
        for k, file in enumerate(files):
            write_vtu(view, case, k, file)
        rows = [
            f"    <DataSet timestep={quoteattr(repr(float(t)))} file={quoteattr(f'{folder.name}/{file.name}')}/>"
            for t, file in zip(np.asarray(case.position), files, strict=True)
        ]
        head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        part.write_text(head + "\n".join(rows) + "\n  </Collection>\n</VTKFile>\n", encoding="utf-8")
    return files
