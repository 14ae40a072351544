"""Kernels uncompiled: the same files, run by Python."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

KERNELS = Path(__file__).parents[2] / "src" / "retrue" / "kernels"
SOURCES = {path.stem: path for path in sorted(KERNELS.glob("*.py")) if path.stem != "__init__"}


def plain(name: str) -> ModuleType:
    """The kernel file of that name, not its machine code."""
    spec = spec_from_file_location(f"plain_{name}", SOURCES[name])
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
