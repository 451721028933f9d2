"""What a live page needs of a body: the core for browsers, programs, the surface, and springs that pull."""

import base64
import gzip
from dataclasses import replace

import numpy as np

from ..body.flexible_body import FlexibleBody
from ..body.recovery import surface_data, surface_of
from ..core.binaries import web_core
from ..core.image import DESCRIPTION
from ..files.basics import FloatArray, OptionError
from ..program.programs import programs, with_guid
from ..program.variable_table import variable_table
from .model import DISPLACEMENT, View
from .motions import body_view

# Programs that the page runs: the body's own, the linear one beside it, and the one that tells the error.
_PROGRAMS = (DESCRIPTION, "linear.prog", "shadow.prog")
_GUID = "live"
# Spring of the pointer over the softest direction of an interface; frequency of rigid motions over the first one's.
_PULL, _FREE = 2.0, 0.1


def live_view(body: FlexibleBody, alone: bool = True) -> View:
    """View of a body that answers to the pointer, with its interfaces.

    Parameters
    ----------
    body : FlexibleBody
    alone : bool
        Whether nothing else is asked of the page.

    Returns
    -------
    View

    Raises
    ------
    OptionError
        Something else is.
    """
    if not alone:
        raise OptionError("a live page begins at rest, without loads, motion or modes: ask for these in another page")
    view = body_view(body)
    model = replace(body.model, method=body.method, mass=body.variant.mass)
    made = {name: draft for name, draft in programs(model).items() if name in _PROGRAMS}
    sizes, on, numbers = surface_data(model, body.method)
    parts = with_guid(made, _GUID) | {"core": web_core(), "numbers": numbers.astype("<f4").tobytes()}
    if (stress := surface_of(model).stress) is not None:
        parts["stress"] = stress.astype("<f4").tobytes()
    live = {
        "guid": _GUID,
        "parts": {name: base64.b64encode(gzip.compress(part, 6, mtime=0)).decode() for name, part in parts.items()},
        "variables": [v.name for v in variable_table(model)],
        "interfaces": model.interface_names,
        "stiffness": _stiffness(body),
        "frequency": model.angular_frequency[model.rigid_count] / (2.0 * np.pi),
        "free": model.rigid_count > 0,
        "sizes": sizes,
        "on": on,
    }
    held = len(model.properties.support_names) if model.properties is not None else 0
    count = model.interface_count + held
    return replace(view, marks=view.marks[:count], mark_points=view.mark_points[:count], colour=DISPLACEMENT, live=live)


def _stiffness(body: FlexibleBody) -> list[float]:
    """Stiffness (N/m) of the pointer's spring at each interface."""
    model, first = body.model, body.model.rigid_count
    omega = np.maximum(model.angular_frequency, _FREE * model.angular_frequency[first])
    weighed: FloatArray = model.interface_displacement / omega
    return [float(_PULL / np.linalg.norm(shape, 2) ** 2) for shape in weighed]
