"""CAD models as STEP (AP214), in millimetres and the camera frame, through OpenCASCADE."""

from __future__ import annotations

import tempfile
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from retrue.cad.model import CadModel, Outline
from retrue.cad.spline import DEGREE, SplineSurface
from retrue.cad.surfaces import PlaneSurface, SphereSurface, Surface
from retrue.errors import DegenerateError, FileError, InputError, require_kind, require_path
from retrue.files.atomic import replaced_file
from retrue.geometry.arrays import FloatArray
from retrue.units import millimetres_per

ENDINGS = (".step", ".stp")


def require_step(path: str | Path, unit: str) -> None:
    """What `write_step` would refuse before there is a model: the ending, the unit, OpenCASCADE not installed."""
    if Path(path).suffix.lower() not in ENDINGS:
        raise FileError(path, f"expected a CAD file that ends in {' or '.join(ENDINGS)}, found {Path(path).name!r}")
    millimetres_per(unit)
    _opencascade("gp")


def write_step(path: str | Path, model: CadModel) -> None:
    """One face for each outline of each patch; whole or not at all.

    Raises
    ------
    FileError : another ending, or the file cannot be written.
    InputError : the length of the model's unit is not known, or OpenCASCADE is not installed.
    DegenerateError : OpenCASCADE calls a face of the model invalid.
    """
    path = require_path(path, "write_step(path, model)")
    require_kind(model, CadModel, "model")
    require_step(path, model.unit)
    mm = millimetres_per(model.unit)
    faces: list[Any] = []
    for patch in model.patches:
        placed, scale = _surface(patch.surface, mm)
        faces += [_face(placed, tuple(polygon * scale for polygon in outline)) for outline in patch.outlines]
    with tempfile.TemporaryDirectory() as folder:
        content = _exported(faces, Path(folder) / "model.step")
    with replaced_file(path) as stream:
        stream.write(content)


def _opencascade(package: str) -> Any:
    """A package of OpenCASCADE's classes; it has no types to check."""
    try:
        return import_module(f"OCP.{package}")
    except ImportError as error:
        raise InputError("CAD needs OpenCASCADE: pip install '.[cad]'") from error


def _surface(surface: Surface, mm: float) -> tuple[Any, float]:
    """The surface in millimetres, and the factor that its parameters take."""
    gp, geom = _opencascade("gp"), _opencascade("Geom")

    def frame(origin: FloatArray, main: FloatArray, x: FloatArray) -> Any:
        return gp.gp_Ax3(gp.gp_Pnt(*map(float, origin * mm)), gp.gp_Dir(*map(float, main)), gp.gp_Dir(*map(float, x)))

    if isinstance(surface, PlaneSurface):
        return geom.Geom_Plane(frame(surface.origin, surface.normal, surface.axes[0])), mm
    if isinstance(surface, SphereSurface):
        x, _, pole = surface.axes
        return geom.Geom_SphericalSurface(frame(surface.centre, pole, x), surface.radius * mm), 1.0
    if isinstance(surface, SplineSurface):
        return _spline(surface, mm), 1.0
    raise TypeError(f"no surface of STEP for {surface.kind}")


def _spline(surface: SplineSurface, mm: float) -> Any:
    gp, collections = _opencascade("gp"), _opencascade("collections")
    poles, weights = surface.poles()
    rows, columns = weights.shape
    pole_table = collections.Array2_gp_Pnt(1, rows, 1, columns)
    weight_table = collections.Array2_double(1, rows, 1, columns)
    for i, j in np.ndindex(rows, columns):
        pole_table.SetValue(i + 1, j + 1, gp.gp_Pnt(*map(float, poles[i, j] * mm)))
        weight_table.SetValue(i + 1, j + 1, float(weights[i, j]))
    knots: list[Any] = []
    multiplicities: list[Any] = []
    for vector in (surface.x_knots, surface.y_knots):
        values, counts = np.unique(vector, return_counts=True)
        knots.append(_filled(collections.Array1_double, values.tolist()))
        multiplicities.append(_filled(collections.Array1_int, counts.tolist()))
    return _opencascade("Geom").Geom_BSplineSurface(pole_table, weight_table, *knots, *multiplicities, DEGREE, DEGREE)


def _filled(array: Any, values: list[Any]) -> Any:
    filled = array(1, len(values))
    for k, value in enumerate(values, start=1):
        filled.SetValue(k, value)
    return filled


def _face(surface: Any, outline: Outline) -> Any:
    """The part of a surface within an outline, with curves in space that follow it."""
    builder = _opencascade("BRepBuilderAPI")
    outer, *holes = (_wire(surface, polygon) for polygon in outline)
    made = builder.BRepBuilderAPI_MakeFace(surface, outer, True)
    for hole in holes:
        made.Add(hole)
    face = made.Face()
    _opencascade("BRepLib").BRepLib.BuildCurves3d_s(face)
    if not _opencascade("BRepCheck").BRepCheck_Analyzer(face).IsValid():
        raise DegenerateError("cad: OpenCASCADE calls a face invalid; give a larger --cad-tolerance")
    return face


def _wire(surface: Any, polygon: FloatArray) -> Any:
    """A closed chain of edges, straight in the parameters of the surface."""
    gp, geom2d, builder = _opencascade("gp"), _opencascade("Geom2d"), _opencascade("BRepBuilderAPI")
    corners: list[tuple[float, float]] = [(float(u), float(v)) for u, v in polygon]
    vertices = [builder.BRepBuilderAPI_MakeVertex(surface.Value(u, v)).Vertex() for u, v in corners]
    wire = builder.BRepBuilderAPI_MakeWire()
    for k, (u, v) in enumerate(corners):
        following = (k + 1) % len(corners)
        du, dv = corners[following][0] - u, corners[following][1] - v
        line = geom2d.Geom2d_Line(gp.gp_Pnt2d(u, v), gp.gp_Dir2d(du, dv))
        length = float(np.hypot(du, dv))
        edge = builder.BRepBuilderAPI_MakeEdge(line, surface, vertices[k], vertices[following], 0.0, length)
        wire.Add(edge.Edge())
    return wire.Wire()


def _exported(faces: list[Any], path: Path) -> bytes:
    """The bytes of a STEP file of all faces; OpenCASCADE writes to a name only, and to stdout unless told not to."""
    messages = _opencascade("Message")
    messenger = messages.Message.DefaultMessenger_s()
    printers = list(messenger.Printers())
    step, brep, topology = _opencascade("STEPControl"), _opencascade("BRep"), _opencascade("TopoDS")
    compound = topology.TopoDS_Compound()
    build = brep.BRep_Builder()
    build.MakeCompound(compound)
    for face in faces:
        build.Add(compound, face)
    for printer in printers:
        messenger.RemovePrinter(printer)
    try:
        writer = step.STEPControl_Writer()
        _opencascade("Interface").Interface_Static.SetCVal_s("write.step.unit", "MM")
        writer.Transfer(compound, step.STEPControl_StepModelType.STEPControl_AsIs)
        writer.Write(str(path))
    finally:
        for printer in printers:
            messenger.AddPrinter(printer)
    return path.read_bytes()
