"""The scene in a browser, through viser."""

from __future__ import annotations

import contextlib
import io
import socket
from collections.abc import Generator
from importlib import import_module
from typing import Any

import numpy as np

from retrue.errors import InputError
from retrue.viewer.scene import Frustum, Scene, Shape, TimeLine

POINT_FRACTION = 1.5e-3  # size of a point over the distance of the scene
FIELD_OF_VIEW = np.radians(50.0)
BACK_OFF = 0.3  # of the distance of the scene that one first stands behind the camera, and a third of it above


def require_viser() -> None:
    """An `InputError` that names the extra, where viser is not installed."""
    try:
        import_module("viser")
    except ImportError as error:
        raise InputError("the viewer needs viser: pip install '.[view]'") from error


@contextlib.contextmanager
def serving(scene: Scene, host: str, port: int) -> Generator[Any]:
    """A viser server that shows the scene until the block ends.

    Raises `InputError` where viser is not installed or nothing can listen there.
    """
    with _quiet():
        server = _started(scene, host, port)
    try:
        yield server
    finally:
        with _quiet():
            server.stop()


def _quiet() -> contextlib.redirect_stdout[io.StringIO]:
    """stdout is the command's own."""
    return contextlib.redirect_stdout(io.StringIO())


def _started(scene: Scene, host: str, port: int) -> Any:
    require_viser()
    _require_free(host, port)
    viser: Any = import_module("viser")
    server = viser.ViserServer(host=host, port=port, label="retrue", verbose=False)
    server.scene.set_up_direction("-y")
    distance = float(np.linalg.norm(scene.middle))
    server.initial_camera.position = tuple(np.array([0.0, -BACK_OFF / 3, -BACK_OFF]) * distance)
    server.initial_camera.look_at = tuple(scene.middle)
    server.initial_camera.up = (0.0, -1.0, 0.0)
    server.initial_camera.fov = FIELD_OF_VIEW
    for shape in scene.shapes:
        _show_shape(server, shape, POINT_FRACTION * distance)
    for frustum in scene.frusta:
        _show_frustum(server, frustum)
    for line in scene.time_lines:
        _show_time_line(server, line)
    if scene.notes:
        server.gui.add_markdown("\n\n".join(scene.notes))
    return server


def _require_free(host: str, port: int) -> None:
    """viser would silently take another port."""
    try:
        with socket.create_server((host, port)):
            pass
    except (OSError, OverflowError) as error:
        raise InputError(f"cannot listen on {host}:{port}: {error}; choose another --port or --host") from error


def _show_shape(server: Any, shape: Shape, point_size: float) -> Any:
    if shape.faces is None:
        points = shape.points.astype(np.float32)
        return server.scene.add_point_cloud(
            f"/{shape.name}", points, shape.colors, point_size=point_size, precision="float32", point_shading="flat"
        )
    from trimesh import Trimesh

    mesh = Trimesh(shape.points, shape.faces, vertex_colors=shape.colors, process=False)
    return server.scene.add_mesh_trimesh(f"/{shape.name}", mesh)


def _show_frustum(server: Any, frustum: Frustum) -> list[Any]:
    """Its lines and its label."""
    lines = server.scene.add_line_segments(
        f"/{frustum.name}",
        frustum.lines.astype(np.float32),
        frustum.color,
        thickness=2.0,
        thickness_units="screen",
        visible=frustum.visible,
    )
    label = server.scene.add_label(
        f"/{frustum.name}/label", frustum.label, position=tuple(frustum.label_at), visible=frustum.visible
    )
    return [lines, label]


def _show_time_line(server: Any, line: TimeLine) -> None:
    """A slider that shows one entry at a time."""
    handles = [_show_frustum(server, frustum) for frustum in line.frusta]
    count = len(handles)
    slider = server.gui.add_slider(f"{line.name}: history", min=1, max=count, step=1, initial_value=count)
    caption = server.gui.add_markdown(line.captions[-1])

    def show(_event: object) -> None:
        for number, parts in enumerate(handles, start=1):
            for part in parts:
                part.visible = number == slider.value
        caption.content = line.captions[slider.value - 1]

    slider.on_update(show)
    show(None)
