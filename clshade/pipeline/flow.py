"""Optical flow: where what a frame shows is in another image, and whether it is seen there."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeAlias

import numpy as np

from ..base.arrays import Array, Bools, Faces, Floats
from ..base.validation import arguments, value_error
from ..scene.camera import Camera
from ..scene.geometry import bounding_box, camera_axes, face_weights, in_image, pixel_rays, triangles
from ..scene.model import Scene, Settings
from .camera_space import near_plane, sample_positions
from .frame import Frame
from .frame_results import Flow
from .hierarchy import Hierarchy
from .opencl.device import Device, shared_device
from .placements import mirroring
from .struct_layout import SAMPLE_BITS

View: TypeAlias = Camera | Scene | Frame

_BAND = 1 << 18  # pixels at a time


@arguments(frame=Frame)
def flow(frame: Frame, to: View, *, device: Device | str | None = None) -> Flow:
    """Return the optical flow from a frame to another image: where the points that its pixels show are there.

    The point is where the ray of the pixel's sample nearest the center meets the plane of the face
    that `id` names, clamped to the face, computed in float64 from the scene; vectors are the difference
    of its places in both images, exactly 0 where nothing moves. ``flow(b, a)`` is the backward flow.

    A point is hidden where a triangle lies between it and the other eye, by the exact predicate of
    shadows. Triangles that lie nearer than the near plane, or whose side is culled, hide nothing;
    blended ones hide all of what is behind them, unless the opacity of their material is below
    ``layer_alpha``. Alpha in textures is not looked up.

    Parameters
    ----------
    frame : Frame
        A rendered frame with the layer id, without which it is refused, as is a scene with other faces.
    to : Frame, Scene or Camera
        The other image: a frame, a scene with its camera, or another camera of the frame's scene. A
        scene may have its meshes elsewhere: the same faces and as many instances, with other vertices
        or placements, such as another time of an animation.
    device : Device or str, optional
        Where it is decided what is hidden, see `clshade.Renderer`.

    Examples
    --------
    >>> import clshade
    >>> from dataclasses import replace
    >>> scene = clshade.builtin("icosphere", level=1)
    >>> frame = clshade.render(scene, layers="id", resolution=(64, 48))
    >>> camera = frame.scene.camera
    >>> moved = replace(camera, eye=camera.eye + (0.1, 0, 0), lookat=camera.lookat + (0.1, 0, 0))
    >>> clshade.flow(frame, moved).vectors.shape
    (48, 64, 2)
    """
    if "id" not in frame:
        raise value_error("flow", "frame", 'a frame with the layer id (layers=("id",))', ", ".join(frame) or "none")
    if not isinstance(to, (Frame, Scene, Camera)):
        raise value_error("flow", "to", "a Frame, a Scene or a Camera", to)
    settings = to.settings if isinstance(to, Frame) else frame.settings
    scene = replace(frame.scene, camera=to) if isinstance(to, Camera) else to.scene if isinstance(to, Frame) else to
    _check_faces(frame.scene, scene)
    ids = frame["id"]
    vectors = np.full((*ids.shape, 2), np.nan, np.float32)
    occluded = np.ones(ids.shape, bool)
    target = _Target(frame.scene, scene, settings, device)
    right, up = (sample_positions(frame.settings.samples)[0] / (1 << SAMPLE_BITS)).tolist()
    step = max(1, _BAND // ids.shape[1])
    for start in range(0, len(ids), step):
        rows = slice(start, start + step)
        rays, origins = pixel_rays(frame.scene.camera, (right, up), rows)
        at = np.nonzero(ids[rows])
        if len(at[0]):
            face = ids[rows][at].astype(np.int64) - 1
            vectors[rows][at], occluded[rows][at] = target.of(face, origins[at], rays[at])
    return Flow(vectors, occluded, scene, settings)


def _check_faces(scene: Scene, other: Scene) -> None:
    """Raise InputError unless the faces of both scenes are the same, mesh by mesh."""
    if len(scene.meshes) != len(other.meshes):
        raise value_error("flow", "to", f"{len(scene.meshes)} meshes, as in the frame's scene", len(other.meshes))
    for number, (mesh, moved) in enumerate(zip(scene.meshes, other.meshes, strict=True), 1):
        counts, counts_there = ((len(one.faces), len(np.asarray(one.instances))) for one in (mesh, moved))
        if counts != counts_there:
            expected = f"{counts[0]} faces and {counts[1]} instances of mesh {number}, as in the frame's scene"
            raise value_error("flow", "to", expected, counts_there)
        if mesh.faces is not moved.faces and not np.array_equal(mesh.faces, moved.faces):
            expected = f"the faces of mesh {number} as in the frame's scene, which may move but not change"
            raise value_error("flow", "to", expected, "others")


class _Target:
    """The other image: where points of faces are in it, and whether it shows them. start: the scene in which the points are
    seen."""

    def __init__(self, start: Scene, scene: Scene, settings: Settings, device: Device | str | None) -> None:
        self._camera, self._start_camera = scene.camera, start.camera
        self._verts, self._faces = triangles(scene)
        verts = self._verts
        low, high = bounding_box(scene)
        self._origin = low + 0.5 * (high - low)
        self._start_verts = verts if start.meshes is scene.meshes else triangles(start)[0]
        self._near = settings.near or near_plane(scene)
        culled, clear = _not_shown(scene, settings, verts, self._faces)
        self._shown = ~culled
        nearer = (verts - scene.camera.eye) @ camera_axes(scene.camera)[2] < self._near
        casts = self._shown & ~nearer[self._faces].all(axis=1) & ~clear
        device = device if isinstance(device, Device) else shared_device(device)
        self._hierarchy = Hierarchy(device, verts - self._origin, np.where(casts[:, None], self._faces, np.int32(0)))

    def of(self, face: Array, origins: Floats, rays: Floats) -> tuple[Floats, Bools]:
        """Return the flow (K, 2) of the points where rays meet faces (K,), and which of them are not shown (K,)."""
        index = self._faces[face]
        weights = face_weights(origins, rays, self._start_verts[index])

        def offsets(verts: Floats, center: Floats) -> Floats:
            """Return the points' offsets from a center: far from the origin their coordinates would be less exact."""
            return np.asarray(np.einsum("kc,kcx->kx", weights, verts[index] - center))

        place, depth = in_image(self._camera, offsets(self._verts, self._camera.eye))
        vectors = place - in_image(self._start_camera, offsets(self._start_verts, self._start_camera.eye))[0]
        with np.errstate(invalid="ignore"):
            ahead = (depth >= self._near) & (np.abs(vectors) <= np.finfo(np.float32).max).all(axis=1)
            inside = ((place >= 0.0) & (place < self._camera.resolution)).all(axis=1)
        traced = ahead & inside & self._shown[face]
        points = offsets(self._verts, self._origin)
        eye = np.append(self._camera.eye - self._origin, 1.0)
        if self._camera.orthographic:  # the direction toward it
            eye = np.append(-camera_axes(self._camera)[2], 0.0)
        hidden = self._hierarchy.shadowed(points, np.where(traced, face, -1), eye)
        return np.where(ahead[:, None], vectors, np.nan), hidden | ~traced


def _not_shown(scene: Scene, settings: Settings, verts: Floats, faces: Faces) -> tuple[Bools, Bools]:
    """Return the faces whose back the camera sees, where backs are not drawn, (F,), and those through which layers look."""
    culled, clear = np.zeros((2, len(faces)), bool)
    end = 0
    for mesh, matrix in ((part, matrix) for part in scene.meshes for matrix in np.asarray(part.instances)):
        start, end = end, end + len(mesh.faces)
        clear[start:end] = mesh.blends and mesh.material.opacity < settings.layer_alpha
        if mesh.material.sides == "both" and not settings.cull:
            continue
        a, b, c = np.moveaxis(verts[faces[start:end]], 1, 0)
        toward = -camera_axes(scene.camera)[2] if scene.camera.orthographic else scene.camera.eye - a
        volume = (np.cross(b - a, c - a) * toward).sum(axis=1)
        culled[start:end] = (volume > 0.0) if mirroring(matrix[None])[0] else (volume < 0.0)
    return culled, clear
