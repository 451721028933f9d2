"""The FMU archive: modal file, travelling code under a name of its own, pythonfmu's library, model description.

pythonfmu puts the resources of every FMU of a process on one module search path and imports by name. The travelling
code therefore lies in a package whose name is a hash of everything in the archive: other contents, other name.
"""

import hashlib
import io
import re
import tempfile
import uuid
import zipfile
import zlib
from importlib.metadata import version
from pathlib import Path

import pythonfmu

from .. import runtime
from ..errors import PackagingError
from ..inputs import Kind, check_input
from ..runtime.contents import DESCRIPTION, Contents, described_guid
from ..runtime.errors import ContentsError, ModalFileError
from ..runtime.kernel import PATTERN
from ..runtime.modal_file import read_modal_file, write_modal_file
from ..runtime.reduced_body import ReducedBody
from ..runtime.slave import MODAL_FILE
from ..runtime.state_block import identity
from ..targets import check_target, whole_file
from .description import model_description

# pythonfmu's base class of slaves and what it imports; the rest of the library is for building only.
_SLAVE_LIBRARY = ("fmi2slave", "_version", "default_experiment", "enums", "logmsg", "variables")
_SLAVE_MODULE = '''"""Entry point for pythonfmu's library."""

import ctypes

from {package}.contents import Contents
from {package}.pythonfmu.fmi2slave import Fmi2Slave
from {package}.slave import BodySlave

# The library runs this file at every instantiation, then gives up a reference to the namespace that it only borrowed:
# without one more each time, the namespace would be freed while in use.
ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))


class FlexibleBodySlave(BodySlave, Fmi2Slave):
    """The body, recognisable to pythonfmu."""

    packed = Contents("{guid}", "{modal}")
'''
_PACKED = re.compile(r'Contents\("([^"]*)", "([^"]*)"\)')
_SLAVE_NAME = "resources/slavemodule.txt"
# The earliest date that the format knows: archives of the same contents are the same.
_DATE = (1980, 1, 1, 0, 0, 0)


def package_fmu(body: ReducedBody, output: Path) -> None:
    """Write a body as an FMU; the file appears whole or not at all, and the same body gives the same bytes.

    Parameters
    ----------
    body : ReducedBody
    output : Path
        Ends in ".fmu".

    Raises
    ------
    OutputError
        A wrong ending, or a folder that is not there or cannot be written to.
    """
    check_target(output, (".fmu",))
    contents = _contents(body)
    with whole_file(output) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(contents):
            entry = zipfile.ZipInfo(name, _DATE)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, contents[name], zipfile.ZIP_DEFLATED)


def _contents(body: ReducedBody) -> dict[str, bytes]:
    """Every file of the archive by its name."""
    with tempfile.TemporaryDirectory(prefix="flexfmu-") as folder:
        path = Path(folder) / MODAL_FILE
        write_modal_file(body, path)
        modal = path.read_bytes()
    travelling = Path(runtime.__file__).parent
    code = {path.name: path.read_bytes() for path in sorted([*travelling.glob("*.py"), *travelling.glob(PATTERN)])}
    library = Path(pythonfmu.__file__).parent
    for name in _SLAVE_LIBRARY:
        code[f"pythonfmu/{name}.py"] = (library / f"{name}.py").read_bytes()
    code["pythonfmu/__init__.py"] = (
        f'"""The slave side of pythonfmu {version("pythonfmu")} (MIT licence)."""\n'.encode()
    )
    binaries = {
        f"binaries/{path.parent.name}/{body.name}{path.suffix}": path.read_bytes()
        for path in sorted((library / "resources" / "binaries").glob("*/*"))
    }

    digest = hashlib.sha256()
    for name, data in sorted({**code, **binaries, MODAL_FILE: modal, "xml": model_description(body, "")}.items()):
        digest.update(f"{name}\0{len(data)}\0".encode() + data)
    package = f"flexfmu_{digest.hexdigest()[:16]}"
    guid = f"{{{uuid.UUID(digest.hexdigest()[:32])}}}"
    return {
        DESCRIPTION: model_description(body, guid),
        f"resources/{MODAL_FILE}": modal,
        _SLAVE_NAME: f"{package}_slave".encode(),
        f"resources/{package}_slave.py": _SLAVE_MODULE.format(
            package=package, guid=guid, modal=identity(modal).hex()
        ).encode(),
        **{f"resources/{package}/{name}": data for name, data in code.items()},
        **binaries,
    }


def read_packaged_body(path: Path) -> ReducedBody:
    """Read the body out of an FMU or a modal file, whichever it is.

    Parameters
    ----------
    path : Path

    Returns
    -------
    ReducedBody

    Raises
    ------
    PackagingError
        The archive is no FMU of flexfmu.
    ContentsError
        Its model description or modal file is that of another FMU.
    ModalFileError
        The modal file is missing, damaged, altered or of an unknown version.
    """
    check_input(path, PackagingError, Kind.FMU, Kind.MODAL)
    if not zipfile.is_zipfile(path):
        if path.suffix.lower() == ".fmu":
            raise PackagingError(f"{path}: not an archive, so no FMU; the file is damaged, or something else")
        return read_modal_file(path)
    name = f"resources/{MODAL_FILE}"
    try:
        with zipfile.ZipFile(path) as archive:
            if name not in archive.namelist():
                raise PackagingError(f"{path}: an archive without {name}; expected an FMU made by flexfmu")
            data = archive.read(name)
            packed = _PACKED.search(archive.read(f"resources/{archive.read(_SLAVE_NAME).decode()}.py").decode())
            guid = described_guid(archive.read(DESCRIPTION))
    except KeyError as error:
        raise PackagingError(f"{path}: an FMU that is not complete ({error}); build it again") from error
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise PackagingError(f"{path}: the archive is damaged ({error}); build or copy it again") from error
    if packed is None:
        raise PackagingError(f"{path}: an FMU that does not tell what it was packed with; build it again")
    try:
        body = read_modal_file(io.BytesIO(data))
        Contents(*packed.groups()).check(identity(data), guid)
    except (ModalFileError, ContentsError) as error:
        raise type(error)(f"{path}: {error}") from error
    return body
