"""The scene as a page that needs no server: what `retrue view --out` writes."""

from __future__ import annotations

from dataclasses import replace

from retrue.errors import InputError
from retrue.reconstruction.cloud import Cloud, Mesh
from retrue.report.space import Layer, Line, space_page
from retrue.units import METRES
from retrue.viewer.contents import Contents
from retrue.viewer.scene import Frustum, make_scene


def contents_page(contents: Contents, *, compare: bool = False, title: str = "retrue") -> str:
    """Clouds, meshes, devices and candidates in metres; of two clouds to compare the first is "before".

    Raises `InputError` where there are no points, or not two clouds to compare.
    """
    models = {name: _in_metres(model) for name, model in contents.models.items()}
    if compare and len(models) != 2:
        raise InputError(f"view: expected two clouds to compare, found {len(models)}")
    whens = ("before", "after") if compare else ("",) * len(models)
    layers = [Layer(name, model, when=when) for (name, model), when in zip(models.items(), whens, strict=True)]
    return space_page(layers, [_line(frustum) for frustum in make_scene(contents).frusta], title)


def _in_metres(model: Cloud | Mesh) -> Cloud | Mesh:
    """Units that nobody knows are shown as they are."""
    factor = METRES.get(model.unit.strip().lower(), 1.0)
    points = model.points * factor
    if isinstance(model, Mesh):
        return replace(model, points=points, unit="m")
    sigma = None if model.sigma is None else model.sigma * factor
    return replace(model, points=points, sigma=sigma, uncertainty=None, unit="m")


def _line(frustum: Frustum) -> Line:
    red, green, blue = (value / 255 for value in frustum.color)
    return Line(f"{frustum.name}: {frustum.label}", frustum.lines.reshape(-1, 3), (red, green, blue))
