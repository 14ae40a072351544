"""Recalibrate a camera-projector rig from one picture, and know how sure the answer is."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from retrue.cad.make_cad import make_cad as make_cad
    from retrue.cad.model import CadModel as CadModel
    from retrue.cad.options import CadOptions as CadOptions
    from retrue.correspondences import Correspondences as Correspondences
    from retrue.decoding.decode import decode as decode
    from retrue.errors import RetrueError as RetrueError
    from retrue.files.captures import read_capture as read_capture
    from retrue.files.history import HistoryEntry as HistoryEntry
    from retrue.files.history import read_history as read_history
    from retrue.files.history import roll_back as roll_back
    from retrue.files.history import write_in_place as write_in_place
    from retrue.files.images import read_image as read_image
    from retrue.files.models import write_cloud as write_cloud
    from retrue.files.models import write_mesh as write_mesh
    from retrue.files.patterns import read_pattern as read_pattern
    from retrue.files.patterns import write_pattern as write_pattern
    from retrue.files.png import write_png as write_png
    from retrue.files.points import read_points as read_points
    from retrue.files.points import write_points as write_points
    from retrue.files.rigs import read_rig as read_rig
    from retrue.files.rigs import write_rig as write_rig
    from retrue.files.step import write_step as write_step
    from retrue.geometry.camera import Camera as Camera
    from retrue.geometry.homography import fit_homography as fit_homography
    from retrue.geometry.planar_pose import PlanarPose as PlanarPose
    from retrue.geometry.planar_pose import planar_pose_candidates as planar_pose_candidates
    from retrue.geometry.planar_pose import planar_pose_candidates_batch as planar_pose_candidates_batch
    from retrue.geometry.plane import Plane as Plane
    from retrue.geometry.robust_homography import RobustHomography as RobustHomography
    from retrue.geometry.robust_homography import fit_homography_robust as fit_homography_robust
    from retrue.geometry.transform import RigidTransform as RigidTransform
    from retrue.geometry.triangulation import triangulate as triangulate
    from retrue.patterns.color_grid import ColorGrid as ColorGrid
    from retrue.patterns.gray_code import GrayCode as GrayCode
    from retrue.recalibration.options import KnownDistance as KnownDistance
    from retrue.recalibration.options import RecalibrateOptions as RecalibrateOptions
    from retrue.recalibration.reasons import Reason as Reason
    from retrue.recalibration.recalibrate import recalibrate as recalibrate
    from retrue.recalibration.result import Accepted as Accepted
    from retrue.recalibration.result import Evidence as Evidence
    from retrue.recalibration.result import Refused as Refused
    from retrue.recalibration.result import Verification as Verification
    from retrue.recalibration.verify import VerifyOptions as VerifyOptions
    from retrue.recalibration.verify import verify as verify
    from retrue.reconstruction.cloud import Cloud as Cloud
    from retrue.reconstruction.cloud import Mesh as Mesh
    from retrue.reconstruction.holes import fill_holes as fill_holes
    from retrue.reconstruction.mesh import make_mesh as make_mesh
    from retrue.reconstruction.normals import with_normals as with_normals
    from retrue.reconstruction.options import ReconstructOptions as ReconstructOptions
    from retrue.reconstruction.reconstruct import reconstruct as reconstruct
    from retrue.rig import Rig as Rig

# Where each public name lives. It is imported when first asked for, so that `import retrue` is quick.
_HOMES = {
    "Accepted": "recalibration.result",
    "CadModel": "cad.model",
    "CadOptions": "cad.options",
    "Camera": "geometry.camera",
    "Cloud": "reconstruction.cloud",
    "ColorGrid": "patterns.color_grid",
    "Correspondences": "correspondences",
    "Evidence": "recalibration.result",
    "GrayCode": "patterns.gray_code",
    "HistoryEntry": "files.history",
    "KnownDistance": "recalibration.options",
    "Mesh": "reconstruction.cloud",
    "PlanarPose": "geometry.planar_pose",
    "Plane": "geometry.plane",
    "Reason": "recalibration.reasons",
    "RecalibrateOptions": "recalibration.options",
    "ReconstructOptions": "reconstruction.options",
    "Refused": "recalibration.result",
    "RetrueError": "errors",
    "Rig": "rig",
    "RigidTransform": "geometry.transform",
    "RobustHomography": "geometry.robust_homography",
    "Verification": "recalibration.result",
    "VerifyOptions": "recalibration.verify",
    "decode": "decoding.decode",
    "fill_holes": "reconstruction.holes",
    "fit_homography": "geometry.homography",
    "fit_homography_robust": "geometry.robust_homography",
    "make_cad": "cad.make_cad",
    "make_mesh": "reconstruction.mesh",
    "planar_pose_candidates": "geometry.planar_pose",
    "planar_pose_candidates_batch": "geometry.planar_pose",
    "read_capture": "files.captures",
    "read_history": "files.history",
    "read_image": "files.images",
    "read_pattern": "files.patterns",
    "read_points": "files.points",
    "read_rig": "files.rigs",
    "recalibrate": "recalibration.recalibrate",
    "reconstruct": "reconstruction.reconstruct",
    "roll_back": "files.history",
    "triangulate": "geometry.triangulation",
    "verify": "recalibration.verify",
    "with_normals": "reconstruction.normals",
    "write_cloud": "files.models",
    "write_in_place": "files.history",
    "write_mesh": "files.models",
    "write_pattern": "files.patterns",
    "write_png": "files.png",
    "write_points": "files.points",
    "write_rig": "files.rigs",
    "write_step": "files.step",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'retrue' has no attribute {name!r}")
    value = getattr(import_module(f"retrue.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(_HOMES)
