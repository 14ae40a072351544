"""From a rig and matched pixels to a cloud of points."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrue.correspondences import Correspondences, require_points
from retrue.errors import DegenerateError, InputError, require_kind
from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.camera import Camera
from retrue.geometry.robust import MAD_TO_SIGMA
from retrue.geometry.triangulation import sampson_distances, triangulate
from retrue.rasters import check_rasters
from retrue.reconstruction.albedo import albedo
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.error_by_distance import common_sigma
from retrue.reconstruction.noise import point_noise, stated_sigmas
from retrue.reconstruction.one_coordinate import completed_projector_px
from retrue.reconstruction.options import ReconstructOptions
from retrue.reconstruction.pieces import find_strays
from retrue.reconstruction.quantised import between_readings, quantisation_px
from retrue.reconstruction.rim import find_rim
from retrue.reconstruction.smooth import smoothed
from retrue.reconstruction.surface_grid import SurfaceGrid, surface_grid
from retrue.reconstruction.uncertainty import Uncertainty
from retrue.rig import Rig, require_baseline, require_rig
from retrue.rig_evidence import unstated

FEW = 500  # points that tell what all have in common
FINEST_RESIDUAL_PX = 0.01  # rays that pass each other by less than this are no outliers, whatever the rest do


def reconstruct(rig: Rig, points: Correspondences, options: ReconstructOptions | None = None) -> Cloud:
    """The cloud (N, 3) that a capture shows, in the camera frame and the rig's unit.

    Undistort both pixels, correct the rays by the least that makes them meet, intersect. Points whose rays
    pass each other by far more than the others' do, or meet behind a device or nowhere, are left out and
    counted in `Cloud.card`; so are strays, on no surface that the capture's grid shows (`find_strays`), and
    pixels and blocks at an edge that see two surfaces (`find_rim`). An error ALONG the epipolar line moves a
    point in depth: it cannot be seen but by the neighbours in such a grid.
    Where one projector coordinate is known, the camera's ray meets the plane of that column or row, and what lies
    beyond the projector's picture is left out; no residual checks such points. Whole projector pixels, as of tools that
    do not read finer, are noticed, and put between their neighbours within half a pixel (`Cloud.card["quantised_px"]`).

    Each point has its own `sigma`, measured on the capture itself; `Cloud.covariance` adds what the rig makes all
    err by together. The card has the median of the one, the RMS of the other, both along the camera's ray, and names
    what the rig's evidence says nothing of, so that it is `taken_for_exact`. Asked for, noise is evened out over the
    grid, never over an edge (`smoothed`).

    Raises
    ------
    CaptureError : points of other rasters than the rig's: `check_rasters`.
    DegenerateError : the rig's devices coincide (t = 0), or no point remains.
    InputError : points without a grid are to be smoothed; an albedo is asked for of points without colours or without
        a grid.

    >>> from retrue import Camera, RigidTransform
    >>> camera = Camera((640, 480), [[500, 0, 320], [0, 500, 240], [0, 0, 1]])
    >>> rig = Rig(camera, camera, RigidTransform(np.eye(3), [-100.0, 0, 0]), unit="mm")
    >>> cloud = reconstruct(rig, Correspondences([[320, 240], [420, 240]], [[220, 240], [370, 240]]))
    >>> cloud.points.round(6).tolist()
    [[0.0, 0.0, 500.0], [200.0, 0.0, 1000.0]]
    """
    require_rig(rig)
    require_points(points)
    check_rasters(rig, points)
    options = ReconstructOptions() if options is None else options
    require_kind(options, ReconstructOptions, "options")
    require_baseline(rig)
    steps = quantisation_px(points)
    if any(steps):
        points = replace(points, projector_px=between_readings(points, steps))
    checked = len(points.axes) == 2
    projector_px = points.projector_px if checked else completed_projector_px(rig, points)
    camera_rays, projector_rays, sigmas = _rays(rig, points.camera_px, projector_px)
    residual_px = sampson_distances(rig.projector_from_camera, camera_rays, projector_rays, **sigmas)
    outlier = _outliers(residual_px, options.outlier_sigmas)
    X = triangulate(rig.projector_from_camera, camera_rays, projector_rays, **sigmas)
    in_front = np.isfinite(X).all(axis=1)
    kept = in_front & ~outlier
    if not kept.any():
        raise DegenerateError(
            f"reconstruction: none of {len(points)} points lies in front of both devices: is this the capture's rig?"
        )
    card: dict[str, Any] = {
        "correspondences": len(points),
        "points": int(kept.sum()),
        "dropped_epipolar_outliers": int(outlier.sum()),
        "dropped_behind_or_at_infinity": int((~in_front & ~outlier).sum()),
        "epipolar_rms_px": float(np.sqrt(np.mean(residual_px[kept] ** 2))) if checked else None,
    }
    if any(steps):
        card["quantised_px"] = list(steps)
    cells = None if points.cells is None else points.cells[kept]
    cloud = Cloud(X[kept], _colors(points)[kept], points.camera_px[kept], rig.unit, cells, card)
    grid = None if cells is None else surface_grid(cloud.points, cells)
    points = points.select(kept)
    cloud = _with_sigma(cloud, rig, points, residual_px[kept], grid)
    cut = np.zeros(len(cloud), dtype=np.bool_)
    if cells is not None and cloud.sigma is not None:
        grid = surface_grid(cloud.points, cells, cloud.sigma)
        cloud, cut = _with_rim(cloud, points, grid)
    if not (options.keep_strays or grid is None):
        cloud, on_surface = _without_strays(cloud, grid, cut)
        points = points.select(on_surface)
    if options.smooth:
        cloud = smoothed(cloud)
    return _with_albedo(cloud, rig, points) if options.albedo else cloud


def _with_sigma(
    cloud: Cloud, rig: Rig, points: Correspondences, residual_px: FloatArray, grid: SurfaceGrid | None
) -> Cloud:
    """The cloud with how sure each point is, where that can be told."""
    noise = point_noise(rig, points, cloud.points, residual_px, grid)
    if noise is None:
        return cloud
    known = Uncertainty(rig, points.axes, *noise, points.projector_sigma_ratio)
    return _known(cloud, known, known.along_rays(cloud.points))


def _known(cloud: Cloud, known: Uncertainty, sigma: FloatArray) -> Cloud:
    few = np.arange(0, len(cloud), max(1, len(cloud) // FEW))
    card = {
        **cloud.card,
        "sigma": float(np.nanmedian(sigma)) if np.isfinite(sigma).any() else None,
        "common_sigma": common_sigma(known.select(few), cloud.points[few]),
        "taken_for_exact": list(unstated(known.rig)),
    }
    return replace(cloud, sigma=sigma, uncertainty=known, card=card)


def _with_rim(cloud: Cloud, points: Correspondences, grid: SurfaceGrid) -> tuple[Cloud, BoolArray]:
    """The cloud with what points beside jumps err more, and which (N,) lie between two surfaces."""
    assert cloud.sigma is not None
    assert cloud.uncertainty is not None
    rim = find_rim(cloud.points, points.camera_px, np.hypot(*stated_sigmas(points)), cloud.sigma, grid)
    return _known(cloud, cloud.uncertainty.scaled(rim.level), cloud.sigma * rim.level), rim.cut


def _with_albedo(cloud: Cloud, rig: Rig, points: Correspondences) -> Cloud:
    if cloud.cells is None or points.colors is None:
        raise InputError("albedo: expected coloured points of a capture with a grid, whose neighbours tell normals")
    grid = surface_grid(cloud.points, cloud.cells)
    return replace(cloud, colors=albedo(rig, points, cloud.points, cloud.sigma, grid))


def _without_strays(cloud: Cloud, grid: SurfaceGrid, cut: BoolArray) -> tuple[Cloud, BoolArray]:
    """The cloud without points that lie on no surface; all of it where the grid shows no surface at all. And which."""
    strays = find_strays(grid, len(cloud))
    cut = cut & ~(strays.alone | strays.islands)
    kept = ~(strays.alone | strays.islands | cut)
    if not kept.any():
        return cloud, np.ones(len(cloud), dtype=np.bool_)
    card = {
        **cloud.card,
        "points": int(kept.sum()),
        "dropped_alone": int(strays.alone.sum()),
        "dropped_in_islands": int(strays.islands.sum()),
        "dropped_at_edges": int(cut.sum()),
    }
    return replace(cloud.select(kept), card=card), kept


def set_aside(rig: Rig, points: Correspondences, cloud: Cloud) -> Cloud:
    """The points in front of both devices that `cloud`, made of the same, was made without; possibly none."""
    everything = reconstruct(rig, points, ReconstructOptions(outlier_sigmas=1e12, keep_strays=True))
    kept = {tuple(pixel) for pixel in cloud.camera_px.tolist()}
    return everything.select(np.array([tuple(pixel) not in kept for pixel in everything.camera_px.tolist()], np.bool_))


def epipolar_residuals(rig: Rig, points: Correspondences) -> FloatArray:
    """Signed distance (N,) in pixels by which each point's two rays miss each other, Sampson's approximation.

    NaN where one projector coordinate only is known.
    """
    require_rig(rig)
    require_points(points)
    camera_rays, projector_rays, sigmas = _rays(rig, points.camera_px, points.projector_px)
    return sampson_distances(rig.projector_from_camera, camera_rays, projector_rays, **sigmas)


def _rays(rig: Rig, camera_px: FloatArray, projector_px: FloatArray) -> tuple[FloatArray, FloatArray, dict[str, float]]:
    """Undistorted rays of both devices, and the sigma of one pixel on them."""
    sigmas = {"camera_sigma": _ray_sigma(rig.camera), "projector_sigma": _ray_sigma(rig.projector)}
    return rig.camera.unproject(camera_px), rig.projector.unproject(projector_px), sigmas


def _ray_sigma(camera: Camera) -> float:
    """Sigma on normalised rays of one pixel of noise: one over the mean focal length."""
    return float(1 / np.sqrt(camera.K[0, 0] * camera.K[1, 1]))


def _outliers(residual: FloatArray, sigmas: float) -> BoolArray:
    """Residuals beyond so many robust sigmas; NaN (a pixel outside the lens model) is left to the depth test."""
    size = np.abs(residual)
    finite = size[np.isfinite(size)]
    typical = MAD_TO_SIGMA * float(np.median(finite)) if len(finite) else 0.0
    return size > max(sigmas * typical, FINEST_RESIDUAL_PX)


def _colors(points: Correspondences) -> NDArray[np.uint8]:
    if points.colors is None:
        return np.full((len(points), 3), 128, dtype=np.uint8)
    return points.colors
