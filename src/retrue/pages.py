"""The page about a result, written to a file: what `--report` does, for scripts and notebooks too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from itertools import zip_longest
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from retrue.calibration.result import Calibrated, RefusedCalibration
from retrue.capture import Capture
from retrue.correspondences import Correspondences, require_captures
from retrue.errors import InputError, in_brief, require_kind, require_path
from retrue.files.atomic import replaced_file
from retrue.geometry.arrays import require_picture
from retrue.recalibration.result import Accepted, Refused, Verification
from retrue.reconstruction.cloud import Cloud, Mesh
from retrue.report.page import Page, Provenance, page_html
from retrue.report.space import model_page
from retrue.rig import Rig, require_rig

if TYPE_CHECKING:
    from retrue.geometry.arrays import Image

Result = Accepted | Refused | Verification | Cloud | Calibrated | RefusedCalibration

LIBRARIES = ("retrue", "numpy", "scipy", "opencv-python-headless")


def write_report(
    path: str | PathLike[str],
    result: Result,
    *,
    rig: Rig | None = None,
    captures: Sequence[Correspondences] = (),
    pictures: Sequence[Image | None] = (),
    sizes: Mapping[str, tuple[int, int]] | None = None,
) -> None:
    """Write the page about a result: one HTML file that loads nothing, whole or not at all.

    Parameters
    ----------
    path : the file to write.
    result : what `recalibrate`, `verify`, `reconstruct` or `calibrate` returned; it has it as `result.report`.
    rig : what the job was given. A calibration needs none.
    captures : what the job was given; of a reconstruction, a list of one.
    pictures : the photograph of each capture, to draw its points on; may be left out.
    sizes : (width, height) of "camera" and "projector"; only a refused calibration needs to be told.

    Raises
    ------
    InputError : what the page needs is missing, or of another kind.
    FileError : the file cannot be written.
    """
    path = require_path(path, "write_report(path, result)")
    require_kind(result, Result.__args__, "result")
    write_page(path, _page(result, rig, captures, pictures, sizes), "retrue.write_report")


def write_view(
    path: str | PathLike[str], *models: Cloud | Mesh, rig: Rig | None = None, before: Cloud | None = None
) -> None:
    """Write clouds and meshes as a page to turn, measure and cut with the mouse; `before` is compared by a slider.

    Parameters
    ----------
    path : the file to write; it loads nothing from anywhere.
    models : in one unit and the camera frame.
    rig : whose camera and projector are drawn too.
    before : the same scene, as another rig had it.

    Raises
    ------
    InputError : no model, or models in several units.
    FileError : the file cannot be written.
    """
    path = require_path(path, "write_view(path, cloud)")
    page = model_page(models, rig, before, path.stem)
    with replaced_file(path) as stream:
        stream.write(page.encode(errors="backslashreplace"))


def view_html(*models: Cloud | Mesh, rig: Rig | None = None, before: Cloud | None = None, most: int = 50_000) -> str:
    """The view of `write_view` as a piece of HTML for notebooks, in a frame of its own.

    Parameters
    ----------
    models, rig, before : as `write_view` takes them; a rig alone shows its devices.
    most : points that are kept of each cloud; a notebook keeps all of them in its file.

    Raises
    ------
    InputError : nothing to show, or models in several units.

    >>> import numpy as np
    >>> ball = np.random.default_rng(0).normal(size=(500, 3)) + [0, 0, 9]
    >>> cloud = Cloud(ball, np.full((500, 3), 90, np.uint8), ball[:, :2], "m")
    >>> view_html(cloud)[:33]
    '<iframe title="retrue" sandbox="a'
    """
    page = model_page(models, rig, before, "retrue", most=most, heading=False)
    style = "width:100%;height:480px;border:0"
    return f'<iframe title="retrue" sandbox="allow-scripts" style="{style}" srcdoc="{escape(page)}"></iframe>'


def write_page(path: Path, page: Page, command: str) -> None:
    """The page as a file; at its foot the command, the time and the versions of what computed it."""
    made = datetime.now(UTC).isoformat(sep=" ", timespec="seconds")
    html = page_html(page, Provenance(command, made, versions()))
    with replaced_file(path) as stream:
        stream.write(html.encode(errors="backslashreplace"))  # names of files may be no text at all


def _page(
    result: Result,
    rig: Rig | None,
    captures: Sequence[Correspondences],
    pictures: Sequence[Image | None],
    sizes: Mapping[str, tuple[int, int]] | None,
) -> Page:
    if isinstance(result, Calibrated | RefusedCalibration):
        return _calibration_page(result, sizes)
    if rig is None:
        raise InputError("rig: expected what the job was given, found None; report(path, rig=rig, captures=[points])")
    require_rig(rig)
    require_captures(captures)
    listed: Any = pictures
    if isinstance(listed, str) or not isinstance(listed, Sequence):
        raise InputError(f"pictures: expected a list of pictures, found {in_brief(pictures)}")
    for number, picture in enumerate(pictures):
        if picture is not None:
            require_picture(picture, f"pictures[{number}]")
    if len(pictures) > len(captures):
        raise InputError(f"pictures: expected at most one of each capture, {len(captures)}, found {len(pictures)}")
    seen = [
        Capture(f"capture {number}", points, picture)
        for number, (points, picture) in enumerate(zip_longest(captures, pictures), start=1)
    ]
    if isinstance(result, Verification):
        from retrue.report.verification_page import verification_page

        return verification_page(rig, seen, result)
    if isinstance(result, Cloud):
        from retrue.report.reconstruction_page import reconstruction_page

        if len(seen) != 1:
            raise InputError(f"captures: expected the one that the cloud was made of, found {len(seen)}")
        return reconstruction_page(rig, seen[0], result)
    from retrue.report.recalibration_page import recalibration_page

    return recalibration_page(rig, seen, result)


def _calibration_page(result: Calibrated | RefusedCalibration, sizes: Mapping[str, tuple[int, int]] | None) -> Page:
    from retrue.report.calibration_page import calibration_page

    if isinstance(result, Calibrated):
        sizes = {"camera": result.rig.camera.size, "projector": result.rig.projector.size}
    elif sizes is None and result.views:
        raise InputError('sizes: expected those of both pictures, {"camera": (width, height), "projector": ...}')
    return calibration_page(result, sizes or {}, result.rig.unit if isinstance(result, Calibrated) else "unknown")


def versions() -> dict[str, str]:
    """Of Python and of what computes."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    found = {"Python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # such as OpenCV under another of its names
            continue
    return found
