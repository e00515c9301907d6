"""`load`: the files it accepts, its options, and the default camera and lights of meshes."""

from __future__ import annotations

import gc
import math
import os
import re
import tracemalloc

import numpy as np
import pytest
from mesh_writers import Gltf, ply, stl
from scene_files import course_dict, refusal, save_npy, write

from clshade.errors import InputError
from clshade.scene import framing, geometry
from clshade.scene.formats.load import load
from clshade.scene.formats.table import BY_EXTENSION, EXTENSIONS, extensions_with, listed

CUBE = "".join(f"v {x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)) + "f 1 2 4 3\nf 5 6 8 7\n"


@pytest.fixture
def cube(tmp_path):
    return write(tmp_path / "cube.obj", CUBE)


def test_files_that_are_none(tmp_path):
    refusal(str(tmp_path / "none.obj"), "none.obj: file: expected an existing file, found no such file")
    refusal(str(tmp_path / "none.xyz"), "none.xyz: file: expected an existing file", ".npy, .obj", "no such", "'.xyz'")
    refusal(
        str(tmp_path / "none"), "none: file: expected an existing file", ".npy, .obj", "no such file, and no extension"
    )
    refusal(write(tmp_path / "image.PNG", "PNG"), "extension: expected one of .npy", "'.png', an image", "inspect")
    refusal(write(tmp_path / "text.txt", "text"), "text.txt: extension: expected one of .npy", "found '.txt'")
    refusal(str(tmp_path), "a folder")
    os.mkdir(tmp_path / "folder.obj")
    refusal(str(tmp_path / "folder.obj"), "folder.obj: file: expected a regular file, found a folder")
    os.mkfifo(tmp_path / "pipe.obj")
    refusal(str(tmp_path / "pipe.obj"), "pipe.obj: file: expected a regular file")
    refusal(str(tmp_path / "a\0.obj"), "file: ", "null")
    refusal(write(tmp_path / "a.obj" / "b.obj", "") + "/c.obj", "file: ")
    refusal(write(tmp_path / "two\nlines.obj", ""), "two\\nlines.obj", "an empty file")
    for name in ("empty.npy", "empty.obj", "empty"):
        refusal(write(tmp_path / name, ""), f"{name}: file: expected content, found an empty file")


def test_unknown_extensions_are_told_the_known_ones(tmp_path):
    for name in ("a.xyz", "a", "a.obj.gz", ".obj"):
        refusal(write(tmp_path / name, CUBE), f"{name}: extension: ", *EXTENSIONS)
    assert load(write(tmp_path / "A.OBJ", CUBE)).name == "A"


SOME = {
    "texture": np.zeros((1, 1, 3)),
    "focal": 2.0,
    "crease": 30,
    "flat": True,
    "weld": True,
    "up": "x",
    "time": 0.0,
    "animation": "a",
    "vertex_colors": "linear",
}


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_what_a_format_does_not_take_is_refused(tmp_path, extension):
    path = write(tmp_path / f"a{extension}", "not read")
    for name in SOME.keys() - BY_EXTENSION[extension].takes:
        *_, last = extensions_with(name)
        refusal(path, f"load: {name}: expected one only for ", f"{last} files, found ", **{name: SOME[name]})
    assert set(BY_EXTENSION[extension].takes) <= SOME.keys()


def test_the_formats_in_one_line():
    assert re.fullmatch(r"\.npy course scene; \.obj .* meshes; \.json saved scene", listed())
    assert set(re.findall(r"\.\w+", listed())) == set(EXTENSIONS)


@pytest.mark.parametrize("path", [None, 3, b"cube.obj", ["cube.obj"]])
def test_paths_that_are_none(path):
    with pytest.raises(InputError, match="load: path: expected a path"):
        load(path)


@pytest.mark.parametrize("resolution", [(0, 5), (5, 16385), (5,), 5, "ab", (1.5, 2), (math.nan, 2)])
def test_refused_resolutions(tmp_path, cube, resolution):
    refusal(cube, "load: resolution", resolution=resolution)
    refusal(save_npy(tmp_path / "a.npy", course_dict()), "load: resolution", resolution=resolution)


def test_lights_are_kept_in_the_order_asked_for(cube):
    lights = load(cube).lights
    assert len(lights) == 3
    positions = [light.position.tolist() for light in lights]
    assert [light.position.tolist() for light in load(cube, lights=[2, 0]).lights] == [positions[2], positions[0]]
    assert [light.position.tolist() for light in load(cube, lights=np.array([1])).lights] == [positions[1]]
    assert load(cube, lights=()).lights == ()
    for lights in ([3], [-1], [0, 0], [0.0], ["0"], 1, "0", [None], [[0]]):
        refusal(cube, "load: lights: ", "3 lights", lights=lights)


@pytest.mark.parametrize("resolution", [(800, 600), (100, 700), (700, 100), (64, 64)])
def test_the_camera_of_a_mesh(tmp_path, resolution):
    text = "v 10 20 30\nv 14 20 30\nv 10 22 30\nv 10 20 29\nf 1 2 3\nf 1 3 4\n"
    camera = (scene := load(write(tmp_path / "a.obj", text), resolution=resolution)).camera
    assert scene.fitted
    assert camera.resolution == resolution
    assert camera.plane[0] / camera.plane[1] == pytest.approx(resolution[1] / resolution[0])
    assert camera.plane[0] == pytest.approx(2 * math.tan(math.radians(framing.FOV / 2)))
    assert camera.eye[1] > camera.lookat[1]  # from above
    assert camera.up.tolist() == [0, 1, 0]


def test_lights_stand_outside_in_front_and_behind(cube):
    scene = load(cube)
    radius = geometry.half_diagonal(*geometry.bounding_box(scene))
    towards = -geometry.camera_axes(scene.camera)[2]
    heights = [light.position @ towards for light in scene.lights]
    assert [h > 0 for h in heights] == [True, True, False]
    for light in scene.lights:
        assert np.linalg.norm(light.position) > 2 * radius
        assert (light.intensity > 0).all()
        assert light.intensity.max() < 1


@pytest.mark.parametrize("exponent", [-60, 20, 60])
def test_framing_scales_with_the_scene(tmp_path, exponent):
    def scaled(scale: float) -> str:
        verts = np.array([[0.25, 1, 2], [3, 1, 0], [1, 4, 1]]) * scale
        return "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in verts.tolist()) + "f 1 2 3\n"

    one = load(write(tmp_path / "a.obj", scaled(1.0)))
    two = load(write(tmp_path / "b.obj", scaled(2.0**exponent)))
    assert np.array_equal(two.camera.eye, np.ldexp(one.camera.eye, exponent))
    for a, b in zip(one.lights, two.lights, strict=True):
        assert np.array_equal(b.position, np.ldexp(a.position, exponent))
    assert two.camera.plane == one.camera.plane


def test_degenerate_and_extreme_extents(tmp_path):
    for text in ("v 0 0 0\nf 1 1 1\n", "v 1e6 2 -3\nf 1 1 1\n", "v -3e38 0 0\nv 3e38 0 0\nv 0 3e38 0\nf 1 2 3\n"):
        scene = load(write(tmp_path / "a.obj", text))
        assert np.isfinite(scene.camera.eye).all()
        assert (scene.camera.eye != scene.camera.lookat).any()
    refusal(write(tmp_path / "b.obj", "v 1e308 0 0\nv -1e308 0 0\nv 0 1e308 0\nf 1 2 3\n"), "b.obj: Camera: eye: ")


@pytest.mark.sampled
@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "glb"])
def test_nothing_of_the_file_is_kept_beside_the_meshes(tmp_path, kind):
    """A scene keeps only its arrays alive: no bytes of the file, no second copy of the vertices."""
    verts = np.random.default_rng(1).random((3000, 3)).astype(np.float32)
    if kind == "obj":
        data: str | bytes = "".join(f"v {x} {y} {z}\n" for x, y, z in verts.tolist())
        data += "".join(f"f {k} {k + 1} {k + 2}\n" for k in range(1, 3000, 3))
    elif kind == "ply":
        head = "element vertex 3000\nproperty float x\nproperty float y\nproperty float z\n"
        head += "element face 1000\nproperty list uchar int vertex_indices\n"
        rows = [("3f", row) for row in verts.tolist()] + [("B3i", [3, k, k + 1, k + 2]) for k in range(0, 3000, 3)]
        data = ply("binary_little_endian", head, rows)
    elif kind == "stl":
        data = stl(verts.reshape(-1, 3, 3))
    else:
        document = Gltf()
        document.mesh({"POSITION": verts, "NORMAL": verts}, np.arange(3000, dtype=np.uint16))
        document.glb(tmp_path / "a.glb")
        data = (tmp_path / "a.glb").read_bytes()
    path = write(tmp_path / f"a.{kind}", data)
    load(path)
    gc.disable()
    tracemalloc.start()
    try:
        scene = load(path)  # without cycles, which would hold it until they are collected
        kept = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
        gc.enable()
    mesh = scene.meshes[0]
    arrays = [mesh.verts, mesh.faces, *(a for a in (mesh.normals, mesh.normal_faces) if a is not None)]
    assert kept < sum(array.nbytes for array in arrays) + 30_000  # for objects; the vertices alone take 36,000
