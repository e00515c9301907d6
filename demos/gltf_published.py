"""Khronos' glTF sample models beside their published pictures: the sheet gltf_published.png.

Each model is drawn from where its picture was taken, in the built-in studio, one stop brighter than by default. The
environments of the published pictures are others: highlights and tints differ, shapes, colors and maps do not.

    python demos/gltf_published.py [--models FOLDER] [--out DIR]

FOLDER holds DamagedHelmet.glb, NormalTangentTest/ and TextureSettingsTest/ with their .gltf files, and NAME_expected.png
for each; the folder `gltf` of CLSHADE_DATA by default.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
if (CHECKOUT / "clshade").is_dir():  # run from a checkout, installed or not
    sys.path.insert(0, str(CHECKOUT))

from clshade.base import interrupts  # noqa: E402

if __name__ == "__main__":
    interrupts.leave_soon()  # the rest takes long to import

import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402

import clshade  # noqa: E402
from clshade.base.text_tables import create_folder  # noqa: E402
from clshade.errors import ClshadeError, InputError  # noqa: E402
from clshade.images import marks, png  # noqa: E402
from clshade.scene.framing import FILL, fitted  # noqa: E402

SIZE = (624, 602)  # of a panel
EXPOSURE = 1.0  # stops


@dataclass(frozen=True)
class View:
    """Where a published picture was taken. azimuth: degrees from +z to the right; elevation: upwards; angle: the vertical
    field of view; fill: how much of the width or height the model fills; about: what to compare."""

    file: str
    azimuth: float
    elevation: float
    angle: float
    fill: float
    about: str

    def frame(self, folder: Path) -> clshade.Frame:
        """Draw the model. The studio turns with models that were made to be seen from -z, before glTF said that their
        front is +z."""
        scene = clshade.load(folder / self.file)
        a, e = math.radians(self.azimuth), math.radians(self.elevation)
        toward = (math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e))
        center = scene.camera.lookat
        camera = clshade.Camera.from_fov(center + np.array(toward), center, (0, 1, 0), self.angle, SIZE)
        camera = fitted(camera, scene.meshes)
        height, width = (side * FILL / self.fill for side in camera.plane)
        studio = replace(clshade.studio(), rotation=180.0 if self.azimuth == 180.0 else 0.0)
        scene = replace(scene, camera=replace(camera, plane=(height, width)), environment=studio, lights=())
        return clshade.render(scene, samples=16, texture_filter="trilinear")


# The helmet's view is the one whose silhouette agrees best with that of its picture.
VIEWS = {
    "DamagedHelmet": View("DamagedHelmet.glb", 52.0, 1.75, 24.5, 0.943, "all core maps, from three quarters"),
    "NormalTangentTest": View(
        "NormalTangentTest/NormalTangentTest.gltf",
        180.0,
        0.0,
        24.5,
        0.95,
        "left of each pair geometry, right its normal map",
    ),
    "TextureSettingsTest": View(
        "TextureSettingsTest/TextureSettingsTest.gltf", 180.0, 0.0, 24.5, 0.995, "a check mark for each setting"
    ),
}


def published(path: Path) -> np.ndarray:
    """Return a published picture, (M, N, 3) uint8, as large as a panel allows, in the middle."""
    pixels = png.read(path)[..., :3]
    scale = min(SIZE[0] / pixels.shape[1], SIZE[1] / pixels.shape[0])
    size = round(pixels.shape[1] * scale), round(pixels.shape[0] * scale)
    large = np.array(Image.fromarray(pixels).resize(size, Image.Resampling.BICUBIC))
    panel = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8)
    top, left = (SIZE[1] - size[1]) // 2, (SIZE[0] - size[0]) // 2
    panel[top : top + size[1], left : left + size[0]] = large
    return panel


def panels(folder: Path) -> list[marks.Panel]:
    """Return ours in the first row, the published pictures below."""
    ours, theirs = [], []
    for name, view in VIEWS.items():
        picture = published(folder / f"{name}_expected.png")
        pixels = view.frame(folder).to_png8(exposure=EXPOSURE)
        ours.append(marks.Panel(pixels, f"{name}: clshade", view.about))
        theirs.append(marks.Panel(picture, f"{name}: published by Khronos", ""))
    return ours + theirs


def main() -> int:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--models", help="folder of the models (default: gltf in CLSHADE_DATA)")
    parser.add_argument("--out", default=".", help="folder for the sheet (default: this one)")
    options = parser.parse_args()
    data = os.environ.get("CLSHADE_DATA")
    try:
        if options.models is None and data is None:
            raise InputError("--models: expected a folder of models, or one in CLSHADE_DATA, found none")
        folder = Path(options.models) if options.models is not None else Path(str(data)) / "gltf"
        path = Path(create_folder(options.out)) / "gltf_published.png"
        layout = marks.Layout(3, SIZE[0], 16, 30, 30, 40, 11, 9)
        heading = (
            "glTF sample models of Khronos: clshade in its studio, and the published pictures in other environments"
        )
        png.write(path, marks.compose_sheet(panels(folder), heading, layout))
    except ClshadeError as error:
        print(f"gltf_published.py: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    print(f"wrote {path}")
    return 0


if __name__ == "__main__":
    interrupts.run(main)
