"""The course's functions in plain float64, written from the formulas, and error bounds for float32."""

from typing import Any

import numpy as np

from clshade.oracle import coverage, shade
from clshade.oracle.lights import Interaction, Lights
from clshade.oracle.shade import Surface
from clshade.scene.model import Scene

HALF_ULP = 2.0**-24  # largest relative rounding error of one float32 operation
# Roundings that may add up, see clshade/measure/README.md, "Bounds, and where they come from".
FACTOR = 32.0
# A device may flush values below float32's normal range to zero.
TINY = float(np.finfo(np.float32).tiny)
Array = np.ndarray


def unit(v: Any) -> Array:
    v = np.asarray(v, np.float64)
    length = np.sqrt((v * v).sum(axis=-1, keepdims=True))
    return v / np.where(length > 0.0, length, 1.0)


def light(point, normal, color, eye, k_a, k_d, k_s, n, positions, intensities) -> Array:
    """Evaluate the Phong model at points (..., 3), each with a normal and a color."""
    normal, to_eye = unit(normal), unit(np.asarray(eye, np.float64) - point)
    total = np.zeros_like(normal) + k_a
    for position, intensity in zip(positions, intensities, strict=True):
        to_light = unit(np.asarray(position, np.float64) - point)
        cosine = (normal * to_light).sum(axis=-1, keepdims=True)
        mirrored = 2.0 * normal * cosine - to_light
        towards = (mirrored * to_eye).sum(axis=-1, keepdims=True)
        diffuse = np.maximum(0.0, cosine)
        specular = np.where((cosine > 0.0) & (towards > 0.0), np.maximum(towards, 0.0) ** n, 0.0)
        total = total + np.asarray(intensity) * color * (k_d * diffuse + k_s * specular)
    return total


def bound(point, normal, color, eye, k_a, k_d, k_s, n, positions, intensities) -> Array:
    """Return the largest error allowed in float32, (..., 3), including highlights that rounding may open or close."""
    point, normal, eye = (np.asarray(v, np.float64) for v in (point, normal, eye))
    positions = np.asarray(positions, np.float64).reshape(-1, 3)
    length = np.sqrt((normal * normal).sum(axis=-1))
    extent = np.abs(point - eye).max(axis=-1)
    lights = Lights(positions, np.reshape(intensities, (-1, 3)))
    at = Interaction(point, normal, eye, lights, extent, np.where(length > 0.0, length, 1.0))
    kappa = shade.condition_number(shade.conditions(at))
    k = {name: np.asarray(coefficient, np.float64) * np.ones(3) for name, coefficient in (("kd", k_d), ("ks", k_s))}
    surface = Surface(np.float64(n), np.asarray(k_a, np.float64), k)
    budget = shade.budget(np.asarray(color, np.float64), surface, lights.intensities)
    jump = shade.jumps(at, surface)
    share = np.minimum(FACTOR * np.sqrt(max(n, 1.0)) * HALF_ULP * kappa, 1.0)
    return share[..., None] * budget + jump * np.abs(color) + TINY


def triangle(shader: str, verts_p, verts_n, verts_c, around: tuple, X) -> tuple[Array, Array, Array]:
    """Draw one triangle over X; return the image, its error bounds, and which pixels are drawn, row 0 at the bottom.

    around: point, eye, k_a (times the ambient light), k_d, k_s, n, positions, intensities.
    """
    xy = np.rint(np.asarray(verts_p, np.float64) * coverage.SUBPIXELS).astype(np.int64)
    rows, columns = np.shape(X)[:2]
    drawn = coverage.triangle_mask(xy, columns, rows)
    row, column = np.nonzero(drawn)
    edges = coverage.edge_functions(xy, column, row)
    weights = edges / np.maximum(edges.sum(axis=1, keepdims=True), 1)
    normals, colors = np.asarray(verts_n, np.float64).T, np.asarray(verts_c, np.float64).T
    image, off = np.array(X, np.float64), np.zeros(np.shape(X))
    if shader == "nolight":
        image[drawn], off[drawn] = weights @ colors, FACTOR * HALF_ULP * np.abs(colors).max()
        return image, off, drawn
    point, *lit_by = around
    if shader == "gouraud":
        image[drawn] = weights @ light(point, normals, colors, *lit_by)
        off[drawn] = bound(point, unit(normals), colors, *lit_by).max(axis=0)
    else:
        normals = normals / max(np.abs(normals).max(), TINY)
        image[drawn] = light(point, weights @ normals, weights @ colors, *lit_by)
        off[drawn] = bound(point, weights @ normals, weights @ colors, *lit_by)
    return image, off, drawn


def scene_arguments(scene: Scene, **changes: Any) -> dict[str, Any]:
    """Return the arguments of `render_object` for a course scene of one mesh, 3xN, with `changes` applied."""
    mesh, camera, material = scene.meshes[0], scene.camera, scene.meshes[0].material
    (N, M), (H, W) = camera.resolution, camera.plane
    colors = np.ones_like(mesh.verts) if mesh.colors is None else mesh.colors
    arguments: dict[str, Any] = {name: getattr(camera, name) for name in ("focal", "eye", "lookat", "up")}
    arguments |= {"shader": "phong", "bg_color": scene.background, "M": M, "N": N, "H": H, "W": W}
    arguments |= {"verts": mesh.verts.T, "verts_colors": colors.T, "faces": mesh.faces.T}
    arguments |= {"k_a": material.ka, "k_d": material.kd, "k_s": material.ks, "n": material.n}
    for name, field in (("l_pos", "position"), ("l_int", "intensity")):
        arguments[name] = np.array([getattr(light, field) for light in scene.lights]).reshape(-1, 3)
    return {**arguments, "light_amb": scene.ambient, **changes}


def map_arguments(scene: Scene, texture_map: Any, **changes: Any) -> dict[str, Any]:
    """Return the same for `render_object_map`."""
    mesh = scene.meshes[0]
    arguments = scene_arguments(scene)
    del arguments["verts_colors"]
    uv_faces = mesh.faces if mesh.uv_faces is None else mesh.uv_faces
    arguments.update(uvs=np.asarray(mesh.uvs).T, uvs_faces=uv_faces.T, texture_map=texture_map)
    return {**arguments, **changes}


def quad_arguments(**changes: Any) -> dict[str, Any]:
    """Return a white square of side 2 around the origin, facing the eye at (0, 0, 4); it fills the middle half of 16 x
    16 pixels."""
    arguments = {"shader": "phong", "focal": 1, "eye": [0, 0, 4], "lookat": [0, 0, 0], "up": [0, 1, 0]}
    arguments |= {"bg_color": [0.5, 0.25, 2.0], "M": 16, "N": 16, "H": 1, "W": 1}
    arguments["verts"] = np.array([[-1, 1, 1, -1], [-1, -1, 1, 1], [0, 0, 0, 0]])
    arguments |= {"verts_colors": np.ones((3, 4)), "faces": np.array([[0, 0], [1, 2], [2, 3]])}
    arguments |= {"k_a": 0.1, "k_d": 0.5, "k_s": 0.0, "n": 1, "light_amb": [1, 2, 3]}
    arguments |= {"l_pos": [[0.0, 0.0, 1e6]], "l_int": [[1.0, 0.5, 4.0]]}
    return {**arguments, **changes}
