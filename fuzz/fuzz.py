"""Coverage-guided fuzzing of one reader; needs `pip install atheris`.

python fuzz/fuzz.py TARGET [libFuzzer option...]
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import atheris

os.environ["OPENCV_LOG_LEVEL"] = "OFF"

with atheris.instrument_imports(include=["retrue"]):
    from targets import TARGETS


def main(name: str, options: list[str]) -> None:
    """Does not return: libFuzzer ends the process, with status 0 where nothing was found."""
    target = TARGETS[name]
    with tempfile.TemporaryDirectory() as folder:
        for number, seed in enumerate(target.seeds):
            (Path(folder) / str(number)).write_bytes(seed)
        corpus = os.environ.get("CORPUS", folder)
        atheris.Setup([sys.argv[0], corpus, folder, "-timeout=10", "-rss_limit_mb=2048", *options], target)
        atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
