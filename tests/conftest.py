"""No test runs on machine code of a kernel that has been edited since, nor deaf to Ctrl-C."""

import signal
from hashlib import sha256
from importlib import import_module

import pytest
from hypothesis import settings

from tests.chromium import browser
from tests.kernels.plain import SOURCES

__all__ = ["browser"]

settings.register_profile("untimed", deadline=None)  # how long a test takes is the machine's affair
settings.load_profile("untimed")

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # as shells start what runs behind: commands would inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_sessionstart() -> None:
    for name, source in SOURCES.items():
        compiled = getattr(import_module(f"retrue.kernels.{name}"), "SOURCE_SHA256", None)
        if compiled != sha256(source.read_bytes()).hexdigest():
            what = "is not compiled" if compiled is None else "was edited since it was compiled"
            pytest.exit(f"kernels/{name}.py: {what}; run: pip install --no-deps --editable .", returncode=4)
