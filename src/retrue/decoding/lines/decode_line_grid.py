"""One colour picture of a line grid -> correspondences of the crossings of its lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.correspondences import Card, Correspondences
from retrue.decoding.light import around, saturated
from retrue.decoding.lines.decode_stripes import decode_stripes
from retrue.decoding.lines.look import look
from retrue.decoding.lines.sight import LineSight, advise
from retrue.decoding.pictures import coverage, rgb, scene_light, seen_colors
from retrue.errors import InputError
from retrue.geometry.arrays import Image
from retrue.patterns.line_grid import LineGrid

FIRST_SIDE = 800  # px: larger pictures are first looked at from further away
SMALL_PITCH = 6.0  # px: lines closer than this are looked at again in a finer picture, if there is one
LARGE_PITCH = 16.0  # px: lines further apart than this are looked at again in a coarser picture
FEW = 0.02  # of the code's crossings: less than that decoded, and coarser pictures are tried too


def decode_line_grid(
    pattern: LineGrid, image: Image, black: Image | None = None, white: Image | None = None
) -> Correspondences:
    """Crossings of the lines of `pattern` in one colour picture; empty, with advice, where there is no such grid.

    Of a pattern of stripes, columns or rows alone: points along them, of one coordinate.

    Parameters
    ----------
    pattern : columns, rows or both.
    image : (h, w, 3) red, green, blue, uint8 or uint16.
    black, white : the same view with the projector dark, and all white; not needed, but they remove the
        room's light and the paint of the scene.

    Returns
    -------
    Correspondences
        one point a crossing; `cells` are (row, column) of the code, `light` what the column adds there, of one class
        for each colour. The card counts crossings, and tells the distance between lines, `pitch_px`.

    Raises
    ------
    InputError
        where `image` is no picture at all, or the other two are not of its size.
    """
    if pattern.columns is None or pattern.rows is None:
        points = decode_stripes(pattern, scene_light(image, black, white), rgb(image, "image"))
    else:
        points = correspondences_of(inspect_line_grid(pattern, image, black, white), rgb(image, "image"))
    return points if white is None else replace(points, colors=seen_colors(white, points.camera_px, "white"))


def inspect_line_grid(
    pattern: LineGrid, image: Image, black: Image | None = None, white: Image | None = None
) -> LineSight:
    """All that the decoder sees on its way: crossings, places, surfaces."""
    columns, rows = pattern.columns, pattern.rows
    if columns is None or rows is None:
        raise InputError("line grid: expected columns and rows, found lines of one direction, which do not cross")
    picture = scene_light(image, black, white)
    halvings = 0
    while max(picture.shape[:2]) / 2**halvings > FIRST_SIDE:
        halvings += 1
    best = look(pattern, columns, rows, picture, halvings)
    while halvings > 0 and best.pitch_px < SMALL_PITCH * 2**best.halvings:
        halvings -= 1
        best = max(look(pattern, columns, rows, picture, halvings), best, key=_decoded)
    coarser = best.halvings
    few = FEW * len(columns.sequence) * len(rows.sequence)
    while min(picture.shape[:2]) / 2 ** (coarser + 1) > 64:
        if not (best.decoded < few or best.pitch_px > LARGE_PITCH * 2**coarser):
            break
        coarser += 1
        best = max(best, look(pattern, columns, rows, picture, coarser), key=_decoded)
    return best


def correspondences_of(sight: LineSight, image: Image) -> Correspondences:
    """The points of a sight, its card, and the light of its columns, NaN where `image` is saturated."""
    columns, rows = sight.pattern.columns, sight.pattern.rows
    assert columns is not None
    assert rows is not None
    cells = np.argwhere(sight.surfaces.held)
    row, column = cells[:, 0], cells[:, 1]
    camera_px = sight.surfaces.position[row, column]
    lights = sight.surfaces.lights[:, row, column]
    height, width = sight.picture.shape[:2]
    rejected = sight.rejected()
    card = Card(
        "crossings",
        seen=len(cells) + sum(rejected.values()),
        decoded=len(cells),
        rejected=rejected,
        coverage=round(coverage(camera_px, width, height), 3),
        advice=tuple(filter(None, [advise(sight)])),
        details={"pitch_px": round(sight.pitch_px, 1)},
    )
    seen = around(image, camera_px)
    full = saturated(seen.reshape(-1, 3)).reshape(-1, 9).any(axis=1)
    return Correspondences(
        camera_px,
        np.stack([columns.middles()[column], rows.middles()[row]], axis=-1),
        camera_sigma_px=sight.sigma_px[row, column],
        confidence=np.clip(sight.surfaces.likeness[row, column], 0.0, 1.0),
        colors=np.clip(lights.sum(axis=0), 0, 255).astype(np.uint8),
        cells=cells,
        card=card,
        light=np.where(full, np.nan, np.maximum(lights[0], 0.0).sum(axis=-1)),
        light_class=np.array(columns.sequence)[column],
        camera_size=(width, height),
        projector_size=sight.pattern.projector_size,
    )


def _decoded(sight: LineSight) -> int:
    return sight.decoded
