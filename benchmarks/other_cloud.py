"""Beside another tool's cloud of the same scene: SLStudio's of a skull, made with its own calibration.

    python -m benchmarks.other_cloud FOLDER

FOLDER holds `skull_2x3`, `skull_gray`, `skull_gray_cloud.mat` and `calibration.xml`. Medians, in the rig's unit, of the
distance of our points to the nearest of its, and to the plane through the 16 nearest; of how far apart its points lie,
which is what the former still is where ours lie on that plane; and the other way round. Then the same of the pixels
alone that bits read, too, as its cloud was made of bits, and how far noise is foretold to move these along their rays.
Its projector's lens is left out in the last rows, as that tool left it out of this cloud. First, what bits and phase
shift read in the same pixels, whose scene is one.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.spatial import cKDTree

import retrue
from retrue.geometry.arrays import FloatArray
from retrue.patterns.layouts import layout_sequence

AROUND = 16


def main(folder: Path) -> None:
    theirs = np.asarray(loadmat(str(folder / "skull_gray_cloud.mat"))["xyz"], dtype=np.float64).reshape(-1, 3)
    theirs = theirs[np.isfinite(theirs).all(axis=1)]
    rig = retrue.read_rig(folder / "calibration.xml", camera_size=(1688, 1352), projector_size=(1824, 1140), unit="mm")
    bare = replace(rig, projector=replace(rig.projector, distortion=np.zeros(5)))
    bits, sines = (
        retrue.read_capture(folder / name, layout_sequence(layout, rig.projector.size))
        for name, layout in (("skull_gray", "slstudio-gray"), ("skull_2x3", "slstudio-2x3"))
    )
    by_bits = _pixels(bits.camera_px)
    _, here, there = np.intersect1d(by_bits, _pixels(sines.camera_px), return_indices=True)
    off = np.abs(bits.projector_px[here, 0] - sines.projector_px[there, 0])
    print(
        f"{len(off)} pixels read by both: {np.median(off):.2f} px apart (median), {np.sum(off > 4)} by more than 4 px"
    )
    for lens, own in (("with the projector's lens", rig), ("without it", bare)):
        for name, points, smooth in (("bits", bits, False), ("sines", sines, False), ("smoothed", sines, True)):
            cloud = retrue.reconstruct(own, points, retrue.ReconstructOptions(smooth=smooth))
            assert cloud.sigma is not None
            ours, shared = cloud.points, np.isin(_pixels(cloud.camera_px), by_bits)
            nearest, surface, apart = _beside(ours, theirs)
            back, back_surface, _ = _beside(theirs, ours)
            print(
                f"{name:10} {lens}: {len(ours)} of {len(points)} points, to the nearest of {len(theirs)} {nearest:.3f}"
                f", to their surface {surface:.3f}, these apart {apart:.3f}; theirs to ours {back:.3f}, to our surface "
                f"{back_surface:.3f}; where bits read {_beside(ours[shared], theirs)[0]:.3f}, noise "
                f"{np.median(cloud.sigma[shared]):.3f}",
                flush=True,
            )


def _pixels(camera_px: FloatArray) -> FloatArray:
    return camera_px @ np.array([1.0, 1e6])


def _beside(points: FloatArray, others: FloatArray) -> tuple[float, float, float]:
    """Medians: to the nearest of the others, to the plane through those around, and from there to the nearest."""
    tree = cKDTree(others)
    distance, rows = tree.query(points, k=AROUND)
    around = others[rows]
    middle = around.mean(axis=1)
    normal = np.linalg.eigh(np.einsum("nki,nkj->nij", around - middle[:, None], around - middle[:, None]))[1][:, :, 0]
    off = np.sum((points - middle) * normal, axis=1)
    left, _ = tree.query(points - off[:, None] * normal)
    return float(np.median(distance[:, 0])), float(np.median(np.abs(off))), float(np.median(left))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
