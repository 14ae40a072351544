"""`import retrue` is quick because heavy libraries wait until they are needed."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import retrue

HEAVY = {"cv2", "scipy", "numba", "matplotlib", "tyro"}


def modules_after(code: str) -> set[str]:
    lines = f"{code}\nimport sys\nprint(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", lines], capture_output=True, text=True, check=True)
    return {name.partition(".")[0] for name in done.stdout.split()}


@pytest.mark.parametrize("code", ["import retrue", "import retrue\nfor name in dir(retrue): getattr(retrue, name)"])
def test_heavy_libraries_are_not_imported(code: str) -> None:
    loaded = modules_after(code)
    assert "retrue" in loaded
    assert not HEAVY & loaded


def test_help_loads_no_heavy_library() -> None:
    code = "from retrue.cli.main import main\ntry: main(['--help'])\nexcept SystemExit: pass"
    assert not (HEAVY - {"tyro"} | {"numpy"}) & modules_after(code)


def test_public_names_are_sorted_and_all_there() -> None:
    names = dir(retrue)
    assert names == sorted(set(names))
    for name in names:
        assert getattr(retrue, name).__name__ == name


def test_type_checkers_see_the_same_names() -> None:
    tree = ast.parse(Path(retrue.__file__).read_text(encoding="utf-8"))
    (block,) = [node for node in tree.body if isinstance(node, ast.If)]
    seen = {
        alias.asname: node.module for node in block.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert seen == {name: getattr(retrue, name).__module__ for name in dir(retrue)}


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'recalibrat'"):
        _ = retrue.recalibrat
