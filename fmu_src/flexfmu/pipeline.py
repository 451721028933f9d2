"""From a body file to an FMU: the job behind `flexfmu build`."""

from pathlib import Path

from .build import reduce_body
from .config import read_body_file
from .errors import PackagingError
from .fmu.package import package_fmu
from .progress import Reporter
from .runtime.modal_file import write_modal_file
from .runtime.reduced_body import ReducedBody


def build_fmu(
    body_file: Path, output: Path, modal_file: Path | None = None, report: Reporter | None = None
) -> ReducedBody:
    """Reduce a body and write its FMU; nothing is written unless all of it succeeds.

    Parameters
    ----------
    body_file : Path
        TOML.
    output : Path
        The FMU.
    modal_file : Path, optional
        Where to keep the modal file as well.
    report : Reporter, optional
        Default: silent.

    Returns
    -------
    ReducedBody

    Raises
    ------
    FlexfmuError
        With what was found, what was expected and what to do.
    """
    report = report or Reporter()
    for path, ending in ((output, ".fmu"), (modal_file, ".h5")):
        if path is not None and path.suffix != ending:
            raise PackagingError(f"{path}: expected a file name that ends in {ending}")
        if path is not None and not path.parent.is_dir():
            raise PackagingError(f"{path}: the folder {path.parent} does not exist; make it first")
    body = reduce_body(read_body_file(body_file), report)
    with report.stage(f"Write {output}"):
        package_fmu(body, output)
        if modal_file is not None:
            write_modal_file(body, modal_file)
    return body
