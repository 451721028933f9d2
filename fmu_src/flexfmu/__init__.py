"""Finite element models of flexible bodies as FMI 2.0 co-simulation FMUs that stay right when the body bends far."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .api import Body
    from .body.flexible_body import FlexibleBody, Response, State, StepLimits
    from .build.choices import Interface, Support
    from .files.errors import FlexfmuError, SimulationError
    from .files.units import UnitSystem
    from .files.version import __version__
    from .fmu.built_body import BuiltBody, SimulationResult, load
    from .given.matrices import linear_body
    from .given.modes import GivenModes, read_given
    from .given.packing import pack
    from .given.sid import read_sid, write_sid
    from .mesh.formats import read_mesh
    from .mesh.model import Mesh
    from .mesh.shells import shell_mesh
    from .model.errors import EquilibriumError, RuntimeBodyError, StepError
    from .model.methods import Mass, Method
    from .reduction.options import Basis
__all__ = [
    "Basis",
    "Body",
    "BuiltBody",
    "EquilibriumError",
    "FlexfmuError",
    "FlexibleBody",
    "GivenModes",
    "Interface",
    "Mass",
    "Mesh",
    "Method",
    "Response",
    "RuntimeBodyError",
    "SimulationError",
    "SimulationResult",
    "State",
    "StepError",
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
    "shell_mesh",
    "write_sid",
]

# Imported when first asked for.
_MODULES = {
    ".api": ("Body",),
    ".body.flexible_body": ("FlexibleBody", "Response", "State", "StepLimits"),
    ".build.choices": ("Interface", "Support"),
    ".files.errors": ("FlexfmuError", "SimulationError"),
    ".files.units": ("UnitSystem",),
    ".files.version": ("__version__",),
    ".fmu.built_body": ("BuiltBody", "SimulationResult", "load"),
    ".given.matrices": ("linear_body",),
    ".given.modes": ("GivenModes", "read_given"),
    ".given.packing": ("pack",),
    ".given.sid": ("read_sid", "write_sid"),
    ".mesh.formats": ("read_mesh",),
    ".mesh.model": ("Mesh",),
    ".mesh.shells": ("shell_mesh",),
    ".model.errors": ("EquilibriumError", "RuntimeBodyError", "StepError"),
    ".model.methods": ("Mass", "Method"),
    ".reduction.options": ("Basis",),
}


def __getattr__(name: str) -> object:
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(module, __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
