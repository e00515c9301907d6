"""Files of cameras: fields, K and pose, round trips, what OpenCV projects, stacks of matrices, refusals."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from processes import ROOT

from clshade.errors import InputError, OutputError
from clshade.farm import orbit, parse_frames, read_cameras, stereo_cameras, write_cameras
from clshade.farm.camera_files import FIELDS
from clshade.scene.camera import Camera
from clshade.scene.geometry import camera_axes

K = [[220.5, 0.0, 70.25], [0.0, 240.75, 41.5], [0.0, 0.0, 1.0]]
POSE = [[0.0, 0.0, 1.0, 1.5], [0.0, 1.0, 0.0, -2.0], [-1.0, 0.0, 0.0, 0.25], [0.0, 0.0, 0.0, 1.0]]
BASE = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.5), (140, 100))


def read(folder: Path, value: object, base: Camera = BASE, **options) -> tuple[Camera, ...]:
    path = folder / "cameras.json"
    path.write_text(value if isinstance(value, str) else json.dumps(value))
    return read_cameras(path, base, **options)


def fields_of(camera: Camera) -> list:
    return [np.asarray(value).tolist() for value in vars(camera).values()]


def test_fields_of_a_camera(tmp_path):
    """A resolution makes pixels square; what is left out is the base's."""
    values = {"eye": [1, 2, 3], "lookat": [0, 1, 0], "up": [0, 0, 1], "focal": 2, "plane": [2, 3]}
    values |= {"resolution": [40, 20], "principal": [0.25, 0.5], "orthographic": True}
    assert {*values, "fov", "K", "pose", "convention", "pixel_center"} == set(FIELDS)
    entries = [values, {}, {"eye": [0, 0, 9], "fov": 90}, {"resolution": [60, 20]}]
    entries += [{"K": K, "eye": [0, 1, 5]}, {"pose": POSE}]
    first, second, third, fourth, lens, placed = read(tmp_path, entries)
    for name, value in values.items():
        assert np.array_equal(getattr(first, name), value), name
    assert fields_of(second) == fields_of(BASE)
    assert third.eye.tolist() == [0, 0, 9]
    assert third.plane[0] / third.focal == pytest.approx(2.0, rel=1e-15)
    assert fourth.plane == (1.0, 3.0)
    assert (lens.eye.tolist(), lens.up.tolist()) == ([0, 1, 5], [0, 1, 0])
    np.testing.assert_allclose(lens.to_matrix()[0], K, rtol=0, atol=1e-12)
    assert (placed.focal, placed.plane) == (BASE.focal, BASE.plane)
    np.testing.assert_allclose(placed.pose(), POSE, rtol=0, atol=1e-15)


def test_the_readme_s_cameras(tmp_path):
    text = (ROOT / "clshade" / "farm" / "README.md").read_text()
    first, second, third = read(tmp_path, text.split("```json cameras.json\n")[1].split("```")[0])
    assert (first.eye.tolist(), second.resolution) == ([-2.4, 4.9, 9.2], (640, 480))
    assert (third.plane, third.principal) == ((0.6, 0.8), (0.5, 0.45))


@pytest.mark.parametrize("convention", ["opencv", "opengl"])
@pytest.mark.parametrize("center", [0.5, 0])
def test_matrices_are_read_written_and_read_again(tmp_path, convention, center):
    entry = {"K": K, "pose": POSE, "resolution": [140, 100], "convention": convention, "pixel_center": center}
    cameras = read(tmp_path, [entry])
    expected = Camera.from_matrix(K, POSE, (140, 100), convention=convention, pixel_center=center)
    assert fields_of(cameras[0]) == fields_of(expected) == fields_of(read(tmp_path, [{**entry, "pose": POSE[:3]}])[0])
    for _ in range(2):
        write_cameras(tmp_path / "again.json", cameras, convention=convention, pixel_center=center)
        cameras = read_cameras(tmp_path / "again.json", BASE)
    (listed,) = json.loads((tmp_path / "again.json").read_text())
    np.testing.assert_allclose(listed["K"], K, rtol=0, atol=1e-12)
    np.testing.assert_allclose(listed["pose"], POSE, rtol=0, atol=1e-14)


def test_stacks_of_matrices(tmp_path):
    poses = np.stack([POSE] * 3)
    poses[:, 0, 3] = range(3)
    stack = poses.tolist()
    one = read(tmp_path, {"K": K, "pose": stack, "convention": "opengl"})
    separate = read(tmp_path, {"K": [K] * 3, "pose": stack, "convention": "opengl", "resolution": [140, 100]})
    expected = Camera.from_matrices(K, stack, (140, 100), convention="opengl")
    lens = read(tmp_path, {"pose": stack, "fov": 40})
    for k in range(3):
        assert fields_of(one[k]) == fields_of(separate[k]) == fields_of(expected[k])
        assert lens[k].eye.tolist() == [k, -2.0, 0.25]
        assert lens[k].plane[0] == pytest.approx(2 * np.tan(np.radians(20)), rel=1e-15)


def test_k_at_another_resolution(tmp_path):
    """Of the same proportions: K is scaled, pixels that are not square stay so. Without its own, K is in those pixels."""
    entry = {"K": K, "pose": POSE, "resolution": [140, 100]}
    (half,) = read(tmp_path, [entry], resolution=(70, 50))
    np.testing.assert_allclose(half.to_matrix()[0][:2], np.array(K)[:2] / 2, rtol=1e-14)
    message = "camera 1: --resolution: expected the proportions of 140x100, whose pixels K is in, found 70x70"
    with pytest.raises(InputError, match=message):
        read(tmp_path, [entry], resolution=(70, 70))
    del entry["resolution"]
    (camera,) = read(tmp_path, [entry], resolution=(70, 50))
    np.testing.assert_allclose(camera.to_matrix()[0], K, rtol=0, atol=1e-12)
    assert camera.resolution == (70, 50)


def test_all_kinds_of_cameras_are_written(tmp_path):
    turn = parse_frames("1..4")
    cameras = [*orbit(BASE, turn.numbers, turn).values(), Camera(*fields_of(BASE)[:6], (0.25, 0.5), True)]
    write_cameras(tmp_path / "c.json", cameras)
    copies = read_cameras(tmp_path / "c.json", Camera((9, 9, 9), (1, 2, 3), (0, 0, 1), 7.0, (3.0, 3.0)))
    assert [camera.resolution for camera in copies] == [(140, 100)] * 5
    for camera, again in zip(cameras, copies, strict=True):
        np.testing.assert_allclose(again.pose(), camera.pose(), rtol=0, atol=1e-14)
    assert fields_of(copies[4]) == fields_of(cameras[4])
    before = (tmp_path / "c.json").read_bytes()
    with pytest.raises(InputError, match=r"^Camera\.pose: convention: .*did you mean 'opencv'"):
        write_cameras(tmp_path / "c.json", cameras, convention="open_cv")
    assert (tmp_path / "c.json").read_bytes() == before
    with pytest.raises(OutputError, match="there is no folder"):
        write_cameras(tmp_path / "none" / "c.json", cameras)


def test_cameras_of_two_eyes():
    turn = parse_frames("1..10000")
    cameras = orbit(BASE, turn.numbers, turn)
    left, right = stereo_cameras(cameras, 0.5, 4.0)
    assert (len(left), len(right), 7 in left, 0 in right, next(iter(left))) == (10_000, 10_000, True, False, 1)
    for eye, expected in zip((left[7], right[7]), cameras[7].stereo(0.5, 4.0), strict=True):
        assert fields_of(eye) == fields_of(expected)


FLAT = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]]
MATRIX = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
REFUSED = [
    ([{"eye": [1, 2, 3]}, {"lokat": [0, 0, 0]}], "camera 2: ", "'lokat': did you mean 'lookat'?"),
    ([{"zzzzzzzz": 1}], "camera 1: ", "eye, lookat, up"),
    ([{"intrinsics": K}], "camera 1: ", "'intrinsics': did you mean 'K'?"),
    ([{"c2w": POSE}], "camera 1: ", "'c2w': did you mean 'pose'?"),
    ({"K": K, "poses": [POSE]}, "cameras: ", "'poses': did you mean 'pose'?"),
    ([{"eye": [1, 2]}], "camera 1: eye: ", "three finite numbers"),
    ([{"eye": [[1, 2], [3]]}], "camera 1: eye: ", ""),
    ([{"focal": True}], "camera 1: focal: ", "number"),
    ([{"fov": 180}], "camera 1: ", "fov"),
    ([{"fov": 1e-320}], "camera 1: ", "fov"),
    ([{"resolution": [1e9, 20]}], "camera 1: resolution N: ", ""),
    ([{"up": [0, 0, 1]}], "camera 1: up: ", "parallel"),
    ([{}, {"K": [[220.5, 0.5, 70.25], *K[1:]]}], "camera 2: K: ", "found a skew of 0.5"),
    ([{"pose": FLAT}], "camera 1: pose: ", "found a singular matrix"),
    ([{"pose": POSE[:2]}], "camera 1: pose: ", "(4, 4) or (3, 4) matrix"),
    ([{"K": [["1", 0, 0], *K[1:]]}], "camera 1: K: ", MATRIX),
    ([{"fov": 40, "focal": 1}], "camera 1: fov: ", "either fov or focal"),
    ([{"K": K, "fov": 40}], "camera 1: K: ", "either K or fov"),
    ([{"K": K, "principal": [0.5, 0.5]}], "camera 1: K: ", "either K or principal"),
    ([{"pose": POSE, "eye": [0, 0, 1]}], "camera 1: pose: ", "either pose or eye"),
    ([{"convention": "opengl"}], "camera 1: convention: ", "expected pose beside it, found none"),
    ([{"pose": POSE, "pixel_center": 0}], "camera 1: pixel_center: ", "expected K beside it"),
    ([{"pose": POSE, "convention": "openGl"}], "camera 1: convention: ", "did you mean 'opengl'?"),
    ([{"K": K, "pixel_center": [0]}], "camera 1: pixel_center: ", "expected 0.5 or 0, found [0]"),
    ({"K": [K] * 3, "pose": [POSE] * 2}, "pose: ", "expected as many as of K, 3, found 2"),
    ({"K": K, "pose": [POSE, FLAT]}, "camera 2: pose: ", "singular"),
    ({"K": [K, POSE], "pose": [POSE] * 2}, "camera 2: K: ", MATRIX),
    ({"K": K, "pose": POSE}, "JSON: ", "a list of cameras, [{...}, ...], or an object"),
    ([[1, 2, 3]], "camera 1: ", "an object"),
    ([], "JSON: ", "a list of cameras, [{...}, ...], found an empty list"),
    ("3", "JSON: ", "a list of cameras"),
    ('[{"eye": [1,2,3], "eye": [3,2,1]}]', "JSON: ", "the key eye twice"),
    ("[{}", "JSON: ", "line 1, column 4"),
    (f'[{{"focal": 1{"0" * 400}}}]', "camera 1: focal: ", ""),
    (f'[{{"focal": 1{"0" * 5000}}}]', "JSON: ", "a whole number of 5001 digits"),
    ("[" + "1," * 2_200_000 + "1]", "JSON: ", "at most"),
]


@pytest.mark.parametrize(("value", "place", "part"), REFUSED)
def test_refused_files(tmp_path, value, place, part):
    with pytest.raises(InputError) as caught:
        read(tmp_path, value)
    message = str(caught.value)
    assert message.startswith(f"{tmp_path}/cameras.json: {place}")
    assert part in message
    assert "\n" not in message


@pytest.mark.parametrize("name", ["K", "pose", "convention", "pixel_center", "eye"])
def test_lists_nested_deeply_and_infinity(tmp_path, name):
    for value in ("[" * 900 + "]" * 900, "[[1e999, 0, 0], [0, 1, 0], [0, 0, 1]]", "1e999"):
        with pytest.raises(InputError, match=rf"/cameras\.json: camera 1: {name}: expected "):
            read(tmp_path, f'[{{"{name}": {value}}}]')


def test_a_camera_straight_above_needs_no_up(tmp_path, capsys):
    (camera,) = read(tmp_path, [{"eye": [0, 9, 0], "lookat": [0, 0, 0]}], replace(BASE, up=(0, 1, 0)))
    assert np.allclose(camera_axes(camera), [[1, 0, 0], [0, 0, -1], [0, -1, 0]], atol=1e-9)
    message = "cameras.json: camera 1: it looks along 0,1,0, its up vector: 0,0,-1 is up in the image\n"
    assert capsys.readouterr().err == f"clshade: {tmp_path}/{message}"
