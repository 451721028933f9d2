"""Finite element models of flexible bodies as FMI 2.0 co-simulation FMUs that stay right when the body bends far."""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING

from .body import FlexibleBody, Response, State, StepLimits
from .methods import Mass, Method

if TYPE_CHECKING:
    from .api import Body, BuiltBody, SimulationResult, load
    from .choices import Interface, Support
    from .config import Basis
    from .given import GivenModes, read_given
    from .matrices import linear_body
    from .mesh.formats import read_mesh
    from .mesh.model import Mesh
    from .mesh.units import UnitSystem
    from .packing import pack
    from .sid import read_sid, write_sid

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
    "Basis": ".config",
    "GivenModes": ".given",
    "Interface": ".choices",
    "Mesh": ".mesh.model",
    "Support": ".choices",
    "UnitSystem": ".mesh.units",
    "linear_body": ".matrices",
    "pack": ".packing",
    "read_given": ".given",
    "read_mesh": ".mesh.formats",
    "read_sid": ".sid",
    "write_sid": ".sid",
}


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES.get(name, ".api"), __name__), name)
