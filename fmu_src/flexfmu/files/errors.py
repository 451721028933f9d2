"""What can go wrong on the build side; each message says what, where, what was expected, and what to do."""

INTERRUPTED = 130
"""Exit code of a job that Ctrl-C ended, as shells have it."""

NOT_MET = 3
"""Exit code of a search that ended well and found no model within the tolerance; 1 is an error, 2 wrong usage."""


class FlexfmuError(Exception):
    """Base of every error that a user's input can cause.

    Attributes
    ----------
    exit_code : int
        Of the command that it ends.
    """

    exit_code = 1


class BodyFileError(FlexfmuError):
    """The body file (TOML) names, lacks or contradicts something."""


class MeshError(FlexfmuError):
    """The mesh file cannot be read, or the mesh cannot be a body."""


class DeckError(MeshError):
    """A deck's line cannot be honoured.

    Parameters
    ----------
    message : str
        What was found, what was expected and what to do.
    file : str
        The deck, or the file that it includes.
    line : int
        Line number, counted from one.
    """

    def __init__(self, message: str, file: str, line: int):
        super().__init__(f"{file}, line {line}: {message}")
        self.file = file
        self.line = line


class ModelError(FlexfmuError):
    """The finite element model is not a body that can be reduced: free to move, or without stiffness or mass."""


class AccuracyError(FlexfmuError):
    """A computed result does not pass its own check (orthogonality, residual)."""


class PackagingError(FlexfmuError):
    """The FMU archive could not be made or read."""


class OutputError(PackagingError):
    """A file cannot, or should not, be written."""


class SimulationError(FlexfmuError):
    """A simulation cannot be set up, or the FMU refused a step."""
