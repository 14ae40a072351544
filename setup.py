"""What pyproject.toml cannot say: the kernels are compiled."""

from retrue_build import BuildKernels, kernels
from setuptools import setup

setup(ext_modules=kernels(), cmdclass={"build_ext": BuildKernels})
