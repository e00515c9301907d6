"""Golden hashes of images, and how the images are drawn."""

from devices import rendered

import clshade
from clshade.measure.digest import digest as digest
from clshade.pipeline.frame import Frame

RESOLUTION = (161, 97)

# (scene, preset, shader) -> the first 16 digits. Update them only for intended changes of an image.
GOLDEN = {
    ("teapot", "standard", "phong"): "f4cc2b0f79986c82",
    ("teapot", "course", "gouraud"): "57eeba9c212311d4",
    ("torus_knot", "standard", "phong"): "e4c41fff845802df",
    ("icosphere", "standard", "phong"): "d89c428fbd91fa87",
    ("icosphere", "course", "phong"): "337d22f988640746",
    ("quads", "standard", "phong"): "faf1f6260594a4db",
    ("box_room", "standard", "gouraud"): "9ad19c4dac72744f",
    ("course", "course", "phong"): "a64d02ed1add0ca6",
    ("course", "standard", "nolight"): "48fd72b65f90a6b4",
}


def draw(device, name: str, preset: str, shader: str, **options) -> Frame:
    scene = clshade.builtin(name, **({"triangles": 10_000} if name == "torus_knot" else {}))
    settings = {"preset": preset, "shader": shader, "layers": ("Z", "id"), "resolution": RESOLUTION}
    return rendered(scene, device=device, **settings, **options)
