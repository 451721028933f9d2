"""What can go wrong while a reduced body runs."""


class RuntimeBodyError(Exception):
    """Base of the errors that the travelling code raises."""


class ModalFileError(RuntimeBodyError):
    """The modal file is not one, is damaged, or has a schema that this version does not read."""


class ContentsError(RuntimeBodyError):
    """Files of an FMU do not belong together."""


class OptionError(RuntimeBodyError):
    """An option or parameter has a value that is not offered."""


class LoadError(RuntimeBodyError):
    """A load is not finite, or acts on an interface that the body does not have."""


class EquilibriumError(RuntimeBodyError):
    """No stable equilibrium was found under the load.

    Parameters
    ----------
    message : str
        What happened and what to do.
    load_factor : float
        Largest fraction of the load for which a stable equilibrium was found.
    """

    def __init__(self, message: str, load_factor: float):
        super().__init__(message)
        self.load_factor = load_factor


class StepError(RuntimeBodyError):
    """A time step has no solution that the iteration can find; the state before it is untouched."""
