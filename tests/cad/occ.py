"""What OpenCASCADE says of a STEP file, read back."""

from dataclasses import dataclass
from importlib import import_module

import pytest


def require_opencascade():
    """Skips the test where it is not installed."""
    pytest.importorskip("OCP.STEPControl", reason="OpenCASCADE is not installed")


@dataclass
class StepFile:
    """The shape that a STEP file holds, in millimetres."""

    shape: object

    @classmethod
    def read(cls, path):
        step = import_module("OCP.STEPControl")
        reader = step.STEPControl_Reader()
        messenger = import_module("OCP.Message").Message.DefaultMessenger_s()
        for printer in list(messenger.Printers()):
            messenger.RemovePrinter(printer)
        status = reader.ReadFile(str(path))
        assert status == import_module("OCP.IFSelect").IFSelect_ReturnStatus.IFSelect_RetDone
        reader.TransferRoots()
        return cls(reader.OneShape())

    @property
    def valid(self):
        return import_module("OCP.BRepCheck").BRepCheck_Analyzer(self.shape).IsValid()

    def faces(self):
        explorer = import_module("OCP.TopExp").TopExp_Explorer(
            self.shape, import_module("OCP.TopAbs").TopAbs_ShapeEnum.TopAbs_FACE
        )
        adaptor = import_module("OCP.BRepAdaptor").BRepAdaptor_Surface
        topology = import_module("OCP.TopoDS").TopoDS
        found = []
        while explorer.More():
            found.append(adaptor(topology.Face(explorer.Current())))
            explorer.Next()
        return found

    def kinds(self):
        return [str(face.GetType()).rpartition("_")[2] for face in self.faces()]

    def distances(self, points_mm):
        """Of points (N, 3) from the nearest point of the faces."""
        gp, builder = import_module("OCP.gp"), import_module("OCP.BRepBuilderAPI")
        extrema = import_module("OCP.BRepExtrema").BRepExtrema_DistShapeShape
        vertices = [builder.BRepBuilderAPI_MakeVertex(gp.gp_Pnt(*map(float, p))).Vertex() for p in points_mm]
        return [extrema(vertex, self.shape).Value() for vertex in vertices]
