"""What was built is kept: who asks for the same again has the mesh read, and little imported beside that."""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from io import BytesIO
from pathlib import Path
from zipfile import ZipFile

import numpy as np

from ..files.outputs import SILENT, Heard, Reporter, check_target, whole_file
from ..files.store import Store, content_key
from ..fmu.package import cores_for, fmu_bytes
from ..fmu.reading import MODAL_FILE
from ..fmu.runtime import Runtime
from ..mesh.formats import file_origin
from ..mesh.model import Mesh
from ..model.reduced_body import ReducedBody
from .config import BodyFile, BodySpec, read_body_file

_Make = Callable[[Reporter], bytes]


def _once(what: str, config: BodySpec, others: object, report: Reporter, store: Store, make: _Make) -> bytes:
    """The file that is kept of a specification and others, said what was said of it; else make and keep it."""
    heard, fresh = Heard(report), list[bytes]()

    def made() -> dict[str, np.ndarray]:
        fresh.append(make(heard))
        parts = {"bytes": fresh[0], "said": json.dumps(heard.said).encode()}
        return {name: np.frombuffer(data, np.uint8) for name, data in parts.items()}

    # Its values, and which of them are no defaults.
    asked = [config.model_dump_json(exclude={"mesh": {"file"}}, exclude_unset=unset) for unset in (False, True)]
    found = store.arrays(content_key(__name__, what, *asked, others), what, report, made)
    for kind, text in [] if fresh else json.loads(found["said"].tobytes()):
        getattr(report, kind)(text)
    return fresh[0] if fresh else found["bytes"].tobytes()


def built_body(mesh: Mesh, config: BodySpec, origin: Mapping[str, str], report: Reporter, store: Store) -> ReducedBody:
    """Reduce a finite element body, or take the one that was kept; see `reduce.reduce_mesh`.

    Parameters
    ----------
    mesh : Mesh
    config : BodySpec
    origin : mapping of str to str
    report : Reporter
    store : Store

    Returns
    -------
    ReducedBody
    """
    from ..model.modal_file import modal_bytes, read_modal_file

    fresh = list[ReducedBody]()

    def make(heard: Reporter) -> bytes:
        from .reduce import reduce_mesh

        fresh.append(reduce_mesh(mesh, config, origin, heard, store))
        return b"" if store.folder is None else modal_bytes(fresh[0])

    data = _once("body", config, (mesh, origin), report, store, make)
    return fresh[0] if fresh else read_modal_file(BytesIO(data))


def build_fmu(
    body_file: Path | BodyFile,
    output: Path,
    modal_file: Path | None = None,
    report: Reporter = SILENT,
    store: Store | None = None,
    runtime: Runtime = Runtime.NATIVE,
    platforms: Sequence[str] = (),
    fmi: int = 2,
) -> None:
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
        Where FMUs, bodies, modes and the like are kept from build to build; default: nowhere.
    runtime : Runtime
        What runs the body.
    platforms : sequence of str
        Where it runs, names of `core.building.PLATFORMS`, or "all"; default: those that this installation has.
    fmi : int
        Version of FMI, 2 or 3.

    Raises
    ------
    FlexfmuError
        With what was found, what was expected and what to do.
    """
    check_target(output, (".fmu",))
    check_target(modal_file, (".h5",))
    # What cannot be compiled is told before anything long begins.
    cores, kept = cores_for(runtime, platforms, report, fmi), store or Store()
    config = read_body_file(body_file) if isinstance(body_file, Path) else body_file
    mesh, origin = config.read_mesh(report), file_origin(config.mesh.file)

    def make(heard: Reporter) -> bytes:
        from ..body.reference_loads import own_error

        body = built_body(mesh, config, origin, heard, kept)
        heard.tell(own_error(body))
        return fmu_bytes(body, runtime, cores, fmi)

    data = _once("FMU", config, (mesh, origin, runtime, cores, fmi), report, kept, make)
    # The modal file takes its name once the FMU is there.
    with nullcontext() if modal_file is None else whole_file(modal_file) as part, whole_file(output) as whole:
        whole.write_bytes(data)
        if part is not None:
            part.write_bytes(ZipFile(BytesIO(data)).read(f"resources/{MODAL_FILE}"))
