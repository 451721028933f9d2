"""The FMU archive: model description, modal file, programs, and the core that runs them.

Of the runtime "native" the core itself is the FMU's library. Of the runtime "python" it is pythonfmu's, which calls the
core by way of a slave in Python. pythonfmu puts the resources of every FMU of a process on one module search path and
imports by name: the slave lies in a package whose name is a hash of everything in the archive.
"""

import hashlib
import uuid
import zipfile
from collections.abc import Sequence
from importlib.metadata import version
from io import BytesIO
from pathlib import Path

from ..core.binaries import core_binaries
from ..core.building import FLAGS, PLATFORMS, folders_3, prefix_header, source_files, sources as core_sources
from ..files.basics import PackagingError
from ..files.outputs import Reporter, check_target, whole_file
from ..model.reduced_body import ReducedBody
from .reading import DESCRIPTION, MODAL_FILE, modal_mark
from .runtime import Runtime

# pythonfmu's base class of slaves and what it imports; the rest of the library is for building only.
_SLAVE_LIBRARY = ("fmi2slave", "_version", "default_experiment", "enums", "logmsg", "variables")


def package_fmu(
    body: ReducedBody,
    output: Path,
    runtime: Runtime = Runtime.NATIVE,
    platforms: Sequence[str] = (),
    report: Reporter | None = None,
    fmi: int = 2,
) -> None:
    """Write a body as an FMU; the file appears whole or not at all, and the same body gives the same bytes.

    Parameters
    ----------
    body : ReducedBody
    output : Path
        Ends in ".fmu".
    runtime : Runtime
    platforms : sequence of str
        Names of `core.building.PLATFORMS`, or "all"; default: those that this installation has the core for.
    report : Reporter, optional
    fmi : int
        Version of FMI, 2 or 3.

    Raises
    ------
    OutputError
        A wrong ending, or a folder that is not there or cannot be written to.
    PackagingError
        There is no core for a platform, and none can be made.
    """
    check_target(output, (".fmu",))
    data = fmu_bytes(body, runtime, cores_for(runtime, platforms, report, fmi), fmi)
    with whole_file(output) as part:
        part.write_bytes(data)


def fmu_bytes(body: ReducedBody, runtime: Runtime, cores: dict[str, bytes], fmi: int) -> bytes:
    """The FMU of a body with cores of `cores_for`."""
    whole = BytesIO()
    with zipfile.ZipFile(whole, "w") as archive:
        for name, data in sorted(_contents(body, runtime, cores, fmi).items()):
            # Of the earliest date that the format knows: archives of the same contents are the same.
            entry = zipfile.ZipInfo(name)
            # Libraries can be loaded where the unpacking program keeps permissions.
            entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
            archive.writestr(entry, data, zipfile.ZIP_DEFLATED)
    return whole.getvalue()


def cores_for(runtime: Runtime, platforms: Sequence[str], report: Reporter | None, fmi: int) -> dict[str, bytes]:
    """Cores that an FMU carries, by file name; those of other platforms are compiled when they are first asked for.

    Parameters
    ----------
    runtime : Runtime
    platforms : sequence of str
        As of `package_fmu`.
    report : Reporter or None
    fmi : int

    Returns
    -------
    dict of str to bytes

    Raises
    ------
    PackagingError
        There is no core for a platform, and none can be made; or pythonfmu has no library for it, or not for FMI 3.0.
    """
    if fmi not in (2, 3):
        raise PackagingError(f"fmi is {fmi}: expected 2 or 3, a version of FMI")
    if runtime is Runtime.NATIVE:
        return core_binaries(platforms, report)
    if fmi == 3:
        raise PackagingError("the runtime python is FMI 2.0 alone; use the runtime native")
    offered = [path.name for path in _pythonfmu()[1].iterdir()]
    refused = [name for name in platforms if name in PLATFORMS and name not in offered]
    if refused:
        found = f"platform {', '.join(refused)}: the runtime python is offered for {', '.join(sorted(offered))} only"
        raise PackagingError(f"{found} (pythonfmu has no other libraries); use the runtime native")
    cores = core_binaries(sorted(offered) if "all" in platforms else platforms, report)
    return {name: data for name, data in cores.items() if Path(name).stem in offered}


def _pythonfmu() -> tuple[Path, Path]:
    """Folders of pythonfmu's modules, and of its library for each platform that it has one for."""
    import pythonfmu

    modules = Path(pythonfmu.__file__).parent
    return modules, modules / "resources" / "binaries"


def _descriptions(body: ReducedBody, runtime: Runtime, guid: str, fmi: int) -> dict[str, bytes]:
    """What describes the FMU, by its names in the archive."""
    from .description import files_3, model_description

    return files_3(body, guid) if fmi == 3 else {DESCRIPTION: model_description(body, guid, runtime)}


def _contents(body: ReducedBody, runtime: Runtime, cores: dict[str, bytes], fmi: int) -> dict[str, bytes]:
    """Every file of the archive by its name."""
    # Who has the FMU from an earlier build needs none of this.
    from ..model.modal_file import modal_bytes
    from ..program.compile import programs, with_guid

    modal, made, code, sources = modal_bytes(body), programs(body), dict[str, bytes](), dict[str, bytes]()
    if runtime is Runtime.NATIVE:
        binaries = {
            f"binaries/{folder}/{body.name}{Path(name).suffix}": data
            for name, data in cores.items()
            for folder in (folders_3(Path(name).stem) if fmi == 3 else [Path(name).stem])
        }
        sources = _sources(body.name)
    else:
        modules, libraries = _pythonfmu()
        binaries = {
            f"binaries/{path.parent.name}/{body.name}{path.suffix}": path.read_bytes()
            for path in sorted(libraries.glob("*/*"))
            if path.parent.name in {Path(name).stem for name in cores}
        }
        binaries |= {f"resources/core/{name}": data for name, data in cores.items()}
        code = {f"pythonfmu/{name}.py": (modules / f"{name}.py").read_bytes() for name in _SLAVE_LIBRARY}
        words = f"The slave side of pythonfmu {version('pythonfmu')} (MIT licence)."
        code["pythonfmu/__init__.py"] = f'"""{words}"""\n'.encode()
        code["python_slave.py"] = Path(__file__).with_name("python_slave.py").read_bytes()
        code["__init__.py"] = b'"""What travels in the FMU."""\n'
    digest = hashlib.sha256()
    everything = {**code, **binaries, **sources, **with_guid(made, ""), MODAL_FILE: modal}
    everything |= _descriptions(body, runtime, "", fmi)
    for name, data in sorted(everything.items()):
        digest.update(f"{name}\0{len(data)}\0".encode() + data)
    guid = f"{{{uuid.UUID(modal_mark(modal) + digest.hexdigest()[:24])}}}"
    contents = {
        **_descriptions(body, runtime, guid, fmi),
        f"resources/{MODAL_FILE}": modal,
        **{f"resources/{name}": data for name, data in with_guid(made, guid).items()},
        **binaries,
        **sources,
    }
    if runtime is Runtime.PYTHON:
        package = f"flexfmu_{digest.hexdigest()[:16]}"
        contents["resources/slavemodule.txt"] = f"{package}_slave".encode()
        contents[f"resources/{package}_slave.py"] = _filled("slave_module", package=package, guid=guid)
        contents |= {f"resources/{package}/{name}": data for name, data in code.items()}
    return contents


def _sources(name: str) -> dict[str, bytes]:
    """The core's sources by their names in the archive of an FMU of a name."""
    found = {f"sources/{path.name}": path.read_bytes() for path in source_files()}
    for path in core_sources():
        found[f"sources/{path.name}"] = b'#include "prefix.h"\n' + found[f"sources/{path.name}"]
    readme = _filled("sources_readme", name=name, flags=" ".join(FLAGS))
    return found | {"sources/prefix.h": prefix_header().encode(), "sources/README.txt": readme}


def _filled(text: str, /, **words: str) -> bytes:
    """A text of this folder with words in place of their names."""
    return Path(__file__).with_name(f"{text}.txt").read_text("utf-8").format(**words).encode()
