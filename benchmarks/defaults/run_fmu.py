"""FMUs as a user gets them: `flexfmu build` of a body file, then a static start under each load."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import fmpy
import numpy as np
from fmpy.fmi2 import (
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)

import flexfmu.core
from benchmarks.defaults.body import Loads
from benchmarks.defaults.shapes import FloatArray

STEPS = 400
"""In which loads on a free body grow, for four fifths of them."""


@dataclass(frozen=True)
class Point:
    """An FMU's start in equilibrium under some loads.

    Attributes
    ----------
    motion : (interfaces, 6) float
        Displacement, m, and rotation vector; NaN where it refused.
    estimate : (interfaces, 2) float
        Its own error of displacement, m, and rotation, rad; NaN where it has none.
    log : tuple of str
        Warnings and refusals.
    """

    motion: FloatArray
    estimate: FloatArray
    log: tuple[str, ...]

    @property
    def refused(self) -> bool:
        """Whether there is no result."""
        return bool(np.isnan(self.motion).any())


class Built:
    """An FMU built from a body file.

    Parameters
    ----------
    body_file : Path
    options : sequence of str
        Of the build.
    kept : Path, optional
        Folder where FMUs stay: one that is there is taken, with this installation's core.

    Attributes
    ----------
    seconds : float
        Time of the build; zero where it was kept.
    said : str
        What the build printed.
    """

    def __init__(self, body_file: Path, options: Sequence[str] = (), kept: Path | None = None):
        fmu, self.seconds, self.said = (kept or body_file.parent) / f"{body_file.stem}.fmu", 0.0, ""
        if not fmu.exists():
            self._build(body_file, fmu, options)
        self._description = fmpy.read_model_description(str(fmu))
        self._numbers = {v.name: v.valueReference for v in self._description.modelVariables}
        self._folder = fmpy.extract(str(fmu))
        if kept:
            for core in Path(self._folder, "binaries").glob("*64/*"):
                shutil.copy(Path(flexfmu.core.__file__).with_name("_flexcore.so"), core)

    def _build(self, body_file: Path, fmu: Path, options: Sequence[str]) -> None:
        start = time.perf_counter()
        command = [sys.executable, "-m", "flexfmu", "build", str(body_file), "-o", str(fmu), *options]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | {"COLUMNS": "200"})
        self.seconds, self.said = time.perf_counter() - start, done.stdout + done.stderr
        if done.returncode:
            raise RuntimeError(f"flexfmu build {body_file} failed:\n{self.said}")

    @property
    def names(self) -> frozenset[str]:
        """Names of its variables."""
        return frozenset(self._numbers)

    def __enter__(self) -> Built:
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)

    def point(self, loads: Loads, interfaces: Sequence[str], seconds: float = 0.0) -> Point:
        """Start in equilibrium under loads, or of a free body what loads that grow for so long come to."""
        log: list[str] = []

        def told(_environment: object, _name: object, _status: int, category: bytes | None, text: bytes) -> None:
            # Lines without a category are fmpy's own.
            if category:
                log.append(text.decode(errors="replace"))

        calls = fmi2CallbackFunctions()
        calls.logger = fmi2CallbackLoggerTYPE(told)
        calls.allocateMemory = fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        calls.freeMemory = fmi2CallbackFreeMemoryTYPE(fmpy.free)
        one = FMU2Slave(
            guid=self._description.guid,
            unzipDirectory=self._folder,
            modelIdentifier=self._description.coSimulation.modelIdentifier,
            instanceName="point",
        )
        one.instantiate(callbacks=calls, loggingOn=True)
        one.setupExperiment(startTime=0.0)

        def load(share: float) -> None:
            for name, force in loads.items():
                numbers = [self._numbers[f"{name}.force.{axis}"] for axis in "xyz"]
                one.setReal(numbers, [share * size for size in force])

        if not seconds:
            one.setString([self._numbers["initialization"]], ["static"])
            load(1.0)
        motion = np.full((len(interfaces), 6), np.nan)
        estimate = np.full((len(interfaces), 2), np.nan)
        try:
            one.enterInitializationMode()
            one.exitInitializationMode()
            for step in range(STEPS if seconds else 0):
                load(min(1.25 * (step + 1) / STEPS, 1.0))
                one.doStep(step * seconds / STEPS, seconds / STEPS)
            for row, name in enumerate(interfaces):
                words = [f"{name}.{what}.{axis}" for what in ("displacement", "rotation") for axis in "xyz"]
                motion[row] = one.getReal([self._numbers[word] for word in words])
                words = [f"{name}.error.{what}" for what in ("displacement", "rotation")]
                if all(word in self._numbers for word in words):
                    estimate[row] = one.getReal([self._numbers[word] for word in words])
        except fmpy.fmi1.FMICallException as error:
            log.append(str(error))
        finally:
            one.freeInstance()
        return Point(motion, estimate, tuple(log))
