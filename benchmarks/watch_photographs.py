"""A rig of two cameras that warms up, and is bumped: `retrue watch --stereo` and `retrue history --watched`, whole.

    python -m benchmarks.watch_photographs --frames 150 --seed 0 [--keep DIR]

Photographs are rendered into two folders, named by the time at which each camera took them, some milliseconds apart; a
side file tells the temperature. The rig turns with it, most of all about the axis that points know worst. Now and then
a frame of one camera is lost, or cut short. At one frame the rig is bumped by half a degree. Told are: how each frame
was judged; which rigs were written, as of what, and how far they are off; and the track of the whole record against
the truth, in degrees and in its own sigma, axis by axis.
"""

from __future__ import annotations

import argparse
import collections
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from retrue import Camera, Rig, RigidTransform, read_rig, write_png, write_rig
from retrue.recalibration.axes import NAMES, axes_between
from retrue.simulation.photographs import photograph, textured_scene

LEFT = Camera((320, 240), [[300, 0, 159.5], [0, 300, 119.5], [0, 0, 1]], [-0.1, 0.02, 0, 0, 0])
RIGHT = Camera((300, 260), [[330, 0, 150], [0, 330, 131], [0, 0, 1]], [-0.08, 0.02, 0, 0, 0])
RIG = Rig(LEFT, RIGHT, RigidTransform.from_rotation_vector([0.02, -0.06, 0.03], [-150.0, 4, 6]), unit="mm")
COLD, WARM, WARMING = 20.0, 38.0, 40  # degrees, and frames in which the difference falls to 1 / e
CREEP_DEG = np.array([0.03, 0.25, -0.04])  # at the end of it
BUMP_DEG, SCENES, SKEW_MS, LOST, CUT = 0.5, 6, 4, 29, 37
FIRST_MS, STEP_MS = 1_764_230_400_000, 60_000


def pose_at(frame: int, bump: int, bumped: np.ndarray) -> tuple[RigidTransform, float]:
    """Where the second camera is, and the temperature."""
    share = 1 - np.exp(-frame / WARMING)
    turn = np.radians(CREEP_DEG * share + (bumped if frame >= bump else 0.0))
    pose = RigidTransform.from_rotation_vector(turn, np.zeros(3)) @ RIG.projector_from_camera
    return pose, COLD + (WARM - COLD) * share


def photographs(folder: Path, frames: int, seed: int) -> tuple[list[RigidTransform], int]:
    """Write them all; the true poses, and the frame of the bump."""
    random, bump = np.random.default_rng(seed), 2 * frames // 3
    bumped = random.normal(0, 1, 3)
    bumped *= BUMP_DEG / np.linalg.norm(bumped)
    scenes = [textured_scene(RIG, 1200.0, seed=10 * seed + number) for number in range(SCENES)]
    poses = []
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
    for frame in range(frames):
        pose, warm = pose_at(frame, bump, bumped)
        poses.append(pose)
        rig = replace(RIG, projector_from_camera=pose)
        pair = photograph(rig, scenes[frame % SCENES], supersample=1, seed=2 * frame + 1000 * seed)
        stamp = FIRST_MS + STEP_MS * frame
        right = folder / "right" / f"{stamp + int(random.integers(-SKEW_MS, SKEW_MS + 1))}.png"
        left = folder / "left" / f"{stamp}.png"
        write_png(left, pair.left)
        left.with_suffix(".json").write_text(json.dumps({"temperature": round(warm + random.normal(0, 0.05), 2)}))
        if frame % LOST != LOST - 1:
            write_png(right, pair.right)
        if frame % CUT == CUT - 1 and right.exists():
            right.write_bytes(right.read_bytes()[:2000])
    return poses, bump


def retrue(*words: object) -> list[dict]:
    """The lines that a command prints."""
    command = [sys.executable, "-c", "from retrue.cli.main import main; raise SystemExit(main())"]
    run = subprocess.run([*command, *map(str, words), "--json"], capture_output=True, text=True, check=False)
    if run.returncode:
        raise SystemExit(run.stderr)
    return [json.loads(line) for line in run.stdout.splitlines()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=150)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = asked.keep or Path(temporary)
        poses, bump = photographs(folder / "in", asked.frames, asked.seed)
        write_rig(folder / "rig.json", RIG)
        began = time.perf_counter()
        quick = ("--settle-seconds", 0.01, "--patience-seconds", 0.1, "--poll-seconds", 0.01, "--idle-seconds", 2)
        told = retrue(
            "watch", folder / "rig.json", folder / "in", "--stereo", "--out", folder / "out", "--lens", "fixed", *quick
        )
        seconds = time.perf_counter() - began
        plot = ("--watched", folder / "out", "--plot", folder / "track.png")
        (found,) = retrue("history", folder / "rig.json", *plot)
        print(f"{asked.frames} frames in {seconds:.0f} s, the bump at {bump}")
        events = [event for event in told if event["event"] in ("frame", "bad frame")]
        print(dict(collections.Counter(event.get("verdict", "bad") for event in events)))
        for event in told:
            if event["event"] in ("recalibrated", "refused"):
                number = frame_of(event["frames"][-1]) if "frames" in event else "?"
                print(f"{event['event']} at frame {number}: {event['kind']}; {event['reason']}")
        last = axes_between(poses[-1], read_rig(folder / "rig.json").projector_from_camera, np.eye(5))
        print("the rig in place is off by", [round(one.moved_deg, 4) for one in last], "deg")
        watched = found["watched"]
        numbers = [frame_of(item["name"]) for item in watched["frames"]]
        true = [axes_between(RIG.projector_from_camera, poses[number], np.eye(5)) for number in numbers]
        off = np.array([item["moved_deg"] for item in watched["frames"]])
        off -= np.array([[one.moved_deg for one in axes] for axes in true])
        sigma = np.array([item["sigma_deg"] for item in watched["frames"]])
        alone = np.array([axis_errors(event, poses) for event in told if event.get("supported")])
        print("bumps of the record:", [frame_of(name) for name in watched["bumps"]])
        for axis, name in enumerate(NAMES):
            rms = np.sqrt(np.mean(off[:, axis] ** 2))
            print(
                f"{name:<42} track {rms:.4f} deg, over sigma {np.sqrt(np.mean((off / sigma)[:, axis] ** 2)):.2f}; "
                f"each frame by itself {np.sqrt(np.mean(alone[:, axis] ** 2)):.4f} deg"
            )


def axis_errors(event: dict, poses: list[RigidTransform]) -> list[float]:
    """(5,) of the pose that a frame supports by itself."""
    pose = RigidTransform(event["supported"]["R"], event["supported"]["t"])
    return [one.moved_deg for one in axes_between(poses[frame_of(event["name"])], pose, np.eye(5))]


def frame_of(name: str) -> int:
    """Its number: the left photograph's time stamp tells it."""
    stamp = int(name.partition(",")[0].partition(".")[0])
    return round((stamp - FIRST_MS) / STEP_MS)


if __name__ == "__main__":
    main()
