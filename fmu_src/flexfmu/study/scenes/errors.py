"""What can be wrong with a scene."""

from ...files.errors import FlexfmuError


class SceneError(FlexfmuError):
    """The scene file, its tables or its records name, lack or contradict something."""
