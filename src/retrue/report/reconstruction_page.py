"""The page of a reconstruction."""

from __future__ import annotations

import numpy as np

from retrue.capture import Capture
from retrue.reconstruction.cloud import Cloud
from retrue.reconstruction.reconstruct import epipolar_residuals, set_aside
from retrue.report.evidence_tables import detail_rows
from retrue.report.lengths import pixels, shown_unit
from retrue.report.page import Fact, Page, Section, Space, Table
from retrue.report.residual_section import median_residual, residual_section
from retrue.report.sigma_section import sigma_section
from retrue.report.space import Layer, rig_lines, space_html
from retrue.rig import Rig
from retrue.shown import figures

SAID_ABOVE = ("points", "correspondences", "sigma", "common_sigma", "epipolar_rms_px")


def reconstruction_page(rig: Rig, capture: Capture, cloud: Cloud, *, faces: int | None = None) -> Page:
    """The cloud in space, what was left out of it, and how well the rays meet; `faces` of the mesh, if one was made."""
    unit = shown_unit(rig.unit)
    depth = cloud.points[:, 2]
    near, middle, far = (float(value) for value in np.quantile(depth, [0.005, 0.5, 0.995]))
    size = [float(extent) for extent in np.diff(np.quantile(cloud.points, [0.005, 0.995], axis=0), axis=0)[0]]
    rows = [
        (
            "Width, height, depth",
            " \N{MULTIPLICATION SIGN} ".join(unit.number(extent) for extent in size) + f" {unit.name}",
        ),
        ("Nearest and farthest", f"{unit.number(near)} to {unit.text(far)}"),
        *detail_rows({key: value for key, value in cloud.card.items() if key not in SAID_ABOVE}),
    ]
    facts = [
        Fact("Points", figures(len(cloud)), f"of {len(capture.points):,} correspondences"),
        Fact("Distance (median)", unit.text(middle), f"{unit.number(near)} to {unit.text(far)}"),
    ]
    both = len(capture.points.axes) == 2  # nothing checks the rays of one coordinate
    if both:
        facts.append(Fact("Rays miss by (median)", pixels(median_residual(rig, [capture]))))
    if cloud.sigma is not None:
        facts.append(Fact("A point's own sigma", unit.text(float(np.nanmedian(cloud.sigma))), "median, along the ray"))
    if faces is not None:
        facts.insert(1, Fact("Faces", figures(faces)))
    return Page(
        "reconstruct",
        f"{len(cloud):,} points",
        "good",
        f"{len(cloud):,} of {len(capture.points):,} correspondences were placed in space, {unit.text(near)} to"
        f" {unit.text(far)} from the camera.",
        tuple(facts),
        (
            Section("In space", "", (_in_space(rig, capture, cloud),)),
            *((residual_section({"With this rig": rig}, [capture]),) if both else ()),
            *((sigma_section(cloud, rig, capture),) if cloud.sigma is not None else ()),
            Section(
                "What was kept",
                "One part in 200 at either end is left out of these sizes.",
                (Table(("", ""), tuple(rows)),),
            ),
        ),
    )


def _in_space(rig: Rig, capture: Capture, cloud: Cloud) -> Space:
    """The cloud, what was set aside in a colour of its own, and both devices."""
    aside = set_aside(rig, capture.points, cloud)
    residual = epipolar_residuals(rig, capture.points)
    by_pixel = {tuple(pixel): k for k, pixel in enumerate(capture.points.camera_px.tolist())}
    rows = np.array([by_pixel.get(tuple(pixel), -1) for pixel in cloud.camera_px.tolist()], dtype=np.int64)
    layers = [Layer("points", cloud, np.where(rows >= 0, residual[rows], np.nan))]
    if len(aside):
        layers.append(Layer("set aside", aside, aside=True))
    lines = rig_lines(rig, float(np.median(cloud.points[:, 2])))
    caption = "Drag to turn, scroll to zoom, shift and drag to move; two clicks measure a distance."
    return Space(space_html(layers, lines), caption)
