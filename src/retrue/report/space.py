"""Clouds, meshes and devices in space, for a browser: one drawing for reports, notebooks and `retrue view`.

Points travel as 16 bits a coordinate within the box of their layer, scalars as 8 bits on a scale of powers, all of it
compressed; and shuffled, so that the first of them are an even thinning, which is what is drawn while the view moves.
"""

from __future__ import annotations

import base64
import gzip
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from retrue.errors import InputError, require_kind, require_kinds
from retrue.geometry.arrays import FloatArray, IntArray
from retrue.geometry.camera import Camera
from retrue.geometry.transform import RigidTransform
from retrue.ranges import require_number
from retrue.reconstruction.cloud import Cloud, Mesh
from retrue.reconstruction.mesh import surface_faces
from retrue.rig import Rig, require_rig

MOST_POINTS = 2_000_000  # of a layer; more are thinned evenly, and the page says so
MOST_FACES = 800_000  # of a mesh; where there are more, its points are shown
SPARSE = 50_000  # points of a grid, up to which its surface is drawn with them: denser ones read as one by themselves
STRAY_SHARE = 0.002  # of the points, at either end of each axis: strays must not shrink the rest
DIRECTIONS = 100  # in which the outermost points are looked for
FRUSTUM_SHARE = 0.16  # of the distance to the scene
CAMERA_COLOR, PROJECTOR_COLOR = (0.43, 0.66, 1.0), (0.95, 0.6, 0.3)
Vector = tuple[float, float, float]
About = Literal["points", "all"]


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """Points or a surface to show.

    Attributes
    ----------
    model : all layers of a page are in one unit and frame.
    residual_px : (N,) by which the rays of each point miss each other; None where not known.
    when : "before" and "after" are compared with a slider; "": always there.
    aside : points that were set aside: shown in a colour of their own.
    """

    name: str
    model: Cloud | Mesh
    residual_px: FloatArray | None = None
    when: Literal["", "before", "after"] = ""
    aside: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """Segments between places (2 N, 3), one after the other.

    Attributes
    ----------
    body : (3 M, 3) corners of triangles that one sees through; None: no body.
    label : written at the first place.
    moment : what happened then; of lines that have one, a slider shows one at a time.
    """

    name: str
    places: FloatArray
    color: Vector
    body: FloatArray | None = None
    label: str = ""
    moment: str = ""


def frustum(
    name: str, device: Camera, camera_from_device: RigidTransform, length: float, color: Vector, *, solid: bool = True
) -> Line:
    """The pyramid that a device sees, up to that depth; without a body for what is no longer so, or never was."""
    o, corners = camera_from_device.t, camera_from_device.apply(device.frustum(length))
    sides = [(corners[k], corners[(k + 1) % 4]) for k in range(4)]
    edges = np.array([end for near, far in sides for end in (o, near, near, far)])
    body = np.array([end for near, far in sides for end in (o, near, far)]) if solid else None
    return Line(name, edges, color, body)


def outline(name: str, corners: FloatArray, color: Vector, *, solid: bool = False) -> Line:
    """A closed outline (4, 3), such as a board's or, with a body, a plane's."""
    edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).reshape(-1, 3)
    return Line(name, edges, color, corners[[0, 1, 2, 0, 2, 3]] if solid else None)


def rig_lines(rig: Rig, distance: float) -> list[Line]:
    """Both devices in the camera frame, for a scene at that distance."""
    length, pose = FRUSTUM_SHARE * distance, rig.projector_from_camera.inverse()
    return [
        frustum("camera", rig.camera, RigidTransform.identity(), length, CAMERA_COLOR),
        frustum("projector", rig.projector, pose, length, PROJECTOR_COLOR),
    ]


def space_html(
    layers: Sequence[Layer],
    lines: Sequence[Line] = (),
    label: str = "Points in space",
    *,
    about: About = "points",
    most: int = MOST_POINTS,
) -> str:
    """The drawing as a piece of a page, without its script and style (`space_assets`).

    Parameters
    ----------
    about : what fills the view at first: the points, or all that is drawn, devices too.
    most : points of a layer; more are thinned evenly.

    Raises
    ------
    InputError : nothing to draw, or layers in several units.
    """
    import jinja2

    environment = jinja2.Environment(autoescape=True)
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    spec = _spec(layers, lines, about, most)
    return environment.from_string(_asset("space.html.j2")).render(label=label, spec=spec)


def space_assets() -> tuple[str, str]:
    """Style and script of all drawings on a page."""
    return _asset("space.css"), _asset("space.js")


def space_page(
    layers: Sequence[Layer],
    lines: Sequence[Line] = (),
    title: str = "retrue",
    *,
    about: About = "points",
    most: int = MOST_POINTS,
    heading: bool = True,
) -> str:
    """The drawing as a page of its own, that loads nothing; without a heading it fills a frame of another page."""
    style, script = space_assets()
    head, room = (f"<h1>{escape(title)}</h1>", "1rem") if heading else ("", "0")
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data: blob:; '
        "style-src 'unsafe-inline'; script-src 'unsafe-inline'\">"
        '<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">'
        f"<title>{escape(title)}</title><style>{_asset('page.css')}\n{style}\n"
        f"body{{max-width:none;padding:{room};display:flex;flex-direction:column;height:100dvh}}"
        ".space{flex:1;display:flex;flex-direction:column;min-height:0}.space .stage{flex:1;min-height:12rem}"
        f".space canvas{{position:absolute;height:100%;min-height:0}}</style></head><body>"
        f"{head}{space_html(layers, lines, title, about=about, most=most)}<script>{script}</script></body></html>"
    )


def model_page(
    models: Sequence[Cloud | Mesh],
    rig: Rig | None,
    before: Cloud | None,
    title: str,
    *,
    most: int = MOST_POINTS,
    heading: bool = True,
) -> str:
    """Models as a page of their own, with the devices of a rig; `before` is compared with the first by a slider."""
    require_kinds(list(models), (Cloud, Mesh), "models", "retrue.reconstruct makes one")
    require_number(most, "most", 1, whole=True)
    if rig is not None:
        require_rig(rig)
    if before is not None:
        require_kind(before, Cloud, "before", "retrue.reconstruct makes one")
    layers = [Layer(f"part {k}" if len(models) > 1 else "points", model) for k, model in enumerate(models, 1)]
    if before is not None and models:
        layers = [Layer("before", before, when="before"), Layer("after", models[0], when="after"), *layers[1:]]
    far = [float(np.median(model.points[:, 2])) for model in models if len(model.points)]
    lines = rig_lines(rig, far[0] if far else float(np.linalg.norm(rig.projector_from_camera.t))) if rig else ()
    return space_page(layers, lines, title, about="points" if far else "all", most=most, heading=heading)


def _spec(layers: Sequence[Layer], lines: Sequence[Line], about: About, most: int) -> dict[str, Any]:
    shown = [layer for layer in layers if len(layer.model.points)]
    if not shown and not lines:
        raise InputError("view: expected points, found none")
    units = {layer.model.unit for layer in shown}
    if len(units) > 1:
        raise InputError(f"view: expected layers in one unit, found {', '.join(sorted(units))}")
    ranges: dict[str, list[float]] = {}
    for name in ("sigma", "residual"):
        found = [values for layer in shown if (values := _scalar(layer, name)) is not None]
        known = np.concatenate([np.abs(values[np.isfinite(values)]) for values in found]) if found else np.empty(0)
        known = known[known > 0]
        if len(known):
            low, high = np.quantile(known, [0.01, 0.99]).tolist()
            ranges[name] = [low, max(high, 1.01 * low)]
    ends = [line.places for line in lines]
    inner = np.concatenate([_inner(layer.model.points) for layer in shown] or ends)
    low, high = inner.min(axis=0), inner.max(axis=0)
    return {
        "unit": units.pop() if units else "",
        "low": low.tolist(),
        "high": high.tolist(),
        **_whole_view(shown, low, high, np.concatenate(ends) if ends and (about == "all" or not shown) else None),
        "mode": "true" if any(np.ptp(layer.model.colors, axis=0).any() for layer in shown) else "depth",
        "ranges": ranges,
        "layers": [_packed_layer(layer, ranges, most) for layer in shown],
        "lines": [
            {
                "name": line.name,
                "color": list(line.color),
                "places": line.places.tolist(),
                "body": None if line.body is None else line.body.tolist(),
                "label": line.label,
                "moment": line.moment,
            }
            for line in lines
        ],
    }


def _whole_view(shown: Sequence[Layer], low: FloatArray, high: FloatArray, lines: FloatArray | None) -> dict[str, Any]:
    """What the view turns about, from where, and what it shows whole: the outermost points; of devices, from aside."""
    ends = np.concatenate([_outermost(layer.model.points, low, high) for layer in shown]) if shown else np.empty((0, 3))
    if lines is not None:
        ends = np.concatenate([ends, lines]) if shown else lines
    middle = (ends.min(axis=0) + ends.max(axis=0)) / 2
    return {"middle": middle.tolist(), "ends": ends.tolist(), "turn": [-0.35, -0.12] if lines is None else [-0.8, 0.35]}


def _packed_layer(layer: Layer, ranges: dict[str, list[float]], most: int) -> dict[str, Any]:
    model = layer.model
    count = len(model.points)
    rows = np.arange(count)
    triangles = _triangles(layer)
    faces = None if triangles is None else _packed(triangles.astype("<u4"))
    if triangles is None:
        rows = np.random.default_rng(0).permutation(count)[:most]
    points = model.points[rows]
    low = points.min(axis=0)
    extent = np.maximum(points.max(axis=0) - low, 1e-30)
    scalars = np.zeros((len(rows), 2), np.uint8)
    for column, name in enumerate(("sigma", "residual")):
        values = _scalar(layer, name)
        if values is not None and name in ranges:
            scalars[:, column] = _on_scale(values[rows], *ranges[name])
    normals = model.normals if isinstance(model, Cloud) else None
    facing = None if normals is None else _packed(np.rint(127 * np.nan_to_num(normals[rows])).astype(np.int8))
    return {
        "name": layer.name,
        "of": _said(layer, len(rows), faces is not None),
        "when": layer.when,
        "aside": layer.aside,
        "low": low.tolist(),
        "extent": extent.tolist(),
        "place": _packed(np.rint((points - low) / extent * 65535).astype("<u2")),
        "tint": _packed(model.colors[rows]),
        "known": _packed(scalars),
        "facing": facing,
        "faces": faces,
        "dots": isinstance(model, Cloud),
    }


def _triangles(layer: Layer) -> IntArray | None:
    """(M, 3) of a mesh, or of the surface that a sparse cloud's own grid shows; None: its points alone are drawn."""
    model = layer.model
    if isinstance(model, Mesh):
        return model.faces if len(model.faces) <= MOST_FACES else None
    if layer.aside or model.cells is None or len(model) > SPARSE:
        return None
    faces = surface_faces(model)
    return faces if len(faces) else None


def _said(layer: Layer, drawn: int, with_faces: bool) -> str:
    """How much of it is drawn."""
    count = len(layer.model.points)
    said = f"{drawn:,} of {count:,}" if drawn < count else f"{count:,}"
    if isinstance(layer.model, Mesh) and not with_faces:
        return f"{said}, as points: {len(layer.model.faces):,} faces are too many"
    return said


def _scalar(layer: Layer, name: str) -> FloatArray | None:
    if name == "residual":
        return layer.residual_px
    return layer.model.sigma if isinstance(layer.model, Cloud) else None


def _on_scale(values: FloatArray, low: float, high: float) -> NDArray[np.uint8]:
    """1 .. 255 from low to high in powers; 0 of what is not known."""
    size = np.abs(values)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.log(size / low) / np.log(high / low)
    known = np.isfinite(share) | (size == 0)
    return np.where(known, 1 + np.rint(254 * np.clip(np.nan_to_num(share, neginf=0), 0, 1)), 0).astype(np.uint8)


def _inner(points: FloatArray) -> FloatArray:
    """(2, 3) the box of all points but a few strays."""
    few = points[:: max(1, len(points) // 100_000)]
    return np.quantile(few, [STRAY_SHARE, 1 - STRAY_SHARE], axis=0)


def _outermost(points: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """(K, 3) of the points in that box those that lie farthest out in one of many directions: their hull, nearly."""
    few = points[:: max(1, len(points) // 100_000)]
    inside = few[((few >= low) & (few <= high)).all(axis=1)]
    steps = np.arange(DIRECTIONS)
    z, turn = (2 * steps + 1) / DIRECTIONS - 1, steps * np.pi * (3 - 5**0.5)  # a spiral over the sphere
    rim = np.sqrt(1 - z**2)
    ways = np.stack([rim * np.cos(turn), rim * np.sin(turn), z], axis=1)
    return inside[sorted({int((inside @ way).argmax()) for way in ways})] if len(inside) else few[:1]


def _packed(array: NDArray[Any]) -> str:
    return base64.b64encode(gzip.compress(np.ascontiguousarray(array).tobytes(), 5, mtime=0)).decode()


def _asset(name: str) -> str:
    return (files("retrue.report") / "assets" / name).read_text(encoding="utf-8")
