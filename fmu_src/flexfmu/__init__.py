"""Finite element models of flexible bodies as FMI 2.0 co-simulation FMUs that stay right when the body bends far."""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING

from .body.flexible_body import FlexibleBody, Response, State, StepLimits
from .model.methods import Mass, Method

if TYPE_CHECKING:
    from .api import Body, BuiltBody, SimulationResult, load
    from .build.choices import Interface, Support
    from .build.config import Basis
    from .files.units import UnitSystem
    from .given.matrices import linear_body
    from .given.modes import GivenModes, read_given
    from .given.packing import pack
    from .given.sid import read_sid, write_sid
    from .mesh.formats import read_mesh
    from .mesh.model import Mesh

__version__ = version("flexfmu")
__all__ = [
    "Basis",
    "Body",
    "BuiltBody",
    "FlexibleBody",
    "GivenModes",
    "Interface",
    "Mass",
    "Mesh",
    "Method",
    "Response",
    "SimulationResult",
    "State",
    "StepLimits",
    "Support",
    "UnitSystem",
    "__version__",
    "linear_body",
    "load",
    "pack",
    "read_given",
    "read_mesh",
    "read_sid",
    "write_sid",
]

# Imported when first asked for: the build side takes a second to load, and a running body does without it.
_MODULES = {
    "Basis": ".build.config",
    "GivenModes": ".given.modes",
    "Interface": ".build.choices",
    "Mesh": ".mesh.model",
    "Support": ".build.choices",
    "UnitSystem": ".files.units",
    "linear_body": ".given.matrices",
    "pack": ".given.packing",
    "read_given": ".given.modes",
    "read_mesh": ".mesh.formats",
    "read_sid": ".given.sid",
    "write_sid": ".given.sid",
}


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES.get(name, ".api"), __name__), name)
