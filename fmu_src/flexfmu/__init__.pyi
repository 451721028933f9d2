"""Public names and where they are from; `__init__.py` imports each when it is first asked for."""

# ruff: noqa: I001 -- a line for each name, as `__init__.py` reads them.

from .api import Body as Body
from .body.flexible_body import FlexibleBody as FlexibleBody
from .body.flexible_body import Response as Response
from .body.flexible_body import State as State
from .body.flexible_body import StepLimits as StepLimits
from .build.choices import Interface as Interface
from .build.choices import Support as Support
from .calls.decay import decay as decay
from .calls.functions import chart as chart
from .calls.functions import check as check
from .calls.functions import couple as couple
from .calls.functions import fit as fit
from .calls.functions import init as init
from .calls.functions import show as show
from .calls.functions import stability as stability
from .files.basics import EquilibriumError as EquilibriumError
from .files.basics import FlexfmuError as FlexfmuError
from .files.basics import RuntimeBodyError as RuntimeBodyError
from .files.basics import SimulationError as SimulationError
from .files.basics import StepError as StepError
from .files.basics import UnitSystem as UnitSystem
from .fmu.built_body import BuiltBody as BuiltBody
from .fmu.built_body import SimulationResult as SimulationResult
from .fmu.built_body import load as load
from .given.linear import linear_body as linear_body
from .given.linear import read_sid as read_sid
from .given.linear import write_sid as write_sid
from .given.modes import GivenModes as GivenModes
from .given.modes import read_given as read_given
from .given.packing import pack as pack
from .mesh.formats import read_mesh as read_mesh
from .mesh.model import Mesh as Mesh
from .mesh.shells import shell_mesh as shell_mesh
from .model.methods import Mass as Mass
from .model.methods import Method as Method
from .reduction.options import Basis as Basis
from .view.shown import Shown as Shown

__version__: str
