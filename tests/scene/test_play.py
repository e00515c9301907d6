"""Animations of glTF files as frames: each is what `load` shows at its time, and camera and lights suit all of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mesh_writers import bar, triangle
from scene_files import ends_in_image

import clshade
from clshade.errors import InputError
from clshade.scene.description import digest_of
from clshade.scene.formats.load import load, load_animation
from clshade.scene.pose import POSED

HALF = math.sqrt(0.5)
SECONDS = np.float32([0, 2])


def bending(**fields):
    """Return a bar that bends by 90 degrees to the left in two seconds."""
    document = bar(**fields)
    document.animation((2, "rotation", SECONDS, np.float32([[0, 0, 0, 1], [0, 0, HALF, HALF]]), "LINEAR"), name="Bend")
    return document


def flying():
    """Return a triangle that goes far to the right, past another one that stays."""
    document = triangle()
    document.add("nodes", {"mesh": 0})
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


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.glb", {"fps": 0}, "load_animation: fps: expected a finite number above 0, found 0"),
        ("a.glb", {"fps": 1e9}, "load_animation: fps: expected at most 1000000 frames, found 2 s of 1e+09"),
        ("a.glb", {"count": 0}, "load_animation: count: expected a whole number from 1 to 1000000, found 0"),
        ("a.glb", {"crease": 3.0, "flat": True}, "load_animation: crease: expected either crease or flat"),
        ("b.obj", {}, "b.obj: extension: expected one of .gltf, .glb, which have animations"),
        ("c.glb", {}, "c.glb: animations: expected an animation to show"),
    ],
)
def test_refused(tmp_path, name, options, message):
    bending().glb(tmp_path / "a.glb")
    triangle().glb(tmp_path / "c.glb")
    with pytest.raises(InputError) as caught:
        load_animation(tmp_path / name, **options)
    assert message in str(caught.value)


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


def studio(folder, *, camera: bool = True, light: bool = True) -> str:
    """Write the flying triangles with a camera and a lamp, which fly along."""
    document = flying()
    document.json["nodes"][0]["children"] = []
    if camera:
        document.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0}})
        children = document.json["nodes"][0]["children"]
        children.append(document.add("nodes", {"camera": 0, "translation": [0, 0, 9]}))
    if light:
        document.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 50}]}}
        document.json["extensionsUsed"] = ["KHR_lights_punctual"]
        lamp = {"translation": [0, 0, 2], "extensions": {"KHR_lights_punctual": {"light": 0}}}
        document.json["nodes"][0]["children"].append(document.add("nodes", lamp))
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
