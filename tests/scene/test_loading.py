"""`load`: the files it accepts, its options, and the default camera and lights of meshes."""

import gc
import math
import os
import tracemalloc

import numpy as np
import pytest
from scene_files import course_dict, refusal, save_npy, write

from clshade.errors import InputError
from clshade.scene import framing, geometry
from clshade.scene.formats.load import load
from clshade.scene.formats.table import BY_EXTENSION, EXTENSIONS, extensions_with

CUBE = "".join(f"v {x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)) + "f 1 2 4 3\nf 5 6 8 7\n"


@pytest.fixture
def cube(tmp_path):
    return write(tmp_path / "cube.obj", CUBE)


def test_files_that_are_none(tmp_path):
    os.mkdir(tmp_path / "folder.obj")
    os.mkfifo(tmp_path / "pipe.obj")
    for name in ("empty.npy", "two\nlines.obj"):
        write(tmp_path / name, "")
    for name in ("image.PNG", "a.xyz", "a", "a.obj.gz", ".obj"):
        write(tmp_path / name, CUBE)
    for name, *parts in (
        ("none.obj", "none.obj: file: expected an existing file, found no such file"),
        ("none", "none: file: expected an existing file", ".npy, .obj", "no such file, and no extension"),
        ("image.PNG", "extension: expected one of .npy", "'.png', an image", "inspect"),
        *((name, f"{name}: extension: ", *EXTENSIONS) for name in ("a.xyz", "a", "a.obj.gz", ".obj")),
        ("folder.obj", "folder.obj: file: expected a regular file, found a folder"),
        ("pipe.obj", "pipe.obj: file: expected a regular file"),
        ("a\0.obj", "file: ", "null"),
        ("two\nlines.obj", "two\\nlines.obj", "an empty file"),
        ("empty.npy", "empty.npy: file: expected content, found an empty file"),
    ):
        refusal(f"{tmp_path}/{name}", *parts)
    assert load(write(tmp_path / "A.OBJ", CUBE)).name == "A"
    for path in (None, 3, b"cube.obj", ["cube.obj"]):
        with pytest.raises(InputError, match="load: path: expected a path"):
            load(path)


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


@pytest.mark.parametrize("resolution", [(0, 5), (5, 16385), (5,), 5, "ab", (1.5, 2), (math.nan, 2)])
def test_refused_resolutions(tmp_path, cube, resolution):
    for path in (cube, save_npy(tmp_path / "a.npy", course_dict())):
        refusal(path, "load: resolution", resolution=resolution)


def test_lights_are_kept_in_the_order_asked_for(cube):
    lights = load(cube).lights
    assert len(lights) == 3
    positions = [light.position.tolist() for light in lights]
    assert [light.position.tolist() for light in load(cube, lights=[2, 0]).lights] == [positions[2], positions[0]]
    assert [light.position.tolist() for light in load(cube, lights=np.array([1])).lights] == [positions[1]]
    assert load(cube, lights=()).lights == ()
    for lights in ([3], [-1], [0, 0], [0.0], ["0"], 1, "0", [None], [[0]]):
        refusal(cube, "load: lights: ", "3 lights", lights=lights)


def test_the_camera_and_the_lights_of_a_mesh(cube):
    camera = (scene := load(cube, resolution=(100, 700))).camera
    assert scene.fitted
    assert camera.resolution == (100, 700)
    assert camera.plane[0] == pytest.approx(2 * math.tan(math.radians(framing.FOV / 2)))
    assert camera.eye[1] > camera.lookat[1]  # from above
    assert camera.up.tolist() == [0, 1, 0]
    radius = geometry.half_diagonal(*geometry.bounding_box(scene))
    heights = [light.position @ -geometry.camera_axes(camera)[2] for light in scene.lights]
    assert [h > 0 for h in heights] == [True, True, False]  # outside, in front and behind
    for light in scene.lights:
        assert np.linalg.norm(light.position) > 2 * radius
        assert 0 < light.intensity.min() <= light.intensity.max() < 1


@pytest.mark.parametrize("extension", ["obj", "ply", "stl", "glb"])
def test_nothing_of_the_file_is_kept_beside_the_meshes(tmp_path, extension):
    """A scene keeps only its arrays alive: no bytes of the file, no second copy of the vertices."""
    trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")
    path = write(tmp_path / f"a.{extension}", trimesh.creation.icosphere(subdivisions=4).export(file_type=extension))
    load(path)
    gc.disable()
    tracemalloc.start()
    try:
        mesh = load(path).meshes[0]  # without cycles, which would hold it until they are collected
        kept = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
        gc.enable()
    arrays = [mesh.verts, mesh.faces, *(a for a in (mesh.normals, mesh.normal_faces) if a is not None)]
    assert kept < sum(array.nbytes for array in arrays) + 30_000  # for objects; the vertices alone take 30,744
