"""Finite element models of flexible bodies as FMI 2.0 co-simulation FMUs that stay right when the body bends far."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .api import Body
    from .body.flexible_body import FlexibleBody, Response, State, StepLimits
    from .build.choices import Interface, Support
    from .build.config import Basis
    from .files.units import UnitSystem
    from .fmu.built_body import BuiltBody, SimulationResult, load
    from .given.matrices import linear_body
    from .given.modes import GivenModes, read_given
    from .given.packing import pack
    from .given.sid import read_sid, write_sid
    from .mesh.formats import read_mesh
    from .mesh.model import Mesh
    from .model.methods import Mass, Method

    __version__: str
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

# Imported when first asked for.
_MODULES = {
    "Basis": ".build.config",
    "Body": ".api",
    "BuiltBody": ".fmu.built_body",
    "FlexibleBody": ".body.flexible_body",
    "GivenModes": ".given.modes",
    "Interface": ".build.choices",
    "Mass": ".model.methods",
    "Mesh": ".mesh.model",
    "Method": ".model.methods",
    "Response": ".body.flexible_body",
    "SimulationResult": ".fmu.built_body",
    "State": ".body.flexible_body",
    "StepLimits": ".body.flexible_body",
    "Support": ".build.choices",
    "UnitSystem": ".files.units",
    "linear_body": ".given.matrices",
    "load": ".fmu.built_body",
    "pack": ".given.packing",
    "read_given": ".given.modes",
    "read_mesh": ".mesh.formats",
    "read_sid": ".given.sid",
    "write_sid": ".given.sid",
}


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "__version__":
        from .files.version import VERSION

        return VERSION
    return getattr(import_module(_MODULES[name], __name__), name)
