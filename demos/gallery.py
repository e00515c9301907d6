"""The image at the head of the README: built-in scenes, and the layers of one of them, on a contact sheet.

python demos/gallery.py [--out DIR]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
if (CHECKOUT / "clshade").is_dir():  # run from a checkout, installed or not
    sys.path.insert(0, str(CHECKOUT))


from clshade.base import interrupts  # noqa: E402

if __name__ == "__main__":
    interrupts.leave_soon()  # the rest takes long to import

import clshade  # noqa: E402
from clshade.base.text_tables import create_folder  # noqa: E402
from clshade.errors import ClshadeError  # noqa: E402
from clshade.images import exr, marks, png  # noqa: E402
from clshade.images.figures import thumbnails  # noqa: E402

SIZE = (544, 408)  # twice a panel's width: reduced, its edges are smooth
SCENES = {
    "teapot": "textures and highlights under colored lights",
    "torus_knot": "100,000 triangles, depth per pixel",
    "box_room": "flat faces under a light at the ceiling",
    "course": "the course's preset: painter's order, centroid light",
}
LAYERS = {
    "N": "layer N: normals, (n + 1)/2",
    "albedo": "layer albedo: color before light",
    "Z": "layer Z: depth",
    "object_id": "layer object_id: one color a mesh",
}


def panels() -> list[marks.Panel]:
    """Return a panel for each scene, then one for each layer of the first scene."""
    scene_panels, first = [], next(iter(SCENES))
    layers = tuple(LAYERS)
    for name, about in SCENES.items():
        scene = clshade.builtin(name, resolution=SIZE)
        frame = clshade.render(scene, samples=16)
        scene_panels.append(marks.Panel(marks.reduced(frame.to_png8()), name, about))
    frame = clshade.render(clshade.builtin(first, resolution=SIZE), layers=layers)
    pictures = thumbnails(exr.flatten(frame.channels()), side=max(SIZE))
    return scene_panels + [marks.Panel(marks.reduced(pictures[layer].pixels), first, LAYERS[layer]) for layer in layers]


def main() -> int:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--out", default=".", help="folder for gallery.png (default: this one)")
    options = parser.parse_args()
    try:
        path = create_folder(options.out) / "gallery.png"
        png.write(path, marks.compose_sheet(panels(), "clshade: scenes made in code, and layers of the first"))
    except ClshadeError as error:
        print(f"gallery.py: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    print(f"wrote {path}")
    return 0


if __name__ == "__main__":
    interrupts.run(main)
