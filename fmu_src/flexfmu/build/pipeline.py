"""From a body file to an FMU: the job behind `flexfmu build`."""

from collections.abc import Sequence
from pathlib import Path

from ..files.progress import Reporter
from ..files.store import Store
from ..files.targets import check_target, whole_file
from ..fmu.package import cores_for, package_fmu
from ..fmu.runtime import Runtime
from ..model.modal_file import write_modal_file
from ..model.reduced_body import ReducedBody
from .config import BodyFile, read_body_file
from .reduce import reduce_body


def build_fmu(
    body_file: Path | BodyFile,
    output: Path,
    modal_file: Path | None = None,
    report: Reporter | None = None,
    store: Store | None = None,
    runtime: Runtime = Runtime.NATIVE,
    platforms: Sequence[str] = (),
    fmi: int = 2,
) -> ReducedBody:
    """Reduce a body and write its FMU; nothing is written unless all of it succeeds.

    Parameters
    ----------
    body_file : Path or BodyFile
        TOML, or what it says.
    output : Path
        The FMU.
    modal_file : Path, optional
        Where to keep the modal file as well.
    report : Reporter, optional
        Default: silent.
    store : Store, optional
        Where modes and the like are kept from build to build; default: nowhere.
    runtime : Runtime
        What runs the body.
    platforms : sequence of str
        Where it runs, names of `core.building.PLATFORMS`, or "all"; default: those that this installation has.
    fmi : int
        Version of FMI, 2 or 3.

    Returns
    -------
    ReducedBody

    Raises
    ------
    FlexfmuError
        With what was found, what was expected and what to do.
    """
    report = report or Reporter()
    check_target(output, (".fmu",))
    if modal_file is not None:
        check_target(modal_file, (".h5",))
    # What cannot be compiled is told before anything long begins.
    cores_for(runtime, platforms, report, fmi)
    config = read_body_file(body_file) if isinstance(body_file, Path) else body_file
    body = reduce_body(config, report, store)
    with report.stage(f"Write {output}"):
        if modal_file is None:
            package_fmu(body, output, runtime, platforms, fmi=fmi)
        else:
            # The modal file takes its name once the FMU is there.
            with whole_file(modal_file) as part:
                write_modal_file(body, part)
                package_fmu(body, output, runtime, platforms, fmi=fmi)
    return body
