"""Mitsuba 3: a ray through each pixel's center, intersection and shading normal, and Lambert's light by Dr.Jit.

Its integrators are not used: their light falls off with the distance and casts shadows, and their samples lie at random in
the pixel.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...scene.model import Scene
from ...scene.seen_points import pixel_rays
from ..bench.peers.peer import MissingPeer
from .drawing import NO_DEPTH, Picture, light_of, mesh_of

VARIANT = "llvm_ad_rgb"  # float32, vectorized; scalar variants take one ray at a time


class Rays:
    def __init__(self, scene: Scene, samples: int, threads: int) -> None:
        self._deep = samples == 1
        self._mi, self._dr = _modules()
        mi, dr = self._mi, self._dr
        if threads:
            dr.set_thread_count(threads)
        self.title = f"Mitsuba {mi.__version__}, {VARIANT}"
        self._scene = mi.load_dict({"type": "scene", "mesh": _mesh(mi, scene)})
        rays, origins = pixel_rays(scene.camera)
        self._shape = rays.shape[:2]
        flat = (
            np.ascontiguousarray(each.reshape(-1, 3).T, np.float32) for each in (origins, rays / scene.camera.focal)
        )
        self._ray = mi.Ray3f(*flat)
        dr.eval(self._ray)
        (mesh,), light = scene.meshes, light_of(scene)
        self._light = mi.Point3f(*map(float, light.position))
        self._color = mi.Color3f(*map(float, mesh.material.kd * light.intensity))

    def draw(self) -> Picture:
        mi, dr = self._mi, self._dr
        hit = self._scene.ray_intersect(self._ray)
        seen = hit.is_valid()
        cosine = dr.dot(hit.sh_frame.n, dr.normalize(self._light - hit.p))
        cosine = dr.select(cosine > 0.0, cosine, 0.0)  # LLVM 15 cannot compile Dr.Jit's maximum
        rgb = dr.select(seen, cosine * self._color, mi.Color3f(0.0))
        depth = dr.select(seen, hit.t, dr.inf) if self._deep else None
        alpha = dr.select(seen, mi.Float(1.0), mi.Float(0.0))
        dr.eval(rgb, depth, alpha)
        image = np.asarray(rgb.numpy(), np.float32).T.reshape(*self._shape, 3)
        z = NO_DEPTH if depth is None else depth.numpy().reshape(self._shape)
        return Picture(image, z, alpha.numpy().reshape(self._shape))


def _modules() -> tuple[Any, Any]:
    try:
        import mitsuba
    except ImportError:
        raise MissingPeer(
            "mitsuba: mitsuba is not installed (pip install mitsuba, or clshade's extra `peers`)"
        ) from None
    try:
        mitsuba.set_variant(VARIANT)
        import drjit

        drjit.eval(mitsuba.Float(1.0) + 1.0)
    except Exception as error:  # without LLVM's library
        reason = " ".join(str(error).split()) or type(error).__name__
        raise MissingPeer(f"mitsuba: variant {VARIANT}: {reason} (on Debian: apt install libllvm15)") from None
    return mitsuba, drjit


def _mesh(mi: Any, scene: Scene) -> Any:
    verts, normals, faces = mesh_of(scene)
    made = mi.Mesh("mesh", len(verts), len(faces), has_vertex_normals=True)
    fields = mi.traverse(made)
    fields["vertex_positions"], fields["vertex_normals"] = verts.ravel(), normals.ravel()
    fields["faces"] = faces.astype(np.uint32).ravel()
    fields.update()
    return made


def open_for(name: str, scene: Scene, samples: int, threads: int) -> Rays:
    return Rays(scene, samples, threads)
