"""Finite element models of flexible bodies as FMI 2.0 co-simulation FMUs that stay right when the body bends far."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .api import Body as Body
    from .body.flexible_body import (
        FlexibleBody as FlexibleBody,
        Response as Response,
        State as State,
        StepLimits as StepLimits,
    )
    from .build.choices import Interface as Interface, Support as Support
    from .calls.decay import decay as decay
    from .calls.functions import *  # noqa: F403
    from .files.basics import (
        EquilibriumError as EquilibriumError,
        FlexfmuError as FlexfmuError,
        RuntimeBodyError as RuntimeBodyError,
        SimulationError as SimulationError,
        StepError as StepError,
        UnitSystem as UnitSystem,
    )
    from .fmu.built_body import BuiltBody as BuiltBody, SimulationResult as SimulationResult, load as load
    from .given.linear import linear_body as linear_body, read_sid as read_sid, write_sid as write_sid
    from .given.modes import GivenModes as GivenModes, read_given as read_given
    from .given.packing import pack as pack
    from .mesh.formats import read_mesh as read_mesh
    from .mesh.model import Mesh as Mesh
    from .mesh.shells import shell_mesh as shell_mesh
    from .model.methods import Mass as Mass, Method as Method
    from .reduction.options import Basis as Basis
    from .view.shown import Shown as Shown

    __version__: str

# Imported when first asked for.
_MODULES = {
    ".api": ("Body",),
    ".body.flexible_body": ("EquilibriumError", "FlexibleBody", "Response", "State", "StepError", "StepLimits"),
    ".build.choices": ("Interface", "Support"),
    ".calls.decay": ("decay",),
    ".calls.functions": ("chart", "check", "couple", "fit", "init", "show", "stability"),
    ".files.basics": ("FlexfmuError", "RuntimeBodyError", "SimulationError", "UnitSystem"),
    ".fmu.built_body": ("BuiltBody", "SimulationResult", "load"),
    ".given.linear": ("linear_body", "read_sid", "write_sid"),
    ".given.modes": ("GivenModes", "read_given"),
    ".given.packing": ("pack",),
    ".mesh.formats": ("read_mesh",),
    ".mesh.model": ("Mesh",),
    ".mesh.shells": ("shell_mesh",),
    ".model.methods": ("Mass", "Method"),
    ".reduction.options": ("Basis",),
    ".view.shown": ("Shown",),
}

__all__ = ["__version__", *(name for names in _MODULES.values() for name in names)]


def __dir__() -> list[str]:
    """Every public name, for completion."""
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> object:
    if name == "__version__":
        return import_module(".files.basics", __name__).own_version()
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(module, __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
