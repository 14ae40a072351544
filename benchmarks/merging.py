"""Twelve views of a known object: how far from the truth, and how long it takes, beside Open3D's multiway registration.

    python -m benchmarks.merging [SEED] [--random] [--foreign] [--no-open3d]

Open3D as its tutorials have it: FPFH features, RANSAC, point-to-plane ICP for every pair of views, pose graph, global
optimisation. Its poses are measured on the same points as ours.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from retrue.geometry.transform import RigidTransform
from retrue.merging.merge import Merged, merge
from retrue.merging.view import usual_cell
from retrue.reconstruction.cloud import Cloud
from tests.merging.objects import HEIGHTS, off_surface, seen, turntable, view_pose

VIEWS = 12


def rms_of_poses(clouds: list[Cloud], poses: list[RigidTransform], found: dict[int, RigidTransform]) -> float:
    """Distance of all points from the true surface, in mm, with the first view where it truly is."""
    first = next(iter(found))
    off = [off_surface((poses[first].inverse() @ pose).apply(clouds[view].points)) for view, pose in found.items()]
    return float(np.sqrt(np.mean(np.concatenate(off) ** 2)))


def open3d_poses(clouds: list[Cloud]) -> dict[int, RigidTransform]:
    """object_from_view of each."""
    import open3d as o3d

    registration = o3d.pipelines.registration
    cell = usual_cell([cloud.points for cloud in clouds])
    thin, features = [], []
    for cloud in clouds:
        points = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.array(cloud.points))).voxel_down_sample(cell)
        points.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=2 * cell, max_nn=30))
        points.orient_normals_towards_camera_location()
        thin.append(points)
        near = o3d.geometry.KDTreeSearchParamHybrid(radius=5 * cell, max_nn=100)
        features.append(registration.compute_fpfh_feature(points, near))
    graph = registration.PoseGraph()
    odometry = np.eye(4)
    graph.nodes.append(registration.PoseGraphNode(odometry))
    for first in range(len(thin)):
        for second in range(first + 1, len(thin)):
            coarse = registration.registration_ransac_based_on_feature_matching(
                thin[first], thin[second], features[first], features[second], True, 1.5 * cell,
                registration.TransformationEstimationPointToPoint(False), 3,
                [registration.CorrespondenceCheckerBasedOnEdgeLength(0.9),
                 registration.CorrespondenceCheckerBasedOnDistance(1.5 * cell)],
                registration.RANSACConvergenceCriteria(100000, 0.999),
            )  # fmt: skip
            fine = coarse
            for reach in (4 * cell, cell):
                fine = registration.registration_icp(
                    thin[first], thin[second], reach, fine.transformation,
                    registration.TransformationEstimationPointToPlane(),
                )  # fmt: skip
            information = registration.get_information_matrix_from_point_clouds(
                thin[first], thin[second], cell, fine.transformation
            )
            if second == first + 1:
                odometry = fine.transformation @ odometry
                graph.nodes.append(registration.PoseGraphNode(np.linalg.inv(odometry)))
            elif fine.fitness < 0.25:
                continue
            uncertain = second != first + 1
            graph.edges.append(registration.PoseGraphEdge(first, second, fine.transformation, information, uncertain))
    option = registration.GlobalOptimizationOption(
        max_correspondence_distance=cell, edge_prune_threshold=0.25, reference_node=0
    )
    registration.global_optimization(
        graph, registration.GlobalOptimizationLevenbergMarquardt(),
        registration.GlobalOptimizationConvergenceCriteria(), option,
    )  # fmt: skip
    matrices = [np.array(node.pose) for node in graph.nodes]
    start = np.linalg.inv(matrices[0])
    return {view: RigidTransform((start @ pose)[:3, :3], (start @ pose)[:3, 3]) for view, pose in enumerate(matrices)}


def main() -> None:
    seed = next((int(word) for word in sys.argv[1:] if word.isdigit()), 0)
    clouds, poses = turntable(VIEWS, seed)
    if "--random" in sys.argv:
        order = np.random.default_rng(seed + 1).permutation(VIEWS)
        clouds, poses = [clouds[k] for k in order], [poses[k] for k in order]
    if "--foreign" in sys.argv:
        heights = np.random.default_rng(5).permutation(HEIGHTS)
        clouds.insert(5, seen(view_pose(0.3), np.random.default_rng(seed + 3), heights=heights))
        poses.insert(5, view_pose(0.3))
    true = {view: poses[0] @ pose.inverse() for view, pose in enumerate(poses)}
    print(f"true poses        RMS {rms_of_poses(clouds[:5], poses, dict(list(true.items())[:5])):.4f} mm: noise alone")
    start = time.perf_counter()
    merged = merge(clouds)
    seconds = time.perf_counter() - start
    assert isinstance(merged, Merged), merged
    first = next(iter(merged.poses))
    off = off_surface(poses[first].inverse().apply(merged.cloud.points))
    print(f"retrue poses      RMS {rms_of_poses(clouds, poses, merged.poses):.4f} mm, {seconds:.1f} s")
    print(f"retrue surface    RMS {np.sqrt(np.mean(off**2)):.4f} mm")
    print(merged)
    if "--no-open3d" not in sys.argv:
        start = time.perf_counter()
        found = open3d_poses(clouds)
        print(f"Open3D poses      RMS {rms_of_poses(clouds, poses, found):.4f} mm, {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
