"""Material libraries: options of maps, masks, illumination models, warnings; creases and light of OBJ files."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_writers import png
from PIL import Image
from scene_files import ROOF, TEXTURED, TRIANGLE, scene_and_warnings, write

from clshade.images.decode import decode_image, read_image
from clshade.scene.formats.load import load
from clshade.scene.framing import AMBIENT

RNG = np.random.default_rng(9)


def material_of(tmp_path, text: str):
    """Load a triangle with that material; return the mesh, the scene and the warnings."""
    write(tmp_path / "a.mtl", "newmtl m\n" + text)
    scene, messages = scene_and_warnings(write(tmp_path / "a.obj", TEXTURED))
    return scene.meshes[0], scene, messages


@pytest.mark.parametrize("name", ["my image.png", "my\timage.png", "two  blanks.png", "-s.png", "1 2.png"])
def test_names_of_images(tmp_path, name):
    Image.new("RGB", (3, 2)).save(tmp_path / name)
    mesh, _, messages = material_of(tmp_path, f"map_Kd {name}\n")
    assert messages == []
    assert mesh.material.texture.image.shape == (2, 3, 3)


@pytest.mark.parametrize(
    ("options", "uvs", "wrap", "ignored"),
    [
        # (u, v) * (2, 3) + (0.5, -0.25) with v = 0 at the bottom, then v = 0 at row 0.
        ("-s 2 3 1 -o 0.5 -0.25 -clamp on", [[0.5, 1.25], [2.5, 1.25], [0.5, -1.75]], "clamp", ()),
        ("-s 2 -blendu on", [[0, 1], [2, 1], [0, 0]], "repeat", ("option -blendu of maps",)),
        ("-s 1e300 1e300 1 -o 0.5 0.25 -clamp off", None, "repeat", ()),
        ("-o 0.5 0.25", [[0.5, 0.75], [1.5, 0.75], [0.5, -0.25]], "repeat", ()),
        ("-o 0.5 -mm 0 1", [[0.5, 1], [1.5, 1], [0.5, 0]], "repeat", ("option -mm of maps",)),
    ],
)
def test_options_of_maps(tmp_path, options, uvs, wrap, ignored):
    for name in ("my image.png", "image.png"):
        Image.new("RGB", (3, 2)).save(tmp_path / name)
        mesh, scene, _ = material_of(tmp_path, f"map_Kd {options} {name}\n")
        assert (mesh.material.texture.wrap, scene.ignored) == ((wrap, wrap), ignored)
        assert uvs is None or mesh.uvs.tolist() == uvs


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


def test_opacity(tmp_path):
    for text, opacity in {
        **{"d 0.25": 0.25, "Tr 0.25": 0.75, "d -halo 0.5": 0.5, "d 1": 1.0, "Tr 0": 1.0, "d": 1.0},
        **{"d 0.5\nTr 1": 0.5, "Tr 0.9\nd 1": 1.0, "d 0\nTr 0": 0.0, "d -3": 0.0, "d 7": 1.0},
    }.items():
        mesh, scene, messages = material_of(tmp_path, text + "\n")
        assert (mesh.material.opacity, mesh.material.blend) == (opacity, opacity < 1.0), text
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
    verts, *faces = ROOF.split("f ")
    objects = "".join(f"o {name}\nf {face}" for name, face in zip("ab", faces, strict=True))
    path = write(tmp_path / "a.obj", verts + objects)
    for crease, smooth in ((30, True), (10, False)):
        one, two = load(path, crease=crease).meshes
        shared = one.normals[one.normal_faces[0, 0]], two.normals[two.normal_faces[0, 1]]
        assert np.allclose(*shared) is smooth
    flat = load(path, flat=True).meshes[0]
    assert np.ptp(flat.normals[flat.normal_faces], axis=(0, 1)).max() == 0
    mesh = load(write(tmp_path / "b.obj", TRIANGLE + "vn 1 0 0\nf 1//1 2//1 3//1\n"), crease=10).meshes[0]
    assert mesh.normals.tolist() == [[1, 0, 0]]  # the file's own are kept


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_alpha_is_kept_only_where_it_is_needed(channels):
    pixels = RNG.integers(0, 256, (4, 5, channels), dtype=np.uint8)
    for opaque in (False, True):
        pixels[:, :, -1:] = 255 if opaque and channels in (2, 4) else pixels[:, :, -1:]
        texels = decode_image(png(pixels.squeeze()), "a.png", srgb=False)
        assert texels.shape == (4, 5, 4 if channels in (2, 4) and not opaque else 3)
        expected = np.asarray(Image.fromarray(pixels.squeeze()).convert("RGBA")) / 255
        np.testing.assert_allclose(texels, expected[:, :, : texels.shape[2]], atol=1e-6)
