"""Depth maps: 16-bit PNG or 32-bit float TIFF, and beside it a JSON of the camera that they belong to.

PNG    whole levels of `depth_scale` a metre, 1000 unless told otherwise, which is what Open3D, nerfstudio and the
       makers of depth cameras expect; 0 where nothing was measured
TIFF   the rig's unit, NaN where nothing was measured

The JSON names what stands in the picture, and holds the camera twice: as ours, and by the keys of Open3D's
PinholeCameraIntrinsic.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from retrue.errors import FileError, InputError, require_kind, require_path
from retrue.files.atomic import replaced_file
from retrue.geometry.arrays import FloatArray
from retrue.geometry.camera import Camera
from retrue.ranges import require_number
from retrue.units import metres_per

ENDINGS = (".png", ".tif", ".tiff")
DEPTH_SCALE = 1000.0  # levels a metre
MOST_LEVELS = 65535


def require_depth_ending(path: str | Path, unit: str) -> None:
    """What `write_depth_map` would refuse, before there is a map."""
    ending = Path(path).suffix.lower()
    if ending not in ENDINGS:
        raise FileError(path, f"expected a depth map that ends in {', '.join(ENDINGS)}, found {ending or 'no ending'}")
    if ending == ".png":
        metres_per(unit)


def write_depth_map(
    path: str | Path, depth: FloatArray, camera: Camera, unit: str, depth_scale: float = DEPTH_SCALE
) -> Path:
    """Write `depth` (h, w), as `depth_map` makes it, and the JSON of its camera, whose path is returned.

    Raises
    ------
    FileError : another ending, or depths beyond what 16 bits hold at that scale.
    InputError : `depth` is not of the camera's size; or PNG, which is in metres, and a unit of unknown length.
    """
    import cv2

    path = require_path(path, "write_depth_map(path, depth, camera, unit)")
    require_depth_ending(path, unit)
    require_kind(depth, np.ndarray, "depth", "retrue.depth_map makes one")
    require_kind(camera, Camera, "camera", "retrue.read_device reads one")
    require_number(depth_scale, "depth_scale", 0, above=True)
    if depth.shape != camera.size[::-1]:
        raise InputError(
            f"depth: expected shape {camera.size[1]} x {camera.size[0]}, found {' x '.join(map(str, depth.shape))}"
        )
    description: dict[str, Any] = {"format": "retrue-depth", "version": 1, "picture": path.name}
    if path.suffix.lower() == ".png":
        picture = _levels(path, depth * metres_per(unit) * depth_scale)
        description |= {"levels_per_metre": depth_scale, "nothing": 0}
    else:
        picture = depth.astype(np.float32)
        description |= {"unit": unit, "nothing": "nan"}
    K, distortion = camera.K, camera.distortion
    description["camera"] = {"size": list(camera.size), "K": K.tolist(), "distortion": distortion.tolist()}
    description |= {"width": camera.size[0], "height": camera.size[1], "intrinsic_matrix": K.T.ravel().tolist()}
    _, content = cv2.imencode(path.suffix.lower(), picture)
    with replaced_file(path) as stream:
        stream.write(content.tobytes())
    beside = path.with_name(f"{path.name}.json")
    with replaced_file(beside) as stream:
        stream.write(json.dumps(description, indent=1, allow_nan=False).encode("ascii"))
    return beside


def _levels(path: Path, levels: FloatArray) -> Any:
    whole = np.round(np.nan_to_num(levels))
    if not whole.max(initial=0.0) <= MOST_LEVELS:
        raise FileError(
            path,
            f"expected depths of at most {MOST_LEVELS} levels, found {whole.max():.0f}: "
            "too far for 16 bits at this scale; write .tiff",
        )
    return whole.astype(np.uint16)
