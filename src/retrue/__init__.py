"""Recalibrate a camera-projector rig from one picture, and know how sure the answer is."""

from retrue.correspondences import Correspondences
from retrue.decoding.decode import decode
from retrue.errors import RetrueError
from retrue.files.captures import read_capture
from retrue.files.images import read_image, write_image
from retrue.files.patterns import read_pattern, write_pattern
from retrue.files.ply import write_cloud, write_mesh
from retrue.files.points import read_points, write_points
from retrue.files.rigs import read_rig, write_rig
from retrue.geometry.camera import Camera
from retrue.geometry.homography import fit_homography
from retrue.geometry.planar_pose import PlanarPose, planar_pose_candidates
from retrue.geometry.plane import Plane
from retrue.geometry.transform import RigidTransform
from retrue.geometry.triangulation import triangulate
from retrue.patterns.color_grid import ColorGrid
from retrue.patterns.gray_code import GrayCode
from retrue.recalibration.options import KnownDistance, RecalibrateOptions
from retrue.recalibration.recalibrate import recalibrate
from retrue.recalibration.result import Accepted, Evidence, Refused, Verification
from retrue.recalibration.verify import verify
from retrue.reconstruction.cloud import Cloud, Mesh
from retrue.reconstruction.mesh import make_mesh
from retrue.reconstruction.options import ReconstructOptions
from retrue.reconstruction.reconstruct import reconstruct
from retrue.rig import Rig

__all__ = [
    "Accepted",
    "Camera",
    "Cloud",
    "ColorGrid",
    "Correspondences",
    "Evidence",
    "GrayCode",
    "KnownDistance",
    "Mesh",
    "PlanarPose",
    "Plane",
    "RecalibrateOptions",
    "ReconstructOptions",
    "Refused",
    "RetrueError",
    "Rig",
    "RigidTransform",
    "Verification",
    "decode",
    "fit_homography",
    "make_mesh",
    "planar_pose_candidates",
    "read_capture",
    "read_image",
    "read_pattern",
    "read_points",
    "read_rig",
    "recalibrate",
    "reconstruct",
    "triangulate",
    "verify",
    "write_cloud",
    "write_image",
    "write_mesh",
    "write_pattern",
    "write_points",
    "write_rig",
]
