"""The course's renderer in plain Python: triangles painted back to front, scanline by scanline, each pixel lit by
itself.

It is a baseline for speed, so it is written as the course teaches it: array operations for the vertices, a loop over
triangles, scanlines and pixels, NumPy for 3-vectors. Its image is that of preset `course` except for pixels on the
triangles' edges, as nothing is snapped here. There is no clipping at the near plane: the whole scene must be in front
of the eye.

    python -m clshade.measure.bench.scanline

measures the speedups of `render_object` and of a scene resident on the device.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ... import course
from ...base.arrays import Array, Floats
from ...base.validation import value_error
from ...course.arguments import SHADERS, Shader
from ...errors import ClshadeError
from ...pipeline.renderer import Renderer
from ...scene.builtin.scenes import builtin
from ...scene.camera import Camera
from ...scene.geometry import camera_axes, vertex_normals
from ...scene.lights import plain_lights
from ...scene.model import Scene

Lights = list[tuple[Array, Array]]  # position and intensity of each
LightArguments = tuple[Array, Array, Array, Array, float, Lights]  # arguments of `light` from `eye` on


def project(points: Array, camera: Camera) -> tuple[Array, Array]:
    """Return image coordinates (V, 2) and depths (V,) of world positions (V, 3)."""
    x, y, z = camera_axes(camera) @ (points - camera.eye).T
    (height, width), (columns, rows) = camera.plane, camera.resolution
    u = (camera.focal * x / (z * width) + 0.5) * columns
    v = (camera.focal * y / (z * height) + 0.5) * rows
    return np.stack([u, v], axis=1), z


def light(
    point: Array, normal: Array, color: Array, eye: Array, k_a: Array, k_d: Array, k_s: Array, n: float, lights: Lights
) -> Floats:
    """Evaluate the Phong model at one point, (3,). k_a includes the ambient intensity."""
    result: Floats = k_a.copy()
    to_eye = eye - point
    to_eye = to_eye / np.linalg.norm(to_eye)
    for position, intensity in lights:
        to_light = position - point
        to_light = to_light / np.linalg.norm(to_light)
        cosine = np.dot(normal, to_light)
        if cosine > 0.0:
            result += intensity * color * k_d * cosine
            mirrored = 2.0 * cosine * normal - to_light
            towards = np.dot(mirrored, to_eye)
            if towards > 0.0:
                result += intensity * color * k_s * towards**n
    return result


def _spans(corners: Array, columns: int, rows: int) -> Iterator[tuple[int, int, int, float, float, Floats, Floats]]:
    """Yield the scanlines of a triangle (3, 2): row, first and last column, the positions of the left and right end,
    and the corners' weights (2, 3) there."""
    v = corners[:, 1]
    for row in range(max(math.ceil(v.min() - 0.5), 0), min(math.floor(v.max() - 0.5), rows - 1) + 1):
        crossings = []
        for i in range(3):
            j = (i + 1) % 3
            if (corners[i, 1] <= row + 0.5) != (corners[j, 1] <= row + 0.5):
                t = (row + 0.5 - corners[i, 1]) / (corners[j, 1] - corners[i, 1])
                weights = np.zeros(3)
                weights[i], weights[j] = 1.0 - t, t
                crossings.append((corners[i, 0] + t * (corners[j, 0] - corners[i, 0]), weights))
        if len(crossings) == 2:
            (left, from_weights), (right, to_weights) = sorted(crossings, key=lambda crossing: crossing[0])
            first, last = max(math.ceil(left - 0.5), 0), min(math.floor(right - 0.5), columns - 1)
            yield row, first, last, left, right, from_weights, to_weights


def _shade_phong(
    image: Array, corners: Array, normals: Array, colors: Array, center: Array, light_arguments: LightArguments
) -> None:
    rows, columns = image.shape[:2]
    for row, first, last, left, right, from_weights, to_weights in _spans(corners, columns, rows):
        from_normal, to_normal = from_weights @ normals, to_weights @ normals
        from_color, to_color = from_weights @ colors, to_weights @ colors
        for column in range(first, last + 1):
            t = (column + 0.5 - left) / (right - left) if right > left else 0.0
            normal = from_normal + t * (to_normal - from_normal)
            length = np.linalg.norm(normal)
            color = from_color + t * (to_color - from_color)
            image[row, column] = light(center, normal / length if length else normal, color, *light_arguments)


def _shade_gouraud(
    image: Array, corners: Array, normals: Array, colors: Array, center: Array, light_arguments: LightArguments
) -> None:
    lit = np.array([light(center, normals[k], colors[k], *light_arguments) for k in range(3)])
    _fill(image, corners, lit)


def _fill(image: Array, corners: Array, colors: Array) -> None:
    rows, columns = image.shape[:2]
    for row, first, last, left, right, from_weights, to_weights in _spans(corners, columns, rows):
        from_color, to_color = from_weights @ colors, to_weights @ colors
        for column in range(first, last + 1):
            t = (column + 0.5 - left) / (right - left) if right > left else 0.0
            image[row, column] = from_color + t * (to_color - from_color)


def render(scene: Scene, shader: str = "phong") -> Array:
    """Render a course scene of one mesh without texture, (M, N, 3) float64, row 0 at the BOTTOM.

    shader: gouraud, phong or nolight. Raises InputError for a scene that it cannot draw.
    """
    owner = "scanline.render"
    if scene.preset != "course" or len(scene.meshes) != 1 or scene.background is None:
        raise value_error(owner, "scene", "a course scene of one mesh, with a background", scene.name)
    mesh, camera = scene.meshes[0], scene.camera
    material = mesh.material
    if material.texture is not None:
        raise value_error(owner, "material.texture", "none", material.texture.name)
    verts = mesh.verts.astype(np.float64)
    colors = np.ones_like(verts) if mesh.colors is None else mesh.colors.astype(np.float64)
    normals = vertex_normals(verts, mesh.faces)
    positions, depths = project(verts, camera)
    if depths.min(initial=1.0) <= 0.0:
        raise value_error(owner, "verts", "positions before the eye", f"depth {depths.min():g}")
    lights = [(source.position, source.intensity) for source in plain_lights("bench", scene.lights)]
    light_arguments = (camera.eye, material.ka * scene.ambient, material.kd, material.ks, material.n, lights)
    columns, rows = camera.resolution
    image = np.tile(scene.background, (rows, columns, 1))
    for face in mesh.faces[np.argsort(-depths[mesh.faces].mean(axis=1), kind="stable")]:
        if shader == "nolight":
            _fill(image, positions[face], colors[face])
            continue
        shade = _shade_phong if shader == "phong" else _shade_gouraud
        shade(image, positions[face], normals[face], colors[face], verts[face].mean(axis=0), light_arguments)
    return image


# The speedup of the kernels


def median_time(draw: Callable[[Camera], object], camera: Camera, frames: int) -> float:
    """Return the median time of a frame in seconds, after one warm-up frame; the camera moves every frame."""
    times = []
    for k in range(frames + 1):
        moved = replace(camera, eye=camera.eye * (1.0 + 1e-3 * k))
        start = time.perf_counter()
        draw(moved)
        times.append(time.perf_counter() - start)
    return statistics.median(times[1:])


def measure(scene: Scene, shader: Shader, frames: int) -> tuple[dict[str, float], float]:
    """Return the seconds per image of each method, and the fraction of pixels where loop and kernels differ by over
    0.05.

    scene: as for `render`. The loop draws once; programs are built before the kernels are timed.
    """
    given = course.arguments(scene)
    start = time.perf_counter()
    expected = render(scene, shader)
    seconds = {"plain Python loop": time.perf_counter() - start}
    apart = np.abs(course.render_object(shader, **given) - expected).max(axis=2)

    def by_function(camera: Camera) -> Array:
        return course.render_object(shader, **{**given, "eye": camera.eye})

    def from_scratch(camera: Camera) -> Array:
        course.release()
        return by_function(camera)

    seconds["render_object, a new object"] = median_time(from_scratch, scene.camera, frames)
    seconds["render_object, the same object"] = median_time(by_function, scene.camera, frames)
    with Renderer(scene, shader=shader) as renderer:
        seconds["Renderer.render, scene on the device"] = median_time(renderer.render, scene.camera, frames)
    return seconds, float((apart > 0.05).mean())


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the comparison; return 0, 1 if the images differ in 1 % of the pixels, 2 for bad usage or no device."""
    about = "How many times as fast as a plain Python scanline loop the kernels draw the course's object."
    parser = argparse.ArgumentParser(prog="python -m clshade.measure.bench.scanline", description=about)
    parser.add_argument("--shader", choices=SHADERS, default="phong")
    parser.add_argument("--level", type=int, default=13, help="64*level^2 triangles (default: 13, which is 10816)")
    parser.add_argument("--size", type=int, default=512, help="rows and columns (default: 512)")
    parser.add_argument("--frames", type=int, default=31, help="that the kernels draw each way (default: 31)")
    options = parser.parse_args(arguments)
    try:
        scene = builtin("course", level=options.level, resolution=(options.size, options.size))
        mesh = scene.meshes[0]
        plain = replace(scene, meshes=(replace(mesh, material=replace(mesh.material, texture=None)),))
        seconds, apart = measure(plain, options.shader, max(options.frames, 1))
    except ClshadeError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{scene.face_count} triangles, {options.size} x {options.size}, {options.shader}")
    slowest = seconds["plain Python loop"]
    for name, taken in seconds.items():
        print(f"{name:38} {taken * 1e3:12.3f} ms {slowest / taken:10,.0f} times as fast")
    print(f"pixels that differ by more than 0.05: {apart:.2%}")
    return 1 if apart > 0.01 else 0


if __name__ == "__main__":
    sys.exit(main())
