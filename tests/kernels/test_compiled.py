"""Every kernel is machine code, and needs no Cython to run."""

import subprocess
import sys

import cython
import pytest

from tests.kernels.plain import SOURCES, plain


@pytest.mark.parametrize("name", SOURCES)
def test_a_kernel_is_compiled_and_runs_without_cython(name: str) -> None:
    code = f"import sys; from retrue.kernels import {name}; print({name}.__file__, *sys.modules, sep='\\n')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    file, *modules = done.stdout.split("\n")
    assert not file.endswith(".py")
    assert not {"cython", "Cython"} & set(modules)


def test_the_plain_run_is_plain() -> None:
    assert not cython.compiled
    for name, source in SOURCES.items():
        assert plain(name).__file__ == str(source)
