"""What a fit has found, in words, as a table, and as a body file with the reason of each choice."""

import html
import math
import os
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..build.config import BodyFile
from ..files.basics import plural
from ..files.outputs import table_frame
from ..files.toml_files import toml_value
from ..model.methods import Variant
from ..reduction.options import Basis
from .candidates import Reduction, times
from .scene.reference import SceneErrors


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """What was found.

    Attributes
    ----------
    reduction : Reduction
    variant : Variant
    measured, given : SceneErrors
        Of the file that was written, and of the body as the user has it.
    verified : SceneErrors or None
        Of the file that was written, against the finite element model where that was asked for.
    step, given_step : float
        Time of a step from Python, s; not a number where the body as given has no answer.
    mode_count, given_mode_count, frame_count, given_frame_count : int
    reasons : dict of str to str
        By the key of the body file.
    seconds : float
        What it took.
    tried : int
        Models whose error was measured.
    """

    reduction: Reduction
    variant: Variant
    measured: SceneErrors
    given: SceneErrors
    verified: SceneErrors | None
    step: float
    given_step: float
    mode_count: int
    given_mode_count: int
    frame_count: int
    given_frame_count: int
    reasons: dict[str, str]
    seconds: float
    tried: int

    @property
    def met(self) -> bool:
        """Whether the file that was written meets the tolerance."""
        return self._counts.share <= 1.0

    @property
    def _counts(self) -> SceneErrors:
        """The errors that decide."""
        return self.verified or self.measured

    @property
    def verdict(self) -> str:
        """Pass or fail, in a line."""
        share = times(self._counts.share)
        if self.met:
            return f"pass: {share} × the tolerance"
        return f"fail: {share} × the tolerance; the best model found is written all the same"

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame of errors and sizes: of the body as given, and of the file that was written."""
        sizes = (self.given_mode_count, self.given_frame_count), (self.mode_count, self.frame_count)
        rows = zip(("given", "written"), (self.given, self._counts), sizes, strict=True)
        return table_frame({"body": name, "modes": m, "frames": s} | errors.columns for name, errors, (m, s) in rows)

    def _repr_html_(self) -> str:
        return "".join(f"<p>{html.escape(line)}</p>" for line in (*self.summary, self.verdict))

    @property
    def summary(self) -> list[str]:
        """The result in a few lines."""
        measured = self._counts
        kinds = {
            "static displacement {:.2g} %": measured.static_displacement,
            "displacement over time {:.2g} % rms": measured.transient_displacement,
        }
        errors = ", ".join(words.format(100.0 * error) for words, error in kinds.items() if not math.isnan(error))
        where = f" ({measured.limited_by})" if measured.limited_by else ""
        lines = [
            f"Error over tolerance: {times(measured.share)}{where}; {errors or measured.failure}.",
            f"{_size(self.mode_count, self.frame_count)}; a step from Python takes {1e6 * self.step:.3g} µs.",
        ]
        if self.verified is not None:
            lines[0] += f" By the finite element model; {times(self.measured.share)} in the search."
        else:
            lines.append("Errors are those against a fine reduced model; chart's, against finite elements, may differ.")
        if math.isnan(self.given_step):
            lines.append(f"As given the body has no answer in this scene: {self.given.failure}")
        else:
            lines.append(
                f"As given: {times(self.given.share)} of the tolerance, "
                f"{_size(self.given_mode_count, self.given_frame_count)}, {1e6 * self.given_step:.3g} µs."
            )
        return lines


def _size(modes: int, frames: int) -> str:
    return f"{plural(modes, 'mode')}, {plural(frames, 'frame')}"


_WIDTH = 118
# Tables that are written by hand, with their reasons.
_CHOSEN = ("name", "frames", "reduction", "formulation")


def body_text(config: BodyFile, folder: Path, header: Sequence[str], reasons: Mapping[str, str]) -> str:
    """TOML of a body file.

    Parameters
    ----------
    config : BodyFile
        With the mesh's path relative to the working directory.
    folder : Path
        Where the file will lie.
    header : sequence of str
        Paragraphs at the top; an empty one is an empty line.
    reasons : mapping of str to str
        Comments by key: "frames", "interface", "basis", "modes", "method", "mass".

    Returns
    -------
    str
    """
    lines = [line for paragraph in header for line in _comment(paragraph)]
    lines += ["", f"name = {toml_value(config.name)}", *_comment(reasons.get("frames", ""))]
    if config.frames is not None:
        lines.append(f"frames = {config.frames}")
    data = config.model_dump(mode="json", exclude_defaults=True, exclude_none=True)
    data["mesh"] = {**data["mesh"], "file": Path(os.path.relpath(config.mesh.file, folder)).as_posix()}
    plain = {key: value for key, value in data.items() if key not in _CHOSEN}
    lines += [f"{key} = {toml_value(value)}" for key, value in plain.items() if not _is_table(value)]
    for key, value in plain.items():
        if not _is_table(value):
            continue
        comment = _comment(reasons.get(key, ""))
        for table in value if isinstance(value, list) else [value]:
            lines += ["", *comment, f"[[{key}]]" if isinstance(value, list) else f"[{key}]"]
            lines += [f"{name} = {toml_value(one)}" for name, one in table.items()]
            comment = []
    reduction = config.reduction
    chosen: dict[str, dict[str, Any]] = {
        "reduction": {"basis": reduction.basis.value, "modes": reduction.modes},
        "formulation": {"method": config.variant.method.value, "mass": config.variant.mass.value},
    }
    if reduction.basis is Basis.NORMAL:
        chosen["reduction"]["residual_flexibility"] = config.residual
    if reduction.membrane != "auto":
        chosen["reduction"]["membrane"] = reduction.membrane
    for title, table in chosen.items():
        lines += ["", f"[{title}]"]
        for name, one in table.items():
            lines += [*_comment(reasons.get(name, "")), f"{name} = {toml_value(one)}"]
    return "\n".join(lines) + "\n"


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(text, _WIDTH, break_long_words=False)]


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))
