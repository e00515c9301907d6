"""Animations of glTF files: each interpolation by its formula, what they animate, and broken ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mesh_writers import CORNERS, INDICES, Gltf, triangle
from scene_files import refusal

from clshade.errors import InputError
from clshade.scene.formats.gltf import hermite, slerp, unit
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


@pytest.mark.parametrize(
    ("interpolation", "time", "expected"),
    [
        ("LINEAR", 0.0, PLACES[0]),
        ("LINEAR", 0.5, PLACES[0]),
        ("LINEAR", 0.75, (PLACES[0] + PLACES[1]) / 2),
        ("LINEAR", 1.5, 0.75 * PLACES[1] + 0.25 * PLACES[2]),
        ("LINEAR", 3.0, PLACES[2]),
        ("LINEAR", 1e39, PLACES[2]),
        ("STEP", 0.0, PLACES[0]),
        ("STEP", 0.999, PLACES[0]),
        ("STEP", 1.0, PLACES[1]),
        ("STEP", 2.999, PLACES[1]),
        ("STEP", 3.0, PLACES[2]),
        ("STEP", 9.0, PLACES[2]),
    ],
)
def test_linear_and_step(tmp_path, interpolation, time, expected):
    document = animated((0, "translation", TIMES, PLACES, interpolation), translation=[7, 7, 7])
    path = document.glb(tmp_path / "a.glb")
    np.testing.assert_allclose(instance(path, time=time)[:3, 3], expected, rtol=1e-14)
    assert instance(path)[:3, 3].tolist() == [7, 7, 7]  # at rest


def test_a_step_begins_at_its_time_in_float32(tmp_path):
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


def test_a_spline_draws_the_polynomial_whose_derivatives_are_its_tangents(tmp_path):
    def cubic(t):
        return 2 - t + 3 * t**2 - 0.5 * t**3

    times = np.array([1, 3], np.float32)
    values, slopes = cubic(times), -1 + 6 * times - 1.5 * times**2
    rows = np.zeros((2, 3, 3), np.float32)
    rows[:, 0, 1] = rows[:, 2, 1] = slopes
    rows[:, 1, 1] = values
    path = animated((0, "translation", times, rows.reshape(6, 3), "CUBICSPLINE")).glb(tmp_path / "a.glb")
    for time in (1.0, 1.375, 2.0, 2.875):
        np.testing.assert_allclose(instance(path, time=time)[1, 3], cubic(time), rtol=1e-14)


@pytest.mark.parametrize("sign", [1, -1])
def test_rotations_turn_evenly_on_the_shorter_arc(tmp_path, sign):
    turns = np.array([turn(10), np.multiply(sign, turn(130))], np.float32)
    path = animated((0, "rotation", np.array([0, 2], np.float32), turns, "LINEAR")).glb(tmp_path / "a.glb")
    for time in (0.0, 0.5, 1.0, 1.75, 2.0):
        angle = math.radians(10 + 60 * time)
        expected = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
        np.testing.assert_allclose(instance(path, time=time)[:2, :2], expected, atol=1e-7)


def test_the_lengths_of_quaternions_do_not_count(tmp_path):
    turns = np.array([np.multiply(5, turn(0)), np.multiply(0.1, turn(90))], np.float32)
    path = animated((0, "rotation", np.array([0, 3], np.float32), turns, "LINEAR")).glb(tmp_path / "a.glb")
    angle = math.radians(30)
    np.testing.assert_allclose(instance(path, time=1)[:2, 0], [math.cos(angle), math.sin(angle)], atol=1e-7)


@pytest.mark.parametrize("degrees", [0.0, 1e-12, 1e-6, 1.0, 179.0, 180.0])
def test_slerp_is_exact_for_every_angle(degrees):
    before, after = (np.array(turn(angle, (1, 2, 3))) for angle in (0.0, degrees))
    for t in (0.0, 0.3, 1.0):
        rotation = slerp(t, before, after)
        np.testing.assert_allclose(rotation, turn(t * degrees, (1, 2, 3)), atol=3e-16)
        assert np.linalg.norm(rotation) == pytest.approx(1.0, abs=3e-16)


def test_a_spline_of_rotations_is_normalized(tmp_path):
    rows = np.zeros((6, 4), np.float32)
    rows[1], rows[4] = turn(0), np.multiply(2, turn(90))  # the second is not a unit quaternion
    path = animated((0, "rotation", np.array([0, 1], np.float32), rows, "CUBICSPLINE")).glb(tmp_path / "a.glb")
    matrix = instance(path, time=0.5)
    middle = unit(hermite(0.5, rows[1].astype(float), rows[4].astype(float), np.zeros(4), np.zeros(4)))
    angle = 2 * math.atan2(middle[2], middle[3])
    assert angle == pytest.approx(2 * math.atan2(math.sqrt(2), 1 + math.sqrt(2)), abs=1e-7)
    np.testing.assert_allclose(matrix[0, :2], [math.cos(angle), -math.sin(angle)], atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(matrix[:3, :3]), 1.0, atol=1e-14)
    assert unit(np.zeros(4)).tolist() == [0, 0, 0, 1]


@pytest.mark.parametrize(("dtype", "factor"), [(np.int8, 127), (np.int16, 32767), (np.uint8, 255), (np.uint16, 65535)])
def test_normalized_integers(tmp_path, dtype, factor):
    turns = np.round(np.multiply([turn(0), turn(90)], factor)).astype(dtype)
    document = triangle()
    document.add("nodes", {"mesh": 0})
    output = document.accessor(turns, normalized=True)
    document.animation((0, "rotation", np.array([0, 1], np.float32), output, "LINEAR"))
    matrix = instance(document.glb(tmp_path / "a.glb"), time=0.5)
    np.testing.assert_allclose(matrix[:2, 0], [math.sqrt(0.5)] * 2, atol=0.5 / factor)


def test_children_cameras_and_lights_move_along(tmp_path):
    document = triangle()
    document.add("nodes", {"children": [1, 2]})
    document.add("nodes", {"mesh": 0, "translation": [1, 0, 0]})
    document.add("nodes", {"camera": 0, "translation": [0, 0, 9]})
    document.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0}})
    ends = np.array([[0, 0, 0], [0, 8, 0]], np.float32)
    sizes = np.array([[1, 1, 1], [3, 1, 1]], np.float32)
    seconds = np.array([0, 2], np.float32)
    document.animation((0, "translation", seconds, ends, "LINEAR"), (0, "scale", seconds, sizes, "LINEAR"))
    scene = load(document.glb(tmp_path / "a.glb"), time=1.0)
    assert scene.meshes[0].instances[0].tolist() == [[2, 0, 0, 2], [0, 1, 0, 4], [0, 0, 1, 0], [0, 0, 0, 1]]
    assert scene.camera.eye.tolist() == [0, 4, 9]


def test_an_animation_is_chosen_by_name_by_number_or_all_of_them(tmp_path):
    document = animated((0, "translation", TIMES[:1], PLACES[:1], "STEP"))
    document.animation((0, "translation", TIMES[:1], PLACES[1:2], "STEP"), name="Run")
    document.animation((0, "scale", TIMES[:1], np.float32([[2, 2, 2]]), "STEP"), name="5")
    path = document.glb(tmp_path / "a.glb")
    assert load(path).animations == ("", "Run", "5")
    for wanted, place, size in (
        *((None, 0, 1), (0, 0, 1), ("0", 0, 1), ("Run", 1, 1), (1, 1, 1)),
        *(("all", 1, 2), (np.int64(1), 1, 1)),
    ):
        matrix = instance(path, time=9, animation=wanted)
        assert (matrix[:3, 3].tolist(), matrix[0, 0]) == (PLACES[place].tolist(), size), wanted
    assert instance(path, animation="5")[0, 0] == 2  # from its beginning
    expected = "a.glb: animation: expected one of Run, 5, a number from 0 to 2, all, found "
    refusal(path, expected, "'run': did you mean 'Run'?", animation="run")
    refusal(path, expected, "'3'", animation=3)
    refusal(path, "load: animation: expected a name or a whole number", animation=1.5)
    refusal(path, "load: animation: expected a name or a whole number", animation=True)
    for time in (-1, math.nan, "1", None.__class__):
        refusal(path, "load: time: expected a finite number of at least 0", time=time)
    refusal(
        triangle().glb(tmp_path / "b.glb"), "b.glb: animations: expected an animation to show", "found none", time=0
    )
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    refusal(tmp_path / "a.obj", "load: time: expected one only for .gltf and .glb files, found 1", time=1)
    refusal(tmp_path / "a.obj", "load: animation: expected one only for .gltf", animation="Run")


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


def changed(times=TIMES, values=PLACES, path="translation", kind="LINEAR", **node) -> Gltf:
    return animated((0, path, times, values, kind), **node)


BROKEN = [
    (changed(np.float32([0, np.nan, 1])), "samplers[0].input: expected finite times from 0 on, found nan in row 1"),
    (changed(np.float32([0, 1, np.inf])), "samplers[0].input: expected finite times from 0 on, found inf in row 2"),
    (changed(np.float32([-1, 0, 1])), "samplers[0].input: expected finite times from 0 on, found -1.0 in row 0"),
    (changed(np.float32([0, 2, 1])), "samplers[0].input: expected times that increase, found 1 after 2 in row 2"),
    (changed(np.float32([0, 1, 1])), "samplers[0].input: expected times that increase, found 1 after 1 in row 2"),
    (changed(np.uint16([0, 1, 2])), "samplers[0].input: expected float32 of type SCALAR"),
    (changed(PLACES), "samplers[0].input: expected float32 of type SCALAR"),
    (changed(values=PLACES[:2]), "samplers[0].output: expected 3 rows of 3 for 3 times, ", "found 2 of 3"),
    (changed(values=np.ones((3, 4), np.float32)), "output: expected 3 rows of 3 for 3 times, ", "found 3 of 4 float32"),
    (changed(kind="CUBICSPLINE"), "samplers[0].output: expected 9 rows of 3 for 3 times, ", "found 3 of 3"),
    (changed(values=np.where(PLACES == 5, np.float32(np.nan), PLACES)), "output: expected finite numbers", "in row 1"),
    (changed(values=PLACES.astype(np.int16)), "times, float32 or normalized integers, found 3 of 3 int16"),
    (
        changed(values=np.zeros((3, 4), np.float32), path="rotation"),
        "output: expected quaternions other than 0",
        "row 0",
    ),
    (changed(path="color"), "channels[0].target.path: expected one of translation, rotation", "found 'color'"),
    (changed(kind="CUBIC"), "interpolation: expected one of LINEAR, STEP, CUBICSPLINE, found 'CUBIC'"),
    (changed(path="weights"), "channels[0].target.node: expected a node whose mesh has morph targets, found nodes[0]"),
    (changed(matrix=np.eye(4).ravel().tolist()), "target.node: expected a node without a matrix, found nodes[0]"),
]


@pytest.mark.parametrize(("document", "words"), [(document, words) for document, *words in BROKEN])
def test_broken_animations_are_refused_where_they_are_asked_for(tmp_path, document, words):
    path = document.glb(tmp_path / "a.glb")
    assert load(path).face_count == 1
    refusal(path, "a.glb: animations[0].", *words, time=0.5)


@pytest.mark.parametrize(
    ("animations", "names", "words"),
    [
        ([{"name": 5}], ("",), "animations[0].name: expected text, found 5"),
        ([3], ("",), "animations[0]: expected an object, found 3"),
        ({"name": "Run"}, (), "animations: expected a list"),
    ],
)
def test_broken_entries_are_refused_where_they_are_asked_for(tmp_path, animations, names, words):
    document = triangle()
    document.json["animations"] = animations
    path = document.glb(tmp_path / "a.glb")
    assert load(path).animations == names
    for options in ({"time": 0}, {"animation": 0}, {"animation": "all"}):
        refusal(path, "a.glb: ", words, **options)


def test_a_sound_animation_beside_a_broken_one(tmp_path):
    document = triangle()
    document.add("nodes", {"mesh": 0})
    document.json["animations"] = [None]
    document.animation((0, "translation", TIMES, PLACES, "LINEAR"), name="Run")
    path = document.glb(tmp_path / "a.glb")
    assert load(path).animations == ("", "Run")
    assert instance(path, animation="Run")[:3, 3].tolist() == instance(path, animation=1)[:3, 3].tolist() == [1, 0, 0]


@pytest.mark.parametrize(
    ("where", "key", "value", "words"),
    [
        ("sampler", "input", None, "samplers[0].input: expected an index, found none"),
        ("sampler", "output", None, "samplers[0].output: expected an index, found none"),
        ("sampler", "output", 99, "samplers[0].output: expected an index of the 4 accessors, found 99"),
        ("channel", "target", None, "channels[0].target: expected an object, found none"),
        ("channel", "sampler", 1, "channels[0].sampler: expected an index of the 1 samplers, found 1"),
        ("channel", "sampler", None, "channels[0].sampler: expected a whole number of at least 0"),
        ("target", "path", None, "channels[0].target.path: expected one of translation"),
        ("target", "node", 4, "channels[0].target.node: expected an index of the 1 nodes, found 4"),
    ],
)
def test_broken_fields(tmp_path, where, key, value, words):
    document = changed()
    (animation,) = document.json["animations"]
    entry = animation["samplers" if where == "sampler" else "channels"][0]
    entry = entry["target"] if where == "target" else entry
    entry.pop(key)
    if value is not None:
        entry[key] = value
    refusal(document.glb(tmp_path / "a.glb"), f"a.glb: animations[0].{words}", time=0)


def test_a_property_has_one_channel(tmp_path):
    channel = (0, "translation", TIMES, PLACES, "LINEAR")
    path = animated(channel, channel).glb(tmp_path / "a.glb")
    refusal(path, "channels[1].target.path: expected one channel for each property", time=0)


def test_times_of_several_channels_are_their_own(tmp_path):
    document = triangle()
    document.mesh({"POSITION": CORNERS}, INDICES)
    document.add("nodes", {"mesh": 0})
    document.add("nodes", {"mesh": 1})
    seconds = [np.array([0, end], np.float32) for end in (1, 4)]
    ends = np.array([[0, 0, 0], [4, 0, 0]], np.float32)
    document.animation(*((node, "translation", seconds[node], ends, "LINEAR") for node in (0, 1)))
    meshes = load(document.glb(tmp_path / "a.glb"), time=2).meshes
    assert [mesh.instances[0, 0, 3] for mesh in meshes] == [4, 2]


def test_an_overflow_is_refused(tmp_path):
    sizes = np.full((1, 3), 3e38, np.float32)
    document = triangle()
    for node in range(9):
        document.add("nodes", {"children": [node + 1]} if node < 8 else {"mesh": 0})
    document.animation(*((node, "scale", TIMES[:1], sizes, "STEP") for node in range(9)))
    with pytest.raises(InputError, match=r"nodes\[8\]\.matrix: expected a finite placement in the world"):
        load(document.glb(tmp_path / "a.glb"), time=0)
