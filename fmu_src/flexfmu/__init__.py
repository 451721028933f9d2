"""Finite element models of flexible bodies as FMI 2.0 co-simulation FMUs that stay right when the body bends far."""

from importlib.metadata import version
from pathlib import Path

from .body import FlexibleBody, Response, State, StepLimits
from .methods import Mass, Method

__version__ = version("flexfmu")
__all__ = [
    "FlexibleBody",
    "Mass",
    "Method",
    "Response",
    "State",
    "StepLimits",
    "__version__",
    "load",
]


def load(path: str | Path, method: Method | str | None = None, mass: Mass | str | None = None) -> FlexibleBody:
    """Read a body from an FMU or a modal file, to use it without FMI.

    Parameters
    ----------
    path : path
        FMU made by flexfmu, or modal file (HDF5).
    method : Method or str, optional
        Default: the one that the body was built with.
    mass : Mass or str, optional
        Default: the body's own, where the method knows it.

    Returns
    -------
    FlexibleBody

    Raises
    ------
    PackagingError
        An archive that is no FMU of flexfmu.
    OptionError
        No such method or mass, or data that the body was built without.
    ModalFileError
        The file is missing, damaged, altered or of an unknown version.
    """
    from .fmu.package import read_packaged_body

    return FlexibleBody(read_packaged_body(Path(path)), method, mass)
