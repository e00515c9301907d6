"""Animations of glTF files: each interpolation by its formula, what they animate, and how one is chosen."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mesh_writers import CORNERS, INDICES, Gltf, triangle
from scene_files import refusal

from clshade.scene.formats.gltf import slerp, unit
from clshade.scene.formats.load import load

TIMES = np.array([0.5, 1.0, 3.0], np.float32)
PLACES = np.array([[1, 0, 0], [3, -2, 5], [-1, 4, 5]], np.float32)


def animated(*channels, **node) -> Gltf:
    """Return a triangle whose node is animated."""
    document = triangle()
    document.add("nodes", {"mesh": 0, **node})
    document.animation(*channels)
    return document


def instance(path, **options) -> np.ndarray:
    (mesh,) = load(path, **options).meshes
    return mesh.instances[0]


def turn(degrees: float, axis=(0, 0, 1)) -> list[float]:
    half = math.radians(degrees) / 2
    return [*(math.sin(half) * np.asarray(axis, float) / np.linalg.norm(axis)), math.cos(half)]


def test_linear_and_step(tmp_path):
    linear = {0.0: PLACES[0], 0.75: PLACES[:2].mean(axis=0), 1.5: 0.75 * PLACES[1] + 0.25 * PLACES[2], 1e39: PLACES[2]}
    steps = dict(zip((0.0, 0.999, 1.0, 2.999, 3.0), PLACES[[0, 0, 1, 1, 2]], strict=True))
    for interpolation, places in (("LINEAR", linear), ("STEP", steps)):
        document = animated((0, "translation", TIMES, PLACES, interpolation), translation=[7, 7, 7])
        path = document.glb(tmp_path / "a.glb")
        for time, expected in places.items():
            np.testing.assert_allclose(instance(path, time=time)[:3, 3], expected, rtol=1e-14)
        assert instance(path)[:3, 3].tolist() == [7, 7, 7]  # at rest
    times = np.array([0, 0.1], np.float32)  # 0.1 is 0.100000001 there
    path = animated((0, "translation", times, PLACES[:2], "STEP")).glb(tmp_path / "a.glb")
    assert instance(path, time=0.1)[:3, 3].tolist() == PLACES[1].tolist()


def test_cubic_splines(tmp_path):
    rng = np.random.default_rng(4)
    arriving, leaving = rng.normal(size=(2, 3, 3)).astype(np.float32)
    rows = np.stack([arriving, PLACES, leaving], axis=1).reshape(9, 3)
    path = animated((0, "translation", TIMES, rows, "CUBICSPLINE")).glb(tmp_path / "a.glb")
    for k, t in ((0, 0.25), (1, 0.6)):
        step = float(TIMES[k + 1] - TIMES[k])
        # The specification's sum, appendix C.5, in another order.
        expected = (
            (2 * t**3 - 3 * t**2 + 1) * PLACES[k].astype(float)
            + step * (t**3 - 2 * t**2 + t) * leaving[k]
            + (-2 * t**3 + 3 * t**2) * PLACES[k + 1]
            + step * (t**3 - t**2) * arriving[k + 1]
        )
        time = float(np.float32(TIMES[k] + t * step))
        np.testing.assert_allclose(instance(path, time=time)[:3, 3], expected, rtol=1e-6)
    for time, place in ((0, 0), (0.5, 0), (1, 1), (3, 2), (8, 2)):
        np.testing.assert_allclose(instance(path, time=time)[:3, 3], PLACES[place], atol=1e-15)
    turns = np.zeros((6, 4), np.float32)
    turns[1], turns[4] = turn(0), np.multiply(2, turn(90))  # the second is not a unit quaternion
    path = animated((0, "rotation", np.array([0, 1], np.float32), turns, "CUBICSPLINE")).glb(tmp_path / "a.glb")
    angle = 2 * math.atan2(math.sqrt(2), 1 + math.sqrt(2))  # of the mean of both
    np.testing.assert_allclose(instance(path, time=0.5)[0, :2], [math.cos(angle), -math.sin(angle)], atol=1e-7)


@pytest.mark.parametrize(
    ("sizes", "dtype", "error"),
    [
        *(((size, second), np.float32, 1e-7) for size, second in ((1, 1), (1, -1), (5, 0.1))),
        *(((size, size), dtype, 2 / size) for size, dtype in ((127, np.int8), (65535, np.uint16))),
    ],
)
def test_rotations_turn_evenly_on_the_shorter_arc(tmp_path, sizes, dtype, error):
    """Whatever the signs, lengths and types of the quaternions."""
    turns = np.transpose([sizes]) * np.array([turn(10), turn(130)])
    document = triangle()
    document.add("nodes", {"mesh": 0})
    integers = dtype is not np.float32
    output = document.accessor((np.round(turns) if integers else turns).astype(dtype), normalized=integers)
    document.animation((0, "rotation", np.array([0, 2], np.float32), output, "LINEAR"))
    path = document.glb(tmp_path / "a.glb")
    for time in (0.0, 0.5, 1.0, 1.75, 2.0):
        angle = math.radians(10 + 60 * time)
        expected = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
        np.testing.assert_allclose(instance(path, time=time)[:2, :2], expected, atol=error)


@pytest.mark.parametrize("degrees", [0.0, 1e-12, 1.0, 179.0, 180.0])
def test_slerp_is_exact_for_every_angle(degrees):
    before, after = (np.array(turn(angle, (1, 2, 3))) for angle in (0.0, degrees))
    for t in (0.0, 0.3, 1.0):
        rotation = slerp(t, before, after)
        np.testing.assert_allclose(rotation, turn(t * degrees, (1, 2, 3)), atol=3e-16)
        assert np.linalg.norm(rotation) == pytest.approx(1.0, abs=3e-16)
    assert unit(np.zeros(4)).tolist() == [0, 0, 0, 1]


def test_children_and_cameras_move_along_each_channel_at_its_times(tmp_path):
    document = triangle()
    document.mesh({"POSITION": CORNERS}, INDICES)
    document.add("nodes", {"children": [1, 2]})
    document.add("nodes", {"mesh": 0, "translation": [1, 0, 0]})
    document.add("nodes", {"camera": 0, "translation": [0, 0, 9]})
    document.add("nodes", {"mesh": 1})
    document.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0}})
    ends, sizes = np.float32([[0, 0, 0], [0, 8, 0]]), np.float32([[1, 1, 1], [3, 1, 1]])
    short, long = np.float32([0, 2]), np.float32([0, 4])
    document.animation(
        *((0, "translation", short, ends, "LINEAR"), (0, "scale", short, sizes, "LINEAR")),
        (3, "translation", long, ends, "LINEAR"),
    )
    scene = load(document.glb(tmp_path / "a.glb"), time=1.0)
    assert scene.meshes[0].instances[0].tolist() == [[2, 0, 0, 2], [0, 1, 0, 4], [0, 0, 1, 0], [0, 0, 0, 1]]
    assert scene.meshes[1].instances[0, 1, 3] == 2
    assert scene.camera.eye.tolist() == [0, 4, 9]


def test_an_animation_is_chosen_by_name_by_number_or_all_of_them(tmp_path):
    document = animated((0, "translation", TIMES[:1], PLACES[:1], "STEP"))
    document.animation((0, "translation", TIMES[:1], PLACES[1:2], "STEP"), name="Run")
    document.animation((0, "scale", TIMES[:1], np.float32([[2, 2, 2]]), "STEP"), name="5")
    document.json["animations"].append(None)  # a broken one beside them
    path = document.glb(tmp_path / "a.glb")
    assert load(path).animations == ("", "Run", "5", "")
    for chosen, place in ((None, 0), (0, 0), ("0", 0), ("Run", 1), (1, 1), (np.int64(1), 1)):
        matrix = instance(path, time=9, animation=chosen)
        assert (matrix[:3, 3].tolist(), matrix[0, 0]) == (PLACES[place].tolist(), 1), chosen
    assert instance(path, animation="5")[0, 0] == 2  # from its beginning
    document.json["animations"].pop()
    matrix = instance(document.glb(tmp_path / "a.glb"), time=9, animation="all")
    assert (matrix[:3, 3].tolist(), matrix[0, 0]) == (PLACES[1].tolist(), 2)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.glb", {"animation": "run"}, "one of Run, a number from 0 to 0, all, found 'run': did you mean 'Run'?"),
        ("a.glb", {"animation": True}, "load: animation: expected a name or a whole number"),
        ("a.glb", {"time": math.nan}, "load: time: expected a finite number of at least 0"),
        ("a.obj", {"time": 1}, "load: time: expected one only for .gltf and .glb files, found 1"),
    ],
)
def test_refused_choices(tmp_path, name, options, message):
    document = triangle()
    document.add("nodes", {"mesh": 0})
    document.animation((0, "translation", TIMES, PLACES, "LINEAR"), name="Run")
    document.glb(tmp_path / "a.glb")
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    refusal(tmp_path / name, message, **options)


def test_what_an_extension_animates_is_named(tmp_path):
    document = animated((0, "translation", TIMES, PLACES, "LINEAR"))
    channels = document.json["animations"][0]["channels"]
    channels.append({"sampler": 0, "target": {"path": "translation"}})  # of an extension, as it has no node
    path = document.glb(tmp_path / "a.glb")
    assert load(path, time=0).ignored == ()
    channels.append({"sampler": 0, "target": {"path": "pointer"}})
    path = document.glb(tmp_path / "a.glb")
    with pytest.warns(UserWarning, match="not rendered: KHR_animation_pointer$"):
        assert load(path, time=0).ignored == ("KHR_animation_pointer",)
