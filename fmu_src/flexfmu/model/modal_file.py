"""The modal file: a `ReducedBody` in HDF5. This module is the schema; docs/file-formats.md describes it in words."""

import hashlib
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import h5py
import numpy as np

from ..methods import Mass, Method
from .errors import ModalFileError
from .inertia import InertiaIntegrals
from .reduced_body import (
    Masses,
    Properties,
    ReducedBody,
    SecondOrder,
    StressSet,
    Surface,
    Ties,
    WholeFrame,
)

FORMAT = "flexfmu modal file"
SCHEMA_VERSION = 3
FRAME_CONVENTION = "global Cartesian frame of the finite element model; rotation vectors about its axes"


class Entry(NamedTuple):
    """A dataset of the file.

    Attributes
    ----------
    path : str
        Where it lies in the file.
    unit : str
        SI unit, "1" for none.
    description : str
        Shape and meaning.
    """

    path: str
    unit: str
    description: str


# Attribute of `ReducedBody` → dataset. Modal coordinates are mass-normalised: kg^0.5 m.
ARRAYS: dict[str, Entry] = {
    "angular_frequency": Entry("modes/angular_frequency", "rad/s", "(m,) undamped angular frequencies"),
    "damping_ratio": Entry("modes/damping_ratio", "1", "(m,) modal damping ratios"),
    "interface_point": Entry("interfaces/point", "m", "(I, 3) reference points"),
    "interface_displacement": Entry("interfaces/displacement", "kg^-0.5", "(I, 3, m) displacement per mode"),
    "interface_rotation": Entry("interfaces/rotation", "rad/(kg^0.5 m)", "(I, 3, m) rotation per mode"),
    "interface_frame": Entry("interfaces/frame", "1", "(I,) frame that carries the interface, -1 for none"),
    "frame_parent": Entry("frames/parent", "1", "(S,) parent frame, -1 for a root"),
    "joint_point": Entry("frames/joint_point", "m", "(S, 3) joints with the parents"),
    "joint_displacement": Entry("frames/joint_displacement", "kg^-0.5", "(S, 3, m) displacement per mode"),
    "joint_rotation": Entry("frames/joint_rotation", "rad/(kg^0.5 m)", "(S, 3, m) rotation per mode"),
    "frame_rotation": Entry("frames/rotation", "rad/(kg^0.5 m)", "(S, 3, m) averaged rotation per mode"),
}
# Present only where the body was built with them.
OPTIONAL: dict[str, Entry] = {
    "stiffness_by_load": Entry(
        "stiffness/by_load",
        "s^-2/N",
        "(6I or 6I + 3, m, m) per unit load: forces, moments (/(N m)), accelerations (/(m/s^2))",
    ),
    "stiffness_by_mode": Entry("stiffness/by_mode", "s^-2/(kg^0.5 m)", "(m, m, m) per unit modal coordinate"),
}
WHOLE: dict[str, Entry] = {
    "joint_point": Entry("whole/joint_point", "m", "(3,) centre of the supports"),
    "joint_displacement": Entry("whole/joint_displacement", "kg^-0.5", "(3, m) displacement per mode"),
    "joint_rotation": Entry("whole/joint_rotation", "rad/(kg^0.5 m)", "(3, m) rotation per mode"),
    "frame_rotation": Entry("whole/rotation", "rad/(kg^0.5 m)", "(3, m) averaged rotation of the whole body per mode"),
}
MASSES: dict[str, Entry] = {
    "mass": Entry("masses/mass", "kg", "(P,) mass of each sub-domain"),
    "point": Entry("masses/point", "m", "(P, 3) centres of mass"),
    "displacement": Entry("masses/displacement", "kg^-0.5", "(P, 3, m) displacement of the centres per mode"),
    "frame": Entry("masses/frame", "1", "(P,) frame that carries it, -1 for none"),
}
# In a group of each stress set's name.
STRESS: dict[str, Entry] = {
    "point": Entry("point", "m", "(P, 3) undeformed places"),
    "stress": Entry(
        "stress", "N/m^2/(kg^0.5 m)", "(P, 6, m) xx, yy, zz, xy, yz, zx per mode, turning with the material"
    ),
}
# Index 0 of y_a stands for X - X_s, index j for the remainder of mode j in the frame.
INERTIA: dict[str, Entry] = {
    "frame": Entry("inertia/frame", "1", "(P,) frame that carries each part"),
    "mass": Entry("inertia/mass", "kg", "(P,) mass of each part"),
    "first": Entry("inertia/first", "kg m, kg^0.5", "(P, 1 + m, 3) integral of rho y_a"),
    "second": Entry("inertia/second", "kg m^2, kg^0.5 m, 1", "(P, 1 + m, 1 + m, 3, 3) integral of rho y_a y_b"),
    "ground": Entry("inertia/ground", "1", "(m, m) modal mass of what lies on no frame"),
}
TIES: dict[str, Entry] = {
    "frame": Entry("ties/frame", "1", "(T, 2) frames that carry the ends, -1 for the ground"),
    "point": Entry("ties/point", "m", "(T, 2, 3) centres of the sections"),
    "displacement": Entry("ties/displacement", "kg^-0.5", "(T, 2, 3, m) displacement per mode"),
    "rotation": Entry("ties/rotation", "rad/(kg^0.5 m)", "(T, 2, 3, m) rotation per mode"),
    "stiffness": Entry("ties/stiffness", "N/m", "(T, 3) along the global axes"),
    "lever": Entry("ties/lever", "m", "(T, 3, 3) in columns, points of the springs that resist tilting"),
}
# Rows are the nodes of the tree: frames, interfaces, centres of mass, ends of ties.
SECOND: dict[str, Entry] = {
    "displacement": Entry("second/displacement", "kg^-1 m^-1", "(K, 3, m, m) second derivative of displacements"),
    "rotation": Entry("second/rotation", "rad/(kg m^2)", "(K, 3, m, m) second derivative of rotation vectors"),
}
SURFACE: dict[str, Entry] = {
    "points": Entry("surface/points", "m", "(n, 3) undeformed corner nodes of the outer faces"),
    "faces": Entry("surface/faces", "1", "(f, 4) rows of points; a triangle repeats its last corner"),
    "modes": Entry("surface/modes", "kg^-0.5", "(n, 3, m) mode shapes"),
    "frame": Entry("surface/frame", "1", "(n,) frame that carries the point, -1 for none"),
}
PROPERTIES: dict[str, Entry] = {
    "box": Entry("properties/box", "m", "(2, 3) smallest and largest coordinates of the undeformed body"),
    "volume": Entry("properties/volume", "m^3", "(K,) volume of each material"),
    "youngs_modulus": Entry("properties/youngs_modulus", "N/m^2", "(K,) of each material"),
    "poissons_ratio": Entry("properties/poissons_ratio", "1", "(K,) of each material"),
    "density": Entry("properties/density", "kg/m^3", "(K,) of each material"),
}
MATERIAL_NAMES = Entry("properties/material", "1", "(K,) names of the materials")
NAMES: dict[str, Entry] = {
    "interface_names": Entry("interfaces/name", "1", "(I,) names"),
    "frame_names": Entry("frames/name", "1", "(S,) names"),
}


@dataclass(frozen=True, slots=True)
class _Digest:
    """What the checksum covers, in a fixed order."""

    body: ReducedBody

    def hexdigest(self) -> str:
        body = self.body
        digest = hashlib.sha256()
        texts = [
            body.name,
            body.method.value,
            body.mass.value,
            str(body.velocity_outputs),
            "\0".join(body.compliance_interfaces),
            str(body.root_interface),
            str(body.floating),
            *body.interface_names,
            *body.frame_names,
            *(f"{key}={body.provenance[key]}" for key in sorted(body.provenance)),
        ]
        arrays = [getattr(body, name) for name in ARRAYS]
        arrays += [value for name in OPTIONAL if (value := getattr(body, name)) is not None]
        if body.whole is not None:
            arrays += [getattr(body.whole, name) for name in WHOLE]
        if body.masses is not None:
            arrays += [getattr(body.masses, name) for name in MASSES]
        if body.inertia is not None:
            arrays += [getattr(body.inertia, name) for name in INERTIA]
        if body.ties is not None:
            arrays += [getattr(body.ties, name) for name in TIES]
        if body.second is not None:
            arrays += [getattr(body.second, name) for name in SECOND]
        if body.properties is not None:
            texts += body.properties.material_names
            arrays += [getattr(body.properties, name) for name in PROPERTIES]
        for part in body.stress_sets:
            texts.append(part.name)
            arrays += [part.point, part.stress]
        if body.surface is not None:
            arrays += [getattr(body.surface, name) for name in SURFACE]
        digest.update("\0".join(texts).encode())
        for array in arrays:
            digest.update(str(array.shape).encode())
            digest.update(np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<")).tobytes())
        return digest.hexdigest()


def write_modal_file(body: ReducedBody, path: Path) -> None:
    """Write a body; the file appears whole or not at all, and the same body gives the same bytes.

    Parameters
    ----------
    body : ReducedBody
    path : Path

    Raises
    ------
    OSError
        The folder cannot be written to.
    """
    # A new folder, which nobody else may write to: no link that others have laid is followed.
    with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
        part = Path(folder) / path.name
        with h5py.File(part, "w", libver=("v110", "v110")) as file:
            file.attrs["format"] = FORMAT
            file.attrs["schema_version"] = SCHEMA_VERSION
            file.attrs["name"] = body.name
            file.attrs["frame_convention"] = FRAME_CONVENTION
            file.attrs["method"] = body.method.value
            file.attrs["mass"] = body.mass.value
            file.attrs["velocity_outputs"] = body.velocity_outputs
            file.attrs["compliance_interfaces"] = ",".join(body.compliance_interfaces)
            file.attrs["root_interface"] = body.root_interface
            file.attrs["floating"] = body.floating
            file.attrs["sha256"] = _Digest(body).hexdigest()
            for field, entry in NAMES.items():
                _write(file, entry, _encoded(getattr(body, field)))
            for field, entry in ARRAYS.items():
                _write(file, entry, getattr(body, field))
            for field, entry in OPTIONAL.items():
                if (value := getattr(body, field)) is not None:
                    _write(file, entry, value)
            if body.whole is not None:
                for field, entry in WHOLE.items():
                    _write(file, entry, getattr(body.whole, field))
            if body.masses is not None:
                for field, entry in MASSES.items():
                    _write(file, entry, getattr(body.masses, field))
            if body.inertia is not None:
                for field, entry in INERTIA.items():
                    _write(file, entry, getattr(body.inertia, field))
            if body.ties is not None:
                for field, entry in TIES.items():
                    _write(file, entry, getattr(body.ties, field))
            if body.second is not None:
                for field, entry in SECOND.items():
                    _write(file, entry, getattr(body.second, field))
            if body.properties is not None:
                _write(file, MATERIAL_NAMES, _encoded(body.properties.material_names))
                for field, entry in PROPERTIES.items():
                    _write(file, entry, getattr(body.properties, field))
            for number, stresses in enumerate(body.stress_sets):
                for field, entry in STRESS.items():
                    place = f"stress/{number:03d}_{stresses.name}/{entry.path}"
                    _write(file, entry._replace(path=place), getattr(stresses, field))
            if body.surface is not None:
                for field, entry in SURFACE.items():
                    _write(file, entry, getattr(body.surface, field))
            group = file.create_group("provenance")
            for key in sorted(body.provenance):
                group.attrs[key] = body.provenance[key]
        part.replace(path)


def _encoded(names: tuple[str, ...]) -> Any:
    """Names as fixed-length bytes, which HDF5 keeps in the same bytes every time."""
    return np.array([name.encode() for name in names] or [b""], dtype="S")[: len(names)]


def _decoded(file: Any, entry: Entry) -> tuple[str, ...]:
    return tuple(text.decode() for text in file[entry.path][()])


def _write(file: Any, entry: Entry, values: Any) -> None:
    dataset = file.create_dataset(entry.path, data=values, track_times=False)
    dataset.attrs["unit"] = entry.unit
    dataset.attrs["description"] = entry.description


def read_modal_file(source: str | Path | BinaryIO) -> ReducedBody:
    """Read and check a modal file.

    Parameters
    ----------
    source : path or binary file object

    Returns
    -------
    ReducedBody

    Raises
    ------
    ModalFileError
        The file is missing, damaged, altered, foreign, or of a schema version that is not read here.
    """
    name = str(source) if isinstance(source, str | Path) else "modal file"
    try:
        with h5py.File(source, "r") as file:
            return _read(file, name)
    except FileNotFoundError as error:
        raise ModalFileError(f"{name}: no such file") from error
    except (OSError, KeyError, ValueError, UnicodeDecodeError, RuntimeError, TypeError) as error:
        raise ModalFileError(f"{name}: not a readable modal file ({error}); build it again") from error


def _read(file: Any, name: str) -> ReducedBody:
    found = file.attrs.get("format")
    if found != FORMAT:
        raise ModalFileError(f"{name}: an HDF5 file, but not a flexfmu modal file (format is {found!r})")
    version = int(file.attrs["schema_version"])
    if version != SCHEMA_VERSION:
        raise ModalFileError(
            f"{name}: schema version {version}, this flexfmu reads version {SCHEMA_VERSION}; build the body again"
        )
    masses = surface = inertia = ties = second = properties = None
    whole = None
    if "whole" in file:
        whole = WholeFrame(**{field: file[entry.path][()] for field, entry in WHOLE.items()})
    if "masses" in file:
        masses = Masses(**{field: file[entry.path][()] for field, entry in MASSES.items()})
    if "inertia" in file:
        inertia = InertiaIntegrals(**{field: file[entry.path][()] for field, entry in INERTIA.items()})
    if "ties" in file:
        ties = Ties(**{field: file[entry.path][()] for field, entry in TIES.items()})
    if "second" in file:
        second = SecondOrder(**{field: file[entry.path][()] for field, entry in SECOND.items()})
    if "properties" in file:
        made = {field: file[entry.path][()] for field, entry in PROPERTIES.items()}
        properties = Properties(material_names=_decoded(file, MATERIAL_NAMES), **made)
    if "surface" in file:
        surface = Surface(**{field: file[entry.path][()] for field, entry in SURFACE.items()})
    contents: dict[str, Any] = {field: _decoded(file, entry) for field, entry in NAMES.items()}
    contents |= {field: file[entry.path][()] for field, entry in ARRAYS.items()}
    contents |= {field: file[entry.path][()] for field, entry in OPTIONAL.items() if entry.path in file}
    body = ReducedBody(
        **contents,
        name=str(file.attrs["name"]),
        method=Method(file.attrs["method"]),
        mass=Mass(file.attrs["mass"]),
        velocity_outputs=bool(file.attrs["velocity_outputs"]),
        compliance_interfaces=tuple(filter(None, str(file.attrs["compliance_interfaces"]).split(","))),
        root_interface=int(file.attrs["root_interface"]),
        floating=bool(file.attrs["floating"]),
        provenance={key: str(value) for key, value in file["provenance"].attrs.items()},
        whole=whole,
        masses=masses,
        inertia=inertia,
        stress_sets=tuple(
            StressSet(key.partition("_")[2], *(group[entry.path][()] for entry in STRESS.values()))
            for key, group in sorted(file.get("stress", {}).items())
        ),
        surface=surface,
        ties=ties,
        second=second,
        properties=properties,
    )
    if _Digest(body).hexdigest() != file.attrs["sha256"]:
        raise ModalFileError(f"{name}: contents do not match their checksum: the file was altered; build it again")
    return body
