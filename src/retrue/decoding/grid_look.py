"""One look at a picture, from a given distance: find, link, name, place, measure."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from retrue.decoding.grid_blocks import Blocks, find_blocks
from retrue.decoding.grid_centres import refine_centres
from retrue.decoding.grid_colors import separate_colors
from retrue.decoding.grid_growth import Grown, cut_blocks, grow
from retrue.decoding.grid_islands import place_islands
from retrue.decoding.grid_links import NONE, Links, link_blocks
from retrue.decoding.grid_sight import GridSight, Verdict
from retrue.decoding.grid_surface import Joints, in_squares, slopes, sound_joints, whole_blocks
from retrue.decoding.grid_windows import (
    SIGNIFICANCE,
    Code,
    code_of,
    joined_places,
    neighbours_colors,
    patch_evidence,
    place_blocks,
    surface_evidence,
)
from retrue.geometry.arrays import BoolArray, FloatArray, Image, IntArray
from retrue.patterns.color_grid import ColorGrid

SURROUNDED = 5  # agreeing neighbours of eight, from which on a block's own colour need not be beyond doubt
LEAST_AGREEING = 3  # of all other blocks, which may also have one neighbour whose colour is clearly another
CLEAR_MARGIN = 0.3  # of a colour beyond doubt


def look(pattern: ColorGrid, picture: Image, halvings: int) -> GridSight:
    """What `picture` (h, w, 3), halved so many times, shows of `pattern`; centres are measured in full size."""
    scale = 2**halvings
    blocks = find_blocks(_eight_bits(_halved(picture, halvings)))
    links = link_blocks(blocks)
    colors, label, margin = separate_colors(blocks.color, links.around, pattern.colors)
    code = code_of(pattern)
    place = place_blocks(code, links, label)
    right = label == code.color(place)

    verdict, holder = _hold_places(code, links, label, place)
    clear = margin > CLEAR_MARGIN
    agreeing, contradicting = neighbours_colors(code, links, label, clear, place)
    sure = (agreeing >= SURROUNDED) | ((agreeing >= LEAST_AGREEING) & (contradicting < 2) & right & clear)
    holder = np.where(held_by(holder, sure, False), holder, NONE)
    holder, joints = _on_surfaces(code, blocks, links, place, right, holder)

    coarse = (held_by(holder, blocks.centre, np.nan) + 0.5) * scale - 0.5
    duty = pattern.block / pattern.pitch
    centres = refine_centres(picture, coarse, joints, duty)
    def grown(position: FloatArray, joints: Joints, amounts: FloatArray, fresh: BoolArray) -> Grown:
        cut = cut_blocks(picture, position, joints, duty) & fresh
        gone = np.where(cut[..., None], np.nan, position)
        held = np.isfinite(gone[..., 0])
        return grow(picture, gone, joints.between(held), amounts, held & fresh, colors, code.cells, duty)

    held = np.isfinite(centres.camera_px[..., 0])
    amounts = held_by(np.where(held, holder, NONE), colors.amounts(blocks.color), np.nan)
    surfaces = grown(centres.camera_px, joints.between(held), amounts, held)
    position = (surfaces.position + 0.5) / scale - 0.5
    left = _free_blobs(blocks, position, surfaces.joints)
    island = place_islands(code, blocks, links, label, clear, left, position, surfaces.joints)
    if (island >= 0).any():
        place = np.where(island >= 0, island, place)
        right = label == code.color(place)
        row, column, _ = code.split(island[island >= 0])
        more = np.full_like(holder, NONE)
        more[row, column] = np.flatnonzero(island >= 0)
        position = held_by(more, blocks.centre, np.nan)
        more_joints = sound_joints(position, joined_places(links, island, more))
        keep = in_squares(more_joints) & whole_blocks(held_by(more, blocks.shape, np.nan), position, more_joints)
        more = np.where(keep, more, NONE)
        more_joints = more_joints.between(keep)
        coarse = (held_by(more, blocks.centre, np.nan) + 0.5) * scale - 0.5
        extra = refine_centres(picture, coarse, more_joints, duty)
        there = np.isfinite(extra.camera_px[..., 0])
        holder = np.where(there, more, holder)
        amounts = np.where(there[..., None], held_by(more, colors.amounts(blocks.color), np.nan), surfaces.amounts)
        both = np.where(there[..., None], extra.camera_px, surfaces.position)
        more_joints = more_joints.between(there)
        all_joints = Joints(surfaces.joints.right | more_joints.right, surfaces.joints.down | more_joints.down)
        surfaces = grown(both, all_joints, amounts, there)
    centres.camera_px[:] = surfaces.position
    centres.sigma_px[np.isnan(centres.sigma_px) & np.isfinite(surfaces.position[..., 0])] = 0.3
    lost = np.setdiff1d(np.flatnonzero(verdict == Verdict.DECODED), holder[np.isfinite(centres.camera_px[..., 0])])
    verdict[lost] = Verdict.OFF_SURFACE
    return GridSight(
        pattern=pattern,
        picture=picture,
        halvings=halvings,
        blocks=blocks,
        links=links,
        label=label,
        place=place,
        verdict=verdict,
        holder=holder,
        centre_px=centres.camera_px,
        sigma_px=centres.sigma_px,
        confidence=held_by(holder, np.where(right, 0.5 + 0.5 * margin, 0.5 * (1 - margin)), 0.0),
        color=held_by(holder, np.clip(blocks.color, 0, 255).astype(np.uint8), 0),
    )


def _free_blobs(blocks: Blocks, position: FloatArray, joints: Joints) -> BoolArray:
    """(N,) blobs that are off all blocks at `position` by half a pitch."""
    from scipy.spatial import KDTree

    u, v, _ = slopes(position, joints)
    pitch = np.minimum(np.linalg.norm(u, axis=-1), np.linalg.norm(v, axis=-1))
    held = np.isfinite(pitch)
    if not held.any():
        return np.ones(len(blocks), dtype=bool)
    distance, nearest = KDTree(position[held]).query(blocks.centre)
    return distance > 0.5 * pitch[held][nearest]


def held_by(holder: IntArray, values: NDArray[Any], fill: float) -> NDArray[Any]:
    """`values` (N, ...) of the blob that holds each place (rows, columns), `fill` where none does."""
    held = holder >= 0
    result = np.full((*holder.shape, *values.shape[1:]), fill, dtype=values.dtype)
    result[held] = values[holder[held]]
    return result


def _hold_places(code: Code, links: Links, label: IntArray, place: IntArray) -> tuple[IntArray, IntArray]:
    """A verdict (N,) on each blob so far, and the blob that holds each place (rows, columns), or -1.

    Of two blobs in one place, the one on the surer surface holds it.
    """
    nats = surface_evidence(code, links, label, place)
    verdict = np.full(len(place), int(Verdict.DECODED))
    verdict[~(nats > SIGNIFICANCE)] = Verdict.TOO_FEW
    verdict[place < 0] = Verdict.NO_PLACE
    verdict[(links.neighbour < 0).all(axis=1)] = Verdict.ALONE
    index = np.flatnonzero(verdict == Verdict.DECODED)
    index = index[np.argsort(nats[index], kind="stable")]
    row, column, _ = code.split(place[index])
    holder = np.full((code.rows, code.columns), NONE)
    holder[row, column] = index
    verdict[index[holder[row, column] != index]] = Verdict.DOUBLED
    return verdict, holder


def _on_surfaces(
    code: Code, blocks: Blocks, links: Links, place: IntArray, right: BoolArray, holder: IntArray
) -> tuple[IntArray, Joints]:
    """`holder` without the blocks whose size, or distance from their neighbours, is not their surface's; and joints."""
    joints = joined_places(links, place, holder)
    for _ in range(2):
        position = held_by(holder, blocks.centre, np.nan)
        joints = sound_joints(position, joined_places(links, place, holder))
        keep = in_squares(joints) & whole_blocks(held_by(holder, blocks.shape, np.nan), position, joints)
        keep &= patch_evidence(code, joints, keep, held_by(holder, right, False)) > SIGNIFICANCE
        holder = np.where(keep, holder, NONE)
    return holder, joints.between(holder >= 0)


def _halved(picture: Image, halvings: int) -> Image:
    scale = 2**halvings
    h, w = picture.shape[0] // scale, picture.shape[1] // scale
    if not halvings:
        return picture
    return np.asarray(cv2.resize(picture[: h * scale, : w * scale], (w, h), interpolation=cv2.INTER_AREA))


def _eight_bits(picture: Image) -> NDArray[np.uint8]:
    if picture.dtype == np.uint8:
        return picture
    brightest = max(float(np.percentile(picture[::4, ::4], 99.9)), 1.0)
    return np.asarray(cv2.convertScaleAbs(picture, alpha=255.0 / brightest), dtype=np.uint8)
