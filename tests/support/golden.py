"""Golden hashes of images, and how the images are drawn."""

from __future__ import annotations

import clshade
from clshade.measure.digest import digest as digest
from clshade.pipeline.frame import Frame
from clshade.pipeline.renderer import Renderer

RESOLUTION = (161, 97)

# (scene, preset, shader) -> the first 16 digits. Update them only for intended changes of an image.
GOLDEN = {
    ("teapot", "standard", "phong"): "dd4470a2cc050524",
    ("teapot", "course", "gouraud"): "b0a149a0b1d58ba3",
    ("torus_knot", "standard", "phong"): "c492d5ef6e411981",
    ("icosphere", "standard", "phong"): "c08619f34c11b9e3",
    ("icosphere", "course", "phong"): "927e48b18e7856bc",
    ("quads", "standard", "phong"): "a40a46783dfc0f1b",
    ("box_room", "standard", "gouraud"): "7fb96803e80b1381",
    ("course", "course", "phong"): "11a7f9f28278f14e",
    ("course", "standard", "nolight"): "7f8f191b9fa851bc",
}


def draw(device, name: str, preset: str, shader: str, **options) -> Frame:
    scene = clshade.builtin(name, **({"triangles": 10_000} if name == "torus_knot" else {}))
    given = {"preset": preset, "shader": shader, "layers": ("Z", "id"), "resolution": RESOLUTION}
    with Renderer(scene, device=device, **given, **options) as renderer:
        return renderer.render()
