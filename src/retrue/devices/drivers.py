"""From the settings in a setup to the drivers, each of which is imported only where it is used."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, cast, get_args, get_type_hints

from retrue.devices.protocols import CameraDriver, ProjectorDriver
from retrue.devices.setup import Setup, in_short
from retrue.errors import DeviceError, FileError, InputError, require_kind
from retrue.rig import Rig, require_rig

if TYPE_CHECKING:
    from retrue.devices.simulated_rig import SimulatedRig

DRIVERS = {
    "opencv": "opencv_camera.OpencvCamera",
    "genicam": "genicam_camera.GenicamCamera",
    "gphoto2": "gphoto2_camera.Gphoto2Camera",
    "picamera2": "picamera2_camera.Picamera2Camera",
    "window": "window_projector.WindowProjector",
}
SIZES = {"size": ("width", "height"), "projector_size": ("projector_width", "projector_height")}


@dataclass(slots=True)
class LiveRig:
    """Both devices of a setup, not open yet.

    Attributes
    ----------
    simulated : the rig behind both, where they are simulated: it can be bumped.
    """

    camera: CameraDriver
    projector: ProjectorDriver
    simulated: SimulatedRig | None = None

    def __enter__(self) -> LiveRig:
        try:
            self.projector.open()
            self.camera.open()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of both."""
        self.camera.close()
        self.projector.close()


def make_rig(setup: Setup, rig: Rig | None = None) -> LiveRig:
    """The devices of a setup. `rig`, where it is known, is where simulated devices stand, and tells their sizes.

    Raises
    ------
    FileError
        a setting that the driver does not have, or of another kind; names the setup.
    DeviceError
        the driver's package is not installed; names the extra.
    """
    require_kind(setup, Setup, "setup", "retrue.parse_setup makes one of a file's text")
    if rig is not None:
        require_rig(rig)
    kinds = setup.camera["driver"], setup.projector["driver"]
    try:
        if kinds == ("simulated", "simulated"):
            return _simulated(setup, rig)
        if "simulated" in kinds:
            raise InputError('driver: "simulated" stands for a whole rig: give it to both, [camera] and [projector]')
        camera = cast("CameraDriver", _made(_driver(kinds[0]), setup.camera, "camera"))
        return LiveRig(camera, cast("ProjectorDriver", _made(_driver(kinds[1]), setup.projector, "projector")))
    except InputError as error:
        raise FileError(setup.path, str(error)) from error


def imported(package: str, extra: str, device: str) -> Any:
    """The package that a driver needs; a `DeviceError` that names the extra, where it is not installed."""
    try:
        return import_module(package)
    except ImportError as error:
        raise DeviceError(device, f"needs {package.partition('.')[0]}: pip install '.[{extra}]'") from error


def _driver(kind: str) -> type:
    module, _, name = DRIVERS[kind].partition(".")
    return cast("type", getattr(import_module(f"retrue.devices.{module}"), name))


def _simulated(setup: Setup, rig: Rig | None) -> LiveRig:
    from retrue.devices.options import SimulatedOptions
    from retrue.devices.simulated_rig import SimulatedRig

    settings = dict(setup.camera)
    if "size" in setup.projector:
        settings["projector_size"] = setup.projector["size"]
    for name, sides in SIZES.items():
        if name in settings:
            size: object = settings.pop(name)
            if not (isinstance(size, list) and len(cast("list[Any]", size)) == 2):
                raise InputError(f"{name}: expected [width, height], found {in_short(repr(cast('object', size)))}")
            settings |= dict(zip(sides, cast("list[Any]", size), strict=True))
    options = cast("SimulatedOptions", _made(SimulatedOptions, settings, "camera"))
    if extra := sorted(setup.projector.keys() - {"driver", "size"}):
        raise InputError(
            f"[projector] {in_short(extra[0])}: a simulated projector has no such setting; [camera] takes them all"
        )
    simulated = SimulatedRig(options, rig)
    return LiveRig(simulated.camera, simulated.projector, simulated)


def _made(kind: type, settings: Mapping[str, Any], table: str) -> object:
    """The dataclass with these settings as its fields; lists become tuples, and whole numbers stand for others."""
    assert is_dataclass(kind)
    hints = get_type_hints(kind)
    known = [item.name for item in fields(kind) if item.init and not item.name.startswith("_")]
    values: dict[str, Any] = {}
    for name, value in settings.items():
        if name == "driver":
            continue
        if name not in known:
            raise InputError(f"[{table}] {in_short(name)}: this driver has no such setting; it has {', '.join(known)}")
        values[name] = _fitting(value, hints[name], f"[{table}] {name}")
    try:
        return kind(**values)
    except InputError as error:
        raise InputError(f"[{table}] {error}") from error


def _fitting(value: Any, hint: Any, name: str) -> Any:
    if isinstance(value, list):
        value = tuple(cast("list[Any]", value))
    allowed = [kind for kind in (get_args(hint) or (hint,)) if kind is not type(None)]
    if hint == tuple[int, int] or tuple[int, int] in allowed:
        if isinstance(value, tuple) and [type(item) for item in cast("tuple[Any, ...]", value)] == [int, int]:
            return cast("tuple[int, int]", value)
        raise InputError(f"{name}: expected [width, height], found {in_short(repr(cast('object', value)))}")
    if type(value) in allowed or (type(value) is int and float in allowed):
        return value
    words = {str: "text", int: "a whole number", float: "a number", bool: "true or false"}
    expected = " or ".join(words.get(kind, str(kind)) for kind in allowed)
    raise InputError(f"{name}: expected {expected}, found {in_short(repr(cast('object', value)))}")
