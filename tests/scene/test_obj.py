"""OBJ files and their material libraries: the meaning of handwritten files, and parsers of the same text."""

from functools import partial
from operator import eq

import numpy as np
import pytest
from mesh_writers import png
from PIL import Image
from scene_files import ROOF, TEXTURED, TRIANGLE, refusal, scene_and_warnings, write

from clshade.images.decode import decode_image, read_image, srgb_to_linear
from clshade.scene import geometry
from clshade.scene.contents import object_names, object_numbers
from clshade.scene.formats import text_tokens
from clshade.scene.formats.load import load
from clshade.scene.formats.obj import ObjText
from clshade.scene.framing import AMBIENT
from clshade.scene.triangulate import triangulated


def test_positions_uvs_and_normals_keep_their_own_indices(tmp_path):
    text = TRIANGLE + "vt 0 0\nvt 0.25 1\nvn 0 0 2\nf 1/2/1 2/1/1 3/2/1\n"
    scene, messages = scene_and_warnings(write(tmp_path / "a.obj", text))
    assert messages == []
    (mesh,) = scene.meshes
    assert mesh.verts.dtype == np.float64
    assert mesh.verts.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2]]
    assert mesh.uv_faces.tolist() == [[1, 0, 1]]
    assert mesh.normal_faces.tolist() == [[0, 0, 0]]
    assert mesh.normals.tolist() == [[0, 0, 2]]
    assert mesh.uvs.tolist() == [[0, 1], [0.25, 0]]  # v = 0 is the bottom in the file, row 0 of the image here
    assert (scene.preset, scene.name, mesh.name) == ("standard", "a", "a")


def test_faces_as_written():
    """Any form of a corner, polygons cut as fans, indices relative to their line, faces without area."""
    text = TRIANGLE + "vt 0 0\nvt 1 0\nvt 0 1\n" + "vn 0 0 1\n" * 3
    plain = [[0, -1, -1], [1, -1, -1], [2, -1, -1]]
    for face, expected in (
        *((face, [plain]) for face in ("f +1 2 3", "f 1/ 2/ 3/", "f 1// 2// 3//")),
        ("f 1/2/ 2/2/ 3/2/", [[[0, 1, -1], [1, 1, -1], [2, 1, -1]]]),
        ("f -3/-1/-3 -2/-2/-2 -1/-3/-1", [[[0, 2, 0], [1, 1, 1], [2, 0, 2]]]),
        ("f 1 2 2 3\nf 1 1 1", [plain[:2] + plain[1:2], plain, plain[:1] * 3]),
        (f"f 1 2 3\n{TRIANGLE}f -3 -2 -1", [plain, [[3, -1, -1], [4, -1, -1], [5, -1, -1]]]),
    ):
        assert ObjText((text + face).encode(), "x.obj").indices.tolist() == expected, face


@pytest.mark.parametrize(
    "text",
    [
        "\ufeff" + TRIANGLE + "f 1 2 3\n",
        TRIANGLE.replace("\n", "\r\n") + "f 1 2 3\r\n",
        TRIANGLE.replace("\n", "\r") + "f 1 2 3\r",
        "# c\n" + TRIANGLE + "\n \t\n  f  1\t2   3  # v 9 9 9\n",
        TRIANGLE + "f 1 2 3",
        TRIANGLE + "f 1 2\\\n 3\n",
        TRIANGLE + "f 1 \\\r\n2 \\\r\n3\n",
        "v 0 0 0 1.0\nv 1.0e0 -0 .0 1\nv 0. +1 0e9 1\nf 1 2 3",
        TRIANGLE + "s off\nl 1 2\np 1\nvp 1 2\nmg 1 2\nshadow_obj x\n#f 9 9 9\nf 1 2 3\n",
        TRIANGLE + "# C:\\folder\\\nf 1 2 3\n",
        "f 1 2 3\n" + TRIANGLE,
    ],
)
@pytest.mark.filterwarnings("ignore:.*not rendered. lines, points")
def test_forms_of_the_text(tmp_path, text):
    (mesh,) = load(write(tmp_path / "a.obj", text)).meshes
    assert mesh.verts.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert mesh.faces.tolist() == [[0, 1, 2]]


def plain(text: str) -> tuple[list, list, list, list]:
    """Parse a valid file in the obvious way: positions, uvs, normals and the corners of polygons."""
    rows: dict[str, list] = {"v": [], "vt": [], "vn": []}
    faces = []
    for line in text.splitlines():
        words = line.split("#")[0].split()
        if words and words[0] in rows:
            rows[words[0]].append([float(word) for word in words[1:]])
        elif words and words[0] == "f":
            polygon = []
            for word in words[1:]:
                numbers = [int(part or "0") for part in (word + "//").split("/")[:3]]
                polygon.append([n - 1 if n >= 0 else len(of) + n for n, of in zip(numbers, rows.values(), strict=True)])
            faces.append(polygon)
    return rows["v"], rows["vt"], rows["vn"], faces


def random_text(rng: np.random.Generator) -> str:
    """Return a file that mixes all forms; every index is valid at its position."""
    lines, counts = [], [0, 0, 0]
    for _ in range(rng.integers(5, 120)):
        kind = rng.integers(0, 8)
        if kind < 3 or 0 in counts:
            which = kind if kind < 3 else counts.index(0)
            numbers = [f"{x:.{rng.integers(0, 17)}{rng.choice(['f', 'e', 'g'])}}" for x in rng.standard_normal(3)]
            lines.append(("v", "vt", "vn")[which] + " " + " ".join(numbers[: 2 if which == 1 else 3]))
            counts[which] += 1
        elif kind < 7:
            form, words = rng.integers(0, 4), []
            for _ in range(rng.integers(3, 7)):
                n = [int(rng.integers(1, c + 1)) - (c + 1) * int(rng.integers(0, 2)) for c in counts]
                words.append((f"{n[0]}", f"{n[0]}/{n[1]}", f"{n[0]}//{n[2]}", f"{n[0]}/{n[1]}/{n[2]}")[form])
            lines.append("f " + (" ", "  ", "\t")[rng.integers(0, 3)].join(words))
        else:
            lines.append(("", "# f 1 2 3", "g a b", "s 1", "usemtl x#1", "  ")[rng.integers(0, 6)])
    return "\n".join([*lines, *(f"{k} 1 2 3" for k in ("v", "vt", "vn")), "f 1 1 1", ""])


@pytest.mark.parametrize("chunk", [7, 1 << 20])
def test_against_the_obvious_parser(monkeypatch, chunk):
    monkeypatch.setattr(text_tokens, "CHUNK", chunk)
    rng = np.random.default_rng(chunk)
    for _ in range(5):
        text = random_text(rng)
        verts, uvs, normals, polygons = plain(text)
        parsed = ObjText(text.encode(), "x.obj")
        assert parsed.verts.tolist() == verts
        assert parsed.uvs.tolist() == [uv[:2] for uv in uvs]
        assert parsed.normals.tolist() == normals
        corners = np.array([corner for polygon in polygons for corner in polygon])
        cuts = triangulated(np.array(verts), corners[:, 0], np.array([len(polygon) for polygon in polygons]))
        assert parsed.indices.tolist() == cuts.triangles(corners).tolist()


@pytest.mark.parametrize("chunk", [1, 100])
def test_chunks_of_any_size_are_the_same_file(monkeypatch, chunk):
    """Colors of some vertices, names, libraries on their lines, smoothing, comments and continued lines."""
    block = "# a\nmtllib {k}.mtl\nv 0 0 {k} 1 0 0.5\nv 1 0 0\nv 0 1 0 0 {k} 0 .5\no {k}\nusemtl m{k} \\\n x\ns {k}\n"
    block += "f -3 -2 \\\n-1\ng g{k} # none\nvt 0 {k}\nf -1/1 -2/1 -3/-1 -1/-1\nl 1 2\ncurv {k}\n"
    data = "".join(block.replace("{k}", str(k)) for k in range(12)).encode()
    reference = ObjText(data, "a.obj")
    monkeypatch.setattr(text_tokens, "CHUNK", chunk)
    parts = ObjText(data, "a.obj")
    names = {name for name in vars(reference) if not name.startswith("_")}
    assert names >= {"verts", "colored", "colors", "uvs", "normals", "indices", "runs", "libraries", "smoothing"}
    for name in names:
        expected, actual = getattr(reference, name), getattr(parts, name)
        same = partial(np.array_equal, equal_nan=True) if isinstance(expected, np.ndarray) else eq
        assert same(expected, actual), name
    assert reference.colored.tolist() == [3 * k + corner for k in range(12) for corner in (0, 2)]
    colors = [row for k in range(12) for row in ([1, 0, 0.5, np.nan], [0, k, 0, 0.5])]
    np.testing.assert_array_equal(reference.colors, colors)
    assert reference.libraries == [(16 * k + 2, f"{k}.mtl") for k in range(12)]
    assert len(reference.runs) == 24


def test_lines_are_counted_across_chunks(tmp_path, monkeypatch):
    monkeypatch.setattr(text_tokens, "CHUNK", 10)
    text = TRIANGLE + "f 1 2 3\n" * 50
    refusal(write(tmp_path / "a.obj", text + "f 1 2 7\n" + "f 1 2 3\n" * 9), "line 54: f: ")
    refusal(write(tmp_path / "a.obj", text + "v 1 2 q\n"), "line 54: v: ")
    refusal(write(tmp_path / "a.obj", text + "?\n"), "line 54: keyword: ")


SQUARE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\n"


def test_materials_and_objects_make_meshes_in_the_order_of_the_file(tmp_path):
    write(tmp_path / "m.mtl", "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\n")
    body = "usemtl a\nf 1 2 3\nusemtl b\nf 2 4 3\nusemtl a\nf 4 1 2\nusemtl a\nf 1 2 4\no part\nf 1 1 1\n"
    scene, messages = scene_and_warnings(write(tmp_path / "a.obj", "mtllib m.mtl\n" + SQUARE + body))
    assert messages == []
    assert [mesh.material.kd.tolist() for mesh in scene.meshes] == [[1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 0, 0]]
    assert [mesh.name for mesh in scene.meshes] == ["a", "a", "a", "part"]
    assert scene.meshes[0].material is scene.meshes[2].material
    positions = np.concatenate([mesh.verts[mesh.faces] for mesh in scene.meshes])
    expected = ObjText((SQUARE + body).encode(), "x")
    assert np.array_equal(positions, expected.verts[expected.indices[:, :, 0]])
    # Without normals in the file, vertex normals average all faces, so that no seam is visible.
    normals = geometry.vertex_normals(expected.verts, expected.indices[:, :, 0])
    got = np.concatenate([mesh.normals[mesh.faces] for mesh in scene.meshes])
    assert np.array_equal(got, normals[expected.indices[:, :, 0]])
    assert len(scene.meshes[1].verts) == 3


@pytest.mark.filterwarnings("ignore:.*no library defines")
@pytest.mark.parametrize(
    ("lines", "objects", "names"),
    [
        ("g left\n#\ng right\n#\n", [1, 2], ["left", "right"]),
        ("o all\ng left\n#\ng right\n#\n", [1], ["all"]),
        ("o a\nusemtl x\n#\nusemtl y\n#\no b\n#\no a\n#\n", [1, 1, 2, 1], ["a", "b"]),
        ("usemtl x\n#\nusemtl y\n#\n", [1, 1], ["file"]),
        ("#\no b\n#\no\n#\n", [1, 2, 1], ["file", "b"]),
    ],
)
def test_objects_are_those_of_the_file_whatever_their_materials(lines, objects, names, tmp_path):
    """Groups are objects in a file without any; a name that comes again goes on."""
    scene = load(write(tmp_path / "file.obj", SQUARE + lines.replace("#", "f 1 2 3")))
    assert object_numbers(scene) == objects
    assert object_names(scene) == names


def test_faces_with_and_without_uvs_and_normals(tmp_path):
    text = SQUARE + "vt 0 0\nvt 1 1\nvn 0 0 1\nf 1/1 2/2 3/1\nf 2 4 3\nf 4//1 1//1 2//1\nf 1/1/1 2/2/1 4/1/1\n"
    meshes = load(write(tmp_path / "a.obj", text), texture=np.ones((2, 2, 3))).meshes
    assert [mesh.uvs is not None for mesh in meshes] == [True, False, False, True]
    assert [mesh.normal_faces is not None for mesh in meshes] == [False, False, True, True]
    assert [mesh.material.texture is not None for mesh in meshes] == [True, False, False, True]
    assert meshes[3].uvs[meshes[3].uv_faces].tolist() == [[[0, 1], [1, 0], [0, 1]]]


def test_vertex_colors(tmp_path):
    text = "v 0 0 0 0.5 0.25 1\nv 1 0 0\nv 0 1 0 nan 0 0\nf 1 2 3\n"
    path = write(tmp_path / "a.obj", text)
    scene, messages = scene_and_warnings(path)
    np.testing.assert_allclose(scene.meshes[0].colors, [[0.214041, 0.050876, 1], [1, 1, 1], [1, 1, 1]], atol=1e-6)
    assert scene_and_warnings(path, vertex_colors="linear")[0].meshes[0].colors[0].tolist() == [0.5, 0.25, 1]
    assert [message.split("/")[-1] for message in messages] == ["a.obj: v: colors that are not finite became white: 1"]
    scene, messages = scene_and_warnings(write(tmp_path / "c.obj", text.replace("nan 0", "1e300 -1")))
    assert (scene.meshes[0].colors[2].tolist(), messages) == ([np.finfo(np.float32).max, 0, 0], [])
    assert load(write(tmp_path / "b.obj", TRIANGLE + "f 1 2 3\n")).meshes[0].colors is None
    for alphas, expected in (("255", 1.0), ("0.5", 0.5)):  # those of some say nothing of others
        text = f"v 0 0 0 0.5 0 0\nv 1 0 0\nv 0 1 0 0 1 0 {alphas}\nf 1 2 3\n"
        (mesh,) = scene_and_warnings(write(tmp_path / "a.obj", text))[0].meshes
        assert (np.ones(3) if mesh.alphas is None else mesh.alphas).tolist() == [1.0, 1.0, expected]


def test_normals_that_are_none_are_computed(tmp_path):
    """The square is clockwise as seen along its other normals: all its faces turn, and the computed normal with them."""
    square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    text = f"{square}vn 0 0 -2\nvn 0 inf 0\nf 1//1 2//1 3//2\nf 1//1 3//2 4//1\n"
    scene, messages = scene_and_warnings(write(tmp_path / "a.obj", text))
    (mesh,) = scene.meshes
    assert mesh.normals[mesh.normal_faces][:, :, 2].tolist() == [[-2, -1, -2], [-2, -2, -1]]
    assert messages == [f"{tmp_path}/a.obj: vn: normals that are 0 or not finite were computed from the faces: 1"]
    text = f"{square}vn 0 0 1\nvn 0 0 0\nf 1//1 2//1 3//1\n"
    assert scene_and_warnings(write(tmp_path / "b.obj", text))[1] == []  # no face uses it


def test_material_values_and_texture(tmp_path):
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3) * 10
    write(tmp_path / "maps" / "x.txt", "")
    Image.fromarray(pixels).save(tmp_path / "maps" / "my image.png")
    mtl = "# c\nnewmtl m\n\tKa 0.5 0.5 0.5\nKd .25 0.5 1 # c\nKs 0.125\nNs 32\nillum 2\nmap_Kd maps\\my image.png\n"
    write(tmp_path / "a.mtl", mtl)
    scene, messages = scene_and_warnings(write(tmp_path / "a.obj", TEXTURED))
    assert messages == []
    material = scene.meshes[0].material
    assert (material.ka.tolist(), material.kd.tolist()) == ([0.5] * 3, [0.25, 0.5, 1])
    assert (material.ks.tolist(), material.n, material.name) == ([0.125] * 3, 32.0, "m")
    assert material.texture.lookup == "standard"
    assert np.array_equal(material.texture.image, srgb_to_linear(pixels / 255).astype(np.float32))
    own = load(tmp_path / "a.obj", texture=tmp_path / "maps" / "my image.png").meshes[0].material
    assert np.array_equal(own.texture.image, material.texture.image)
    retextured = load(tmp_path / "a.obj", texture=pixels).meshes[0].material
    assert np.array_equal(retextured.texture.image, (pixels / 255).astype(np.float32))
    assert retextured.n == 32.0


def test_repeated_libraries_and_images(tmp_path):
    Image.new("RGB", (8, 8)).save(tmp_path / "one.png")
    Image.new("RGB", (8, 8)).save(tmp_path / "two.png")
    write(tmp_path / "a.mtl", "newmtl m\nmap_Kd one.png\nnewmtl n\nmap_Kd two.png\nnewmtl o\nmap_Kd one.png\n")
    path = write(tmp_path / "a.obj", TEXTURED + "usemtl n\nf 1/1 2/2 3/3\nusemtl o\nf 1/1 2/2 3/3\n")
    meshes = load(path).meshes
    assert meshes[0].material.texture is meshes[2].material.texture


def test_smoothing_and_what_is_not_rendered(tmp_path):
    def flat_and_ignored(text: str, **options):
        scene, messages = scene_and_warnings(write(tmp_path / "a.obj", TRIANGLE + text), **options)
        assert len(messages) == (1 if scene.ignored else 0)
        return scene.meshes[0].normals is not None, scene.ignored

    face = "f 1 2 3\n"
    assert flat_and_ignored(face) == (False, ())  # smooth: left to the mesh
    assert flat_and_ignored("s 1\n" + face) == (False, ())
    assert flat_and_ignored("s off\n" + face) == flat_and_ignored("s 0\n" + face) == (True, ())  # flat
    assert flat_and_ignored("s 1\n" + face + "s off\n" + face) == (False, ("smoothing groups",))
    assert flat_and_ignored("s 1\n" + face + "s 2\n" + face, crease=30) == (True, ())
    assert flat_and_ignored("vn 0 0 1\ns 1\nf 1//1 2//1 3//1\ns off\nf 1//1 2//1 3//1\n") == (True, ())
    lines = "l 1 2\nl 2 3\np 1\ncurv 0 1 1 2\nsurf 0 1 0 1 1 2 3\nvc 1 0 0\n#MRGB ffff0000\n"
    unsupported = ("free-form curves and surfaces", "colors by vc", "colors in comments (#MRGB)")
    assert flat_and_ignored(face + lines) == (False, ("lines", "points", *unsupported))
    assert flat_and_ignored("f 1 2\n" + face + "f\nf 1 1") == (False, ("faces of fewer than 3 corners",))


# Material libraries

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
