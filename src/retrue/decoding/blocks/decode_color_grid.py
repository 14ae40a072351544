"""One colour picture of a colour grid -> correspondences of block centres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retrue.correspondences import Card, Correspondences
from retrue.decoding.blocks.look import look
from retrue.decoding.blocks.sight import GOOD_COUNT, MIRRORED, NOT_THIS, GridSight, advise
from retrue.decoding.blocks.true_colors import true_colors
from retrue.decoding.light import around, saturated
from retrue.decoding.pictures import coverage, rgb, scene_light
from retrue.geometry.arrays import Image
from retrue.patterns.color_grid import ColorGrid

FIRST_SIDE = 800  # px: larger pictures are first looked at from further away
SMALL_BLOCK = 4.5  # px: blocks below this are looked at again in a finer picture, if there is one
LARGE_BLOCK = 13.0  # px: blocks above this are looked at again in a coarser picture
FEW_BLOCKS = 0.02  # of the code: less than that decoded, and coarser pictures are tried too


def decode_color_grid(
    pattern: ColorGrid, image: Image, black: Image | None = None, white: Image | None = None
) -> Correspondences:
    """Block centres of `pattern` in one colour picture; empty, with advice, where there is no such grid.

    Parameters
    ----------
    pattern : any colour grid, wherever it comes from.
    image : (h, w, 3) red, green, blue, uint8 or uint16.
    black, white : the same view with the projector dark, and all white; not needed, but they remove the
        room's light and the paint of the scene.

    Returns
    -------
    Correspondences
        one point a block: the image of its centre, and that centre in the projector; `cells` are (row, column)
        of the code, `colors` those of the scene (`true_colors`). The card counts blocks, and tells their side,
        `block_px`.

    Raises
    ------
    InputError
        where `image` is no picture at all, or the other two are not of its size.
    """
    points = correspondences_of(inspect_color_grid(pattern, image, black, white))
    if points.card is not None and NOT_THIS in points.card.advice and _is_mirrored(pattern, image, black, white):
        points = replace(points, card=replace(points.card, advice=(MIRRORED,)))
    row, column = np.asarray(points.cells).reshape(-1, 2).T
    places = np.full((len(pattern.code), len(pattern.code[0]), 2), np.nan)
    places[row, column] = points.camera_px
    colors = true_colors(pattern, places, image, black, white)[row, column]
    return _with_light(replace(points, colors=colors), image, black, white)


def inspect_color_grid(
    pattern: ColorGrid, image: Image, black: Image | None = None, white: Image | None = None
) -> GridSight:
    """All that the decoder sees on its way: blocks, links, colours, places, verdicts and centres."""
    picture = scene_light(image, black, white)
    halvings = 0
    while max(picture.shape[:2]) / 2**halvings > FIRST_SIDE:
        halvings += 1
    best = look(pattern, picture, halvings)
    while halvings > 0 and best.block_px < SMALL_BLOCK * 2**best.halvings:
        halvings -= 1
        best = max(look(pattern, picture, halvings), best, key=_decoded)
    coarser = best.halvings
    few = FEW_BLOCKS * len(pattern.code) * len(pattern.code[0])
    while min(picture.shape[:2]) / 2 ** (coarser + 1) > 64:
        if not (_decoded(best) < few or best.block_px > LARGE_BLOCK * 2**coarser):
            break
        coarser += 1
        best = max(best, look(pattern, picture, coarser), key=_decoded)
    return best


def _is_mirrored(pattern: ColorGrid, image: Image, black: Image | None, white: Image | None) -> bool:
    """Whether the picture decodes when it is turned over."""
    turned = [None if one is None else np.ascontiguousarray(one[:, ::-1]) for one in (image, black, white)]
    assert turned[0] is not None
    return _decoded(inspect_color_grid(pattern, turned[0], turned[1], turned[2])) >= GOOD_COUNT


def correspondences_of(sight: GridSight) -> Correspondences:
    """The points of a sight, its card, and the light of the blocks as the picture that was looked at has it."""
    cells = np.argwhere(np.isfinite(sight.centre_px).all(axis=-1))
    row, column = cells[:, 0], cells[:, 1]
    pattern = sight.pattern
    h, w = sight.picture.shape[:2]
    decoded, rejected = len(cells), sight.rejected()
    card = Card(
        "blocks",
        seen=decoded + sum(rejected.values()),
        decoded=decoded,
        rejected=rejected,
        coverage=round(coverage(sight.centre_px[row, column], w, h), 3),
        advice=tuple(filter(None, [advise(sight, decoded)])),
        details={"block_px": round(sight.block_px, 1)},
    )
    return Correspondences(
        sight.centre_px[row, column],
        pattern.centres()[row, column],
        camera_sigma_px=sight.sigma_px[row, column],
        confidence=sight.confidence[row, column],
        colors=sight.color[row, column],
        cells=cells,
        card=card,
        light=sight.light[row, column].sum(axis=-1),
        light_class=np.asarray(pattern.code)[row, column],
        camera_size=(w, h),
        projector_size=pattern.projector_size,
    )


def _with_light(points: Correspondences, image: Image, black: Image | None, white: Image | None) -> Correspondences:
    """`points` with the light that the projector adds, in its own unit, and NaN where a picture is saturated.

    A picture in white light divides out of the blocks what it shows itself: how bright each place is. So that is read
    from the white picture, less the black one; all blocks are of one class then. Without the black one it also holds
    the room's light. The white picture has the scene's true colours, too.
    """
    shown = image if white is None else white
    seen = around(rgb(shown, "image"), points.camera_px)
    light, light_class, colors = points.light, points.light_class, points.colors
    if white is not None:
        light = light_class = None
        colors = (seen.mean(axis=1) * (255 / np.iinfo(seen.dtype).max)).round().astype(np.uint8)
        if black is not None:
            dark = around(rgb(black, "black"), points.camera_px)
            light = (seen.astype(np.float64) - dark).mean(axis=(1, 2))
    if light is not None:
        light = np.where(saturated(seen.reshape(-1, 3)).reshape(-1, 9).any(axis=1), np.nan, light)
    return replace(points, light=light, light_class=light_class, colors=colors)


def _decoded(sight: GridSight) -> int:
    return int(np.isfinite(sight.centre_px[..., 0]).sum())
