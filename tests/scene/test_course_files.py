"""Course .npy files: layouts, options, writing back, and pickles designed to take long. Refusals: test_refused_files.py."""

import gc
import os
import pickle
import struct
import time
from dataclasses import replace
from math import prod

import numpy as np
import pytest
from PIL import Image
from scene_files import course_dict, npy_of_pickle, refusal, same, save_npy, transposed

from clshade.errors import InputError
from clshade.scene.formats.course_npy import save_course
from clshade.scene.formats.load import load
from clshade.scene.formats.safe_pickle import MAX_OPCODES, Refused, _Steps, unpickle
from clshade.scene.model import Camera, Material, Mesh, PointLight, Scene, Texture

POSITIONS, INTENSITIES = [[0, 0, 5], [1, 2, 3]], [[1, 1, 1], [1, 0.5, 0.25]]


def test_every_field_arrives(tmp_path):
    content = course_dict()
    mesh = Mesh(
        *(content["verts"].T, [[0, 1, 2], [1, 3, 2]], content["vertex_colors"].T),
        uvs=content["uvs"].T,
        uv_faces=[[0, 1, 2], [1, 2, 0]],
        material=Material(0.1, 0.8, 0.5, 7),
        name="cat",
    )
    camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 2.0, (3.0, 4.0), (64, 48))
    lights = tuple(map(PointLight, POSITIONS, INTENSITIES))
    scene = load(save_npy(tmp_path / "cat.npy", content))
    assert scene.meshes[0].verts.dtype == np.float32
    assert same(scene, Scene((mesh,), camera, lights, [0.2, 0.3, 0.4], [1.0, 0.9, 0.8], "course", "cat"))


@pytest.mark.parametrize(
    "content",
    [
        transposed(course_dict()),
        course_dict(
            verts=course_dict()["verts"].astype(">f4"),
            face_indices=course_dict()["face_indices"].astype(">u2"),
            vertex_colors=np.asfortranarray(course_dict()["vertex_colors"]),
        ),
        course_dict(kd=np.array(0.8), M=np.array(48)),
        course_dict(light_positions=np.array(POSITIONS), light_intensities=np.array(INTENSITIES)),
        course_dict(light_positions=POSITIONS, light_intensities=[tuple(row) for row in INTENSITIES]),
        course_dict(
            light_positions=[np.array([[0, 0, 5.0]]), np.array([[1, 2, 3.0]])],
            light_intensities=[np.ones((3, 1)), np.array([[1], [0.5], [0.25]])],
        ),
    ],
)
def test_other_forms_of_the_same_scene(tmp_path, content):
    """Nx3 or 3xN, any type and order of bytes and numbers, lights as rows or a list."""
    assert same(load(save_npy(tmp_path / "a.npy", content)), load(save_npy(tmp_path / "a.npy", course_dict())))


def test_square_arrays_follow_the_others(tmp_path):
    square = np.arange(9, dtype=np.float64).reshape(3, 3)
    plain = {"verts": square, "vertex_colors": square, "uvs": None, "face_uv_indices": None}
    for faces in ([[0, 1], [1, 2], [2, 0]], [[0, 1, 2]], [[0, 1, 2], [1, 2, 0], [2, 2, 1]]):
        columns = len(faces) == 3
        mesh = load(save_npy(tmp_path / "a.npy", course_dict(**plain, face_indices=np.array(faces)))).meshes[0]
        assert np.array_equal(mesh.verts, square.T if columns else square)
        assert mesh.faces.tolist() == (np.transpose(faces) if columns else np.array(faces)).tolist()


def test_three_lights_are_still_rows_and_none_are_none(tmp_path):
    positions = np.arange(9.0).reshape(3, 3)
    scene = load(save_npy(tmp_path / "a.npy", course_dict(light_positions=positions, light_intensities=positions)))
    assert [light.position.tolist() for light in scene.lights] == positions.tolist()
    for none in ([], np.zeros((0, 3)), np.zeros(0)):
        content = course_dict(light_positions=none, light_intensities=[])
        assert load(save_npy(tmp_path / "a.npy", content)).lights == ()


def test_options(tmp_path):
    path = save_npy(tmp_path / "a.npy", course_dict(focal=None))
    assert load(path, focal=70).camera.focal == 70.0
    path = save_npy(tmp_path / "b.npy", course_dict())
    scene = load(path, focal=7.5, resolution=(100, 50), lights=[1])
    assert (scene.camera.focal, scene.camera.plane, scene.camera.resolution) == (7.5, (3.0, 6.0), (100, 50))
    assert [light.position.tolist() for light in scene.lights] == [[1, 2, 3]]
    refusal(path, "load: focal: ", focal=-1)


def test_texture(tmp_path):
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    Image.fromarray(pixels).save(tmp_path / "image.png")
    path = save_npy(tmp_path / "a.npy", course_dict())
    texture = load(path, texture=tmp_path / "image.png").meshes[0].material.texture
    assert (texture.lookup, texture.name) == ("course", "image.png")
    assert np.array_equal(texture.image, (pixels / 255).astype(np.float32))
    assert np.array_equal(load(path, texture=pixels).meshes[0].material.texture.image, texture.image)
    refusal(path, "a.npy: Texture: image: ", texture=pixels[:, :, 0])
    refusal(path, "none.png: file: ", "no such file", texture=tmp_path / "none.png")


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_saving_and_loading_keeps_every_bit(tmp_path, dtype):
    rng = np.random.default_rng(5)
    content = course_dict(verts=rng.standard_normal((3, 4)).astype(dtype), ka=rng.random(3), n=0.3, focal=1 / 3)
    scene = load(save_npy(tmp_path / "a.npy", content))
    path = tmp_path / "a.npy"
    save_course(scene, path)
    assert same(load(path), scene)
    plain = np.load(path, allow_pickle=True).item()  # as the course reads it
    assert plain["verts"].shape == (3, 4)
    assert plain["face_indices"].dtype == np.int64
    assert all(item.flags.c_contiguous for item in plain.values() if isinstance(item, np.ndarray))
    save_course(load(path), tmp_path / "c.npy")
    assert (tmp_path / "c.npy").read_bytes() == path.read_bytes()


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


# Pickles designed to take long: any file is loaded or refused in time linear in its size

SIZE = 300_000  # bytes of a worst case
SECONDS = 4.0  # of CPU time: most take a tenth, and what is not linear in the size takes ten or more
DEPTH = 28  # levels that hold the one before twice: 2^28 steps take seconds, and end
FIRST = 300  # of the memo indices used here
PRIME = (1 << 61) - 1  # CPython's hash of its multiples is 0
KNOWN = pickle.dumps(np.array(course_dict(), dtype=object), protocol=3)  # 4 has frames: nothing can be inserted
END = KNOWN[KNOWN.rindex(b"uat") :]  # ends the dict, the list that holds it, the array's state, the array
FRESH = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\nK\x00\x85C\x01btR"


def word(value: int) -> bytes:
    return struct.pack("<I", value)


def text(content: str) -> bytes:
    return b"X" + word(len(content.encode())) + content.encode()


def put(index: int) -> bytes:
    return b"r" + word(FIRST + index)


def get(index: int) -> bytes:
    return b"j" + word(FIRST + index)


def dtype(name: bytes, order: bytes = b"X\x01\x00\x00\x00<") -> bytes:
    state = b"(K\x03" + order + b"NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb"
    return b"cnumpy\ndtype\n(" + name + b"K\x00K\x01tR" + state


F2, F8, I1 = (dtype(text(name)) for name in ("f2", "f8", "i1"))


def array(shape: bytes, kind: bytes, data: bytes) -> bytes:
    return FRESH + b"(K\x01" + shape + kind + b"\x89B" + word(len(data)) + data + b"tb"


def zeros(*shape: int) -> bytes:
    """Return an array of one byte per number."""
    return array(b"(" + b"".join(b"J" + word(extent) for extent in shape) + b"t", I1, bytes(prod(shape)))


def fields(**values: bytes) -> bytes:
    """Return the pickle of a course file with fields added or replaced."""
    return KNOWN.removesuffix(END) + b"".join(text(key) + value for key, value in values.items()) + END


def pairs() -> bytes:
    """Return a nested tuple of 2^DEPTH leaves: each level holds the one before twice."""
    return b"K\x01" + put(0) + b"".join(get(k) + b"\x86" + put(k + 1) for k in range(DEPTH))


def lists() -> bytes:
    """Return the same with lists, all of them in a list; the largest is `get(DEPTH)`."""
    return b"](K\x01" + put(0) + b"".join(b"](" + get(k) * 2 + b"e" + put(k + 1) for k in range(DEPTH)) + b"e"


def repeated(part: bytes, before: bytes = b"", after: bytes = b"") -> bytes:
    return before + part * ((SIZE - len(before) - len(after)) // len(part)) + after


LONG = b"\x8a\xff" + b"\xff" * 254 + b"\x7f"
COLLIDING = b"".join(b"\x8a\x0a" + (k * PRIME).to_bytes(10, "little", signed=True) + b"N" for k in range(SIZE // 13))
LISTED = b"](" + b"K\x01" * 1000 + b"e" + put(0)
WORST = {
    # One opcode, or a few, repeated
    **{f"only {part!r}": repeated(part) for part in (b"N", b"(", b"cnumpy\ndtype\n")},
    "frames": repeated(b"\x95" + struct.pack("<Q", SIZE // 2)),
    "memoized anywhere": b"N" + b"".join(b"r" + word(k << 14) for k in range(SIZE // 5)),
    "a long reference": repeated(b"a", b"c", b"\nload\n"),
    # Values
    **{f"list of {one[:12]!r}": fields(verts=repeated(one, b"](", b"e")) for one in (b"K\x01", LONG, b"\x8c\x01\xff")},
    "appended to itself": fields(verts=repeated(get(0) + b"a", b"]" + put(0))),
    "many keys": fields(**{f"{k:06x}": b"N" for k in range(SIZE // 12)}),
    "colliding keys": fields(verts=b"}(" + COLLIDING + b"u"),
    "many lights": fields(light_positions=zeros(SIZE // 3, 3) + put(0), light_intensities=get(0)),
    "many faces": fields(face_indices=zeros(3, SIZE // 3) + put(0), face_uv_indices=get(0)),
    # Nested
    "lists in lists": fields(verts=b"](" * (SIZE // 3) + b"e" * (SIZE // 3)),
    "arrays in arrays": fields(verts=FRESH[:38] + b")R(NNNN" * (SIZE // 46) + b"N" + b"tb" * (SIZE // 46)),
    # Referenced many times
    "2^28 leaves": fields(verts=pairs()),
    "a list of 2^28 leaves": fields(unused=lists(), verts=get(DEPTH)),
    "a shape of 2^28 leaves": fields(verts=array(pairs(), F8, b"")),
    "a byte order of 2^28 leaves": fields(verts=array(b"K\x01\x85", dtype(text("f8"), pairs()), bytes(8))),
    "the whole of 2^28 leaves": pairs() + b".",
    "a list in all fields": fields(unused=LISTED, **{key: b"](" + get(0) * 250 + b"e" for key in course_dict()}),
    "an array many times": fields(unused=zeros(3) + put(0), light_positions=repeated(get(0), b"](", b"e")),
    "long arguments often": repeated(b"cnumpy\ndtype\n" + get(0) + b"R", b"(" + b"N" * (SIZE // 2) + b"t" + put(0)),
    "a long state often": repeated(get(0) + b"b", b"(" + b"N" * (SIZE // 2) + b"t" + put(0) + F8),
}


@pytest.mark.sampled
@pytest.mark.parametrize("name", WORST)
def test_worst_cases_take_no_time(tmp_path, name):
    path, start = npy_of_pickle(tmp_path / "a.npy", WORST[name]), time.process_time()
    try:
        load(path)
    except InputError as error:
        assert str(error).isprintable()
        assert len(str(error)) < 400
    assert time.process_time() - start < SECONDS


def test_the_garbage_collector_is_as_before(tmp_path):
    paths = [npy_of_pickle(tmp_path / f"{k}.npy", pickled) for k, pickled in enumerate([KNOWN, b"N."])]
    try:
        for switch in (gc.disable, gc.enable):
            switch()
            load(paths[0])
            refusal(paths[1], "1.npy: pickle: ")
            assert gc.isenabled() == (switch is gc.enable)
    finally:
        gc.enable()


@pytest.mark.parametrize("key", [b"K\x01", b"N", b"C\x01a", b"K\x01\x85", b"\x88", text("k" * 65)])
def test_keys_are_short_text(tmp_path, key):
    pickled = fields(unused=b"}" + key + b"Ns")
    refusal(npy_of_pickle(tmp_path / "bad.npy", pickled), "bad.npy: pickle: ", "a key other than text of at most 64")
    assert load(npy_of_pickle(tmp_path / "a.npy", fields(unused=b"}" + text("k" * 64) + b"Ns"))).face_count == 2


def test_limits_are_what_they_say(monkeypatch):
    """Each limit at its last valid and first invalid value."""
    assert MAX_OPCODES == 1 << 20
    monkeypatch.setattr(_Steps, "left", 100)
    assert unpickle(b"N" * 99 + b".") is None
    with pytest.raises(Refused, match="more than 1048576 opcodes"):
        unpickle(b"N" * 100 + b".")


@pytest.mark.parametrize(("times", "long"), [(200, False), (300, True)])
def test_what_a_file_names_again_may_be_a_quarter_of_a_million_numbers(tmp_path, times, long):
    repeated = b"](" + b"K\x01" * 1000 + b"e" + put(0)
    pickled = fields(unused=repeated, light_positions=b"](" + get(0) * times + b"e", light_intensities=b"]")
    message = refusal(npy_of_pickle(tmp_path / "a.npy", pickled), "light_positions")
    assert ("a list that is too long" in message) == long
