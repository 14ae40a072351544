"""Peak memory of the colour-grid decoder, over the bytes of the picture, at several picture sizes (Linux).

    python benchmarks/color_grid_memory.py [PICTURE PATTERN]

Each size runs in a process of its own, which decodes a small picture first, so that libraries and machine code are
loaded; counted is what it takes above that, the picture included.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
from color_grid_renders import RENDERS, read, read_grid

from retrue.decoding.blocks.decode_color_grid import decode_color_grid
from retrue.geometry.arrays import Image
from retrue.patterns.color_grid import ColorGrid

WIDTHS = (640, 1280, 2048, 4096)


def main(picture: Path, pattern: Path) -> None:
    print(f"{'width':>6} {'points':>6} {'picture MiB':>11} {'peak MiB':>8} {'ratio':>6}")
    for width in WIDTHS:
        command = [sys.executable, __file__, str(picture), str(pattern), str(width)]
        print(subprocess.run(command, check=True, capture_output=True, text=True).stdout, end="", flush=True)


def measure(image: Image, grid: ColorGrid) -> str:
    decode_color_grid(grid, np.ascontiguousarray(image[:120, :160]))
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew
    before = memory("VmRSS")
    image = image.copy()
    points = decode_color_grid(grid, image)
    peak, own = memory("VmHWM") - before, image.nbytes / 2**20
    return f"{image.shape[1]:6} {len(points):6} {own:11.1f} {peak:8.1f} {peak / own:6.1f}"


def memory(field: str) -> float:
    """MiB of this process."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(field))


if __name__ == "__main__":
    if len(sys.argv) == 4:
        shot = read(Path(sys.argv[1]))
        scale = int(sys.argv[3]) / shot.shape[1]
        resized = cv2.resize(
            shot, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        )
        print(measure(np.asarray(resized, dtype=np.uint8), read_grid(Path(sys.argv[2]))))
    elif len(sys.argv) == 3:
        main(Path(sys.argv[1]), Path(sys.argv[2]))
    else:
        main(RENDERS / "wall_objects_0.png", RENDERS / "pattern.json")
