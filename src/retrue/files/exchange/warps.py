"""A warp as other programs take it: an ST map, a warp mesh, and the warped picture itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from retrue.errors import FileError, require_kind, require_path
from retrue.files.atomic import replaced_file
from retrue.geometry.arrays import Image, require_picture
from retrue.ranges import require_number
from retrue.reconstruction.warp import Warp

NOT_DRAWN = -1.0  # brightness of a node that shows nothing


def write_st_map(path: str | Path, warp: Warp) -> None:
    """A TIFF of 32-bit floats, red s, green t from the bottom, blue 1 where the pixel shows the picture, else 0.

    What compositing programs call an ST map, or UV map; s and t are those of `Warp`, 0 where blue is.

    Raises
    ------
    FileError : the name does not end in .tif or .tiff, or it cannot be written.
    """
    import cv2

    path = require_path(path, "write_st_map(path, warp)")
    require_kind(warp, Warp, "warp", "retrue.warp makes one")
    if path.suffix.lower() not in (".tif", ".tiff"):
        raise FileError(path, f"expected an ST map that ends in .tif or .tiff, found {path.suffix or 'no ending'}")
    shown = np.isfinite(warp.st[..., :1])
    red_green_blue = np.concatenate([np.nan_to_num(warp.st), shown], axis=-1).astype(np.float32)
    _, content = cv2.imencode(".tiff", np.ascontiguousarray(red_green_blue[..., ::-1]))
    with replaced_file(path) as stream:
        stream.write(content.tobytes())


def write_warp_mesh(path: str | Path, warp: Warp, every: int = 16) -> None:
    """A text mesh of a node every so many projector pixels: 2, then columns and rows, then x y u v brightness a node.

    x runs over plus or minus the aspect ratio of the projector's picture and y over -1 to 1, upwards; u and v are s and
    t; a brightness of -1 is not drawn. Rows run from the bottom. Source: P. Bourke,
    "Data format for warping mesh files".
    """
    path = require_path(path, "write_warp_mesh(path, warp)")
    require_kind(warp, Warp, "warp", "retrue.warp makes one")
    height, width = warp.st.shape[:2]
    require_number(every, "every", 1, min(width, height) - 1, whole=True)
    columns = np.unique([*range(0, width, every), width - 1])
    rows = np.unique([*range(0, height, every), height - 1])[::-1]
    x = ((columns + 0.5) / width * 2 - 1) * width / height
    y = 1 - (rows + 0.5) / height * 2
    nodes = np.zeros((len(rows), len(columns), 5))
    nodes[..., 0], nodes[..., 1] = x, y[:, None]
    nodes[..., 2:4] = warp.st[np.ix_(rows, columns)]
    nodes[..., 4] = np.where(np.isnan(nodes[..., 2]), NOT_DRAWN, 1.0)
    table = np.nan_to_num(nodes).reshape(-1, 5).tolist()
    lines = ["2", f"{len(columns)} {len(rows)}", *(" ".join(f"{value:.7g}" for value in node) for node in table)]
    with replaced_file(path) as stream:
        stream.write(("\n".join(lines) + "\n").encode("ascii"))


def warped_picture(warp: Warp, picture: Image) -> Image:
    """What the projector must show, (h, w) or (h, w, 3) as the picture; black where it shows nothing.

    Where the picture is finer than the projector's pixels, it is averaged over them first.
    """
    import cv2

    require_kind(warp, Warp, "warp", "retrue.warp makes one")
    require_picture(picture, "picture")
    height, width = picture.shape[:2]
    per_pixel = np.nanmedian(np.abs(np.diff(warp.st[..., 0], axis=1))) * width
    if per_pixel > 1.5:  # pixels of the picture for one of the projector
        picture = cv2.resize(picture, None, fx=1 / per_pixel, fy=1 / per_pixel, interpolation=cv2.INTER_AREA)
        height, width = picture.shape[:2]
    x = (warp.st[..., 0] * width - 0.5).astype(np.float32)
    y = ((1 - warp.st[..., 1]) * height - 0.5).astype(np.float32)
    shown = cv2.remap(picture, np.nan_to_num(x), np.nan_to_num(y), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    shown[np.isnan(x)] = 0
    return shown
