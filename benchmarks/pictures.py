"""From pictures to points and to a pose, beside the time that it takes to read or copy them.

python benchmarks/pictures.py [--gray-code CAPTURE --pattern pattern.json --rig rig.json] [--rounds 7]

The colour grid is the capture that ships with `retrue demo`. Nothing else reads a colour grid, and OpenCV's decoder of
Gray codes (contrib) answers one pixel a call, so that the limits are what there is to compare with.
"""

from __future__ import annotations

import argparse
from importlib.resources import as_file, files
from pathlib import Path

import cv2
from side_by_side import Job, compare, print_machine

from retrue import decode, read_image, read_pattern, read_rig, recalibrate
from retrue.files.captures import read_capture
from retrue.files.images import read_folder


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--gray-code", type=Path, metavar="CAPTURE")
    parser.add_argument("--pattern", type=Path)
    parser.add_argument("--rig", type=Path)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    print_machine()
    with as_file(files("retrue") / "demo_data") as data:
        color_grid(data, options.rounds)
    if options.gray_code is not None:
        gray_code(options.gray_code, options.pattern, options.rig, options.rounds)


def color_grid(data: Path, rounds: int) -> None:
    path, rig = data / "scene.jpg", read_rig(data / "rig_before.json")
    pattern, picture = read_pattern(data / "pattern.json"), read_image(data / "scene.jpg")
    points = decode(pattern, picture)
    jobs: dict[str, Job] = {
        "retrue, file to pose": lambda: recalibrate(rig, [read_capture(path, pattern)]),
        "  decoding alone": lambda: decode(pattern, picture),
        f"  pose of its {len(points)} points": lambda: recalibrate(rig, [points]),
        "limit: read the file": lambda: cv2.imread(str(path)),
        "limit: copy the picture": lambda: picture.copy(),
    }
    height, width = picture.shape[:2]
    compare(f"colour grid, {width} x {height}", jobs, rounds)


def gray_code(capture: Path, pattern_file: Path, rig_file: Path, rounds: int) -> None:
    pattern, rig = read_pattern(pattern_file), read_rig(rig_file)
    pictures, paths = read_folder(capture)
    points = decode(pattern, pictures)
    jobs: dict[str, Job] = {
        "retrue, files to pose": lambda: recalibrate(rig, [read_capture(capture, pattern)]),
        "  decoding alone": lambda: decode(pattern, pictures),
        f"  pose of its {len(points)} points": lambda: recalibrate(rig, [points]),
        "limit: read the files": lambda: [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths],
        "limit: copy the pictures": lambda: [picture.copy() for picture in pictures],
    }
    height, width = pictures[0].shape[:2]
    compare(f"Gray code, {len(pictures)} pictures of {width} x {height}", jobs, rounds)


if __name__ == "__main__":
    main()
