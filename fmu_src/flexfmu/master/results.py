"""Results of a coupling: columns over time with names and units, in a CSV or an HDF5 file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ..files.array_types import FloatArray
from ..files.plain_data import picture_html
from ..files.tables import write_table
from ..files.targets import whole_file

SUFFIXES = (".csv", ".h5", ".hdf5")
ITERATIONS = "master.iterations"
CREATED_ENERGY = "master.created_energy"


@dataclass(frozen=True, slots=True)
class Result:
    """What the coupled FMUs did.

    Attributes
    ----------
    names : tuple of str
        "fmu.variable", C of them; the last ones are the master's own.
    units : tuple of str or None
    time : (T,) float
        s.
    values : (T, C) float
    """

    names: tuple[str, ...]
    units: tuple[str | None, ...]
    time: FloatArray
    values: FloatArray

    def __post_init__(self) -> None:
        if self.values.shape != (len(self.time), len(self.names)) or len(self.units) != len(self.names):
            raise ValueError(
                f"{len(self.names)} names, {len(self.units)} units, {len(self.time)} times, values {self.values.shape}"
            )
        for array in (self.time, self.values):
            array.flags.writeable = False

    def __getitem__(self, name: str) -> FloatArray:
        """Values (T,) of a column by its name."""
        return self.values[:, self.names.index(name)]

    def to_dataframe(self) -> Any:
        """A pandas.DataFrame of the columns, with time as its index."""
        import pandas

        return pandas.DataFrame(self.values, index=pandas.Index(self.time, name="time"), columns=list(self.names))

    def plot(self) -> Any:
        """A matplotlib figure of the motions among the columns."""
        from ..fmu.curves import result_figure

        return result_figure(self.names, self.time, self.values)

    def _repr_html_(self) -> str:
        return picture_html(self.plot())


def write_result(path: Path, result: Result) -> None:
    """Write results, by the file name's ending as CSV or HDF5; the file appears whole or not at all.

    CSV: as `write_table`. HDF5: datasets "time" and one a column, with the attribute "unit".

    Parameters
    ----------
    path : Path
    result : Result

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    if path.suffix.lower() == ".csv":
        write_table(path, result.names, np.column_stack([result.time, result.values]), result.units)
        return
    units = zip(result.names, result.units, strict=True)
    columns = [("time", "s", result.time), *((name, unit, result[name]) for name, unit in units)]
    with whole_file(path) as part, h5py.File(part, "w") as file:
        for name, unit, values in columns:
            # HDF5 takes a slash for a group.
            dataset = file.create_dataset(name.replace("/", "_"), data=values, track_times=False)
            dataset.attrs["unit"] = unit or ""
