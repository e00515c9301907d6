"""VTK: its own shaders in an off-screen window on Mesa's software rasterizer. The window has 8 bits a channel."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ...scene.model import Scene
from ..bench.peers.opengl import SOFTWARE, buffer_depth
from ..bench.peers.peer import MissingPeer
from .drawing import NO_DEPTH, Picture, light_of, mesh_of


class Window:
    def __init__(self, scene: Scene, samples: int) -> None:
        vtk = _module()
        os.environ[SOFTWARE] = "1"
        self._scene, self._deep = scene, samples == 1
        self._window = vtk.vtkRenderWindow()
        self._window.SetOffScreenRendering(1)
        self._window.SetMultiSamples(0)
        self._window.SetSize(*scene.camera.resolution)
        self._renderer = renderer = vtk.vtkRenderer()
        renderer.SetBackground(0.0, 0.0, 0.0)
        renderer.AutomaticLightCreationOff()
        renderer.RemoveAllLights()
        renderer.AddLight(_light(vtk, scene))
        renderer.AddActor(_actor(vtk, scene))
        self._window.AddRenderer(renderer)
        _aim(renderer.GetActiveCamera(), scene)
        renderer.ResetCameraClippingRange()
        self._color, self._depth = vtk.vtkUnsignedCharArray(), vtk.vtkFloatArray()
        self._window.Render()
        capabilities = self._window.ReportCapabilities()
        if "llvmpipe" not in capabilities:
            raise MissingPeer(
                "vtk: expected a window on Mesa's llvmpipe (on Debian: apt install libegl1 libgl1-mesa-dri)"
            )
        self.title = f"VTK {vtk.vtkVersion.GetVTKVersion()}, {self._window.GetClassName()} on llvmpipe"

    def draw(self) -> Picture:
        from vtkmodules.util import numpy_support

        as_array: Any = numpy_support.vtk_to_numpy
        columns, rows = self._scene.camera.resolution
        corners = (0, 0, columns - 1, rows - 1)
        self._window.Render()
        self._window.GetRGBACharPixelData(*corners, 0, self._color)
        self._window.GetZbufferData(*corners, self._depth)
        image = as_array(self._color).reshape(rows, columns, 4)[::-1, :, :3].astype(np.float32) / np.float32(255.0)
        buffer = as_array(self._depth).reshape(rows, columns)[::-1]
        planes = self._renderer.GetActiveCamera().GetClippingRange()
        depth = buffer_depth(buffer, *planes) if self._deep else NO_DEPTH
        return Picture(image, depth, (buffer < 1.0).astype(np.float32))


def _module() -> Any:
    try:
        import vtk
    except ImportError:
        raise MissingPeer("vtk: vtk is not installed (pip install vtk, or clshade's extra `peers`)") from None
    return vtk


def _light(vtk: Any, scene: Scene) -> Any:
    light = light_of(scene)
    made = vtk.vtkLight()
    made.SetLightTypeToSceneLight()
    made.SetPositional(True)
    made.SetConeAngle(180.0)  # no cone
    made.SetAttenuationValues(1.0, 0.0, 0.0)
    made.SetPosition(*map(float, light.position))
    made.SetDiffuseColor(*map(float, light.intensity))
    return made


def _actor(vtk: Any, scene: Scene) -> Any:
    from vtkmodules.util import numpy_support

    as_reals: Any = numpy_support.numpy_to_vtk
    as_indices: Any = numpy_support.numpy_to_vtkIdTypeArray
    verts, normals, faces = mesh_of(scene)
    points, cells, data = vtk.vtkPoints(), vtk.vtkCellArray(), vtk.vtkPolyData()
    points.SetData(as_reals(verts, deep=True))
    offsets = np.arange(0, 3 * len(faces) + 1, 3)
    cells.SetData(as_indices(offsets, deep=True), as_indices(faces.astype(np.int64).ravel(), deep=True))
    data.SetPoints(points)
    data.SetPolys(cells)
    data.GetPointData().SetNormals(as_reals(normals, deep=True))
    mapper, actor = vtk.vtkPolyDataMapper(), vtk.vtkActor()
    mapper.SetInputData(data)
    actor.SetMapper(mapper)
    look = actor.GetProperty()
    look.SetInterpolationToPhong()
    look.SetAmbient(0.0)
    look.SetDiffuse(1.0)
    look.SetSpecular(0.0)
    look.SetDiffuseColor(*map(float, scene.meshes[0].material.kd))
    return actor


def _aim(view: Any, scene: Scene) -> None:
    camera = scene.camera
    view.SetPosition(*map(float, camera.eye))
    view.SetFocalPoint(*map(float, camera.lookat))
    view.SetViewUp(*map(float, camera.up))
    view.SetViewAngle(float(np.degrees(2.0 * np.arctan(camera.plane[0] / (2.0 * camera.focal)))))


def open_for(name: str, scene: Scene, samples: int, threads: int) -> Window:
    return Window(scene, samples)
