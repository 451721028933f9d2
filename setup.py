"""What pyproject.toml cannot say yet: the compiled step."""

import os

from setuptools import Extension, setup

# Without a C compiler the installation goes on, and steps run in NumPy.
kernel = Extension(
    "flexfmu.runtime._kernel",
    ["fmu_src/flexfmu/runtime/kernel.c"],
    # Nobody reads errno or floating-point exceptions.
    extra_compile_args=["-O3", "-fno-math-errno", "-fno-trapping-math"] if os.name == "posix" else [],
    optional=True,
)
setup(ext_modules=[kernel])
