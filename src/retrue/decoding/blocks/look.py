"""One look at a picture, from a given distance: find, link, name, place, measure, grow."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.decoding.blocks.blobs import Blocks, find_blocks
from retrue.decoding.blocks.centres import refine_centres
from retrue.decoding.blocks.colors import Colors, separate_colors
from retrue.decoding.blocks.growth import MISFIT, Surfaces, grow, look_again
from retrue.decoding.blocks.holders import held_by, hold_places, on_surfaces
from retrue.decoding.blocks.islands import place_islands
from retrue.decoding.blocks.links import NONE, Links, link_blocks
from retrue.decoding.blocks.places import Code, code_of, place_blocks
from retrue.decoding.blocks.rims import at_rims
from retrue.decoding.blocks.sight import GridSight, Verdict
from retrue.decoding.surface import Joints, lengths, median, noise_of, slopes
from retrue.geometry.arrays import FloatArray, Image, IntArray
from retrue.geometry.nearest import nearest
from retrue.patterns.color_grid import ColorGrid

CLEAR_MARGIN = 0.3  # of a colour beyond doubt
OWN_PLACE = 0.5  # pitches about a centre in which a blob is that block


def look(pattern: ColorGrid, picture: Image, halvings: int) -> GridSight:
    """What `picture` (h, w, 3), halved so many times, shows of `pattern`; centres are measured in full size."""
    small = _halved(picture, halvings)
    gain = _gain(small)
    blocks = find_blocks(_eight_bits(small, gain))
    links = link_blocks(blocks)
    colors, label, margin = separate_colors(blocks.color, links.around, pattern.colors)
    code, clear = code_of(pattern), margin > CLEAR_MARGIN
    place = place_blocks(code, links, label)
    verdict, holder, joints = hold_places(code, blocks, links, label, clear, place)

    table = _Table(picture, 2**halvings, gain, blocks, colors, code, pattern.block / pattern.pitch)
    surfaces = table.extended(_nothing(code), holder, joints)
    block, distance = table.nearest_blocks(surfaces)
    island = place_islands(
        code, blocks, links, label, clear, block < 0, table.scaled(surfaces.position), surfaces.joints
    )
    if (island >= 0).any():
        row, column, _ = code.split(island[island >= 0])
        holder = np.full_like(holder, NONE)
        holder[row, column] = np.flatnonzero(island >= 0)
        holder, joints = on_surfaces(blocks, links, island, holder)
        if (holder >= 0).any():
            surfaces = table.extended(surfaces, holder, joints)
            block, distance = table.nearest_blocks(surfaces)

    surfaces = at_rims(picture, surfaces, table.duty)
    holder = _nearest_blobs(code, block, distance)
    verdict[verdict == Verdict.DECODED] = Verdict.OFF_SURFACE
    verdict[holder[holder >= 0]] = Verdict.DECODED
    right = held_by(holder, label, NONE) == code.colors
    margin = held_by(holder, margin, 0.0)
    by_color = np.where(right, 0.5 + 0.5 * margin, 0.5 * (1 - margin))
    return GridSight(
        pattern=pattern,
        picture=picture,
        halvings=halvings,
        block_px=_block_px(blocks, links, verdict) * 2**halvings,
        blocks=blocks,
        links=links,
        label=label,
        verdict=verdict,
        holder=holder,
        centre_px=surfaces.position,
        sigma_px=_sigma(surfaces),
        confidence=np.where(np.isfinite(surfaces.misfit), 1 - 0.5 * surfaces.misfit / MISFIT, by_color),
        color=np.clip(np.nan_to_num(surfaces.light), 0, 255).astype(np.uint8),
        light=surfaces.light,
    )


def _sigma(surfaces: Surfaces) -> FloatArray:
    """(rows, columns) px: how the centres scatter, and their doubt, as far as that is more than the usual one, which
    the scatter holds already."""
    doubted = surfaces.doubt[surfaces.held]
    usual = median(doubted) if len(doubted) else 0.0
    more = np.sqrt(np.maximum(surfaces.doubt**2 - usual**2, 0.0))
    return np.hypot(noise_of(surfaces.position, surfaces.joints), more)


def _block_px(blocks: Blocks, links: Links, verdict: IntArray) -> float:
    """Median side of the decoded blocks, or of all blobs that have two neighbours; 0: none."""
    good = verdict == Verdict.DECODED
    if not good.any():
        good = (links.neighbour >= 0).sum(axis=1) >= 2
    return median(np.sqrt(12 * blocks.area()[good])) if good.any() else 0.0


def _nothing(code: Code) -> Surfaces:
    none = np.full((code.rows, code.columns, 3), np.nan)
    return Surfaces(none[..., :2], none, none[..., 0], none[..., 0], Joints.none(code.rows, code.columns))


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """A picture and its blobs, to measure with."""

    picture: Image
    scale: int
    gain: float
    blocks: Blocks
    colors: Colors
    code: Code
    duty: float

    def extended(self, surfaces: Surfaces, holder: IntArray, joints: Joints) -> Surfaces:
        """`surfaces`, and the blobs of `holder` on theirs, measured; those that are cut go, and all of it grows."""
        coarse = (held_by(holder, self.blocks.centre, np.nan) + 0.5) * self.scale - 0.5
        centres = refine_centres(self.picture, coarse, joints, self.duty)
        position = centres.camera_px
        there = np.isfinite(position[..., 0])
        cut, doubt = look_again(self.picture, position, joints.between(there), centres.unlike, self.duty)
        there &= ~cut
        joints = joints.between(there)
        new = there[..., None]
        together = Surfaces(
            np.where(new, position, surfaces.position),
            np.where(new, held_by(holder, self.blocks.color, np.nan), surfaces.light),
            np.where(there, np.hypot(centres.doubt_px, doubt), surfaces.doubt),
            surfaces.misfit,
            Joints(surfaces.joints.right | joints.right, surfaces.joints.down | joints.down),
        )
        return grow(self.picture, self.gain, together, there, self.colors, self.code.colors, self.duty)

    def scaled(self, position: FloatArray) -> FloatArray:
        """Pixels of the picture in those of the blobs."""
        return (position + 0.5) / self.scale - 0.5

    def nearest_blocks(self, surfaces: Surfaces) -> tuple[IntArray, FloatArray]:
        """Index (N,) in the code of the block that each blob is, or covers, or -1; and the distance of its centre."""
        position = self.scaled(surfaces.position)
        u, v = slopes(position, surfaces.joints)
        pitch = np.minimum(lengths(u), lengths(v)).ravel()
        known = np.flatnonzero(np.isfinite(pitch))
        if not len(known):
            return np.full(len(self.blocks), NONE), np.full(len(self.blocks), np.inf)
        distance, index = nearest(position.reshape(-1, 2)[known], self.blocks.centre)
        return np.where(distance < OWN_PLACE * pitch[known][index], known[index], NONE), distance


def _nearest_blobs(code: Code, block: IntArray, distance: FloatArray) -> IntArray:
    """Blob (rows, columns) nearest to each block, of those (N,) that are in its `block`, or -1."""
    order = np.argsort(-distance, kind="stable")
    order = order[block[order] >= 0]
    holder = np.full(code.colors.size, NONE)
    holder[block[order]] = order
    return holder.reshape(code.colors.shape)


def _halved(picture: Image, halvings: int) -> Image:
    scale = 2**halvings
    h, w = picture.shape[0] // scale, picture.shape[1] // scale
    if not halvings:
        return picture
    return np.asarray(cv2.resize(picture[: h * scale, : w * scale], (w, h), interpolation=cv2.INTER_AREA))


def _gain(picture: Image) -> float:
    """What grey levels of `picture` are multiplied with to be those of eight bits."""
    if picture.dtype == np.uint8:
        return 1.0
    return 255.0 / max(float(np.percentile(picture[::4, ::4], 99.9)), 1.0)


def _eight_bits(picture: Image, gain: float) -> NDArray[np.uint8]:
    if picture.dtype == np.uint8:
        return picture
    return np.asarray(cv2.convertScaleAbs(picture, alpha=gain), dtype=np.uint8)
