"""From mesh file to image: the texel, color or material that a pixel shows, for each format and its features."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_writers import Gltf, ply, png
from PIL import Image
from scene_files import scene_and_warnings, write

from clshade.images.decode import srgb_to_linear
from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera
from clshade.scene.formats.load import load
from clshade.scene.framing import BACKGROUND

# A texture of 4 x 4 different texels on a square from -1 to 1, seen from the front: 9 pixels per texel.
PICTURE = (np.arange(48).reshape(4, 4, 3) * 5 + 10).astype(np.uint8)
LINEAR = srgb_to_linear(PICTURE / 255)
SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
FRONT = Camera([0, 0, 3], [0, 0, 0], [0, 1, 0], 3.0, (2.0, 2.0), (36, 36))
NEAR = 2e-6  # a few roundings of float32 in u, v and the weights of the four texels


def drawn(path, device, **options) -> np.ndarray:
    """Render a file's meshes without light, seen from the front: colors and coverage (36, 36, 4)."""
    scene = load(path, **options)
    with Renderer(scene, shader="nolight", device=device) as renderer:
        frame = renderer.render(camera=FRONT)
        return np.dstack([frame.rgb, frame.alpha])


def texels(image: np.ndarray) -> np.ndarray:
    """Return the colors (4, 4, 3) of the pixels at the texels' centers."""
    return image[4::9, 4::9, :3]


def obj_square(tmp_path, uvs: str, mtl: str, colors: str = "", name: str = "p.png") -> str:
    Image.fromarray(PICTURE).save(tmp_path / name)
    write(tmp_path / "a.mtl", f"newmtl m\n{mtl}")
    lines = "".join(f"v {x} {y} {z}{colors}\n" for x, y, z in SQUARE.tolist())
    return write(tmp_path / "a.obj", f"mtllib a.mtl\n{lines}{uvs}usemtl m\nf 1/1 2/2 3/3 4/4\n")


UVS = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
GLTF_UVS = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)  # v = 0 is the top
QUAD = np.array([0, 1, 2, 0, 2, 3], np.uint16)


def gltf_square(tmp_path, colors=None) -> str:
    document = Gltf()
    document.add("images", {"bufferView": document.view(png(PICTURE)), "mimeType": "image/png"})
    document.add("textures", {"source": 0})
    document.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    attributes = {"POSITION": SQUARE, "TEXCOORD_0": GLTF_UVS, **({} if colors is None else {"COLOR_0": colors})}
    document.mesh(attributes, QUAD, material=0)
    return document.glb(tmp_path / "a.glb")


def ply_square(tmp_path, form: str) -> str:
    Image.fromarray(PICTURE).save(tmp_path / "my picture.png")
    head = "comment TextureFile my picture.png\nelement vertex 4\n"
    head += "".join(f"property float {name}\n" for name in ("x", "y", "z", "s", "t"))
    head += "element tristrips 1\nproperty list int int vertex_indices\n"
    uvs = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    rows = [("5f", [*map(float, corner), *uv]) for corner, uv in zip(SQUARE, uvs, strict=True)]
    return write(tmp_path / "a.ply", ply(form, head, [*rows, ("i4i", [4, 0, 1, 3, 2])]))


@pytest.mark.sampled
@pytest.mark.parametrize("kind", ["obj", "ply", "binary ply", "glb", "own texture"])
def test_the_picture_is_upright_and_decoded(tmp_path, device, kind):
    if kind == "obj":
        name = "two  blanks\tand a tab.png"
        path, options = obj_square(tmp_path, UVS, f"map_Kd {name}\n", name=name), {}
    elif "ply" in kind:
        path, options = ply_square(tmp_path, "binary_big_endian" if kind != "ply" else "ascii"), {}
    elif kind == "glb":
        path, options = gltf_square(tmp_path), {}
    else:
        path, options = obj_square(tmp_path, UVS, "Kd 1 1 1\n"), {"texture": tmp_path / "p.png"}
    image = drawn(path, device, **options)
    assert (image[:, :, 3] == 1).all()
    np.testing.assert_allclose(texels(image), LINEAR, atol=NEAR)


@pytest.mark.long
def test_vertex_colors_multiply_texels(tmp_path, device):
    """Codes of sRGB in OBJ files, linear in glTF files, or as the option says; alpha blends with the background."""
    codes = np.array([0.5, 0.25, 1])
    paths = [obj_square(tmp_path, UVS, "map_Kd p.png\n", colors=" 0.5 0.25 1")]
    paths.append(gltf_square(tmp_path, colors=np.array([codes] * 4, np.float32)))
    for path, usual in zip(paths, ("srgb", "linear"), strict=True):
        for option, meaning in ((None, usual), ("srgb", "srgb"), ("linear", "linear")):
            expected = LINEAR * (codes if meaning == "linear" else srgb_to_linear(codes))
            np.testing.assert_allclose(texels(drawn(path, device, vertex_colors=option)), expected, atol=NEAR)
    path = obj_square(tmp_path, UVS, "map_Kd p.png\n", colors=" 1 1 1 0.25")
    np.testing.assert_allclose(texels(drawn(path, device)), LINEAR * 0.25 + BACKGROUND * 0.75, atol=NEAR)


def test_normals_that_are_none_are_computed(tmp_path):
    document = Gltf()
    document.mesh({"POSITION": SQUARE, "NORMAL": np.float32([[0, 0, 0], [0, np.nan, 0]] * 2)}, QUAD)
    scene, (message,) = scene_and_warnings(document.glb(tmp_path / "a.glb"))
    assert scene.meshes[0].normals.tolist() == [[0, 0, 1]] * 4
    assert message.endswith(
        "primitives[0].attributes.NORMAL: normals that are 0 or not finite were computed from the faces: 4"
    )
