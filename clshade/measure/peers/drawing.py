"""What renderers take and return, and what some of them share: rays, light in NumPy, several samples by a larger
image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from ...base.arrays import Array
from ...scene.lights import PointLight, plain_lights
from ...scene.model import Scene

SIDE = 4  # subpixels along a pixel's side, in the image of those that cannot sample a pixel several times themselves
SAMPLES = (1, SIDE * SIDE)
NO_DEPTH = np.zeros((0, 0), np.float32)


class Picture(NamedTuple):
    """An image. rgb: (M, N, 3) linear, row 0 at the top, over black. depth: (M, N) along the viewing direction, +inf where
    nothing is; NO_DEPTH of one of several samples. alpha: (M, N), the part of the pixel that is covered."""

    rgb: Array
    depth: Array
    alpha: Array


class Drawer(Protocol):
    """A renderer with a scene. title: its name and version."""

    title: str

    def draw(self) -> Picture:
        """Draw a frame; its arrays may be overwritten by the next."""


# From name, scene of one mesh under one light, samples a pixel and number of threads (0: all) to the renderer. One that
# cannot sample a pixel several times itself gets the larger scene with the number of samples.
Opener = Callable[[str, Scene, int, int], Drawer]


class Larger:
    """A renderer of one sample a pixel, whose image of SIDE times the size is averaged."""

    def __init__(self, opener: Opener, name: str, scene: Scene, samples: int, threads: int) -> None:
        self._drawer = opener(name, larger(scene), samples, threads)
        self.title = self._drawer.title

    def draw(self) -> Picture:
        rgb, _, alpha = self._drawer.draw()
        return Picture(_means(rgb), NO_DEPTH, _means(alpha))


def _means(image: Array) -> Array:
    rows, columns = image.shape[:2]
    parts = image.reshape(rows // SIDE, SIDE, columns // SIDE, SIDE, *image.shape[2:])
    return np.asarray(np.mean(parts, axis=(1, 3), dtype=np.float32))


def larger(scene: Scene) -> Scene:
    """Return the scene with SIDE times as many pixels along each side of the image."""
    columns, rows = scene.camera.resolution
    return replace(scene, camera=replace(scene.camera, resolution=(SIDE * columns, SIDE * rows)))


def lambert(normals: Array, points: Array, scene: Scene) -> Array:
    """Return the light (K, 3) that points with normals of any length (K, 3) send, in their own precision: kd I max(N.L,
    0)."""
    kind = normals.dtype
    (mesh,), light = scene.meshes, light_of(scene)
    toward = np.asarray(light.position, kind) - points
    lengths = np.einsum("kx,kx->k", normals, normals) * np.einsum("kx,kx->k", toward, toward)
    cosine = np.einsum("kx,kx->k", normals, toward) / np.sqrt(np.where(lengths > 0.0, lengths, kind.type(1.0)))
    color = np.asarray(mesh.material.kd * light.intensity, kind)
    lit: Array = np.maximum(cosine, kind.type(0.0))[:, None] * color
    return lit


def picture_of(seen: Array, rgb: Array, depth: Array | None) -> Picture:
    """Return the picture of pixels that show something: seen (M, N) bool, rgb (K, 3) and depth (K,) of these."""
    image, z = np.zeros((*seen.shape, 3), rgb.dtype), NO_DEPTH
    image[seen] = rgb
    if depth is not None:
        z = np.full(seen.shape, np.inf, depth.dtype)
        z[seen] = depth
    return Picture(image, z, seen.astype(np.float32))


def mesh_of(scene: Scene) -> tuple[Array, Array, Array]:
    """Return vertices (V, 3) and normals (V, 3), float32, and faces (F, 3), int32, of the scene's one mesh."""
    (mesh,) = scene.meshes
    assert mesh.normals is not None
    return mesh.verts.astype(np.float32), mesh.normals.astype(np.float32), mesh.faces.astype(np.int32)


def light_of(scene: Scene) -> PointLight:
    """Return the scene's one light."""
    (light,) = plain_lights("report", scene.lights)
    return light


def interpolated(values: Array, faces: Array, second: Array, third: Array) -> Array:
    """Return values (V, 3) in faces (K, 3), (K, 3), from the weights of their second and third corners, (K,)."""
    a, b, c = (values[faces[:, k]] for k in range(3))
    mixed: Array = a + second[:, None] * (b - a) + third[:, None] * (c - a)
    return mixed
