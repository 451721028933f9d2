"""setuptools' build backend, which asks pip for `ziglang` only where it is needed.

That is where there is no C compiler, and for a wheel with the core of every platform (FLEXFMU_PLATFORMS=all).
"""

import os
import shutil

from setuptools.build_meta import *  # noqa: F403 - the hooks of PEP 517
from setuptools.build_meta import (
    get_requires_for_build_editable as _for_editable,
    get_requires_for_build_wheel as _for_wheel,
)

_ZIG = "ziglang>=0.13"


def _compiler() -> list[str]:
    found = os.environ.get("CC") or any(shutil.which(name) for name in ("cc", "gcc", "clang"))
    return [] if found else [_ZIG]


def get_requires_for_build_wheel(config_settings=None):  # noqa: D103
    needed = [_ZIG] if os.environ.get("FLEXFMU_PLATFORMS") == "all" else _compiler()
    return [*_for_wheel(config_settings), *needed]


def get_requires_for_build_editable(config_settings=None):  # noqa: D103
    return [*_for_editable(config_settings), *_compiler()]
