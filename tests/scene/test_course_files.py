"""Course .npy files: layouts, refusals of every field, hostile pickles, and writing them back."""

from __future__ import annotations

import os
import pickle
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from scene_files import course_dict, npy_of_pickle, pickled_array, refusal, save_npy, transposed

from clshade.errors import InputError
from clshade.scene.formats import safe_pickle
from clshade.scene.formats.course_npy import save_course
from clshade.scene.formats.load import load
from clshade.scene.model import Mesh, Texture


def test_every_field_arrives(tmp_path):
    content = course_dict()
    scene = load(save_npy(tmp_path / "cat.npy", content))
    (mesh,) = scene.meshes
    assert (scene.preset, scene.name, mesh.verts.dtype) == ("course", "cat", np.float32)
    assert np.array_equal(mesh.verts, content["verts"].T)
    assert np.array_equal(mesh.colors, content["vertex_colors"].T)
    assert mesh.faces.tolist() == [[0, 1, 2], [1, 3, 2]]
    assert np.array_equal(mesh.uvs, content["uvs"].T)
    assert mesh.uv_faces.tolist() == [[0, 1, 2], [1, 2, 0]]
    assert mesh.normals is None
    material = mesh.material
    assert (material.ka.tolist(), material.kd[0], material.ks[2], material.n) == ([0.1] * 3, 0.8, 0.5, 7)
    assert material.texture is None
    camera = scene.camera
    assert (camera.eye.tolist(), camera.up.tolist(), camera.lookat.tolist()) == ([0, 0, 5], [0, 1, 0], [0, 0, 0])
    assert (camera.focal, camera.plane, camera.resolution) == (2.0, (3.0, 4.0), (64, 48))
    assert [light.position.tolist() for light in scene.lights] == [[0, 0, 5], [1, 2, 3]]
    assert [light.intensity.tolist() for light in scene.lights] == [[1, 1, 1], [1, 0.5, 0.25]]
    assert scene.ambient.tolist() == [0.2, 0.3, 0.4]
    assert scene.background.tolist() == [1.0, 0.9, 0.8]


def same(a: Mesh, b: Mesh) -> bool:
    return all(
        np.array_equal(getattr(a, name), getattr(b, name)) and getattr(a, name).dtype == getattr(b, name).dtype
        for name in ("verts", "faces", "colors", "uvs", "uv_faces")
    )


def test_both_layouts_are_the_same_scene(tmp_path):
    one = load(save_npy(tmp_path / "a.npy", course_dict()))
    two = load(save_npy(tmp_path / "b.npy", transposed(course_dict())))
    assert same(one.meshes[0], two.meshes[0])


def test_square_arrays_follow_the_others(tmp_path):
    square = np.arange(9, dtype=np.float64).reshape(3, 3)
    faces = np.array([[0, 1], [1, 2], [2, 0]])
    plain = {"verts": square, "vertex_colors": square, "uvs": None, "face_uv_indices": None}
    mesh = load(save_npy(tmp_path / "a.npy", course_dict(**plain, face_indices=faces))).meshes[0]
    assert np.array_equal(mesh.verts, square.T)
    mesh = load(save_npy(tmp_path / "b.npy", course_dict(**plain, face_indices=faces.T))).meshes[0]
    assert np.array_equal(mesh.verts, square)
    assert mesh.faces.tolist() == faces.T.tolist()
    faces = np.array([[0, 1, 2], [1, 2, 0], [2, 2, 1]])
    mesh = load(save_npy(tmp_path / "c.npy", course_dict(**plain, face_indices=faces))).meshes[0]
    assert np.array_equal(mesh.verts, square.T)
    assert mesh.faces.tolist() == faces.T.tolist()


def test_a_conflict_of_layouts_names_both(tmp_path):
    content = course_dict()
    content["uvs"] = content["uvs"].T
    refusal(save_npy(tmp_path / "a.npy", content), "a.npy: uvs: ", "layout of verts", "(3, 2)")


@pytest.mark.parametrize(
    "lights",
    [
        {
            "light_positions": np.array([[0, 0, 5], [1, 2, 3]]),
            "light_intensities": np.array([[1, 1, 1], [1, 0.5, 0.25]]),
        },
        {"light_positions": [[0, 0, 5], [1, 2, 3]], "light_intensities": [(1, 1, 1), (1.0, 0.5, 0.25)]},
        {
            "light_positions": [np.array([[0, 0, 5.0]]), np.array([[1, 2, 3.0]])],
            "light_intensities": [np.ones((3, 1)), np.array([[1], [0.5], [0.25]])],
        },
    ],
)
def test_lights_are_rows_or_a_list(tmp_path, lights):
    scene = load(save_npy(tmp_path / "a.npy", course_dict(**lights)))
    assert [light.position.tolist() for light in scene.lights] == [[0, 0, 5], [1, 2, 3]]
    assert [light.intensity.tolist() for light in scene.lights] == [[1, 1, 1], [1, 0.5, 0.25]]


def test_three_lights_are_still_rows(tmp_path):
    positions = np.arange(9.0).reshape(3, 3)
    scene = load(save_npy(tmp_path / "a.npy", course_dict(light_positions=positions, light_intensities=positions)))
    assert [light.position.tolist() for light in scene.lights] == positions.tolist()


@pytest.mark.parametrize("none", [[], np.zeros((0, 3)), np.zeros(0)])
def test_no_lights(tmp_path, none):
    assert load(save_npy(tmp_path / "a.npy", course_dict(light_positions=none, light_intensities=[]))).lights == ()


@pytest.mark.parametrize(
    ("key", "value", "part"),
    [
        ("verts", np.zeros((4, 4)), "shape (3, N) or (N, 3)"),
        ("verts", np.full((3, 4), np.nan), "finite"),
        ("verts", 3.0, "shape (3, N)"),
        ("verts", "text", "'text'"),
        ("verts", {"a": 1}, "dict"),
        ("verts", np.array([[None] * 4] * 3), "type 'O8'"),
        ("verts", [[0, 1, 2, 3], [0, 1], [0]], "differ in shape"),
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
        ("cam_eye", [0, 0, np.inf], "three finite numbers"),
        ("cam_lookat", [0, 0, 5], "other than eye"),
        ("cam_up", [0, 0, 1], "not parallel"),
        ("ka", [1, 2], "three finite numbers"),
        ("kd", None, "this key"),
        ("ks", np.nan, "finite"),
        ("n", -1, "0 to 1e9"),
        ("n", 2e9, "0 to 1e9"),
        ("n", np.inf, "0 to 1e9"),
        ("light_positions", np.zeros((2, 2)), "shape (L, 3)"),
        ("light_positions", [0, 0, 5], "one row per light"),
        ("light_positions", [[0, 0, 5]], "one row per light"),
        ("light_positions", [[0, 0, 5], [0, 0, np.nan]], "finite"),
        ("light_intensities", [[1, 1, 1, 1]] * 2, "shape (L, 3)"),
        ("Ia", np.nan, "finite"),
        ("M", 0, "from 1 to 16384"),
        ("N", 16385, "from 1 to 16384"),
        ("N", 1.5, "from 1 to 16384"),
        ("W", 0, "above 0"),
        ("H", -1, "above 0"),
        ("bg_color", [1, 1], "three finite numbers"),
        ("focal", 0, "above 0"),
        ("focal", None, "this key"),
        ("focal", True, "a finite number above 0, found True"),
        ("ka", True, "a number or three finite numbers, found "),
        ("focal", 1 << 70, "beyond 64 bits"),
    ],
)
def test_refused_fields(tmp_path, key, value, part):
    path = save_npy(tmp_path / "bad.npy", course_dict(**{key: value}))
    field = "light_intensities" if part == "one row per light" else key
    refusal(path, f"bad.npy: {field}: ", part)


@pytest.mark.parametrize("key", ["M", "N", "W", "H", "focal", "n", "ka", "kd", "ks", "Ia", "bg_color"])
@pytest.mark.parametrize(
    "wrapped", [lambda v: [v], lambda v: [[v]], lambda v: np.array([v]), lambda v: np.full((1, 1, 1), v)]
)
def test_an_array_of_one_is_no_number(tmp_path, key, wrapped):
    value = 48 if key in "MN" else 0.5
    load(save_npy(tmp_path / "a.npy", course_dict(**{key: value})))
    load(save_npy(tmp_path / "a.npy", course_dict(**{key: np.array(value)})))
    refusal(
        save_npy(tmp_path / "bad.npy", course_dict(**{key: wrapped(value)})), f"bad.npy: {key}: ", "number", "shape (1"
    )


@pytest.mark.parametrize("key", sorted(set(course_dict()) - {"depth"}))
def test_a_missing_key_is_named(tmp_path, key):
    if key == "vertex_colors":  # not needed with uvs
        assert load(save_npy(tmp_path / "a.npy", course_dict(vertex_colors=None))).meshes[0].colors is None
        plain = course_dict(vertex_colors=None, uvs=None, face_uv_indices=None)
        refusal(save_npy(tmp_path / "bad.npy", plain), "bad.npy: vertex_colors: expected this key")
    else:
        refusal(save_npy(tmp_path / "bad.npy", course_dict(**{key: None})), f"bad.npy: {key}: expected this key")


def test_options(tmp_path):
    path = save_npy(tmp_path / "a.npy", course_dict(focal=None))
    assert load(path, focal=70).camera.focal == 70.0
    path = save_npy(tmp_path / "b.npy", course_dict())
    scene = load(path, focal=7.5, resolution=(100, 50), lights=[1])
    assert (scene.camera.focal, scene.camera.plane, scene.camera.resolution) == (7.5, (3.0, 6.0), (100, 50))
    assert [light.position.tolist() for light in scene.lights] == [[1, 2, 3]]
    refusal(path, "load: focal: ", focal=-1)


@pytest.mark.parametrize(
    ("key", "value", "options"),
    [
        ("focal", -1, {"focal": 70}),
        ("M", 0, {"resolution": (64, 64)}),
        ("W", "wide", {"resolution": (64, 64)}),
        ("light_positions", [[0, 0, np.nan]], {"lights": []}),
        ("vertex_colors", np.zeros((3, 3)), {"texture": np.zeros((2, 2, 3))}),
    ],
)
def test_fields_are_checked_even_where_an_option_replaces_them(tmp_path, key, value, options):
    refusal(save_npy(tmp_path / "bad.npy", course_dict(**{key: value})), f"bad.npy: {key}: ", **options)


def test_texture(tmp_path):
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    Image.fromarray(pixels).save(tmp_path / "image.png")
    path = save_npy(tmp_path / "a.npy", course_dict())
    texture = load(path, texture=tmp_path / "image.png").meshes[0].material.texture
    assert texture.lookup == "course"
    assert np.array_equal(texture.image, (pixels / 255).astype(np.float32))
    assert np.array_equal(load(path, texture=pixels).meshes[0].material.texture.image, texture.image)
    plain = save_npy(tmp_path / "b.npy", course_dict(uvs=None, face_uv_indices=None))
    refusal(plain, "b.npy: uvs: ", texture=pixels)
    refusal(path, "a.npy: Texture: image: ", texture=pixels[:, :, 0])
    refusal(path, "none.png: file: ", "no such file", texture=tmp_path / "none.png")


def test_texture_coordinates_may_be_nan(tmp_path):
    """Exporters write NaN for untextured corners: the renderer gives such a corner a finite color."""
    content = course_dict()
    content["uvs"] = np.array(content["uvs"], np.float64)
    content["uvs"][0, 0] = np.nan
    uvs = load(save_npy(tmp_path / "a.npy", content)).meshes[0].uvs
    assert np.array_equal(uvs.T, content["uvs"], equal_nan=True)


def test_number_types_and_byte_order(tmp_path):
    content = course_dict()
    content["verts"] = content["verts"].astype(">f4")
    content["face_indices"] = content["face_indices"].astype(">u2")
    content["vertex_colors"] = np.asfortranarray(content["vertex_colors"])
    expected = load(save_npy(tmp_path / "a.npy", course_dict())).meshes[0]
    assert same(load(save_npy(tmp_path / "b.npy", content)).meshes[0], expected)
    content["verts"] = content["verts"].astype(float)
    assert load(save_npy(tmp_path / "c.npy", content)).meshes[0].verts.dtype == np.float64


@pytest.mark.parametrize("protocol", [2, 3, 4, 5])
def test_pickle_protocols(tmp_path, protocol):
    pickled = pickle.dumps(np.array(course_dict(), dtype=object), protocol=protocol)
    path = npy_of_pickle(tmp_path / "a.npy", pickled)
    if protocol in (3, 4):
        assert len(load(path).meshes[0].faces) == 2
    else:  # 2 needs _codecs.encode for bytes, 5 has another constructor; numpy.save writes neither
        refusal(path, "a.npy: pickle: ", "reference to")


class Call:
    """Object that pickles as a function call."""

    def __init__(self, function, *arguments):
        self.reduced = function, arguments

    def __reduce__(self):
        return self.reduced


def laughs() -> list:
    part: list = [1.0] * 10
    for _ in range(30):
        part = [part] * 10
    return part


def endless() -> list:
    part: list = []
    part.append(part)
    return part


@pytest.mark.parametrize(
    "content",
    [
        Call(os.system, "touch PWNED"),
        Call(eval, "open('PWNED', 'w')"),
        Call(exec, "open('PWNED', 'w')"),
        Call(np.zeros, 1 << 40),
        {"verts": Call(os.system, "touch PWNED")},
        {"depth": Call(open, "PWNED", "w")},
        {**course_dict(), "ignored": Call(os.mkdir, "PWNED")},
        {**course_dict(), "focal": Call(getattr, np.ndarray, "tofile")},
    ],
)
def test_pickles_that_call_something_do_not(folder, content):
    for pickled in (pickle.dumps(content, protocol=4), pickled_array(content), pickle.dumps(content, protocol=0)):
        refusal(npy_of_pickle(folder / "bad.npy", pickled), "bad.npy: pickle: ")
        assert sorted(os.listdir(folder)) == ["bad.npy"]


def test_the_calls_would_be_made_by_others(folder):
    np.load(npy_of_pickle(folder / "bad.npy", pickled_array(Call(os.mkdir, "PWNED"))), allow_pickle=True)
    assert os.path.exists("PWNED")


@pytest.mark.parametrize("content", [laughs(), endless(), [1.0] * (1 << 20), [[[[1.0]]]], [np.zeros(1 << 10)] * 100])
def test_lists_that_would_fill_the_memory(tmp_path, content):
    path = save_npy(tmp_path / "bad.npy", course_dict(light_positions=content))
    refusal(path, "bad.npy: ")


def test_integers_up_to_63_bits_and_a_sign(tmp_path):
    for number in ((1 << 63) - 1, 1 - (1 << 63)):
        content = safe_pickle.Content({"n": number, "list": [[number, 1]]}, "a.npy", 100)
        assert content.value("n") == number
        assert content.value("list").tolist() == [[number, 1]]
    for number in (1 << 63, -(1 << 63) - 1, 1 << 64):
        for content in (number, [number]):
            path = save_npy(tmp_path / "bad.npy", course_dict(verts=content))
            refusal(path, "bad.npy: verts: ", "an integer beyond 64 bits")


ARRAY = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\nK\x00\x85C\x01btR"
DTYPE = b"cnumpy\ndtype\n(X\x02\x00\x00\x00f8K\x00K\x01tR"
DTYPE += b"(K\x03X\x01\x00\x00\x00<NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb"


@pytest.mark.parametrize(
    "pickled",
    [
        b"",
        b"\x80\x04.",
        b"\x80\x04N.",
        b"\x80\x03K\x01r\xff\xff\xff\x7f.",  # a memo of 2^31 entries
        b"\x80\x04\x8e\xff\xff\xff\xff\xff\xff\xff\x7f.",  # 2^63 bytes follow
        b"\x80\x04\x95\xff\xff\xff\xff\xff\xff\xff\x7fN.",  # a frame of 2^63 bytes
        b"\x80\x05\x96\xff\xff\xff\xff\x00\x00\x00\x00.",
        ARRAY + b"(K\x01(J\xff\xff\xff\x7fJ\xff\xff\xff\x7ft" + DTYPE + b"\x89C\x00tb.",  # 2^62 numbers
        ARRAY + b"(K\x01)" + DTYPE + b"\x89]tb.",
        ARRAY + b"(NX\x05\x00\x00\x00statet.",
        ARRAY + b"N}X\x05\x00\x00\x00stateNs\x86b.",  # sets an attribute
        b"cnumpy\nndarray\nN}X\x04\x00\x00\x00nameNs\x86b.",
        b"cnumpy\nndarray\n(K\x05\x85tR.",
        b"cnumpy\ndtype\n)R.",
        b"cnumpy\ndtype\n(cnumpy\nndarray\ntR.",
        b"cnumpy\nload\n.",
        b"cnumpy.core.multiarray\nscalar\n.",
        b"\x80\x02cnumpy\ndtype\n\x81.",
        b"(lp0\n.",
        b"]" * 200_000 + b"a" * 199_999 + b".",
    ],
)
def test_strange_pickles(tmp_path, pickled):
    refusal(npy_of_pickle(tmp_path / "bad.npy", pickled), "bad.npy: pickle: ")


@pytest.mark.parametrize(
    "header",
    [
        b"\x93NUMPY",
        b"PK\x03\x04 and so on",
        b"\x93NUMPY\x09\x00v\x00" + b" " * 118,
        b"\x93NUMPY\x01\x00\xff\xff{}",
        b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}",
        b"\x93NUMPY\x01\x00\x02\x00{}",
        b"\x93NUMPY\x01\x00\x0e\x00__import__('os')",
        b"\x93NUMPY\x01\x00\x00\x08" + b"(" * 2048,
        b"\x93NUMPY\x01\x00\x00\x08" + b"-" * 2048,
        b"\x93NUMPY\x01\x00\x35\x00{'descr': '|O', 'fortran_order': False, 'shape': (9,)}",
    ],
)
def test_strange_headers(tmp_path, header):
    path = tmp_path / "bad.npy"
    path.write_bytes(header)
    refusal(path, "bad.npy: header: ")


def test_a_plain_array_is_refused(tmp_path):
    np.save(tmp_path / "bad.npy", np.zeros((3, 3)))
    refusal(tmp_path / "bad.npy", "header", "shape (3, 3) and type '<f8'")


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_saving_and_loading_keeps_every_bit(tmp_path, dtype):
    rng = np.random.default_rng(5)
    content = course_dict(verts=rng.standard_normal((3, 4)).astype(dtype), ka=rng.random(3), n=0.3, focal=1 / 3)
    scene = load(save_npy(tmp_path / "a.npy", content))
    save_course(scene, tmp_path / "b.npy")
    again = load(tmp_path / "b.npy")
    assert same(again.meshes[0], scene.meshes[0])
    for part in ("ka", "kd", "ks", "n"):
        assert np.array_equal(getattr(again.meshes[0].material, part), getattr(scene.meshes[0].material, part))
    for part in ("eye", "lookat", "up", "focal", "plane", "resolution"):
        assert np.array_equal(getattr(again.camera, part), getattr(scene.camera, part))
    for one, two in zip(again.lights, scene.lights, strict=True):
        assert np.array_equal(one.position, two.position)
        assert np.array_equal(one.intensity, two.intensity)
    assert np.array_equal(again.ambient, scene.ambient)
    assert np.array_equal(again.background, scene.background)
    assert again.preset == "course"
    plain = np.load(tmp_path / "b.npy", allow_pickle=True).item()  # as the course reads it
    assert plain["verts"].shape == (3, 4)
    assert plain["face_indices"].dtype == np.int64
    assert all(item.flags.c_contiguous for item in plain.values() if isinstance(item, np.ndarray))
    save_course(again, tmp_path / "c.npy")
    assert (tmp_path / "c.npy").read_bytes() == (tmp_path / "b.npy").read_bytes()


def test_saving_a_square_scene_and_one_without_lights_or_colors(tmp_path):
    scene = load(save_npy(tmp_path / "a.npy", course_dict()))
    triangle = Mesh(np.arange(9.0).reshape(3, 3), [[0, 1, 2], [2, 1, 0], [0, 0, 1]], material=scene.meshes[0].material)
    save_course(replace(scene, meshes=(triangle,), lights=()), tmp_path / "b.npy")
    again = load(tmp_path / "b.npy")
    assert np.array_equal(again.meshes[0].verts, triangle.verts)
    assert np.array_equal(again.meshes[0].faces, triangle.faces)
    assert (again.meshes[0].colors == 1).all()
    assert again.lights == ()


def test_saving_refuses_what_the_file_cannot_hold(tmp_path):
    scene = load(save_npy(tmp_path / "a.npy", course_dict()))
    mesh = scene.meshes[0]
    textured = replace(mesh.material, texture=Texture(np.zeros((1, 1, 3))))
    for name, variant in {
        "preset": replace(scene, preset="standard"),
        "scene.meshes": replace(scene, meshes=(mesh, mesh)),
        "background": replace(scene, background=None),
        "instances": replace(scene, meshes=(replace(mesh, instances=np.stack([np.eye(4)] * 2)),)),
        "normals": replace(scene, meshes=(replace(mesh, normals=np.ones((4, 3))),)),
        "texture": replace(scene, meshes=(replace(mesh, material=textured),)),
    }.items():
        with pytest.raises(InputError, match=f"save_course: .*{name}.*expected"):
            save_course(variant, tmp_path / "no.npy")
    with pytest.raises(InputError, match=r"ending in \.npy"):
        save_course(scene, tmp_path / "no.txt")
    assert os.listdir(tmp_path) == ["a.npy"]
