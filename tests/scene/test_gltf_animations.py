"""Animations of glTF files: each interpolation by its formula, what they animate, how one is chosen, and their frames."""

import math

import numpy as np
import pytest
from mesh_writers import CORNERS, INDICES, PLACES, TIMES, Gltf, bar, cubic, triangle
from scene_files import ends_in_image, refusal

import clshade
from clshade.scene.description import digest_of
from clshade.scene.formats.gltf import slerp, unit
from clshade.scene.formats.load import load, load_animation
from clshade.scene.pose import POSED


def animated(*channels, **node) -> Gltf:
    """Return a triangle whose node is animated."""
    document = triangle({"mesh": 0, **node})
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
        expected = cubic(t, step, PLACES[k].astype(float), leaving[k], PLACES[k + 1], arriving[k + 1])
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
    document = triangle({"mesh": 0})
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


# Frames

HALF = math.sqrt(0.5)
SECONDS = np.float32([0, 2])


def bending(**fields):
    """Return a bar that bends by 90 degrees to the left in two seconds."""
    document = bar(**fields)
    document.animation((2, "rotation", SECONDS, np.float32([[0, 0, 0, 1], [0, 0, HALF, HALF]]), "LINEAR"), name="Go")
    return document


def flying():
    """Return a triangle that goes far to the right, past another one that stays."""
    document = triangle({"mesh": 0})
    document.mesh({"POSITION": np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]])}, np.uint16([0, 1, 2]))
    document.add("nodes", {"mesh": 1})
    document.animation((0, "translation", SECONDS, np.float32([[0, 0, 0], [40, 0, 0]]), "LINEAR"))
    return document


@pytest.mark.parametrize("document", [bending(), flying()], ids=["bar", "triangle"])
def test_a_frame_is_what_load_shows_at_its_time(tmp_path, document):
    path = document.glb(tmp_path / "a.glb")
    played = clshade.load_animation(path, count=4)
    assert played.times == (0.0, 0.5, 1.0, 1.5)
    assert (played.seconds, list(played.poses), list(played.cameras)) == (2.0, [1, 2, 3, 4], [1, 2, 3, 4])
    for frame, time in enumerate(played.times, 1):
        posed, expected = played.poses[frame].of(played.scene), load(path, time=time)
        assert len(posed.meshes) == len(expected.meshes)
        for mesh, reference in zip(posed.meshes, expected.meshes, strict=True):
            for name in (*POSED, "faces"):
                np.testing.assert_array_equal(getattr(mesh, name), getattr(reference, name))
    assert not played.poses[1].meshes  # which is the scene itself
    assert list(played.poses[2].meshes) == [0]


def test_the_number_of_frames(tmp_path):
    path = bending().glb(tmp_path / "a.glb")
    assert [len(load_animation(path, fps=fps).times) for fps in (30, 24, 1.2, 0.1)] == [60, 48, 2, 1]
    assert load_animation(path, fps=1.2).times == (0.0, 1.0)  # which divide the length
    still = bar()
    still.animation((2, "rotation", SECONDS[:1], np.float32([[0, 0, HALF, HALF]]), "STEP"))
    assert load_animation(still.glb(tmp_path / "b.glb")).times == (0.0,)


WHO = "load_animation"


@pytest.mark.parametrize(
    ("read", "name", "options", "message"),
    [
        (load, "a.glb", {"animation": "go"}, "one of Go, a number from 0 to 0, all, found 'go': did you mean 'Go'?"),
        (load, "a.glb", {"animation": True}, "load: animation: expected a name or a whole number"),
        (load, "a.glb", {"time": math.nan}, "load: time: expected a finite number of at least 0"),
        (load, "b.obj", {"time": 1}, "load: time: expected one only for .gltf and .glb files, found 1"),
        (load_animation, "a.glb", {"fps": 0}, f"{WHO}: fps: expected a finite number above 0, found 0"),
        (load_animation, "a.glb", {"fps": 1e9}, f"{WHO}: fps: expected at most 1000000 frames, found 2 s of 1e+09"),
        (load_animation, "a.glb", {"count": 0}, f"{WHO}: count: expected a whole number from 1 to 1000000, found 0"),
        (load_animation, "a.glb", {"crease": 3.0, "flat": True}, f"{WHO}: crease: expected either crease or flat"),
        (load_animation, "b.obj", {}, "b.obj: extension: expected one of .gltf, .glb, which have animations"),
        (load_animation, "c.glb", {}, "c.glb: animations: expected an animation to show"),
    ],
)
def test_refused(tmp_path, read, name, options, message):
    bending().glb(tmp_path / "a.glb")
    triangle().glb(tmp_path / "c.glb")
    (tmp_path / "b.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    refusal(tmp_path / name, message, read=read, **options)


def test_the_chosen_camera_shows_every_frame(tmp_path):
    path = flying().glb(tmp_path / "a.glb")
    played = load_animation(path, count=8)
    assert len({id(camera) for camera in played.cameras.values()}) == 1
    poses = {frame: pose.of(played.scene).meshes for frame, pose in played.poses.items()}
    peak = max(np.abs(ends_in_image(played.cameras[frame], meshes)).max() for frame, meshes in poses.items())
    assert 0.85 < peak < 0.9 + 1e-9
    assert [len(scene.meshes) for scene in (played.scene, played.stage)] == [2, 3]
    early = load(path, time=0.1).meshes
    assert np.abs(ends_in_image(load(path).camera, early)).max() > 1.0  # that of the file at rest would not


def studio(folder) -> str:
    """Write the flying triangles with a camera and a lamp, which fly along."""
    document = flying()
    document.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0}})
    document.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 50}]}}
    document.json["extensionsUsed"] = ["KHR_lights_punctual"]
    lamp = {"translation": [0, 0, 2], "extensions": {"KHR_lights_punctual": {"light": 0}}}
    along = [document.add("nodes", node) for node in ({"camera": 0, "translation": [0, 0, 9]}, lamp)]
    document.json["nodes"][0]["children"] = along
    return document.glb(folder / "studio.glb")


def test_cameras_and_lights_of_the_file_move_and_keep_their_scale(tmp_path):
    played = load_animation(studio(tmp_path), count=4)
    assert [camera.eye.tolist() for camera in played.cameras.values()] == [[x, 0, 9] for x in (0, 10, 20, 30)]
    lights = [played.poses[frame].lights for frame in played.poses]
    assert [light.position.tolist() for (light,) in lights] == [[x, 0, 2] for x in (0, 10, 20, 30)]
    assert {light.intensity[0] for (light,) in lights} == {played.scene.light_scale * 50}
    fitted = load_animation(tmp_path / "studio.glb", count=4, fit=True)
    assert fitted.scene.fitted
    assert fitted.cameras[1] is fitted.cameras[4]


def test_the_source_of_poses_tells_them_apart(tmp_path):
    path = studio(tmp_path)
    digests = [
        digest_of(load_animation(path, **options).poses.source)
        for options in ({"count": 4}, {"count": 4}, {"count": 5}, {"count": 4, "crease": 30})
    ]
    assert digests[0] == digests[1]
    assert len(set(digests)) == 3
    for change in (lambda document: None, lambda document: document.json["nodes"][0].update(scale=[1, 2, 3])):
        document = flying()
        change(document)
        digests.append(digest_of(load_animation(document.gltf(tmp_path / "b.gltf", "b.bin"), count=4).poses.source))
    data = bytearray((tmp_path / "b.bin").read_bytes())
    data[-4] ^= 1  # of where it flies
    (tmp_path / "b.bin").write_bytes(data)
    digests.append(digest_of(load_animation(tmp_path / "b.gltf", count=4).poses.source))
    assert len(set(digests)) == 6
