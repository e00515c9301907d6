"""A coarse sphere with smooth normals, lit from the side, with shadows: hard where each face turns from the light, and as
clshade draws it, where the light fades out before (Chiang, Li, Burley 2019, "Taming the Shadow Terminator").

python demos/shadow_terminator.py [--level N] [--out DIR]

The left image is put together of others: where rays from flat faces reach the light, and these stop at a face's own plane,
it has the light of smooth normals without shadows, and elsewhere none.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
if (CHECKOUT / "clshade").is_dir():  # run from a checkout, installed or not
    sys.path.insert(0, str(CHECKOUT))

from clshade.base import interrupts  # noqa: E402

if __name__ == "__main__":
    interrupts.leave_soon()  # the rest takes long to import

import numpy as np  # noqa: E402

import clshade  # noqa: E402
from clshade.base.text_tables import create_folder  # noqa: E402
from clshade.errors import ClshadeError  # noqa: E402
from clshade.images import contact_sheet, png  # noqa: E402
from clshade.images.tonemap import tonemap  # noqa: E402

LAYOUT = contact_sheet.Layout(across=2)
FINE = 4  # pixels of the images along each side of the sheet's
SIDE = FINE * LAYOUT.panel
FLOOR = -1.3  # the sphere has the radius 1


def lit_from_the_side(level: int, flat: bool) -> clshade.Scene:
    """Return a sphere of 20 * 4^level triangles above a floor, with flat faces or smooth normals."""
    scene = clshade.builtin("icosphere", level=level)
    sphere = scene.meshes[0]
    material = replace(sphere.material, ka=0.0, ks=0.0)
    verts, faces = sphere.verts, sphere.faces
    if flat:
        verts, faces, normals = verts[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3), None
    else:
        normals = sphere.normals
    ball = clshade.Mesh(verts, faces, normals=normals, material=material)
    corners = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]]) * 40.0 + [0.0, FLOOR, 0.0]
    floor = clshade.Mesh(corners, [[0, 1, 2], [0, 2, 3]], material=material)
    light = clshade.DirectionalLight((-1.0, -0.45, -0.15))
    camera = clshade.Camera.from_fov((0.0, 1.0, 4.5), (-0.2, -0.15, 0.0), (0.0, 1.0, 0.0), 35.0)
    return clshade.Scene((ball, floor), camera.with_resolution((SIDE, SIDE)), (light,), background=(0.0, 0.0, 0.0))


def drawn(level: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the linear images without the softening and with it, (M, N, 3)."""
    smooth = lit_from_the_side(level, flat=False)
    reached = clshade.render(lit_from_the_side(level, flat=True), shadows=True).rgb > 0.0
    hard = np.where(reached, clshade.render(smooth, shadows=False).rgb, 0.0)
    return hard, clshade.render(smooth, shadows=True).rgb


def panels(level: int) -> list[contact_sheet.Panel]:
    faces = 20 * 4**level
    about = {
        "not softened": f"{faces} triangles with smooth normals:\neach face is dark where it turns away",
        "softened": "shadows as clshade draws them:\nthe light fades out before",
    }
    pictures = (tonemap(image) for image in drawn(level))
    return [
        contact_sheet.Panel(contact_sheet.reduced(picture), title, text)
        for picture, (title, text) in zip(pictures, about.items(), strict=True)
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--level", type=int, default=2, help="of the sphere: 20 * 4^level triangles (default: 2)")
    parser.add_argument("--out", default=".", help="folder for shadow_terminator.png (default: this one)")
    options = parser.parse_args()
    try:
        path = create_folder(options.out) / "shadow_terminator.png"
        sheet = contact_sheet.compose(panels(options.level), "clshade: the shadow terminator of a coarse mesh", LAYOUT)
        png.write(path, sheet)
    except ClshadeError as error:
        print(f"shadow_terminator.py: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    print(f"wrote {path}")
    return 0


if __name__ == "__main__":
    interrupts.run(main)
