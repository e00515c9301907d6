"""Invalid values in scenes, cameras and settings: an InputError of one line that names class and field."""

from __future__ import annotations

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.images.layers import LAYERS
from clshade.pipeline.effective_settings import effective_settings
from clshade.scene.camera import Camera
from clshade.scene.formats.load import load
from clshade.scene.model import Material, Mesh, PointLight, Scene, Settings, Texture

CAMERA = Camera((0, 0, 0), (0, 0, 1), (0, 1, 0), 1.0, (1.0, 1.0))
EYE = ((0, 0, 0), (0, 0, 1), (0, 1, 0))
K, POSE = np.diag([9.0, 9.0, 1.0]), np.eye(4)
SCENE = Scene((), CAMERA)
IMAGE = np.zeros((2, 2, 3))
LAYER_NAMES = ", ".join(LAYERS)
TRIANGLE = np.eye(3), [[0, 1, 2]]

CASES = {
    "layers=5": (lambda: Settings(layers=5), f"Settings: layers: expected names of {LAYER_NAMES}, or all, found 5"),
    "layers=None": (
        lambda: Settings(layers=None),
        f"Settings: layers: expected names of {LAYER_NAMES}, or all, found None",
    ),
    "layers=(5,)": (lambda: Settings(layers=(5,)), f"Settings: layers: expected one of {LAYER_NAMES}, all, found 5"),
    "cull": (lambda: Settings(cull="false"), "Settings: cull: expected True or False, found 'false'"),
    "cull=0": (lambda: Settings(cull=0), "Settings: cull: "),
    "sample_shading": (lambda: Settings(sample_shading=np.array([0, 1])), "Settings: sample_shading: "),
    "two_sided": (lambda: Material(two_sided="no"), "Material: two_sided: expected True or False, found 'no'"),
    "two_sided=None": (lambda: Material(two_sided=None), "Material: two_sided: "),
    "orthographic": (lambda: Camera(*EYE, 1.0, (1, 1), orthographic="no"), "Camera: orthographic: "),
    "load flat": (lambda: load("a.obj", flat="no"), "load: flat: expected True or False, found 'no'"),
    "load two_sided": (lambda: load("a.obj", two_sided=np.ones(2)), "load: two_sided: "),
    "near": (lambda: Settings(near="far"), "Settings: near: "),
    "preset": (lambda: Settings.from_preset(""), "Settings: preset: expected one of course, standard, pbr, found ''"),
    "preset=5": (lambda: Settings.from_preset(5), "Settings: preset: expected one of course, standard, pbr, found 5"),
    "render layers": (lambda: effective_settings(SCENE, layers=None), "Settings: layers: "),
    "render preset": (
        lambda: effective_settings(SCENE, ""),
        "Settings: preset: expected one of course, standard, pbr, found ''",
    ),
    "scene preset": (lambda: Scene((), CAMERA, preset=""), "Scene: preset: "),
    "wrap=5": (lambda: Texture(IMAGE, wrap=5), "Texture: wrap: expected one name or two, for u and v, found 5"),
    "wrap=None": (lambda: Texture(IMAGE, wrap=None), "Texture: wrap: "),
    "wrap of three": (lambda: Texture(IMAGE, wrap=("clamp",) * 3), "Texture: wrap: "),
    "lookup": (lambda: Texture(IMAGE, lookup=None), "Texture: lookup: "),
    "image": (lambda: Texture("x"), "Texture: image: "),
    "n": (lambda: Material(n="x"), "Material: n: "),
    "light": (lambda: PointLight("x"), "PointLight: position: "),
    "animations='Run'": (
        lambda: Scene((), CAMERA, animations="Run"),
        "Scene: animations: expected a sequence of texts",
    ),
    "animations=(5,)": (lambda: Scene((), CAMERA, animations=(5,)), "Scene: animations: expected a sequence of texts"),
    "ignored=None": (lambda: Scene((), CAMERA, ignored=None), "Scene: ignored: expected a sequence of texts"),
    "meshes=5": (lambda: Scene(5, CAMERA), "Scene: meshes: "),
    "verts": (lambda: Mesh("x", [[0, 1, 2]]), "Mesh: verts: "),
    "faces": (lambda: Mesh(np.eye(3), "x"), "Mesh: faces: "),
    "ragged faces": (lambda: Mesh(np.eye(3), [[0, 1, 2], [0]]), "Mesh: faces: "),
    "instances": (lambda: Mesh(*TRIANGLE, instances=[[1], [1, 2]]), "Mesh: instances: "),
    "instance_names": (
        lambda: Mesh(*TRIANGLE, instance_names=("a", "b")),
        "Mesh: instance_names: expected one text per instance (1), or none, found 2",
    ),
    "instance_names='ab'": (
        lambda: Mesh(*TRIANGLE, instance_names="ab"),
        "Mesh: instance_names: expected a sequence of texts",
    ),
    "plane": (lambda: Camera(*EYE, 1.0, 5), "Camera: plane: expected two numbers (H, W), found 5"),
    "principal": (lambda: Camera(*EYE, 1.0, (1, 1), principal="x"), "Camera: principal: "),
    "resolution": (
        lambda: Camera(*EYE, 1.0, (1, 1), 5),
        "Camera: resolution: expected two whole numbers (N, M), found 5",
    ),
    "other resolution": (lambda: CAMERA.with_resolution(("a", 3)), "Camera: resolution N: "),
    "focal of an array": (
        lambda: Camera(*EYE, [1.0], (1, 1)),
        "Camera: focal: expected a finite number above 0, found [1.0]",
    ),
    "resolution of arrays": (lambda: Camera(*EYE, 1.0, (1, 1), ([3], [3])), "Camera: resolution N: expected a whole"),
    "resolution of flags": (lambda: Camera(*EYE, 1.0, (1, 1), (np.True_, 3)), "Camera: resolution N: expected a whole"),
    "plane of arrays": (lambda: Camera(*EYE, 1.0, ([1], [1])), "Camera: plane H: expected a finite number above 0"),
    "ka of an array": (
        lambda: Material(ka=[1.0]),
        "Material: ka: expected a number or three finite numbers, found [1.0]",
    ),
    "n of an array": (lambda: Material(n=[1.0]), "Material: n: expected a number from 0 to 1e9, found [1.0]"),
    "focal=True": (lambda: Camera(*EYE, True, (1, 1)), "Camera: focal: expected a finite number above 0, found True"),
    "n of a flag": (lambda: Material(n=np.True_), "Material: n: expected a number from 0 to 1e9, found "),
    "ka=True": (lambda: Material(ka=True), "Material: ka: expected a number or three finite numbers, found True"),
    "kd of flags": (lambda: Material(kd=(True, False, True)), "Material: kd: expected a number or three finite"),
    "rays": (
        lambda: Settings(ambient_occlusion=-1),
        "Settings: ambient_occlusion: expected a whole number from 0 to 1024",
    ),
    "too many rays": (
        lambda: Settings(ambient_occlusion=1025),
        "Settings: ambient_occlusion: expected a whole number from",
    ),
    "no length": (lambda: Settings(ao_distance=0), "Settings: ao_distance: expected a finite number above 0, found 0"),
    "no end": (
        lambda: Settings(ao_distance=np.inf),
        "Settings: ao_distance: expected a finite number above 0, found inf",
    ),
    "AO of no rays": (lambda: Settings(layers="AO"), "Settings: layers: expected ambient_occlusion with the layer AO"),
    "ambient": (lambda: Scene((), CAMERA, ambient=[1.0]), "Scene: ambient: expected a number or three"),
    "fov": (lambda: Camera.from_fov(*EYE, "x"), "Camera.from_fov: fov: "),
    "fov resolution=5": (lambda: Camera.from_fov(*EYE, 45, 5), "Camera.from_fov: resolution: "),
    "fov resolution": (lambda: Camera.from_fov(*EYE, 45, ("a", 3)), "Camera.from_fov: resolution N: "),
    "fov resolution 0": (lambda: Camera.from_fov(*EYE, 45, (3, 0)), "Camera.from_fov: resolution M: "),
    "matrix": (lambda: Camera.from_matrix("x", POSE, (3, 3)), "Camera.from_matrix: matrix: expected [[fx, 0, cx]"),
    "ragged matrix": (lambda: Camera.from_matrix([[1], [1, 2]], POSE, (3, 3)), "Camera.from_matrix: matrix: "),
    "pose": (
        lambda: Camera.from_matrix(K, "x", (3, 3)),
        "Camera.from_matrix: pose: expected a finite (4, 4) or (3, 4)",
    ),
    "matrix resolution=5": (lambda: Camera.from_matrix(K, POSE, 5), "Camera.from_matrix: resolution: "),
    "matrix resolution": (lambda: Camera.from_matrix(K, POSE, ("a", 3)), "Camera.from_matrix: resolution N: "),
    "pixel center": (
        lambda: Camera.from_matrix(K, POSE, (3, 3), pixel_center="x"),
        "Camera.from_matrix: pixel_center: ",
    ),
}


@pytest.mark.parametrize(("call", "message"), CASES.values(), ids=list(CASES))
def test_refused_in_one_line(call, message):
    with pytest.raises(InputError) as caught:
        call()
    text = str(caught.value)
    assert text.startswith(message)
    assert "\n" not in text
    assert "expected" in text
    assert "found" in text


def test_flags_of_numpy_are_taken():
    settings = Settings(cull=np.bool_(True), sample_shading=np.array([False])[0])
    assert (settings.cull, settings.sample_shading) == (True, False)
    assert isinstance(settings.cull, bool)


def test_names_are_kept_as_a_tuple():
    scene = Scene((), CAMERA, ignored=["points"], animations=iter(["Run", ""]))
    assert (scene.ignored, scene.animations) == (("points",), ("Run", ""))
