"""PLY and STL: the meaning of files, tested with handwritten ones, and refusals, with their element and row."""

import re

import numpy as np
import pytest
from mesh_writers import ply, properties, stl, stl_text
from PIL import Image
from scene_files import scene_and_warnings, write

from clshade.images.decode import srgb_to_linear
from clshade.scene import geometry
from clshade.scene.formats import ply as ply_format
from clshade.scene.formats import stl as stl_format
from clshade.scene.formats.load import load

RNG = np.random.default_rng(6)
FORMS = ("ascii", "binary_little_endian", "binary_big_endian")
XYZ, NORMALS, RGB = properties("float", "x y z"), properties("float", "nx ny nz"), properties("uchar", "red green blue")
VERTS = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.5]]
POINTS = [("3f", row) for row in VERTS]
HEAD = f"comment x\nelement vertex 4\n{XYZ}"
FACES = "element face {}\nproperty list uchar int vertex_indices\n"


@pytest.mark.parametrize("form", FORMS)
def test_polygons_become_fans(tmp_path, form):
    half, whole = [0, 1, 2], [0, 1, 3, 2]
    for lists in ([half, [1, 3, 2]], [whole], [half, whole, [3, 2, 1]], [[2, 3, 1], [2, 3, 1, 0]]):
        rows = POINTS + [(f"B{len(row)}i", [len(row), *row]) for row in lists]
        path = write(tmp_path / "a.ply", ply(form, HEAD + FACES.format(len(lists)), rows))
        scene, messages = scene_and_warnings(path)
        (mesh,) = scene.meshes
        assert messages == []
        assert mesh.verts.tolist() == VERTS
        assert mesh.verts.dtype == (np.float64 if form == "ascii" else np.float32)
        assert mesh.faces.tolist() == [[row[0], *row[k : k + 2]] for row in lists for k in range(1, len(row) - 1)]
        assert mesh.normals is None


@pytest.mark.parametrize("corners", [3, 10])
@pytest.mark.parametrize("form", FORMS)
def test_faces_may_stand_before_vertices(tmp_path, form, corners):
    """The header's last byte, before the first length, is 10 as well."""
    verts = RNG.random((corners, 3)).astype(np.float32).tolist()
    header = FACES.format(1) + f"element vertex {corners}\n{XYZ}"
    rows = [(f"B{corners}i", [corners, *range(corners)]), *(("3f", row) for row in verts)]
    (mesh,) = load(write(tmp_path / "a.ply", ply(form, header, rows))).meshes
    assert mesh.verts.tolist() == verts
    assert len(mesh.faces) == corners - 2
    assert sorted(set(mesh.faces.ravel().tolist())) == list(range(corners))


@pytest.mark.parametrize("form", FORMS)
def test_strips_colors_normals_and_coordinates(tmp_path, form):
    strip = [0, 1, 2, 3, -1, 3, 2, -1, 2, 1, 0]
    header = HEAD + NORMALS + RGB + properties("float", "s t")
    header += "element tristrips 2\nproperty list int int vertex_indices\n"
    rows = [("6f3B2f", [*row, 0.0, 0.0, 2.0, 255, 0, 128, 0.25, 0.75]) for row in VERTS]
    rows += [(f"{len(strip) + 1}i", [len(strip), *strip]), ("4i", [3, 1, 2, 3])]
    path = write(tmp_path / "a.ply", ply(form, header, rows))
    (mesh,) = load(path).meshes
    assert mesh.faces.tolist() == [[0, 1, 2], [1, 3, 2], [2, 0, 1], [1, 3, 2]]
    np.testing.assert_allclose(mesh.colors[0], srgb_to_linear(np.array([255, 0, 128]) / 255), rtol=1e-6)
    assert mesh.normals.tolist() == [[0, 0, 2]] * 4
    assert mesh.uvs.tolist() == [[0.25, 0.25]] * 4  # v = 0 is the bottom in the file
    assert mesh.material.texture is None
    assert load(path, texture=np.ones((2, 2, 3))).meshes[0].material.texture.image.shape == (2, 2, 3)


DART = [[0.0, 4.0, 0.0], [0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 4.0, 0.0], [2.0, 1.0, 0.0]]


@pytest.mark.parametrize("form", FORMS)
def test_corners_keep_their_coordinates_and_faces_their_colors(tmp_path, form):
    """However polygons are cut."""
    header = f"comment TextureFile my image.png\nelement vertex 5\n{XYZ}{FACES.format(2)}"
    header += f"property list uchar float texcoord\n{RGB}"
    rows = [("3f", corner) for corner in DART]
    for face, color in (([3, 4, 0, 1, 2], 188), ([2, 1, 0], 0)):
        uvs = [value for corner in face for value in DART[corner][:2]]
        rows.append((f"B{len(face)}iB{len(uvs)}f3B", [len(face), *face, len(uvs), *uvs, color, 255, color]))
    Image.new("RGB", (3, 2), (188, 188, 188)).save(tmp_path / "my image.png")
    (mesh,) = load(write(tmp_path / "a.ply", ply(form, header, rows))).meshes
    red = np.float32(srgb_to_linear(np.array(188 / 255)))
    assert np.array_equal(mesh.material.texture.image, np.full((2, 3, 3), red))
    points, uvs = mesh.verts[mesh.faces], mesh.uvs[mesh.uv_faces]
    areas = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])[:, 2] / 2
    assert (areas[:3].min() > 0, areas[:3].sum(), areas[3]) == (True, 10, -8)
    assert np.array_equal(np.stack([uvs[:, :, 0], 1 - uvs[:, :, 1]], 2), points[:, :, :2])
    assert mesh.colors[mesh.faces].tolist() == [[[red, 1, red]] * 3] * 3 + [[[0, 1, 0]] * 3]
    faces = [[DART.index(corner) for corner in face] for face in points.tolist()]
    smooth = geometry.vertex_normals(DART, faces)[faces]
    np.testing.assert_allclose(mesh.normals[mesh.normal_faces], smooth, atol=1e-6)


def test_line_ends_and_what_is_not_rendered(tmp_path, monkeypatch):
    monkeypatch.setattr(ply_format, "_CHUNK", 5)
    more = "property list uchar int flags\n"
    header = "comment TextureFile a.png\n" + HEAD + "element edge 1\nproperty int vertex1\n" + FACES.format(1) + more
    data = ply("ascii", header, [*POINTS, ("i", [0]), ("B3iB1i", [3, 0, 1, 2, 1, 7])])
    data = data.replace(b"ply\n", b"ply \n", 1).replace(b"end_header", b"end_header ").replace(b"\n", b"\r\n")
    scene, messages = scene_and_warnings(write(tmp_path / "a.ply", data))
    assert scene.ignored == ("textures of faces without texture coordinates", "list flags", "element edge")
    assert len(messages) == 1
    assert scene.face_count == 1


COLORS = [("uchar", 188), ("float", 188 / 255), ("int", 188), ("float", 188.0), ("ushort", 188 * 257)]


@pytest.mark.parametrize(("kind", "code"), COLORS)
@pytest.mark.parametrize("of", ["vertex", "face"])
def test_colors_are_codes_of_any_type_and_blend(tmp_path, kind, code, of):
    """The same in a PLY file of any type, and in an OBJ file: codes of sRGB, or linear on demand, and alpha."""
    rgba = f"{code:.9g} 0 {code / 188 * 255:.9g} {code / 188 * 51:.9g}"
    rgba_of = properties(kind, "red green blue alpha")
    faces, points = FACES.format(1), [f"{x} {y} {z}" for x, y, z in VERTS]
    colored = "\n".join(f"{point} {rgba}" for point in points)
    header, rows = HEAD + rgba_of + faces, f"{colored}\n3 0 1 2\n"
    if of == "face":
        header, rows = HEAD + faces + rgba_of, "\n".join([*points, f"3 0 1 2 {rgba}\n"])
    paths = [write(tmp_path / "a.ply", f"ply\nformat ascii 1.0\n{header}end_header\n{rows}")]
    if kind == "float":
        paths.append(write(tmp_path / "a.obj", re.sub("^", "v ", colored, flags=re.MULTILINE) + "\nf 1 2 3\n"))
    for path in paths:
        scene, messages = scene_and_warnings(path)
        (mesh,) = scene.meshes
        np.testing.assert_allclose(mesh.colors[0], [srgb_to_linear(np.array(188 / 255)), 0, 1], rtol=1e-6)
        np.testing.assert_allclose(mesh.alphas, 0.2, rtol=1e-6)
        assert mesh.blends
        assert len(messages) == (2 if (kind, code) == ("float", 188.0) else 0)
        linear = scene_and_warnings(path, vertex_colors="linear")[0].meshes[0].colors[0]
        np.testing.assert_allclose(linear, [188 / 255, 0, 1], rtol=1e-6)


@pytest.mark.parametrize(
    ("color", "remark"),
    [("nan 0 0 1", "colors that are not finite became white: 4"), ("0 0 0 0", "alphas, which are all 0, became 1")],
)
def test_normals_and_colors_that_are_none(tmp_path, color, remark):
    lines = "".join(f"{x} {y} {z} {normal} {color}\n" for (x, y, z), normal in zip(VERTS, 4 * ["0 0 nan"], strict=True))
    header = f"ply\nformat ascii 1.0\n{HEAD}{NORMALS}{properties('float', 'r g b a')}{FACES.format(1)}end_header\n"
    scene, messages = scene_and_warnings(write(tmp_path / "a.ply", header + lines + "3 0 1 2\n"))
    (mesh,) = scene.meshes
    assert mesh.normals[mesh.normal_faces].tolist() == [[[0, 0, 1]] * 3]
    assert mesh.colors[0].tolist() == ([1, 1, 1] if "nan" in color else [0, 0, 0])
    assert (mesh.alphas, mesh.blends) == (None, False)
    first, second = (message.split(": ", 2)[1:] for message in messages)
    assert first == ["element vertex", remark]
    assert second == ["element vertex", "nx, ny, nz: normals that are 0 or not finite were computed from the faces: 3"]


def test_both_sides_are_lit_unless_asked_otherwise(tmp_path):
    for name, data in (
        ("a.ply", ply("ascii", HEAD + FACES.format(1), [*POINTS, ("B3i", [3, 0, 1, 2])])),
        ("a.stl", stl(TRIANGLES)),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    ):
        path = write(tmp_path / name, data)
        for two_sided, lit in ((None, True), (True, True), (False, False)):
            assert load(path, two_sided=two_sided).meshes[0].material.two_sided is lit


@pytest.mark.parametrize("colored", [False, True])
def test_faces_against_the_files_normals_are_turned(tmp_path, colored):
    head = HEAD + NORMALS
    lists = "property list uchar int vertex_indices\nproperty list uchar float texcoord\n"
    points = [("6f", [*VERTS[k], 0.0, 0.0, 1.0]) for k in range(4)]
    rows = []
    for face in ([0, 1, 2], [1, 2, 3]):  # the second one is clockwise
        uvs = [value for k in face for value in (k / 4, 1.0)]
        rows.append(("B3iB6f" + "3B" * colored, [3, *face, 6, *uvs] + [255, 0, 255] * colored))
    data = ply("binary_little_endian", head + f"element face 2\n{lists}{RGB * colored}", points + rows)
    mesh = load(write(tmp_path / "a.ply", data)).meshes[0]
    assert mesh.verts[mesh.faces].tolist() == [[VERTS[0], VERTS[1], VERTS[2]], [VERTS[1], VERTS[3], VERTS[2]]]
    assert mesh.uvs[mesh.uv_faces][:, :, 0].tolist() == [[0, 0.25, 0.5], [0.25, 0.75, 0.5]]
    text = "".join(f"v {x} {y} {z}\nvt 0.{k} 0\n" for k, (x, y, z) in enumerate(VERTS)) + "vn 0 0 1\n"
    mesh = load(write(tmp_path / "a.obj", text + "f 1/1/1 2/2/1 3/3/1\nf 2/2/1 3/3/1 4/4/1\nf 2/2 3/3 4/4\n")).meshes[0]
    assert mesh.verts[mesh.faces].tolist() == [[VERTS[0], VERTS[1], VERTS[2]], [VERTS[1], VERTS[3], VERTS[2]]]
    np.testing.assert_allclose(mesh.uvs[mesh.uv_faces][:, :, 0], [[0, 0.1, 0.2], [0.1, 0.3, 0.2]])


TRIANGLES = RNG.standard_normal((7, 3, 3)).astype(np.float32)


@pytest.mark.parametrize("chunk", [10, 1 << 20])
def test_stl_of_both_kinds(tmp_path, monkeypatch, chunk):
    monkeypatch.setattr(stl_format, "_CHUNK", chunk)
    text = stl_text(TRIANGLES)
    for data in (
        stl(TRIANGLES),
        text,
        "\ufeff" + text.upper() + "\0\0",
        text.replace("\n", "\r\n").replace("endloop", "end loop").removeprefix("solid a name of facets"),
        text.replace("endloop", "end  loop").replace("endfacet", "end\tfacet").replace("endsolid", "end solid"),
        text + text.replace("solid a", "solid"),
    ):
        (mesh,) = load(write(tmp_path / "a.stl", data)).meshes
        assert np.array_equal(mesh.verts.reshape(-1, 3, 3)[:7], TRIANGLES)
        assert mesh.faces.reshape(-1).tolist() == list(range(len(mesh.verts)))
        assert mesh.normals is None  # unshared corners: flat
        assert mesh.material.two_sided
    assert len(mesh.verts) == 42


BINARY_STL = stl(TRIANGLES)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (BINARY_STL + b"\r\n", "bytes after the last of 7 facets are left out: 2"),
        (BINARY_STL[:80] + bytes(4) + BINARY_STL[84:], "0 was read as 7, the facets in the file"),
        (BINARY_STL[:80] + b"\xff" * 4 + BINARY_STL[84:], "4294967295 was read as 7, the facets in the file"),
        (b"solid".ljust(80, b"\0") + BINARY_STL[80:] + b"\n", "bytes after the last of 7 facets are left out: 1"),
    ],
)
def test_counts_of_facets_that_do_not_fit_the_file(tmp_path, data, words):
    scene, messages = scene_and_warnings(write(tmp_path / "a.stl", data))
    assert np.array_equal(scene.meshes[0].verts.reshape(-1, 3, 3), TRIANGLES)
    assert messages == [f"{tmp_path}/a.stl: facet count: {words}"]


def test_stl_options_and_attributes(tmp_path):
    square = [[VERTS[0], VERTS[1], VERTS[2]], [VERTS[1], [1, 1, 0], VERTS[2]]]
    path = write(tmp_path / "a.stl", stl(square, attribute=1))
    scene, messages = scene_and_warnings(path)
    assert scene.ignored == ("colors or attributes of facets",)
    assert len(messages) == 1
    assert scene.camera.up.tolist() == [0, 0, 1]
    assert scene.camera.eye[2] > scene.camera.lookat[2]
    scene, _ = scene_and_warnings(path, crease=30, up="y")
    assert scene.meshes[0].verts.tolist() == [VERTS[0], VERTS[1], VERTS[2], [1, 1, 0]]
    assert scene.meshes[0].faces.tolist() == [[0, 1, 2], [1, 3, 2]]
    assert scene.meshes[0].normals.tolist() == [[0, 0, 1]] * 4
    assert scene.camera.up.tolist() == [0, 1, 0]
