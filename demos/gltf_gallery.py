"""Scenes after Khronos' glTF sample models, those that the tests render: the sheet gltf_gallery.png, and the .glb files.

Cells that test a setting are green where it is right, and partly red where it is wrong.

    python demos/gltf_gallery.py [--out DIR]
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(CHECKOUT), str(CHECKOUT / "tests" / "support")]  # the scenes are the tests' own

from clshade.base import interrupts  # noqa: E402

if __name__ == "__main__":
    interrupts.leave_soon()  # the rest takes long to import

import khronos_cards as cards  # noqa: E402

import clshade  # noqa: E402
from clshade.base.text_tables import create_folder  # noqa: E402
from clshade.errors import ClshadeError  # noqa: E402
from clshade.images import marks, png  # noqa: E402
from clshade.scene.adjust_camera import named_cameras  # noqa: E402

SIZE = (544, 408)  # twice a panel's width: reduced, its edges are smooth
SCENES = {
    "metal_rough_spheres": (
        cards.metal_rough_spheres,
        "rougher to the right: metals, dielectrics,\nmetals by textures",
    ),
    "normal_tangent": (cards.normal_tangent, "domes of geometry, and of a normal map:\nturned, mirrored, in halves"),
    "normal_tangent_mirror": (
        partial(cards.normal_tangent, tangents=True),
        "the same with the file's tangents",
    ),
    "texture_settings": (cards.texture_settings, "wrap modes along u and v, filters, sides"),
    "alpha_modes": (cards.alpha_modes, "cutoffs at alpha and one step above it,\nmixtures of red and green"),
    "multi_uv": (cards.multi_uv, "base color, emission and occlusion by the\nsecond set of coordinates"),
    "vertex_colors": (cards.vertex_colors, "colors at vertices, and as a factor"),
    "emissive_strength": (cards.emissive_strength, "each twice as strong as the one before"),
    "wrong_settings": (partial(cards.texture_settings, wrong=True), "texture_settings with wrong ones: how it fails"),
}


def panels(folder: Path) -> list[marks.Panel]:
    """Write each scene's file into the folder and return its panel."""
    scene_panels = []
    for name, (write, about) in SCENES.items():
        scene = clshade.load(write(folder / f"{name}.glb"))
        camera = named_cameras(scene, ["front"], SIZE)["front"]
        frame = clshade.render(replace(scene, camera=camera), samples=16)
        scene_panels.append(marks.Panel(marks.reduced(frame.to_png8()), name, about))
    return scene_panels


def main() -> int:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", default=".", help="folder for the sheet and the .glb files (default: this one)")
    options = parser.parse_args()
    try:
        folder = Path(create_folder(options.out))
        path = folder / "gltf_gallery.png"
        png.write(path, marks.compose_sheet(panels(folder), "clshade: scenes after Khronos' glTF sample models"))
    except (ClshadeError, OSError) as error:
        print(f"gltf_gallery.py: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    print(f"wrote {path}")
    return 0


if __name__ == "__main__":
    interrupts.run(main)
