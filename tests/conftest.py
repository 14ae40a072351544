"""No test runs on machine code of a kernel that has been edited since."""

from hashlib import sha256
from importlib import import_module

import pytest
from hypothesis import settings

from tests.kernels.plain import SOURCES

settings.register_profile("untimed", deadline=None)  # how long a test takes is the machine's affair
settings.load_profile("untimed")


def pytest_sessionstart() -> None:
    for name, source in SOURCES.items():
        compiled = getattr(import_module(f"retrue.kernels.{name}"), "SOURCE_SHA256", None)
        if compiled != sha256(source.read_bytes()).hexdigest():
            what = "is not compiled" if compiled is None else "was edited since it was compiled"
            pytest.exit(f"kernels/{name}.py: {what}; run: pip install --no-deps --editable .", returncode=4)
