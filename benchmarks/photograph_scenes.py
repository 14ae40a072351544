"""Is sigma true, and is a scene without a plane answered? Simulated pairs of cameras whose lenses are known so well.

    python -m benchmarks.photograph_scenes --pairs 120 --seed 0

A garden has no plane: each match lies at a depth of its own about shrubs and a lawn that is none, some behind the
others, some moved by wind between the photographs. A room has walls, a floor and boxes. The lenses err as the rig's
file says, each pair of cameras by a draw of its own, and the pose that counts is the true one. Of each scene: how many
answers; error over sigma, RMS; the mean normalised error squared over five, 1 where sigma is honest; and, of five
photographs of one rig at other places, whether each two agree within three sigma of what their points tell.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from benchmarks.photograph_matches import depths
from retrue import Camera, Correspondences, Rig, RigidTransform, recalibrate
from retrue.correspondences import Card
from retrue.geometry.transform import vector_from_rotation
from retrue.geometry.two_view import tangent_basis

FOCAL, CENTRE_PX, K1 = 1e-3, 0.5, 5e-4
PHOTOGRAPHS = 5
SIZE = (1280, 960)


def garden(rays: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """(N,) depths of rays (N, 2): shrubs, each a cloud of leaves, before a lawn with waves and far trees."""
    lawn = 1.5 / np.maximum(rays[:, 1] + 0.05 * random.standard_normal(len(rays)), 0.06)
    depth = np.minimum(lawn, random.uniform(15, 40)) * np.exp(random.normal(0, 0.05, len(rays)))
    for _ in range(random.integers(4, 10)):
        centre, width = random.uniform([-0.6, -0.4], [0.6, 0.3]), random.uniform(0.1, 0.3)
        leaves = (np.linalg.norm(rays - centre, axis=1) < width) & (random.random(len(rays)) < 0.8)
        nearer = random.uniform(2, 12) * (1 + random.normal(0, 0.08, len(rays)))
        depth = np.where(leaves & (nearer < depth), nearer, depth)
    return depth


def rigs(random: np.random.Generator) -> tuple[Rig, Rig]:
    """As it is; and as its file has it: with the lenses' errors, their covariance, and an old pose."""
    f = random.uniform(700, 1300, 2)
    K = [[[g, 0, 639.5], [0, g, 479.5], [0, 0, 1]] for g in f]
    bend = random.uniform(-0.3, 0.1, 2)
    devices = [Camera(SIZE, k, [k1, 0.02, 0, 0, 0]) for k, k1 in zip(K, bend, strict=True)]
    pose = RigidTransform.from_rotation_vector(random.normal(0, 0.04, 3), [-0.3, *random.normal(0, 0.02, 2)])
    true = Rig(devices[0], devices[1], pose)
    sigmas = np.array([FOCAL, CENTRE_PX, CENTRE_PX, K1])
    stated = []
    for device in devices:
        error = random.normal(0, sigmas)
        wrong = device.K.copy()
        wrong[:2, :2] *= np.exp(error[0])
        wrong[:2, 2] += error[1:3]
        stated.append(Camera(SIZE, wrong, [device.distortion[0] + error[3], *device.distortion[1:]]))
    moved = RigidTransform.from_rotation_vector(np.radians(random.normal(0, 1, 3)), [0, 0, 0]) @ pose
    evidence = {"lens_covariance": np.diag(np.tile(sigmas**2, 2)).tolist()}
    return true, Rig(stated[0], stated[1], moved, evidence=evidence)


def photographs(rig: Rig, scene: str, random: np.random.Generator) -> Correspondences:
    """What a matcher gives of one pair."""
    pixels = random.uniform([8, 8], [1272, 952], (int(random.integers(300, 900)), 2))
    rays = rig.camera.unproject(pixels)
    depth = garden(rays, random) if scene == "garden" else depths(rays, random, random.uniform(2, 8))[0]
    points = np.column_stack([rays, np.ones(len(rays))]) * depth[:, None]
    if scene == "garden":
        windy = random.random(len(points)) < 0.2
        points[windy] += random.normal(0, 0.01, (int(windy.sum()), 3))
    seen = rig.projector.project(rig.projector_from_camera.apply(points))
    wrong = random.random(len(seen)) < random.uniform(0, 0.1)
    seen[wrong] = random.uniform([0, 0], SIZE, (int(wrong.sum()), 2))
    sigma = np.exp(random.normal(np.log(0.12), 0.4, len(seen)))
    seen = seen + random.normal(0, 1, seen.shape) * sigma[:, None]
    kept = np.isfinite(seen).all(axis=1) & rig.projector.contains(np.nan_to_num(seen, nan=-9.0))
    each = sigma[kept] / np.sqrt(2)
    card = Card("features", len(kept), len(each), {}, 1.0)
    return Correspondences(pixels[kept], seen[kept], each, each, card=card, camera_size=SIZE, projector_size=SIZE)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    for scene in ("room", "garden"):
        began, answered, relative, honest, agree = time.process_time(), 0, [], [], []
        for number in range(asked.pairs // PHOTOGRAPHS):
            random = np.random.default_rng([asked.seed, number, scene == "garden"])
            true, rig = rigs(random)
            found = [recalibrate(rig, [photographs(true, scene, random)]) for _ in range(PHOTOGRAPHS)]
            answered += sum(one.verdict != "refused" for one in found)
            told = [one.evidence for one in found if one.verdict != "refused"]
            errors = []
            for one in told:
                unit = true.projector_from_camera.t / np.linalg.norm(true.projector_from_camera.t)
                new = one.pose.t / np.linalg.norm(one.pose.t)
                turned = vector_from_rotation(one.pose.R @ true.projector_from_camera.R.T)
                error = np.concatenate([turned, tangent_basis(new).T @ (new - unit)])
                covariance = np.array(one.details["covariance"])
                errors.append(error)
                parts = [np.linalg.norm(error[:3]), np.linalg.norm(error[3:])]
                relative.append(np.degrees(parts) / [one.sigma.rotation_deg, one.sigma.translation_deg])
                honest.append(error @ np.linalg.solve(covariance, error) / len(error))
            for i in range(len(told)):
                for j in range(i):
                    between = np.linalg.norm(errors[i][:3] - errors[j][:3])
                    known = [np.trace(np.array(told[k].details["covariance"])[:3, :3]) for k in (i, j)]
                    agree.append(between < 3 * np.sqrt(sum(known)))
        ratio = np.sqrt(np.mean(np.square(relative), axis=0))
        print(
            f"{scene}: {answered} of {asked.pairs} accepted, error over sigma {ratio[0]:.2f} rotation, {ratio[1]:.2f} "
            f"direction of t, normalised error squared {np.mean(honest):.2f} (median {np.median(honest):.2f}), "
            f"{np.mean(agree):.1%} of {len(agree)} agree within 3 sigma, {time.process_time() - began:.0f} s"
        )


if __name__ == "__main__":
    main()
