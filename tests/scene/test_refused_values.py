"""Invalid values in scenes, cameras, lights and settings: an InputError of one line that names class and field."""

from math import inf, nan

import numpy as np
import pytest
from every_light import EVERY

from clshade import (
    Camera,
    DirectionalLight,
    Edges,
    Environment,
    Material,
    Mesh,
    PointLight,
    RectangleLight,
    Scalars,
    Scene,
    Settings,
    SpotLight,
    Texture,
    builtin,
    load,
    with_look,
)
from clshade.errors import InputError
from clshade.images.layers import LAYERS
from clshade.pipeline.effective_settings import effective_settings
from clshade.scene.adjust_camera import adjusted, named_cameras
from clshade.scene.geometry import crease_normals
from clshade.scene.ground import with_ground
from clshade.scene.lights import plain_lights
from clshade.scene.look import sized_lights
from clshade.scene.model import MAX_FACES

EYE = {"eye": (0, 0, 0), "lookat": (0, 0, 1), "up": (0, 1, 0)}
CAMERA = Camera(**EYE, focal=1.0, plane=(1.0, 1.0))
FLAT = Camera(**EYE, focal=1.0, plane=(1.0, 1.0), orthographic=True)
K, SKEW = np.diag([9.0, 9.0, 1.0]), np.array([[9, 0.5, 4], [0, 9, 4], [0, 0, 1]])
TURN = np.array([[0, 1, 0, 5], [-1, 0, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1.0]])
TRIANGLE = {"verts": np.eye(3), "faces": [[0, 1, 2]]}
FALLING = {"attenuation": "inverse-square"}
SCENE = Scene((Mesh(**TRIANGLE),), CAMERA, [DirectionalLight((0, 1, 0))])
NAMES = f"expected names of {', '.join(LAYERS)}, or all, found"
ONE_NAME = f"expected one of {', '.join(LAYERS)}, all, found"
FLAG = "expected True or False, found"
ABOVE = "expected a finite number above 0, found"
COUNT = "expected a whole number"
PRESET = "expected one of course, standard, pbr, found"
TEXTS = "expected a sequence of texts"
DEGREES = "expected degrees from 0 to 90"
SIZE = "expected a finite number of at least 0"

# With these a call is taken; a row changes one of them.
VALID = {
    Camera: {**EYE, "focal": 1.0, "plane": (1.0, 1.0)},
    Camera.from_fov: {**EYE, "fov": 45.0},
    Camera.from_matrix: {"matrix": K, "pose": np.eye(4), "resolution": (3, 3)},
    Camera.from_matrices: {"matrices": K, "poses": [np.eye(4)] * 2, "resolution": (3, 3)},
    Scene: {"meshes": (), "camera": CAMERA},
    Mesh: TRIANGLE,
    Texture: {"image": np.zeros((2, 2, 3))},
    Environment: {"image": np.ones((1, 1, 3))},
    Scalars: {"name": "a"},
    PointLight: {"position": (0, 0, 0)},
    DirectionalLight: {"direction": (0, 1, 0)},
    SpotLight: {"position": (0, 0, 0), "direction": (0, 1, 0), "outer_cone": 20},
    RectangleLight: {"position": (0, 0, 0), "right": (0, 0, -2), "up": (0, 0.5, 0)},
    load: {"path": "a.obj"},
    CAMERA.stereo: {"baseline": 1.0},
    FLAT.stereo: {"baseline": 1.0},
    effective_settings: {"scene": SCENE},
    with_look: {"scene": SCENE, "look": "studio"},
    with_ground: {"scene": SCENE},
    adjusted: {"camera": CAMERA},
    named_cameras: {"scene": SCENE},
    crease_normals: {"verts": np.eye(3), "faces": np.array([[0, 1, 2]])},
    plain_lights: {"owner": "bench"},
    sized_lights: {"scene": SCENE, "radius": 1.0, "option": "--light-radius"},
    builtin: {"name": "teapot"},
}

STARTS = {
    Settings.from_preset: "Settings: ",
    effective_settings: "Settings: ",
    CAMERA.with_resolution: "Camera: ",
    adjusted: ("Camera: ", "camera: "),
    plain_lights: "bench: ",
    sized_lights: "scene: --light-radius: ",
    builtin: "",
}

REFUSED = [
    (Settings, {"layers": 5}, f"layers: {NAMES} 5"),
    (Settings, {"layers": (5,)}, f"layers: {ONE_NAME} 5"),
    (Settings, {"layers": "AO"}, "layers: expected ambient_occlusion with the layer AO"),
    (Settings, {"shader": "Phong"}, "shader: ... found 'Phong': did you mean 'phong'?"),
    (Settings, {"cull": "false"}, f"cull: {FLAG} 'false'"),
    (Settings, {"sample_shading": np.array([0, 1])}, f"sample_shading: {FLAG}"),
    (Settings, {"near": "far"}, "near: "),
    (Settings, {"light_samples": 257}, f"light_samples: {COUNT}"),
    (Settings, {"ambient_occlusion": -1}, f"ambient_occlusion: {COUNT} from 0 to 1024"),
    (Settings, {"ambient_occlusion": 1025}, f"ambient_occlusion: {COUNT} from 0 to 1024"),
    (Settings, {"ao_distance": inf}, f"ao_distance: {ABOVE} inf"),
    (Settings, {"scalars": 5}, "scalars: expected a name, a Scalars or None, found 5"),
    (Edges, {"width": 64.5}, "width: ... 64, found 64.5"),
    (Edges, {"angle": 181}, "angle: expected degrees from 0 to 180"),
    (Settings.from_preset, {"preset": ""}, f"preset: {PRESET} ''"),
    (effective_settings, {"preset": ""}, f"preset: {PRESET} ''"),
    (Scalars, {"name": ""}, "name: expected the name of the scalars, found ''"),
    (Scalars, {"colormap": "virdis"}, "colormap: expected a color map "),
    (Scalars, {"colormap": []}, "colormap: expected a name, or 1 to 65536 colors"),
    (Scalars, {"colormap": ["red", "rde"]}, "colormap: expected a color such as red, "),
    (Scalars, {"clim": (2, 1)}, "clim: expected two finite numbers, low and high, low not above high"),
    (Scalars, {"nan_color": "nothing"}, "nan_color: expected a color such as red"),
    (Material, {"two_sided": "no"}, f"two_sided: {FLAG} 'no'"),
    (Material, {"n": "x"}, "n: expected a number from 0 to 1e9, found 'x'"),
    (Material, {"n": np.True_}, "n: expected a number from 0 to 1e9, found "),
    (Material, {"ka": True}, "ka: expected a number or three finite numbers, found True"),
    (Material, {"kd": (True, False, True)}, "kd: expected a number or three finite"),
    (Material, {"name": 5}, "name: expected a text, found 5"),
    (Texture, {"wrap": ("clamp",) * 3}, "wrap: "),
    (Texture, {"lookup": None}, "lookup: "),
    (Texture, {"image": "x"}, "image: "),
    (Scene, {"preset": ""}, f"preset: {PRESET} ''"),
    (Scene, {"animations": "Run"}, f"animations: {TEXTS}"),
    (Scene, {"ignored": None}, f"ignored: {TEXTS}"),
    (Scene, {"meshes": 5}, "meshes: "),
    (Scene, {"ambient": [1.0]}, "ambient: expected a number or three"),
    (Scene, {"lights": [EVERY[0], 3]}, "lights: expected a sequence of PointLight or DirectionalLight or"),
    (Scene, {"environment": "sky.hdr"}, "environment: "),
    (Scene, {"own_lights": 1}, "own_lights: "),
    (Mesh, {"verts": "x"}, "verts: "),
    (Mesh, {"faces": "x"}, "faces: "),
    (Mesh, {"faces": [[0, 1, 2], [0]]}, "faces: "),
    (Mesh, {"instances": [[1], [1, 2]]}, "instances: "),
    (Mesh, {"instance_names": ("a", "b")}, "instance_names: expected one text per instance (1), or none, found 2"),
    (Mesh, {"name": 5}, "name: expected a text, found 5"),
    (Mesh, {"scalars": {"a": np.zeros(5)}}, "scalars 'a': expected (3,) per vertex, (1,) per face or (1, 3) per "),
    (Mesh, {"scalars": {"a": "abc"}}, "scalars 'a': expected an array of numbers"),
    (Mesh, {"scalars": {5: np.zeros(3)}}, "scalars: expected names that are texts, found 5"),
    (Mesh, {"scalars": 7}, "scalars: expected a mapping from names to arrays, found 7"),
    (Environment, {"image": np.ones((4, 8))}, "image: "),
    (Environment, {"image": np.full((1, 2, 3), nan)}, "image: ... 2 pixels that are NaN"),
    (Environment, {"image": np.full((1, 1, 3), inf)}, "image: ... 1 pixel that is beyond 1e30"),
    (Environment, {"image": np.full((1, 1, 3), -0.5)}, "image: ... 1 pixel that is negative"),
    (Environment, {"up": (0, 0, 0)}, "up: "),
    (Environment, {"intensity": 1e31}, "intensity: "),
    (Environment, {"rotation": inf}, "rotation: "),
    (Environment, {"name": 3}, "name: "),
    (PointLight, {"position": (0, 0, nan)}, "position: expected three finite numbers"),
    (PointLight, {"intensity": (1, 1, 1e39)}, "intensity: expected numbers within float32"),
    (PointLight, {"attenuation": "linear"}, "attenuation: expected one of none, inverse-square"),
    (PointLight, {"range": 3.0}, "range: expected None without attenuation"),
    (PointLight, {**FALLING, "range": 0.0}, f"range: {ABOVE} 0"),
    (PointLight, {"radius": -1e-9}, f"radius: {SIZE}"),
    (DirectionalLight, {"direction": (0, 0, 0)}, "direction: expected a vector other than 0"),
    (SpotLight, {"inner_cone": -1}, f"inner_cone: {DEGREES}"),
    (SpotLight, {"outer_cone": 90.1}, f"outer_cone: {DEGREES}"),
    (SpotLight, {"inner_cone": 30}, "inner_cone: expected an angle of at most outer_cone, 20 degrees"),
    (RectangleLight, {"up": (0, 1e-9, 3)}, "up: expected a vector that is not parallel to right"),
    (RectangleLight, {**FALLING, "range": -1}, f"range: {ABOVE} -1"),
    (plain_lights, {"lights": (PointLight((1, 2, 3), radius=0.25),)}, "lights: expected points without attenuation"),
    (plain_lights, {"lights": SCENE.lights}, "lights: expected points without attenuation"),
    (sized_lights, {"radius": -1.0}, SIZE),
    (Camera, {"eye": (0, 0, nan)}, "eye: "),
    (Camera, {"lookat": (0, 0, 0)}, "lookat: "),
    (Camera, {"up": (0, 0, 2)}, "up: "),
    (Camera, {"up": (0, 0, 0)}, "up: "),
    (Camera, {"orthographic": "no"}, f"orthographic: {FLAG} 'no'"),
    (Camera, {"plane": 5}, "plane: expected two numbers (H, W), found 5"),
    (Camera, {"plane": ([1], [1])}, f"plane H: {ABOVE} [1]"),
    (Camera, {"principal": "x"}, "principal: "),
    (Camera, {"resolution": 5}, "resolution: expected two whole numbers (N, M), found 5"),
    (Camera, {"focal": [1.0]}, f"focal: {ABOVE} [1.0]"),
    (CAMERA.with_resolution, {"resolution": ("a", 3)}, f"resolution N: {COUNT}"),
    (Camera.from_fov, {"fov": "x"}, "fov: "),
    (Camera.from_fov, {"resolution": (3, 0)}, "resolution M: "),
    (Camera.from_matrix, {"matrix": [[1], [1, 2]]}, "matrix: expected [[fx, 0, cx]"),
    (Camera.from_matrix, {"matrix": 2 * K}, "matrix: expected [[fx, 0, cx]"),
    (Camera.from_matrix, {"matrix": K * [[-1], [1], [1]]}, "matrix: expected fx and fy above 0"),
    (Camera.from_matrix, {"matrix": SKEW}, "matrix: ... found a skew of 0.5"),
    (Camera.from_matrix, {"pose": np.eye(4) * nan}, "pose: expected a finite (4, 4) or (3, 4)"),
    (Camera.from_matrix, {"pose": np.diag([2.0, 2, 2, 1])}, "pose: ... the matrix [2 0 0; 0 2 0; 0 0 2]"),
    (Camera.from_matrix, {"pose": np.diag([1.0, 1, 0, 1])}, "pose: ... found a singular matrix [1 0 0; 0 1 0; 0 0 0]"),
    (Camera.from_matrix, {"pose": np.diag([1e200, 1e200, 1e200, 1])}, "pose: ... found the matrix [1e+200"),
    (Camera.from_matrix, {"pose": np.diag([-1.0, 1, 1, 1])}, "pose: ... found a reflection"),
    (Camera.from_matrix, {"pose": TURN.T}, "pose: expected a last row of 0, 0, 0, 1"),
    (Camera.from_matrices, {"poses": [np.eye(4), np.diag([1.0, 1, 0, 1])]}, "poses[1]: ... found a singular matrix"),
    (Camera.from_matrices, {"matrices": [K, SKEW]}, "matrices[1]: ... found a skew of 0.5"),
    (Camera.from_matrices, {"matrices": [K] * 3}, "matrices: expected one, or 2 for as many poses, found 3"),
    (Camera.from_matrices, {"poses": [np.eye(4), np.eye(3)]}, "poses: expected an array"),
    (FLAT.to_matrix, {}, "expected a perspective camera, found an orthographic"),
    (CAMERA.to_matrix, {"pixel_center": 1}, "pixel_center: expected 0.5 or 0, found 1"),
    (FLAT.pose, {"convention": "OpenGL"}, "convention: ... did you mean 'opengl'"),
    (FLAT.stereo, {}, "expected a perspective camera"),
    (CAMERA.stereo, {"baseline": 0}, f"baseline: {ABOVE} 0"),
    (CAMERA.stereo, {"convergence": 0}, f"convergence: {ABOVE} 0"),
    (adjusted, {"view_angle": 180.0}, "view angle"),
    (adjusted, {"up": [0, 0, 1]}, "a vector not parallel to lookat - eye"),
    (named_cameras, {"names": ("front", "side")}, "one of front, back, left, right"),
    (load, {"flat": "no"}, f"flat: {FLAG} 'no'"),
    (load, {"two_sided": np.ones(2)}, f"two_sided: {FLAG}"),
    (with_look, {"look": "stage"}, "look: ... found 'stage'"),
    (with_look, {"up": "w"}, "up: expected"),
    (with_ground, {"up": "up"}, "up: expected one of"),
    (with_ground, {"settings": "pbr"}, "settings: expected a Settings"),
    (crease_normals, {"degrees": -1}, "degrees: expected degrees from 0 to 180"),
    (crease_normals, {"degrees": 181}, "degrees: expected degrees from 0 to 180"),
    (builtin, {"name": "tea"}, "name: expected one of teapot, torus_knot, icosphere, quads, box_room, course"),
    (builtin, {"triangles": 3}, "builtin 'teapot': triangles: expected one of level, resolution"),
    (builtin, {"level": 501}, f"teapot: level: {COUNT} from 2 to 500"),
    (builtin, {"resolution": (0, 5)}, "resolution "),
    (builtin, {"name": "torus_knot", "triangles": MAX_FACES + 1}, "torus_knot: triangles: "),
    (builtin, {"name": "torus_knot", "p": 2, "q": 4}, "common divisor"),
    (builtin, {"name": "icosphere", "level": 10}, "level: "),
    (builtin, {"name": "quads", "count": 0}, "count: "),
    (builtin, {"name": "quads", "cuont": 3}, "cuont: ... did you mean 'count'?"),
    (builtin, {"name": "quads", "seed": -1}, "seed: "),
    (builtin, {"name": "box_room", "divisions": True}, "divisions: "),
    (builtin, {"name": "box_room", "soft": "yes"}, "soft: expected"),
]


@pytest.mark.parametrize(("make", "changes", "message"), REFUSED)
def test_refused_in_one_line(make, changes, message):
    """The message begins with the class or function, except where STARTS has another, and holds each part of a row's."""
    with pytest.raises(InputError) as caught:
        make(**{**VALID.get(make, {}), **changes})
    text = str(caught.value)
    assert text.startswith(STARTS.get(make, f"{make.__qualname__}: "))
    assert "\n" not in text
    assert all(part in text for part in ("expected ", "found ", *message.split(" ... ")))


def test_flags_of_numpy_and_sequences_are_taken():
    settings = Settings(cull=np.bool_(True), sample_shading=np.array([False])[0])
    assert (settings.cull, settings.sample_shading) == (True, False)
    assert isinstance(settings.cull, bool)
    scene = Scene((), CAMERA, ignored=["points"], animations=iter(["Run", ""]))
    assert (scene.ignored, scene.animations) == (("points",), ("Run", ""))


def test_the_docstring_says_what_a_field_takes():
    for line in (
        'shader : {"gouraud", "phong", "nolight", "pbr"}, default \'phong\'',
        "near : float above 0, default 1e-4 of the scene's bounding radius",
        "scalars : Scalars or str, optional",
    ):
        assert f"\n{line}\n    " in Settings.__doc__
