"""Material libraries: options of maps, masks, illumination models, warnings; creases and light of OBJ files."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from PIL import Image
from scene_files import TEXTURED, TRIANGLE, refusal, scene_and_warnings, write

from clshade.errors import InputError
from clshade.images.decode import decode_image, read_image
from clshade.scene.formats.load import load
from clshade.scene.framing import AMBIENT

RNG = np.random.default_rng(9)


def material_of(tmp_path, text: str):
    """Load a triangle with that material; return the mesh, the scene and the warnings."""
    write(tmp_path / "a.mtl", "newmtl m\n" + text)
    scene, messages = scene_and_warnings(write(tmp_path / "a.obj", TEXTURED))
    return scene.meshes[0], scene, messages


def test_a_library_named_between_faces_changes_no_material(tmp_path):
    write(tmp_path / "a.mtl", "newmtl m\nKd 1 0 0\n")
    write(tmp_path / "b.mtl", "newmtl n\nKd 0 1 0\n")
    faces = "usemtl m\nf 1 2 3\nmtllib b.mtl\nf 1 2 3\nusemtl n\nf 1 2 3\n"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        meshes = load(write(tmp_path / "a.obj", "mtllib a.mtl\n" + TRIANGLE + faces)).meshes
    assert [len(mesh.faces) for mesh in meshes] == [2, 1]
    assert [mesh.material.kd.tolist() for mesh in meshes] == [[1, 0, 0], [0, 1, 0]]


@pytest.mark.parametrize("name", ["image.png", "my image.png", "my\timage.png", "two  blanks.png", "-s.png", "1 2.png"])
def test_names_of_images(tmp_path, name):
    Image.new("RGB", (3, 2)).save(tmp_path / name)
    mesh, _, messages = material_of(tmp_path, f"map_Kd {name}\n")
    assert messages == []
    assert mesh.material.texture.image.shape == (2, 3, 3)


def test_options_of_maps(tmp_path):
    Image.new("RGB", (3, 2)).save(tmp_path / "my image.png")
    mesh, scene, _ = material_of(tmp_path, "map_Kd -s 2 3 1 -o 0.5 -0.25 -clamp on -blendu on my image.png\n")
    assert mesh.material.texture.wrap == ("clamp", "clamp")
    assert scene.ignored == ("option -blendu of maps",)
    # (u, v) * (2, 3) + (0.5, -0.25) with v = 0 at the bottom, then v = 0 at row 0.
    assert mesh.uvs.tolist() == [[0.5, 1.25], [2.5, 1.25], [0.5, -1.75]]
    mesh, _, _ = material_of(tmp_path, "map_Kd -s 2 my image.png\n")
    assert mesh.uvs.tolist() == [[0, 1], [2, 1], [0, 0]]
    mesh, _, _ = material_of(tmp_path, "map_Kd -o 0.5 0.25 my image.png\n")
    assert mesh.uvs.tolist() == [[0.5, 0.75], [1.5, 0.75], [0.5, -0.25]]
    mesh, _, _ = material_of(tmp_path, "map_Kd -o 0.5 my image.png\n")
    assert mesh.uvs.tolist() == [[0.5, 1], [1.5, 1], [0.5, 0]]
    assert material_of(tmp_path, "map_Kd -mm 0 1 my image.png\n")[1].ignored == ("option -mm of maps",)


@pytest.mark.parametrize(
    "option", ["-s 1e400", "-s 1 -1e999 1", "-o 0 0 1e400", "-t 1e400", "-bm 1e400", "-mm 0 1e400"]
)
def test_numbers_of_options_that_overflow_are_refused(tmp_path, option):
    Image.new("RGB", (3, 2)).save(tmp_path / "image.png")
    write(tmp_path / "a.mtl", f"newmtl m\nmap_Kd {option} image.png\n")
    path = write(tmp_path / "a.obj", TEXTURED)
    name, number = option.split()[0], next(word for word in option.split() if "e" in word)
    refusal(path, f"a.mtl: line 2: map_Kd: {name}: expected finite numbers, found '{number}'")
    write(tmp_path / "a.mtl", f"newmtl m\nmap_Kd {option.replace(number, '1e300')} image.png\n")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert load(path).meshes[0].material.texture is not None


def test_masks(tmp_path):
    colors = RNG.integers(0, 256, (2, 3, 3), dtype=np.uint8)
    mask = np.array([[0, 128, 255], [255, 0, 64]], np.uint8)
    Image.fromarray(colors).save(tmp_path / "c.png")
    Image.fromarray(mask).save(tmp_path / "m.png")
    Image.fromarray(np.dstack([colors, mask])).save(tmp_path / "both.png")
    plain = read_image(tmp_path / "c.png", srgb=True)
    for text in ("map_Kd c.png\nmap_d m.png\n", "map_Kd both.png\nmap_d both.png\n"):
        mesh, scene, messages = material_of(tmp_path, text)
        assert messages == []
        assert (mesh.material.alpha_cutoff, mesh.material.blend, mesh.blends) == (None, True, True)
        assert np.array_equal(mesh.material.texture.image[:, :, :3], plain)
        np.testing.assert_allclose(mesh.material.texture.image[:, :, 3], mask / 255, atol=1e-6)
    mesh, _, _ = material_of(tmp_path, "map_d m.png\n")
    assert (mesh.material.texture.image[:, :, :3] == 1).all()
    Image.fromarray(np.dstack([colors, mask])[:1]).save(tmp_path / "small.png")
    mesh, scene, _ = material_of(tmp_path, "map_Kd c.png\nmap_d small.png\n")
    assert scene.ignored == ("map_d of another size than map_Kd",)
    assert not mesh.blends
    _, _, messages = material_of(tmp_path, "map_Kd both.png\n")
    assert [message.split("/")[-1] for message in messages] == ["both.png: image: its alpha channel is left out"]


@pytest.mark.parametrize(
    ("text", "opacity"),
    [
        ("d 0.25", 0.25),
        ("Tr 0.25", 0.75),
        ("d -halo 0.5", 0.5),
        ("d 1", 1.0),
        ("Tr 0", 1.0),
        ("d 0.5\nTr 1", 0.5),
        ("Tr 0.9\nd 1", 1.0),
        ("d 0\nTr 0", 0.0),
        ("d -3", 0.0),
        ("d 7", 1.0),
    ],
)
def test_opacity(tmp_path, text, opacity):
    mesh, scene, messages = material_of(tmp_path, text + "\n")
    assert (mesh.material.opacity, mesh.material.blend) == (opacity, opacity < 1.0)
    assert (scene.ignored, messages) == ((), [])


def test_full_transparency_alone_counts_as_opaque(tmp_path):
    mesh, _, messages = material_of(tmp_path, "Tr 1.0\nnewmtl m2\nTr 1\n")
    assert (mesh.material.opacity, mesh.material.blend) == (1.0, False)
    (message,) = messages
    assert message.endswith("a.obj: materials with Tr 1 and without d are read as opaque")


@pytest.mark.parametrize("kd", ["Kd 0 0 0\nmap_Kd {}\n", "map_Kd {}\nKd 0.0\n"])
def test_black_beside_a_map_counts_as_white(tmp_path, kd):
    Image.new("RGB", (3, 2)).save(tmp_path / "a.png")
    for name in ("a.png", "none.png"):
        mesh, _, messages = material_of(tmp_path, kd.format(name))
        assert (mesh.material.kd.tolist(), mesh.material.ka.tolist()) == ([1, 1, 1], [1, 1, 1])
        assert messages[-1].endswith("a.obj: materials with Kd 0 0 0 and a map_Kd are read with Kd 1 1 1")
    assert load(tmp_path / "a.obj", texture=np.ones((1, 1, 3))).meshes[0].material.kd.tolist() == [1, 1, 1]
    assert material_of(tmp_path, "Kd 0 0 0\n")[0].material.kd.tolist() == [0, 0, 0]


@pytest.mark.parametrize("text", ["d", "d half", "Tr nan", "d 0.5 0.5"])
def test_an_opacity_that_is_no_number_is_refused(tmp_path, text):
    if text == "d":
        assert material_of(tmp_path, "d\n")[0].material.opacity == 1.0
        return
    with pytest.raises(InputError, match=r"a\.mtl: line \d+: (d|Tr): expected a number, found"):
        material_of(tmp_path, text + "\n")


def test_models_of_illumination(tmp_path):
    values = "Kd 1 0.5 0.25\nKs 1 1 1\nNs 9\n"
    mesh, _, _ = material_of(tmp_path, values + "illum 2\n")
    material = mesh.material
    assert (material.kd.tolist(), material.ks.tolist(), material.n) == ([1, 0.5, 0.25], [1] * 3, 9)
    assert material.ka.tolist() == material.kd.tolist()  # no Ka is given
    assert material_of(tmp_path, values + "illum 1\n")[0].material.ks.tolist() == [0] * 3
    flat = material_of(tmp_path, values + "illum 0\n")[0].material
    assert (flat.ka * AMBIENT * flat.color).tolist() == [1, 0.5, 0.25]
    assert not flat.kd.any()
    assert material_of(tmp_path, "illum 7\n")[1].ignored == ("reflection and refraction (illum)",)


def test_an_exponent_of_0_is_no_highlight(tmp_path):
    for text, ks in (("Ks 1\nNs -1.96\n", 0.0), ("Ks 1\nNs 0\n", 0.0), ("Ns 0.0\nKs 1\n", 0.0), ("Ks 1\nNs 1\n", 1.0)):
        assert material_of(tmp_path, text)[0].material.ks.tolist() == [ks] * 3, text


def test_what_is_not_rendered_is_told_once(tmp_path):
    text = "Tf 0.5 1 1\nKe 1 1 1\nmap_Bump -bm 2 b.png\nbump b.png\nmap_Ks k.png\n"
    _, scene, messages = material_of(tmp_path, text)
    assert scene.ignored == ("transmission", "emission", "normal maps", "maps of Ka, Ks and Ns")
    assert len(messages) == 1
    assert "a.obj: not rendered: transmission, emission" in messages[0]
    assert material_of(tmp_path, "d 1.0\nTr 0\nKe 0 0 0\nNi 1.5\nPs 0\nPc 0.0\naniso 0\n")[2] == []
    Image.new("RGB", (3, 2)).save(tmp_path / "a.png")
    _, scene, _ = material_of(tmp_path, "Pm 1\nPc 0.5\nmap_Tr a.png\nmap_Kd a.png\n")
    assert scene.ignored == ("metallic-roughness", "sheen, clearcoat and anisotropy", "map_tr")
    bare, _ = scene_and_warnings(write(tmp_path / "b.obj", "mtllib a.mtl\n" + TRIANGLE + "usemtl m\nf 1 2 3\n"))
    assert bare.ignored[-1] == "textures of faces without texture coordinates"


def test_creases_of_a_whole_file(tmp_path):
    verts = "v 0 0 0\nv 0 1 0\nv -1 0 0\nv 0.9 0 -0.3\n"
    text = verts + "o a\nf 1 2 3\no b\nf 2 1 4\n"
    for crease, same in ((30, True), (10, False)):
        one, two = load(write(tmp_path / "a.obj", text), crease=crease).meshes
        shared = one.normals[one.normal_faces[0, 0]], two.normals[two.normal_faces[0, 1]]
        assert np.allclose(*shared) is same
    flat = load(tmp_path / "a.obj", flat=True).meshes[0]
    assert np.ptp(flat.normals[flat.normal_faces], axis=(0, 1)).max() == 0
    mesh = load(write(tmp_path / "b.obj", TRIANGLE + "vn 1 0 0\nf 1//1 2//1 3//1\n"), crease=10).meshes[0]
    assert mesh.normals.tolist() == [[1, 0, 0]]  # the file's own are kept


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_alpha_is_kept_only_where_it_is_needed(tmp_path, channels):
    pixels = RNG.integers(0, 256, (4, 5, channels), dtype=np.uint8)
    image = Image.fromarray(pixels[:, :, 0] if channels == 1 else pixels)
    image.save(tmp_path / "a.png")
    texels = decode_image((tmp_path / "a.png").read_bytes(), "a.png", srgb=False)
    assert texels.shape == (4, 5, 4 if channels in (2, 4) else 3)
    expected = np.asarray(image.convert("RGBA")) / 255
    np.testing.assert_allclose(texels, expected[:, :, : texels.shape[2]], atol=1e-6)
    if channels in (2, 4):
        pixels[:, :, -1] = 255
        Image.fromarray(pixels).save(tmp_path / "a.png")
        assert decode_image((tmp_path / "a.png").read_bytes(), "a.png", srgb=False).shape == (4, 5, 3)
