"""Files that are refused, each in one line that says where and why. A row: what is wrong, and parts of the message, between
which … stands for other words."""

import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_writers import ply, properties, stl, stl_text
from scene_files import TEXTURED, TRIANGLE, course_dict, npy_of_pickle, pickled_array, refusal, save_npy, write

from clshade.scene.formats import obj, text_tokens
from clshade.scene.formats import ply as ply_format
from clshade.scene.formats import stl as stl_format
from clshade.scene.formats.load import load

HEAD = f"comment x\nelement vertex 4\n{properties('float', 'x y z')}"
HEAD += "element face 1\nproperty list uchar int vertex_indices\n"
POINTS = [("3f", row) for row in ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.5])]
PLY = ply("ascii", HEAD, [*POINTS, ("B3i", [3, 0, 1, 2])]).decode()
BINARY = ply("binary_little_endian", HEAD, [*POINTS, ("B3i", [3, 0, 1, 2])])
FACETS = np.random.default_rng(6).standard_normal((7, 3, 3)).astype(np.float32)
OBJ = [
    ("v 0 0\n", "line 1: v: expected 3 numbers…found 2"),
    ("v 0 0 0 0 0\n", "line 1: v: …found 5"),
    ("v 0 0 0 0 0 0 0 0\n", "line 1: v: …or 7 with a color and alpha, found 8"),
    (TRIANGLE + "v 0 x 0\n", "line 4: v: expected numbers, found 'x'"),
    ("\n\nv 0 0 1.#IND\n", "line 3: v: …1.#IND"),
    *((f"v {word} 3 4\n", f"line 1: v: expected numbers, found '{word}'") for word in ("1_0", "0x1", "1-2", "1,5")),
    *((f"v 1{blank}2 3 4\n", "line 1: v: expected numbers") for blank in "\u00a0\0"),
    *((f"v 0 {number} 0\n", "line 1: v: expected finite") for number in ("nan", "-inf", "1e999")),
    ("vn 0 1\n", "line 1: vn: expected 3 numbers"),
    ("vt\n", "line 1: vt: expected 1 to 3 numbers, found 0"),
    ("vt a\n", "line 1: vt: expected numbers, found 'a'"),
    (TRIANGLE + "f 1 2 3\nf 0 1 2\n", "line 5: f: expected indices from 1…'0'"),
    (TRIANGLE + "f 1 2 4\n", "line 4: f: expected v indices up to 3, found 4"),
    (TRIANGLE + "f 1 2 -4\n", "line 4: f: expected v indices up to the 3 so far, found '-4'"),
    ("f -1 -1 -1\n" + TRIANGLE, "line 1: f: expected v indices up to the 0 so far"),
    (TRIANGLE + "f 1 2 4294967298\n", "line 4: f: …4294967298"),
    (TRIANGLE + "f 1 2 99999999999999999999\n", "line 4: f: …99999999999999999999"),
    *(
        (f"{TRIANGLE}f 1 2 {word}\n", f"line 4: f: expected corners of whole numbers…'{word}'")
        for word in ("3.0", "1e0", "nan", "1-1", "1/1/1/1", "3////")
    ),
    (TRIANGLE + "f 1 2 3/\u00b2\n", "line 4: f: expected corners"),
    (TRIANGLE + "f 1 2 /3\n", "line 4: f: …'/3'"),
    (TRIANGLE + "f 1 2 /\n", "line 4: f: …'/'"),
    (TRIANGLE + "vt 0 0\nf 1/1 2/2 3/1\n", "line 5: f: expected vt indices up to 1, found 2"),
    (TRIANGLE + "vn 0 0 1\nf 1//1 2//1 3//2\n", "line 5: f: expected vn indices up to 1, found 2"),
    (TRIANGLE + "vt 0 0\nf 1/1 2/0 3/1\n", "line 5: f: expected indices from 1…'2/0'"),
    (TRIANGLE + "vt 0 0\nf 1/1 2 3/1\n", "line 5: f: expected vt at all corners or none, found 2 of 3"),
    (TRIANGLE + "f 1 2 \\\n3 \\\n9\n", "line 4: f: …found 9"),
    ("# \\\nv 0 0\n", "line 2: v: "),
    ("solid x\nfacet-normal 0 0 1\n", "line 2: keyword: …'facet-normal'"),
    ("v 0 0 0\nvertex" + "x" * 99, "line 2: keyword: "),
    ("\xff\xfe v 0 0 0\n", "line 1: keyword: "),
    (TRIANGLE, "f: expected at least one face, found none"),
    ("\0" * 5000, "line 1: keyword: "),
]
PLY_CHANGES = [
    ("format ascii 1.0\n", "", "header: expected a line of format"),
    ("ascii", "zip", "line 2: format: expected one of ascii, binary_…found 'zip 1.0'"),
    ("ascii 1.0", "ascii 2.0", "line 2: format: …the version 1.0…found 'ascii 2.0'"),
    ("comment x", "remark x", "line 3: expected format, element, …found 'remark'"),
    ("comment x", "property float x", "line 3: property: expected an element before it"),
    ("vertex 4", "vertex -4", "line 4: element vertex: "),
    ("vertex 4", "vertex 400000000000", "element vertex: expected 400000000000 rows…16 values left"),
    ("vertex 4", "vertex " + "9" * 5000, "line 4: "),
    ("face 1", "face 2", "element face: row 1: vertex_indices: …found the end of the file"),
    ("float x", "half x", "line 5: property: expected one of the types char …found 'half'"),
    ("float x", "float x y", "line 5: property: expected a type and a name, …found 'float x y'"),
    ("float y", "float x", "line 6: property: expected properties of different names…found 'x'"),
    ("uchar int", "uchar long", "line 9: property: expected one of the types…found 'long'"),
    ("uchar int", "float int", "line 9: property: expected a type of whole numbers"),
    ("float z", "float w", "element vertex: expected properties x, y and z, found x, y, w"),
    ("vertex_indices", "others", "element face: expected a list property…found others"),
    ("element face", "element vertex", "elements of different names"),
    ("3 0 1 2", "3 0 1 -1", "element face: row 0: expected indices from 0 to 3, found -1"),
    ("3 0 1 2", "3 0 1 4294967298", "element face: row 0"),
    ("3 0 1 2", "3 0 1 1.5", "element face: row 0…1.5"),
    ("3 0 1 2", "2 0 1", "element face: row 0: expected at least 3 corners"),
    ("3 0 1 2", "-3 0 1 2", "element face: row 0: vertex_indices: "),
    ("3 0 1 2", "3 0 1 2 9", "rows: "),
    ("1.0 1.0 0.5", "1.0 nan 0.5", "element vertex: row 3: y: …nan"),
    ("1.0 1.0 0.5", "1.0 abc 0.5", "line 14: expected numbers, found 'abc'"),
    ("vertex_indices\n", "vertex_indices\nproperty list uchar float texcoord\n", "element face: row 0: texcoord"),
]
BINARY_PLY = [
    (BINARY[:-1], "element face: "),
    (BINARY[:-13], "element face: …found 0 bytes left"),
    (BINARY[:-20], "element vertex: "),
    (BINARY[:-13] + b"\xff" + BINARY[-12:], "element face: row 0: vertex_indices: "),
    (BINARY.replace(b"uchar int", b"int int"), "element face: "),
    ("plx\n", "magic: "),
    ("ply\nformat ascii 1.0\n", "header: expected end_header"),
    (PLY.replace("face 1", "face 0").replace("3 0 1 2\n", ""), "element face: expected at least one triangle"),
]
STL = [
    (stl(FACETS)[:-1], "facet count: expected 434 bytes for its 7 facets, or …found 433 bytes"),
    (b"\xff" * 84, "facet count: "),
    (b"\xff" * 20, "facet count: expected at least 84 bytes, or solid, found 20 bytes"),
    (b"solid".ljust(34, b"\0"), "facet count: "),  # as long as a file of -1 facets would be
    (stl([]), "facet count: "),
    ("solid x\nendsolid x\n", "facet count: "),
    (stl_text(FACETS).encode("utf-16"), "facets, or ASCII text that begins with solid"),
    (stl(np.where(np.arange(63).reshape(7, 3, 3) == 30, np.nan, 1)), "facet 3: vertex 1: expected finite…nan"),
    (stl_text(FACETS).replace("endfacet", "end", 1), "facet 0: expected endfacet, found 'end'"),
    (stl_text(FACETS).replace("vertex", "vertex x", 1), "facet 0: vertex: expected numbers, found 'x'"),
    (stl_text([[[0, 0, 0], [1, 0, 0], [0, 1, 1e300]]]), "facet 0: vertex 2: expected finite"),
    (stl_text(FACETS)[:900], "facet "),
    ("solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\n", "facet 0: expected endfacet, found the end"),
]
PLAIN_ARRAY = b"\x93NUMPY\x01\x00\x39\x00{'descr': '<f8', 'fortran_order': False, 'shape': (3, 3)}"
NPY = [
    (b"\x93NUMPY", "header: "),
    (b"\x93NUMPY\x09\x00v\x00" + b" " * 118, "header: "),
    (b"\x93NUMPY\x01\x00\xff\xff{}", "header: "),
    (b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}", "header: "),
    (b"\x93NUMPY\x01\x00\x0e\x00__import__('os')", "header: …__import__"),
    (b"\x93NUMPY\x01\x00\x00\x08" + b"(" * 2048, "header: "),
    (PLAIN_ARRAY, "header: …shape (3, 3) and type '<f8'"),
]
CONTENTS = [
    *(("obj", *row) for row in OBJ),
    *(("ply", PLY.replace(before, after), message) for before, after, message in PLY_CHANGES),
    *(("ply", *row) for row in BINARY_PLY),
    *(("stl", *row) for row in STL),
    *(("npy", *row) for row in NPY),
]


def refused(path: str | Path, message: str, **options: Any) -> None:
    refusal(path, f"{os.path.basename(path)}: ", *message.split("…"), **options)


@pytest.mark.parametrize("row", range(len(CONTENTS)), ids=lambda row: f"{CONTENTS[row][0]}{row}")
def test_contents(tmp_path, row):
    ending, content, message = CONTENTS[row]
    refused(write(tmp_path / f"bad.{ending}", content), message)


def test_a_ragged_file_cut_anywhere(tmp_path):
    rows = [*POINTS, ("B3i", [3, 0, 1, 2]), ("B4i", [4, 0, 1, 3, 2])]
    data = ply("binary_big_endian", HEAD.replace("face 1", "face 2"), rows)
    for cut in range(len(data) - 60, len(data)):
        refused(write(tmp_path / "bad.ply", data[:cut]), "element ")


def test_texts_that_are_too_large(tmp_path, monkeypatch):
    monkeypatch.setattr(text_tokens, "CHUNK", 100)
    monkeypatch.setattr(text_tokens, "MAX_LINE", 1000)
    for line in ("1 " * 600, "f 1 \\\n" * 600):
        refused(write(tmp_path / "bad.obj", line), "line: expected lines of at most 1000 bytes")
    monkeypatch.setattr(obj, "MAX_FACES", 20)
    monkeypatch.setattr(stl_format, "MAX_FACES", 6)
    monkeypatch.setattr(ply_format, "MAX_FACES", 1)
    polygons = TRIANGLE + "f 1 2 3 1 2 3\n" * 5
    assert load(write(tmp_path / "good.obj", polygons)).face_count == 20
    refused(write(tmp_path / "bad.obj", polygons + "f 1 2 3\n"), "f: expected at most 20 triangles")
    for data, message in ((stl(FACETS), "from 1 to 6, found 7"), (stl_text(FACETS), "at most 6, found more")):
        refused(write(tmp_path / "bad.stl", data), f"facet count: expected {message}")
    data = ply("binary_big_endian", HEAD, [*POINTS, ("B4i", [4, 0, 1, 3, 2])])
    refused(write(tmp_path / "bad.ply", data), "element face: expected at most 1 triangles")


def test_textures_without_coordinates(tmp_path):
    course = pickled_array(course_dict(uvs=None, face_uv_indices=None))
    for path, field in (
        (write(tmp_path / "a.obj", TRIANGLE + "f 1 2 3\n"), "vt"),
        (write(tmp_path / "a.ply", PLY), "element vertex"),
        (write(tmp_path / "a.stl", stl(FACETS)), "texture"),
        (npy_of_pickle(tmp_path / "a.npy", course), "uvs"),
    ):
        refused(path, f"{field}: expected ", texture=np.ones((1, 1, 3)))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("Kd 1 1", "Kd: expected one or three finite numbers, found '1 1'"),
        ("Kd x", "Kd: "),
        ("Kd nan 0 0", "Kd: "),
        ("Ks spectral a.rfl 1", "Ks: "),
        ("Ns 2e9", "Ns: expected a number up to 1e9, found 2e+09"),
        ("Ns 1 2", "Ns: "),
        ("d half", "d: expected a number, found 'half'"),
        ("Tr nan", "Tr: expected a number, found"),
        ("map_Kd -s 1 -1e999 1 a.png", "map_Kd: -s: expected finite numbers, found '-1e999'"),
        ("map_Kd -o 0 0 1e400 a.png", "map_Kd: -o: expected finite numbers, found '1e400'"),
        ("map_Kd -mm 0 1e400 a.png", "map_Kd: -mm: expected finite numbers, found '1e400'"),
    ],
)
def test_libraries(tmp_path, line, message):
    write(tmp_path / "a.mtl", "newmtl m\n" + line + "\n")
    refused(write(tmp_path / "a.obj", TEXTURED), f"a.mtl: line 2: {message}")


# Course files


@pytest.mark.parametrize(
    ("key", "value", "part"),
    [
        ("verts", np.zeros((4, 4)), "shape (3, N) or (N, 3)"),
        ("verts", np.full((3, 4), np.nan), "finite"),
        ("verts", "text", "'text'"),
        ("verts", {"a": 1}, "dict"),
        ("verts", np.array([[None] * 4] * 3), "type 'O8'"),
        ("verts", [[0, 1, 2, 3], [0, 1], [0]], "differ in shape"),
        ("verts", [[0, None]] * 3, "a list with None"),
        ("uvs", course_dict()["uvs"].T, "the layout of verts…(3, 2)"),
        ("vertex_colors", np.zeros((3, 5)), "one color per vertex (4)"),
        ("vertex_colors", np.full((3, 4), np.inf), "finite"),
        ("face_indices", np.array([[0.0], [1], [2]]), "whole numbers"),
        ("face_indices", np.array([[0], [1], [4]]), "4 in face 0"),
        ("face_indices", np.array([[0], [-1], [2]]), "-1 in face 0"),
        ("face_indices", np.array([[0], [1], [2**32 + 2]]), "4294967298"),
        ("face_uv_indices", np.array([[0, 1], [1, 2], [2, 3]]), "3 in face 1"),
        ("face_uv_indices", np.array([[0], [1], [2]]), "one triple per face (2)"),
        ("uvs", np.zeros((3, 4)), "shape (2, N)"),
        ("cam_eye", np.zeros(2), "three finite numbers"),
        ("cam_lookat", [0, 0, 5], "other than eye"),
        ("cam_up", [0, 0, 1], "not parallel"),
        ("ka", [1, 2], "three finite numbers"),
        ("ka", True, "a number or three finite numbers, found "),
        ("ka", [0.5], "number…shape (1"),
        ("ks", np.nan, "finite"),
        ("n", -1, "0 to 1e9"),
        ("n", np.array([[2.0]]), "number…shape (1"),
        ("light_positions", np.zeros((2, 2)), "shape (L, 3)"),
        ("light_positions", [[0, 0, 5], [0, 0, np.nan]], "finite"),
        ("light_positions", [[[[1.0]]]], "nested too deep"),
        ("light_positions", [np.zeros(1 << 10)] * 100, "an array of 1024 numbers"),
        ("light_intensities", [[1, 1, 1, 1]] * 2, "shape (L, 3)"),
        ("light_intensities", [[0, 0, 5]], "one row per light"),
        ("light_intensities", [0, 0, 5], "one row per light"),
        ("M", 0, "from 1 to 16384"),
        ("M", np.array([48]), "number…shape (1"),
        ("N", 1.5, "from 1 to 16384"),
        ("W", 0, "above 0"),
        ("focal", True, "a finite number above 0, found True"),
        ("focal", np.full((1, 1, 1), 2.0), "number…shape (1"),
        *(("verts", number, "an integer beyond 64 bits") for number in (1 << 63, [-(1 << 63) - 1], 1 << 70)),
        *((key, None, "expected this key") for key in course_dict() if key not in ("depth", "vertex_colors")),
    ],
)
def test_fields_of_course_files(tmp_path, key, value, part):
    refused(save_npy(tmp_path / "bad.npy", course_dict(**{key: value})), f"{key}: …{part}")


@pytest.mark.parametrize(
    ("key", "value", "options"),
    [
        ("focal", -1, {"focal": 70}),
        ("M", 0, {"resolution": (64, 64)}),
        ("light_positions", [[0, 0, np.nan]], {"lights": []}),
        ("vertex_colors", np.zeros((3, 3)), {"texture": np.zeros((2, 2, 3))}),
    ],
)
def test_fields_are_checked_even_where_an_option_replaces_them(tmp_path, key, value, options):
    refused(save_npy(tmp_path / "bad.npy", course_dict(**{key: value})), f"{key}: ", **options)


class Call:
    """Object that pickles as a function call."""

    def __init__(self, function, *arguments):
        self.reduced = function, arguments

    def __reduce__(self):
        return self.reduced


@pytest.mark.parametrize(
    "content",
    [
        Call(os.system, "touch PWNED"),
        Call(eval, "open('PWNED', 'w')"),
        Call(np.zeros, 1 << 40),
        {"depth": Call(open, "PWNED", "w")},
        {**course_dict(), "ignored": Call(os.mkdir, "PWNED")},
        {**course_dict(), "focal": Call(getattr, np.ndarray, "tofile")},
    ],
)
def test_pickles_that_call_something_do_not(folder, content):
    for pickled in (pickle.dumps(content, protocol=4), pickled_array(content), pickle.dumps(content, protocol=0)):
        refused(npy_of_pickle(folder / "bad.npy", pickled), "pickle: ")
        assert sorted(os.listdir(folder)) == ["bad.npy"]


def test_the_calls_would_be_made_by_others(folder):
    np.load(npy_of_pickle(folder / "bad.npy", pickled_array(Call(os.mkdir, "PWNED"))), allow_pickle=True)
    assert os.path.exists("PWNED")


ARRAY = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\nK\x00\x85C\x01btR"
DTYPE = b"cnumpy\ndtype\n(X\x02\x00\x00\x00f8K\x00K\x01tR"
STATE = b"(K\x03X\x01\x00\x00\x00<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb"


@pytest.mark.parametrize(
    "pickled",
    [
        b"",
        b"\x80\x04N.",
        b"\x80\x03K\x01r\xff\xff\xff\x7f.",  # a memo of 2^31 entries
        b"\x80\x04\x8e\xff\xff\xff\xff\xff\xff\xff\x7f.",  # 2^63 bytes follow
        b"\x80\x04\x95\xff\xff\xff\xff\xff\xff\xff\x7fN.",  # a frame of 2^63 bytes
        b"\x80\x05\x96\xff\xff\xff\xff\x00\x00\x00\x00.",
        ARRAY + b"(K\x01(J\xff\xff\xff\x7fJ\xff\xff\xff\x7ft" + DTYPE + STATE + b"\x89C\x00tb.",  # 2^62 numbers
        ARRAY + b"(K\x01)" + DTYPE + STATE + b"\x89]tb.",
        ARRAY + b"(NX\x05\x00\x00\x00statet.",
        ARRAY + b"N}X\x05\x00\x00\x00stateNs\x86b.",  # sets an attribute
        b"cnumpy\nndarray\nN}X\x04\x00\x00\x00nameNs\x86b.",
        b"cnumpy\nndarray\n(K\x05\x85tR.",
        b"cnumpy\ndtype\n)R.",
        b"cnumpy\nload\n.",
        b"\x80\x02cnumpy\ndtype\n\x81.",
        b"N(K\x01e.",
        b"N(K\x01K\x02u.",
        b"(lp0\n.",
        pickle.dumps(np.array(course_dict(), dtype=object), protocol=2),  # of which numpy.save writes none
    ],
)
def test_strange_pickles(tmp_path, pickled):
    refused(npy_of_pickle(tmp_path / "bad.npy", pickled), "pickle: ")
