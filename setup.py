"""What pyproject.toml cannot say yet: the compiled step."""

from setuptools import Extension, setup

# Without a C compiler the installation goes on, and steps run in NumPy.
kernel = Extension(
    "flexfmu.runtime._kernel", ["fmu_src/flexfmu/runtime/kernel.c"], extra_compile_args=["-O3"], optional=True
)
setup(ext_modules=[kernel])
