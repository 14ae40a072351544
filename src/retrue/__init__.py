"""Recalibrate a camera-projector rig from one picture, and know how sure the answer is.

The public names stand in `__init__.pyi`, where type checkers and editors look for them. The same lines tell here where
each name lives; it is imported when it is first asked for, so that `import retrue` is quick.
"""


def _homes() -> dict[str, str]:
    """The module of each public name, from lines such as `from retrue.rig import Rig as Rig`."""
    from pathlib import Path

    lines = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8").splitlines()
    return {words[3]: words[1] for words in map(str.split, lines) if words[:1] == ["from"]}


def __getattr__(name: str) -> object:
    from importlib import import_module

    if name.startswith("_") or name not in (homes := _homes()):
        raise AttributeError(f"module 'retrue' has no attribute {name!r}")
    value = getattr(import_module(homes[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(_homes())
