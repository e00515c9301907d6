"""PLY and STL: the meaning of files, tested with handwritten ones, and refusals, with their element and row."""

from __future__ import annotations

import re

import numpy as np
import pytest
from mesh_writers import ply, stl, stl_text
from PIL import Image
from scene_files import refusal, scene_and_warnings, write

from clshade.images.decode import srgb_to_linear
from clshade.scene import geometry
from clshade.scene.formats import ply as ply_format
from clshade.scene.formats import stl as stl_format
from clshade.scene.formats.load import load

RNG = np.random.default_rng(6)
FORMS = ("ascii", "binary_little_endian", "binary_big_endian")
XYZ = "property float x\nproperty float y\nproperty float z\n"
VERTS = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.5]]
POINTS = [("3f", row) for row in VERTS]
HEAD = f"comment x\nelement vertex 4\n{XYZ}"
FACES = "element face {}\nproperty list uchar int vertex_indices\n"


@pytest.mark.parametrize("form", FORMS)
def test_polygons_become_fans(tmp_path, form):
    for lists in ([[0, 1, 2], [1, 3, 2]], [[0, 1, 3, 2]], [[0, 1, 2], [0, 1, 3, 2], [3, 2, 1]]):
        rows = POINTS + [(f"B{len(row)}i", [len(row), *row]) for row in lists]
        path = write(tmp_path / "a.ply", ply(form, HEAD + FACES.format(len(lists)), rows))
        scene, messages = scene_and_warnings(path)
        (mesh,) = scene.meshes
        assert messages == []
        assert mesh.verts.tolist() == VERTS
        assert mesh.verts.dtype == (np.float64 if form == "ascii" else np.float32)
        assert mesh.faces.tolist() == [[row[0], *row[k : k + 2]] for row in lists for k in range(1, len(row) - 1)]
        assert mesh.normals is None


@pytest.mark.parametrize("corners", [3, 10, 13])
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
def test_strips_are_decoded(tmp_path, form):
    strip = [0, 1, 2, 3, -1, 3, 2, -1, 2, 1, 0]
    header = HEAD + "element tristrips 2\nproperty list int int vertex_indices\n"
    rows = [*POINTS, (f"{len(strip) + 1}i", [len(strip), *strip]), ("4i", [3, 1, 2, 3])]
    (mesh,) = load(write(tmp_path / "a.ply", ply(form, header, rows))).meshes
    assert mesh.faces.tolist() == [[0, 1, 2], [1, 3, 2], [2, 1, 0], [1, 2, 3]]


@pytest.mark.parametrize("form", FORMS)
def test_colors_normals_and_coordinates(tmp_path, form):
    more = "property float nx\nproperty float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\n"
    header = HEAD + more + "property uchar blue\nproperty float s\nproperty float t\n" + FACES.format(1)
    rows = [("6f3B2f", [*row, 0.0, 0.0, 2.0, 255, 0, 128, 0.25, 0.75]) for row in VERTS] + [("B3i", [3, 0, 1, 2])]
    path = write(tmp_path / "a.ply", ply(form, header, rows))
    (mesh,) = load(path).meshes
    np.testing.assert_allclose(mesh.colors[0], srgb_to_linear(np.array([255, 0, 128]) / 255), rtol=1e-6)
    assert mesh.normals.tolist() == [[0, 0, 2]] * 4
    assert mesh.uvs.tolist() == [[0.25, 0.25]] * 4  # v = 0 is the bottom in the file
    assert mesh.material.texture is None
    assert load(path, texture=np.ones((2, 2, 3))).meshes[0].material.texture.image.shape == (2, 2, 3)


@pytest.mark.parametrize("form", FORMS)
def test_coordinates_of_corners_and_a_texture(tmp_path, form):
    header = "comment TextureFile my image.png\n" + HEAD + FACES.format(2) + "property list uchar float texcoord\n"
    uvs = [[0.0, 0.0, 1.0, 0.0, 0.0, 1.0], [0.5, 0.5, 1.0, 1.0, 0.25, 1.0, 0.0, 0.0]]
    faces = [[0, 1, 2], [0, 1, 3, 2]]
    rows = [*POINTS]
    for face, uv in zip(faces, uvs, strict=True):
        rows.append((f"B{len(face)}iB{len(uv)}f", [len(face), *face, len(uv), *uv]))
    path = write(tmp_path / "a.ply", ply(form, header, rows))
    Image.new("RGB", (3, 2)).save(tmp_path / "my image.png")
    (mesh,) = load(path).meshes
    assert mesh.material.texture.image.shape == (2, 3, 3)
    corners = mesh.uvs[mesh.uv_faces]
    assert corners.tolist() == [
        [[0, 1], [1, 1], [0, 0]],
        [[0.5, 0.5], [1, 0], [0.25, 0]],
        [[0.5, 0.5], [0.25, 0], [0, 1]],
    ]


@pytest.mark.parametrize("form", FORMS)
def test_colors_of_faces(tmp_path, form):
    colors = "property float red\nproperty float green\nproperty float blue\n"
    header = HEAD + FACES.format(2) + colors
    rows = [*POINTS, ("=B3i3f", [3, 0, 1, 2, 1, 0, 0]), ("=B4i3f", [4, 0, 1, 3, 2, 0, 0.5, 0])]
    rows = [(kind.lstrip("="), values) for kind, values in rows]
    (mesh,) = load(write(tmp_path / "a.ply", ply(form, header, rows))).meshes
    np.testing.assert_allclose(mesh.colors, [[1, 0, 0]] * 3 + [[0, 0.214041, 0]] * 6, atol=1e-6)
    faces = [[0, 1, 2], [0, 1, 3], [0, 3, 2]]
    assert mesh.verts[mesh.faces].tolist() == [[VERTS[k] for k in face] for face in faces]
    smooth = geometry.vertex_normals(VERTS, faces)
    np.testing.assert_allclose(mesh.normals[mesh.normal_faces], smooth[faces], atol=1e-6)


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


NORMALS = "".join(f"property float n{axis}\n" for axis in "xyz")
COLORS = [("uchar", 188), ("float", 188 / 255), ("int", 188), ("float", 188.0), ("ushort", 188 * 257)]


@pytest.mark.parametrize(("kind", "code"), COLORS)
@pytest.mark.parametrize("of", ["vertex", "face"])
def test_colors_are_codes_of_any_type_and_blend(tmp_path, kind, code, of):
    """The same in a PLY file of any type, and in an OBJ file: codes of sRGB, or linear on demand, and alpha."""
    rgba = f"{code:.9g} 0 {code / 188 * 255:.9g} {code / 188 * 51:.9g}"
    properties = "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue", "alpha"))
    faces, points = FACES.format(1), [f"{x} {y} {z}" for x, y, z in VERTS]
    colored = "\n".join(f"{point} {rgba}" for point in points)
    header, rows = HEAD + properties + faces, f"{colored}\n3 0 1 2\n"
    if of == "face":
        header, rows = HEAD + faces + properties, "\n".join([*points, f"3 0 1 2 {rgba}\n"])
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
    color_names = "".join(f"property float {name}\n" for name in "rgba")
    lines = "".join(f"{x} {y} {z} {normal} {color}\n" for (x, y, z), normal in zip(VERTS, 4 * ["0 0 nan"], strict=True))
    header = f"ply\nformat ascii 1.0\nelement vertex 4\n{XYZ}{NORMALS}{color_names}{FACES.format(1)}end_header\n"
    scene, messages = scene_and_warnings(write(tmp_path / "a.ply", header + lines + "3 0 1 2\n"))
    (mesh,) = scene.meshes
    assert mesh.normals[mesh.normal_faces].tolist() == [[[0, 0, 1]] * 3]
    assert mesh.colors[0].tolist() == ([1, 1, 1] if "nan" in color else [0, 0, 0])
    assert (mesh.alphas, mesh.blends) == (None, False)
    first, second = (message.split(": ", 2)[1:] for message in messages)
    assert first == ["element vertex", remark]
    assert second == ["element vertex", "nx, ny, nz: normals that are 0 or not finite were computed from the faces: 3"]


GOOD = ply("ascii", HEAD + FACES.format(1), [*POINTS, ("B3i", [3, 0, 1, 2])]).decode()
BINARY = ply("binary_little_endian", HEAD + FACES.format(1), [*POINTS, ("B3i", [3, 0, 1, 2])])


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("plx\n", ["magic: "]),
        ("ply\nformat ascii 1.0\n", ["header: expected end_header"]),
        (GOOD.replace("ascii", "zip"), ["line 2: format: expected one of ascii, binary_", "found 'zip 1.0'"]),
        (GOOD.replace("ascii 1.0", "ascii 2.0"), ["line 2: format: ", "the version 1.0", "found 'ascii 2.0'"]),
        (GOOD.replace("comment x", "remark x"), ["line 3: expected format, element, ", "found 'remark'"]),
        (GOOD.replace("comment x", "property float x"), ["line 3: property: expected an element before it"]),
        (GOOD.replace("comment x", "element x"), ["line 3: element x: expected a name and a number of rows"]),
        (GOOD.replace("format ascii 1.0\n", ""), ["header: expected a line of format"]),
        (GOOD.replace("vertex 4", "vertex -4"), ["line 4: element vertex: "]),
        (GOOD.replace("vertex 4", "vertex 400000000000"), ["element vertex: expected 400000000000 rows"]),
        (GOOD.replace("vertex 4", "vertex " + "9" * 5000), ["line 4: "]),
        (GOOD.replace("face 1", "face 1000000"), ["element face: "]),
        (GOOD.replace("face 1", "face 2"), ["element face: row 1: vertex_indices: ", "found the end of the file"]),
        (GOOD.replace("float x", "half x"), ["line 5: property: expected one of the types char ", "found 'half'"]),
        (GOOD.replace("float x", "float x y"), ["line 5: property: expected a type and a name, ", "found 'float x y'"]),
        (GOOD.replace("float y", "float x"), ["line 6: property: expected properties of different names", "found 'x'"]),
        (GOOD.replace("uchar int", "uchar long"), ["line 9: property: expected one of the types", "found 'long'"]),
        (GOOD.replace("uchar int", "float int"), ["line 9: property: expected a type of whole numbers"]),
        (GOOD.replace("float z", "float w"), ["element vertex: expected properties x, y and z, found x, y, w"]),
        (GOOD.replace("vertex_indices", "others"), ["element face: expected a list property", "found others"]),
        (GOOD.replace("element face", "element vertex"), ["elements of different names"]),
        (GOOD.replace("3 0 1 2", "3 0 1 -1"), ["element face: row 0: expected indices from 0 to 3, found -1"]),
        (GOOD.replace("3 0 1 2", "3 0 1 4"), ["element face: row 0", "found 4"]),
        (GOOD.replace("3 0 1 2", "3 0 1 4294967298"), ["element face: row 0"]),
        (GOOD.replace("3 0 1 2", "3 0 1 1.5"), ["element face: row 0", "1.5"]),
        (GOOD.replace("3 0 1 2", "3 0 1 nan"), ["element face: row 0"]),
        (GOOD.replace("3 0 1 2", "2 0 1"), ["element face: row 0: expected at least 3 corners"]),
        (GOOD.replace("3 0 1 2", "-3 0 1 2"), ["element face: row 0: vertex_indices: "]),
        (GOOD.replace("3 0 1 2", "3 0 1 2 9"), ["rows: "]),
        (GOOD.replace("1.0 1.0 0.5", "1.0 nan 0.5"), ["element vertex: row 3: y: ", "nan"]),
        (GOOD.replace("1.0 1.0 0.5", "1.0 1e999 0.5"), ["element vertex: row 3: y: ", "inf"]),
        (GOOD.replace("1.0 1.0 0.5", "1.0 abc 0.5"), ["line 14: expected numbers, found 'abc'"]),
        (GOOD.replace("face 1", "face 0").replace("3 0 1 2\n", ""), ["element face: expected at least one triangle"]),
        (BINARY[:-1], ["element face: "]),
        (BINARY[:-13], ["element face: "]),
        (BINARY[:-20], ["element vertex: "]),
        (BINARY[:-40], ["element vertex: "]),
        (BINARY[:-13] + b"\xff" + BINARY[-12:], ["element face: row 0: vertex_indices: "]),
        (BINARY.replace(b"uchar int", b"int int"), ["element face: "]),
    ],
)
def test_refused_ply(tmp_path, text, parts):
    refusal(write(tmp_path / "bad.ply", text), "bad.ply: ", *parts)


def test_a_ragged_file_cut_anywhere_is_refused(tmp_path):
    rows = [*POINTS, ("B3i", [3, 0, 1, 2]), ("B4i", [4, 0, 1, 3, 2])]
    data = ply("binary_big_endian", HEAD + FACES.format(2), rows)
    for cut in range(len(data) - 60, len(data)):
        refusal(write(tmp_path / "bad.ply", data[:cut]), "bad.ply: element ")


def test_both_sides_are_lit_unless_asked_otherwise(tmp_path):
    for name, data in (("a.ply", GOOD), ("a.stl", stl(TRIANGLES)), ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")):
        path = write(tmp_path / name, data)
        for two_sided, lit in ((None, True), (True, True), (False, False)):
            assert load(path, two_sided=two_sided).meshes[0].material.two_sided is lit


@pytest.mark.parametrize("colored", [False, True])
def test_faces_against_the_files_normals_are_turned(tmp_path, colored):
    head = HEAD.replace("property float z\n", "property float z\n" + "".join(f"property float n{c}\n" for c in "xyz"))
    color = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue")) if colored else ""
    lists = "property list uchar int vertex_indices\nproperty list uchar float texcoord\n"
    points = [("6f", [*VERTS[k], 0.0, 0.0, 1.0]) for k in range(4)]
    rows = []
    for face in ([0, 1, 2], [1, 2, 3]):  # the second one is clockwise
        uvs = [value for k in face for value in (k / 4, 1.0)]
        rows.append(("B3iB6f" + "3B" * colored, [3, *face, 6, *uvs] + [255, 0, 255] * colored))
    data = ply("binary_little_endian", head + f"element face 2\n{lists}{color}", points + rows)
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
    refusal(path, "a.stl: texture: ", texture=np.ones((1, 1, 3)))


@pytest.mark.parametrize(
    ("data", "parts"),
    [
        (stl(TRIANGLES)[:-1], ["facet count: expected 434 bytes for its 7 facets, or ", "found 433 bytes"]),
        (b"\xff" * 84, ["facet count: "]),
        (b"short", ["facet count: "]),
        (b"solid".ljust(34, b"\0"), ["facet count: "]),  # as long as a file of -1 facets would be
        (stl([]), ["facet count: "]),
        ("solid x\nendsolid x\n", ["facet count: "]),
        (stl_text(TRIANGLES).encode("utf-16"), ["facets, or ASCII text that begins with solid"]),
        (stl(np.where(np.arange(63).reshape(7, 3, 3) == 30, np.nan, 1)), ["facet 3: vertex 1: expected finite", "nan"]),
        (stl_text(TRIANGLES).replace("endfacet", "end", 1), ["facet 0: expected endfacet, found 'end'"]),
        (stl_text(TRIANGLES).replace("vertex", "vertex x", 1), ["facet 0: vertex: expected numbers, found 'x'"]),
        (stl_text([[[0, 0, 0], [1, 0, 0], [0, 1, 1e300]]]), ["facet 0: vertex 2: expected finite"]),
        (stl_text(TRIANGLES)[:900], ["facet "]),
        ("solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n", ["facet 0: expected endfacet, found the end"]),
    ],
)
def test_refused_stl(tmp_path, data, parts):
    refusal(write(tmp_path / "bad.stl", data), "bad.stl: ", *parts)
