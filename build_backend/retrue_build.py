"""How retrue is built: setuptools, and kernels compiled by the C compiler that is there, or by Zig's from PyPI.

The hooks of PEP 517 and 660 are setuptools' own, but for what they ask for where no compiler is found. What a kernel
compiles to is kept in build/kernels under a hash of all that it depends on, so that nothing is compiled twice, and
machine code never stands for a source that was edited: it carries the SHA-256 of its own (`SOURCE_SHA256`).
"""

from __future__ import annotations

import os
import shlex
import shutil
import sys
import sysconfig
from hashlib import sha256
from pathlib import Path
from typing import Any

from setuptools import Extension, build_meta
from setuptools.build_meta import *  # noqa: F403
from setuptools.command.build_ext import build_ext

KERNELS = Path("src/retrue/kernels")
PACKAGE = "retrue.kernels"
SHARED = f"{PACKAGE}._shared"  # Cython's memoryviews, once for all kernels: a fifth of the time to compile each
KEPT = Path("build/kernels")
DIRECTIVES = {
    "boundscheck": False,
    "cdivision": True,
    "infer_types": True,
    "initializedcheck": False,
    "language_level": 3,
    "wraparound": False,
}
# Nothing here changes a result: a kernel says to the last bit what it says uncompiled.
EXACT = ["-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-g0"]
# Sums in any order, for what is iterated to convergence; NaN and infinity stay what they are.
REORDERED = ["-fassociative-math", "-fno-signed-zeros", "-freciprocal-math"]
# A row is written number by number: read back in pairs, it stalls the processor.
IN_ORDER = ["-fno-tree-slp-vectorize"]
FLAGS = {"homography": REORDERED, "two_view": IN_ORDER}


def get_requires_for_build_wheel(config_settings: Any = None) -> list[str]:
    return [*build_meta.get_requires_for_build_wheel(config_settings), *_missing_compiler()]


def get_requires_for_build_editable(config_settings: Any = None) -> list[str]:
    return [*build_meta.get_requires_for_build_editable(config_settings), *_missing_compiler()]


def build_wheel(wheel_directory: str, config_settings: Any = None, metadata_directory: str | None = None) -> str:
    for folder in Path("build").glob("lib*"):  # setuptools would pack what an earlier build left there
        shutil.rmtree(folder)
    return build_meta.build_wheel(wheel_directory, config_settings, metadata_directory)


def _missing_compiler() -> list[str]:
    return [] if _compiler() else ["ziglang>=0.13"]


def _compiler() -> str | None:
    """The C compiler of $CC, of Python itself, or of the PATH; None where there is none."""
    python_s = sysconfig.get_config_var("CC")
    for command in (os.environ.get("CC"), python_s, "cc", "gcc", "clang"):
        if command and shutil.which(shlex.split(command)[0]):
            return command
    return None


def kernels() -> list[Extension]:
    sources = sorted(path for path in KERNELS.glob("*.py") if path.stem != "__init__")
    return [Extension(SHARED, []), *(Extension(f"{PACKAGE}.{path.stem}", [path.as_posix()]) for path in sources)]


class BuildKernels(build_ext):
    """From Python by way of C to machine code, or straight from what an earlier build kept."""

    def run(self) -> None:
        if sys.platform != "win32":
            _choose_compiler()
            if not any(Path(folder, "Python.h").is_file() for folder in self.include_dirs):
                raise SystemExit("Python.h: not found; install Python's headers (Debian: python3-dev)")
        stems = {_stem(kernel) for kernel in self.extensions}
        for old in KERNELS.glob("*.so"):
            if old.name.partition(".")[0] not in stems:  # of a kernel that is no more
                old.unlink()
        self.force = True
        self.parallel = os.cpu_count()
        super().run()

    def build_extensions(self) -> None:
        if self.compiler.compiler_type == "unix":
            for kernel in self.extensions:
                kernel.extra_compile_args = EXACT + FLAGS.get(_stem(kernel), [])
        self.kept = {kernel.name: self._keep(kernel) for kernel in self.extensions}
        self._translate([kernel for kernel in self.extensions if not self.kept[kernel.name].exists()])
        super().build_extensions()

    def build_extension(self, ext: Extension) -> None:
        kept, made = self.kept[ext.name], Path(self.get_ext_fullpath(ext.name))
        if kept.exists():
            made.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(kept, made)
            return
        super().build_extension(ext)
        kept.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(made, kept)

    def _keep(self, kernel: Extension) -> Path:
        """Where the machine code of `kernel` is kept: a name for all that it depends on."""
        from Cython import __version__ as cython

        command = [*self.compiler.compiler_so, *kernel.extra_compile_args, *self.compiler.linker_so]
        parts = [cython, sys.version, self.get_ext_filename(kernel.name), *command, Path(__file__).read_text("utf-8")]
        parts += [Path(source).read_text("utf-8") for source in kernel.sources]
        return KEPT / sha256("\0".join(parts).encode()).hexdigest()[:16] / f"{_stem(kernel)}.so"

    def _translate(self, changed: list[Extension]) -> None:
        """Write their C, of a copy of each source that knows its own hash, and make that what is compiled."""
        from Cython.Build import cythonize
        from Cython.Compiler.Errors import CompileError

        folder = KEPT / "c" / PACKAGE.replace(".", "/")
        folder.mkdir(parents=True, exist_ok=True)
        (folder.parent / "__init__.py").touch()
        (folder / "__init__.py").touch()
        copies: list[Extension] = []
        for kernel in changed:
            copy = folder / f"{_stem(kernel)}.c"
            if kernel.name != SHARED:
                source = Path(kernel.sources[0]).read_bytes()
                copy = copy.with_suffix(".py")
                copy.write_bytes(source + f'SOURCE_SHA256 = "{sha256(source).hexdigest()}"\n'.encode())
            copies.append(Extension(kernel.name, [copy.as_posix()]))
        try:
            translated = cythonize(
                copies, force=True, quiet=True, compiler_directives=DIRECTIVES, shared_utility_qualified_name=SHARED
            )
        except CompileError as error:  # Cython has said which and where
            raise SystemExit("kernels: not compiled") from error
        for kernel, done in zip(changed, translated, strict=True):
            kernel.sources = done.sources


def _stem(kernel: Extension) -> str:
    return kernel.name.rpartition(".")[2]


def _choose_compiler() -> None:
    """Tell distutils by $CC and $LDSHARED where Python's own compiler is not there to be used."""
    found = _compiler()
    if found == sysconfig.get_config_var("CC"):
        return
    found = found or f"{shlex.quote(sys.executable)} -m ziglang cc"
    os.environ.setdefault("CC", found)
    os.environ.setdefault("LDSHARED", f"{os.environ['CC']} -shared")
