"""A body is read out of its FMU, without what makes one."""

import hashlib
import io
import zipfile
import zlib
from pathlib import Path

from ..core.interface import DESCRIPTION as PROGRAM, guid_of
from ..files.basics import ContentsError, ModalFileError, PackagingError
from ..files.tables import Kind, check_input
from ..model.reduced_body import ReducedBody
from .python_slave import guid_in

DESCRIPTION = "modelDescription.xml"
MODAL_FILE = "modal.h5"


def modal_mark(modal: bytes) -> str:
    """What a guid begins with: so a modal file of another FMU is noticed."""
    return hashlib.sha256(modal).hexdigest()[:8]


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
        Its model description is that of another FMU.
    ModalFileError
        The modal file is missing, damaged, altered or of an unknown version.
    """
    from ..model.modal_file import read_modal_file

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
            program = archive.read(f"resources/{PROGRAM}")
            guid = guid_in(archive.read(DESCRIPTION))
    except KeyError as error:
        raise PackagingError(f"{path}: an FMU that is not complete ({error}); build it again") from error
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise PackagingError(f"{path}: the archive is damaged ({error}); build or copy it again") from error
    try:
        body = read_modal_file(io.BytesIO(data))
    except ModalFileError as error:
        raise ModalFileError(f"{path}: {error}") from error
    packed, mixed = guid_of(program), "files of two FMUs are mixed; unpack the FMU again, or build it again"
    if not packed:
        other = "its programs were built by another version of flexfmu, or are damaged"
        raise ContentsError(f"{path}: {other}; build it again")
    if guid != packed:
        raise ContentsError(f"{path}: {DESCRIPTION} has the guid {guid}, its programs are of {packed}: {mixed}")
    if guid.strip("{}")[:8] != modal_mark(data):
        raise ContentsError(f"{path}: {name} is not the one that the FMU of guid {guid} was built with: {mixed}")
    return body
