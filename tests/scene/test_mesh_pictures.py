"""From mesh file to image: the texel, color or material that a pixel shows, for each format and its features."""

from __future__ import annotations

import math

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


def gltf_square(tmp_path, uvs=GLTF_UVS, pixels=PICTURE, material=None, colors=None, sampler=None, **info) -> str:
    document = Gltf()
    document.add("images", {"bufferView": document.view(png(pixels)), "mimeType": "image/png"})
    document.add("textures", {"source": 0, **({} if sampler is None else {"sampler": 0})})
    if sampler is not None:
        document.add("samplers", sampler)
    reflection = {"baseColorTexture": {"index": 0, **info}}
    document.add("materials", {"pbrMetallicRoughness": reflection, **(material or {})})
    attributes = {"POSITION": SQUARE, "TEXCOORD_0": uvs, **({} if colors is None else {"COLOR_0": colors})}
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


@pytest.mark.parametrize("normal", [0.0, np.nan])
def test_normals_that_are_none_are_computed(tmp_path, normal):
    document = Gltf()
    document.mesh({"POSITION": SQUARE, "NORMAL": np.full((4, 3), normal, np.float32)}, QUAD)
    scene, messages = scene_and_warnings(document.glb(tmp_path / "a.glb"))
    (mesh,) = scene.meshes
    assert mesh.normals.tolist() == [[0, 0, 1]] * 4
    where = f"{tmp_path}/a.glb: meshes[0].primitives[0].attributes.NORMAL"
    assert messages == [f"{where}: normals that are 0 or not finite were computed from the faces: 4"]


WRAPS = [(10497, lambda k: k % 4), (33071, lambda k: np.clip(k, 0, 3)), (33648, lambda k: np.minimum(k % 8, 7 - k % 8))]


@pytest.mark.parametrize(("mode", "texel"), WRAPS, ids=["repeat", "clamp", "mirror"])
def test_wrap_modes(tmp_path, device, mode, texel):
    """The square shows the texture offset by its size to the right and down: texels 4 to 7, and -4 to -1."""
    for shift in (1, -1):
        path = gltf_square(tmp_path, uvs=GLTF_UVS + np.float32(shift), sampler={"wrapS": mode, "wrapT": mode})
        indices = texel(np.arange(4) + 4 * shift)
        expected = LINEAR[indices][:, indices]
        np.testing.assert_allclose(texels(drawn(path, device)), expected, atol=NEAR)


def test_texture_transforms(tmp_path, device):
    """A quarter turn about the texture's top left corner, then a shift down by its size: the left side is at the
    top."""
    moved = {"offset": [0, 1], "rotation": math.pi / 2}
    path = gltf_square(tmp_path, extensions={"KHR_texture_transform": moved})
    # (u, v) -> (v, 1 - u): the pixel at column x, row y shows column y, row 3 - x.
    np.testing.assert_allclose(texels(drawn(path, device)), LINEAR.transpose(1, 0, 2)[:, ::-1], atol=NEAR)
    path = obj_square(tmp_path, UVS, "map_Kd -o 0.25 0.5 p.png\n")
    expected = np.roll(LINEAR, (2, -1), axis=(0, 1))
    np.testing.assert_allclose(texels(drawn(path, device)), expected, atol=NEAR)


@pytest.mark.long
def test_alpha_masks_leave_holes(tmp_path, device):
    alpha = np.full((4, 4, 1), 255, np.uint8)
    alpha[1, 2] = 0
    path = gltf_square(tmp_path, pixels=np.dstack([PICTURE, alpha]), material={"alphaMode": "MASK"})
    image = drawn(path, device)
    hole = np.zeros((36, 36), bool)
    hole[9:18, 18:27] = True  # row 1, column 2
    assert not image[11:16, 20:25, 3].any()
    assert (image[:, :, 3] == 1)[~hole].all()  # alpha goes from 0 to 1 between texel centers


@pytest.mark.long
def test_face_colors_and_materials(tmp_path, device):
    """Two triangles: of two colors in a PLY file, of two materials with a texture each in an OBJ file."""
    head = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n"
    head += "property list uchar int vertex_indices\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
    rows = [("3f", list(map(float, corner))) for corner in SQUARE]
    rows += [("B3i3B", [3, 0, 1, 2, 255, 0, 51]), ("B3i3B", [3, 0, 2, 3, 0, 128, 255])]
    one, two = (srgb_to_linear(np.array(color) / 255) for color in ([255, 0, 51], [0, 128, 255]))
    lower, upper = (31, 33), (4, 2)  # pixels, row and column, in either triangle
    image = drawn(write(tmp_path / "a.ply", ply("binary_little_endian", head, rows)), device)
    np.testing.assert_allclose([image[lower][:3], image[upper][:3]], [one, two], atol=1e-6)
    for name, color in (("one.png", [255, 0, 51]), ("two.png", [0, 128, 255])):
        Image.new("RGB", (2, 2), tuple(color)).save(tmp_path / name)
    write(tmp_path / "a.mtl", "newmtl a\nmap_Kd one.png\nnewmtl b\nmap_Kd two.png\n")
    text = "mtllib a.mtl\n" + "".join(f"v {x} {y} {z}\n" for x, y, z in SQUARE.tolist()) + UVS
    text += "usemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 1/1 3/3 4/4\n"
    image = drawn(write(tmp_path / "a.obj", text), device)
    np.testing.assert_allclose([image[lower][:3], image[upper][:3]], [one, two], atol=1e-6)


@pytest.mark.long
def test_instances_and_nodes(tmp_path, device):
    """One small square, placed twice under a parent that moves both."""
    document = Gltf()
    document.mesh({"POSITION": SQUARE * np.float32(0.25)}, QUAD)
    document.add("nodes", {"children": [1, 2], "translation": [0, 0.5, 0]})
    document.add("nodes", {"mesh": 0, "translation": [-0.5, 0, 0]})
    document.add("nodes", {"mesh": 0, "translation": [0.5, -1, 0], "scale": [-1, 1, 1]})
    document.add("scenes", {"nodes": [0]})
    expected = np.zeros((36, 36))
    expected[4:13, 4:13] = expected[22:31, 22:31] = 1  # from 4.5 to 13.5 and from 22.5 to 31.5: the centers in between
    assert np.array_equal(drawn(document.glb(tmp_path / "a.glb"), device)[:, :, 3], expected)
