"""Holes in a surface, closed where one smooth patch explains all that surrounds them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from retrue.errors import InputError
from retrue.geometry.arrays import BoolArray, FloatArray, IntArray
from retrue.reconstruction.cloud import Cloud, require_cloud
from retrue.reconstruction.pieces import grown, linked_pieces, masked_pieces
from retrue.reconstruction.surface_grid import SurfaceGrid, surface_grid

RIM = 2  # cells around a hole that tell how the surface runs
FEWEST_RIM = 8  # points of the rim; six determine the patch


def fill_holes(cloud: Cloud) -> Cloud:
    """The cloud with points in the cells that are missing inside of a surface; `Cloud.card` says how many.

    A hole is filled where it is enclosed by ONE piece of surface, and where a quadric of inverse depth over the
    cells follows its rim as closely as neighbours on a surface follow each other. So what shadows leave between
    two surfaces stays open. The points filled in are invented: they have the rim's mean colour.

    Raises
    ------
    InputError : the points have no grid.
    """
    require_cloud(cloud)
    if cloud.cells is None:
        raise InputError("fill_holes: expected points of a capture with a grid, found scattered ones; decode a picture")
    grid = surface_grid(cloud.points, cloud.cells)
    piece = _piece_of_each_cell(grid, len(cloud))
    holes, boxes = masked_pieces(grid.index < 0)
    open_to_outside = np.unique(np.concatenate([holes[0], holes[-1], holes[:, 0], holes[:, -1]]))
    origin = cloud.cells.min(axis=0)
    patches: list[Cloud] = []
    for number, box in enumerate(boxes, start=1):
        if number not in open_to_outside:
            window = _widened(box, grid.index.shape)
            patch = _patch(cloud, grid, piece, holes[window] == number, window, origin)
            patches += [] if patch is None else [patch]
    enclosed = len(boxes) - len(open_to_outside[open_to_outside > 0])
    card = {
        **cloud.card,
        "points": len(cloud) + sum(map(len, patches)),
        "holes_filled": len(patches),
        "holes_left_open": enclosed - len(patches),
        "points_filled_in": sum(map(len, patches)),
    }
    return replace(_joined([cloud, *patches]), card=card, **_unknown_of_new(cloud, sum(map(len, patches))))


def _unknown_of_new(cloud: Cloud, new: int) -> dict[str, Any]:
    """How sure the points are, with NaN for as many more that nobody measured."""
    nothing = np.full(new, np.nan)
    known = cloud.uncertainty
    if known is not None:
        camera, projector = (np.append(column, nothing) for column in (known.camera_sigma_px, known.projector_sigma_px))
        ratio = None if known.projector_sigma_ratio is None else np.append(known.projector_sigma_ratio, nothing)
        known = replace(known, camera_sigma_px=camera, projector_sigma_px=projector, projector_sigma_ratio=ratio)
    return {"sigma": None if cloud.sigma is None else np.append(cloud.sigma, nothing), "uncertainty": known}


def _piece_of_each_cell(grid: SurfaceGrid, count: int) -> IntArray:
    """(H, W) number of the piece of surface, -1 for none."""
    piece = linked_pieces(*grid.links(), count)
    return np.where(grid.index >= 0, piece[grid.index], -1)


def _patch(
    cloud: Cloud,
    grid: SurfaceGrid,
    piece: IntArray,
    hole: BoolArray,
    window: tuple[slice, slice],
    origin: IntArray,
) -> Cloud | None:
    """The points that fill one hole, or None where its rim is not one smooth surface."""
    beside = grown(hole, RIM) & ~hole & (grid.index[window] >= 0)
    if beside.sum() < FEWEST_RIM or len(np.unique(piece[window][beside])) > 1:
        return None
    rim, limit = grid.index[window][beside], grid.limit[window][beside]
    points = cloud.points[rim]
    known = np.column_stack([points[:, :2] / points[:, 2:], 1 / points[:, 2], cloud.camera_px[rim]])
    terms, wanted = _quadric_terms(beside, hole)
    coefficients, _, rank, _ = np.linalg.lstsq(terms, known, rcond=None)
    off = terms @ coefficients[:, 2] - known[:, 2]
    filled = wanted @ coefficients
    if rank < terms.shape[1] or not np.mean(off**2) <= np.median(limit) ** 2 or not (filled[:, 2] > 0).all():
        return None
    w = filled[:, 2:3]
    corner = np.array([window[0].start, window[1].start])
    color = np.asarray(cloud.colors[rim].mean(axis=0), dtype=np.float64).round()
    return Cloud(
        np.hstack([filled[:, :2], np.ones_like(w)]) / w,
        np.tile(color, (len(w), 1)).astype(np.uint8),
        filled[:, 3:],
        cloud.unit,
        np.argwhere(hole) + corner + origin,
    )


def _widened(box: tuple[slice, slice], shape: tuple[int, int]) -> tuple[slice, slice]:
    """The box with the rim around it."""
    rows, columns = (
        slice(max(0, side.start - RIM), min(length, side.stop + RIM)) for side, length in zip(box, shape, strict=True)
    )
    return rows, columns


def _quadric_terms(beside: BoolArray, hole: BoolArray) -> tuple[FloatArray, FloatArray]:
    """1, r, c, r^2, r c, c^2 of the cells beside a hole and in it, r and c about the middle in sizes of the window."""
    half = np.array(hole.shape) / 2
    rows: list[FloatArray] = []
    for mask in (beside, hole):
        r, c = ((np.argwhere(mask) - half) / half).T
        rows.append(np.column_stack([np.ones_like(r), r, c, r * r, r * c, c * c]))
    return rows[0], rows[1]


def _joined(clouds: list[Cloud]) -> Cloud:
    """One cloud of several; without normals."""
    points, colors, camera_px, cells = (
        np.concatenate([getattr(cloud, name) for cloud in clouds])
        for name in ("points", "colors", "camera_px", "cells")
    )
    return Cloud(points, colors, camera_px, clouds[0].unit, cells)
