"""Makes the inputs of the quick start: a rig file from before a bump, and one picture from after it.

`python docs/try/make.py` writes `rig.json` and `wall.jpg` beside itself. The rig turned by 4 degrees in between.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

import retrue
from retrue.simulation.camera_model import CameraModel
from retrue.simulation.scene import Scene, render
from retrue.simulation.surfaces import Box, Paint, Sphere, Wall

HERE = Path(__file__).parent


def rig_before() -> retrue.Rig:
    """As it was calibrated."""
    camera = retrue.Camera((1280, 960), [[1510, 0, 634], [0, 1512, 487], [0, 0, 1]], [-0.09, 0.04, 0, 0, 0])
    projector = retrue.Camera((1024, 768), [[1320, 0, 508], [0, 1318, 392], [0, 0, 1]])
    pose = retrue.RigidTransform.from_rotation_vector([0.03, 0.27, 0.02], [-430.0, 40.0, 60.0])
    return retrue.Rig(camera, projector, pose, unit="mm")


def bumped(rig: retrue.Rig) -> retrue.Rig:
    """The same with its projector turned and pushed."""
    push = retrue.RigidTransform.from_rotation_vector(np.radians([1.5, -3.6, 0.8]), [0, 0, 0])
    pose = push @ rig.projector_from_camera
    return replace(rig, projector_from_camera=retrue.RigidTransform(pose.R, pose.t + np.array([2.0, 12.0, -9.0])))


def scene() -> Scene:
    """A wall, and before it a ball and a crate."""
    crate = retrue.RigidTransform.from_rotation_vector([0.05, 0.55, 0.0], [250.0, 130.0, 1340.0])
    return Scene(
        [
            Wall.facing(1600, [0.05, 0.16, 0.0], Paint((0.82, 0.8, 0.75), blob_size=240, contrast=0.12, seed=3)),
            Sphere(np.array([-170.0, 90.0, 1290.0]), 165, Paint((0.85, 0.6, 0.48), gloss=0.1)),
            Box(crate, (95, 120, 80), Paint((0.6, 0.7, 0.8))),
        ],
        ambient=(0.1, 0.1, 0.11),
    )


def main() -> None:
    """Write both files."""
    rig = rig_before()
    pattern = retrue.make_color_grid(rig.projector.size)
    camera = CameraModel(exposure=1.25, blur_px=0.7, vignetting=0.2, electrons=9000, read_noise=8, gamma=1.4)
    picture = render(bumped(rig), scene(), pattern.render(), camera).image
    Image.fromarray(picture).save(HERE / "wall.jpg", quality=88)
    retrue.write_rig(HERE / "rig.json", rig)


if __name__ == "__main__":
    main()
