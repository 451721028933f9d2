"""What the many builds and runs of a search say, kept instead of shown."""

from ...files.progress import Reporter


class Heard(Reporter):
    """Keeps notes and warnings; passes warnings on, once each, where someone is given who wants them.

    Parameters
    ----------
    report : Reporter, optional
    """

    def __init__(self, report: Reporter | None = None):
        self._report = report
        self.notes: list[str] = []
        self.warnings: list[str] = []

    def note(self, text: str) -> None:
        """Keep it."""
        self.notes.append(text)

    def warning(self, text: str) -> None:
        """Keep it, and pass it on if it is new."""
        if self._report is not None and text not in self.warnings:
            self._report.warning(text)
        self.warnings.append(text)
