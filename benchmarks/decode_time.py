"""How long a sequence takes to decode, beside reading its files: by processor time and by the clock.

    python -m benchmarks.decode_time LAYOUT WIDTHxHEIGHT FOLDER [REPEATS]

LAYOUT is gray-code, or one of the layouts of sequences, of a projector of that size. Reading is `imread` of OpenCV, of
each file as grey, one after the other. In turn with it: `read_folder`, which reads with two threads, and decoding what
it read; minima of the repeats. Then processes of their own, that only read, or read and decode: their processor time,
less that of one that imports the same and does neither.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2

from retrue.decoding.sequence.decode_sequence import decode_sequence
from retrue.files.images import picture_paths, read_folder
from retrue.patterns.gray_code import GrayCode
from retrue.patterns.layouts import layout_sequence
from retrue.patterns.sequence import FrameSequence

NOTHING = "import cv2, sys, retrue, retrue.decoding.sequence.decode_sequence; from pathlib import Path; "
READING = NOTHING + "[cv2.imread(p, cv2.IMREAD_GRAYSCALE) for p in sys.argv[3:]]"
DECODING = NOTHING + (
    "from benchmarks.decode_time import pattern_of; "
    "retrue.read_capture(Path(sys.argv[3]).parent, pattern_of(*sys.argv[1:3]))"
)


def main(layout: str, size: str, folder: Path, repeats: int) -> None:
    pattern = pattern_of(layout, size)
    paths = picture_paths(folder)
    images, names = read_folder(folder)[0], [path.name for path in paths]
    work: dict[str, Callable[[], object]] = {
        "imread": lambda: [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths],
        "read_folder": lambda: read_folder(folder),
        "decode": lambda: decode_sequence(pattern, images, names),
    }
    least = dict.fromkeys(work, (float("inf"), float("inf")))
    for _ in range(repeats):
        for name, run in work.items():
            least[name] = _least(least[name], _timed(run))
    processor, clock = least["imread"]
    print(f"{folder.name}, {len(paths)} pictures: imread {processor:.3f} s of processor, {clock:.3f} of clock")
    for name in ("read_folder", "decode"):
        own = least[name]
        print(f"  {name}: {own[0] / processor:.2f} of its processor time, {own[1] / clock:.2f} of its clock")
    words = [layout, size, *map(str, paths)]
    nothing, reading, decoding = (
        min(_processor_time(script, words) for _ in range(repeats)) for script in (NOTHING, READING, DECODING)
    )
    share = (decoding - reading) / (reading - nothing)
    print(f"  as processes: reading {reading - nothing:.2f} s; what decoding takes beyond it, {share:.2f} of that")


def pattern_of(layout: str, size: str) -> GrayCode | FrameSequence:
    """Of that name and a projector of so many pixels, 1024x768."""
    width, height = map(int, size.split("x"))
    return GrayCode((width, height)) if layout == "gray-code" else layout_sequence(layout, (width, height))


def _timed(run: Callable[[], object]) -> tuple[float, float]:
    processor, clock = time.process_time(), time.perf_counter()
    run()
    return time.process_time() - processor, time.perf_counter() - clock


def _least(first: tuple[float, float], second: tuple[float, float]) -> tuple[float, float]:
    return min(first[0], second[0]), min(first[1], second[1])


def _processor_time(script: str, words: list[str]) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", script, *words], check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], Path(sys.argv[3]), int(sys.argv[4]) if len(sys.argv) > 4 else 5)
