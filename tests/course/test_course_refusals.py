"""Refusals of the course's functions: a ValueError that names function, argument, expected and found, before any
work."""

import re
from unittest.mock import Mock

import course_reference as reference
import numpy as np
import pytest

from clshade import course
from clshade.errors import InputError
from clshade.scene.builtin.scenes import builtin

SCENE = builtin("course", level=2)
MESH = SCENE.meshes[0]
NAN, INF = float("nan"), float("inf")

LIGHT = {"point": [0, 0, 0], "normal": [0, 0, 1], "color": [1, 1, 1], "cam_pos": [0, 0, 5], "k_a": 0.1, "k_d": 0.8}
LIGHT |= {"k_s": 0.5, "n": 20, "l_pos": [[0, 0, 3]], "l_int": [[1, 1, 1]]}
SHADE = {"verts_p": np.zeros((3, 2)), "verts_n": np.eye(3), "verts_c": np.eye(3), "bcoords": [0, 0, 0]}
SHADE |= {name: LIGHT[name] for name in ("cam_pos", "k_a", "k_d", "k_s", "n", "l_pos", "l_int")}
SHADE |= {"l_amb": 1.0, "X": np.zeros((4, 5, 3))}
VALID = {
    "light": LIGHT,
    "calculate_normals": {"verts": MESH.verts.T, "faces": MESH.faces.T},
    "gouraud_shading": {name: SHADE[name] for name in ("verts_p", "verts_c", "X")},
    "shade_gouraud": SHADE,
    "shade_phong": SHADE,
    "bilerp": {"uv": [0.5, 0.5], "texture_map": np.ones((2, 3, 3))},
    "render_object": reference.scene_arguments(SCENE),
    "render_object_map": reference.map_arguments(SCENE, np.ones((2, 3, 3))),
}


def changed(array: np.ndarray, place: tuple, value) -> np.ndarray:
    array = np.array(array, np.result_type(array, type(value)))
    array[place] = value
    return array


VECTOR = [None, "red", [1, 2], [0, NAN, 1], [0, 1, INF], [0, 1j, 2]]
COEFFICIENT = ["half", [1, 2], [0.1, NAN, 0.3]]
LIGHTS = {
    "l_pos": [None, [1, 2], [[1, 2]], [[0, 0, NAN]], [0, NAN, 0], np.zeros((3, 2)), np.zeros((2, 3)), [["a", 0, 0]]],
    "l_int": [None, 1.0, [[1, 1]], [[INF, 0, 0]], [INF, 0, 0], [[1, 1, 1], [1, 1, 1]], ["a", 0, 0], []],
}
POINT = dict.fromkeys(("point", "normal", "color", "cam_pos"), VECTOR)
TERMS = dict.fromkeys(("k_a", "k_d", "k_s"), COEFFICIENT) | {"n": [None, -1, NAN, INF, 2e9, [1, 2], "20"]}
X = [None, np.zeros((4, 5)), np.zeros((4, 5, 4)), np.zeros((0, 5, 3)), np.full((4, 5, 3), NAN), np.zeros((1, 17000, 3))]
CORNERS = {
    "verts_p": [None, np.zeros((2, 3)), np.zeros((3, 3)), np.full((3, 2), INF), [[1, 2], [3]], [["a", "b"]] * 3],
    "verts_c": [None, np.zeros((3, 4)), np.zeros(3), np.full((3, 3), NAN)],
    "X": X,
}
SHADING = CORNERS | TERMS | LIGHTS | {"verts_n": CORNERS["verts_c"], "bcoords": VECTOR, "cam_pos": VECTOR}
SHADING |= {"l_amb": COEFFICIENT}
VIEW = {
    "shader": [None, "Phong", "flat", "pbr", 1, ["phong"]],
    "focal": [None, 0, -1, NAN, INF, "70", [1, 2]],
    "eye": [*VECTOR, SCENE.camera.lookat],
    "lookat": VECTOR,
    "up": [*VECTOR, [0, 0, 0], SCENE.camera.lookat - SCENE.camera.eye],
    "bg_color": [None, "white", [1, 2], NAN],
    "M": [None, 0, -3, 1.5, NAN, 16385, "512", True],
    "N": [None, 0, 1e9, INF],
    "H": [None, 0, -15, NAN],
    "W": [None, 0, INF],
    "light_amb": COEFFICIENT,
}
VERTS = [None, "teapot", np.zeros((4, 5)), MESH.verts[:, :2], MESH.verts]  # the other arrays are 3xN
VERTS += [changed(MESH.verts.T, (1, 7), NAN), changed(MESH.verts.T, (0, 0), INF)]
COUNT = len(MESH.verts)
FACES = [None, MESH.faces.T.astype(float), MESH.faces[:, :2], changed(MESH.faces.T, (2, 3), COUNT), MESH.faces]
FACES += [changed(MESH.faces.T, (2, 3), -1), changed(MESH.faces.T.astype(np.int64), (0, 0), 2**32 + 2)]
COLORS = [None, MESH.colors.T[:, :-1], changed(MESH.colors.T, (0, 3), NAN), np.ones(COUNT), MESH.colors]
UVS = [None, MESH.uvs.T[:1], changed(MESH.uvs.T, (0, 1), NAN), np.zeros((3, 9)), MESH.uvs]
UV_FACES = [None, MESH.uv_faces.T[:, :-1], changed(MESH.uv_faces.T, (0, 0), len(MESH.uvs)), MESH.uv_faces]
TEXTURE = [None, np.ones((2, 3)), np.ones((2, 3, 4)), np.ones((0, 3, 3)), np.full((2, 3, 3), NAN), "cat_diff.png", 7]
MAPPED = {"uvs": UVS, "uvs_faces": UV_FACES, "texture_map": TEXTURE}

REFUSED = {
    "light": POINT | TERMS | LIGHTS,
    "calculate_normals": {"verts": VERTS, "faces": FACES},
    "gouraud_shading": CORNERS,
    "shade_gouraud": SHADING,
    "shade_phong": SHADING,
    "bilerp": {"uv": [None, 0.5, [1, 2, 3], [0.5, NAN], [INF, 0], "uv"], "texture_map": TEXTURE},
    "render_object": VIEW | TERMS | LIGHTS | {"verts": VERTS, "verts_colors": COLORS, "faces": FACES},
    "render_object_map": VIEW | TERMS | LIGHTS | {"verts": VERTS, "faces": FACES} | MAPPED,
}
CASES = [(name, argument) for name, arguments in REFUSED.items() for argument in arguments]


@pytest.fixture
def no_device(monkeypatch):
    monkeypatch.setattr(course, "shared_device", Mock(side_effect=AssertionError("a device was asked for")))


# Names that may be blamed if several arguments disagree.
RELATED = {"verts": "verts|verts_colors|faces|uvs_faces|uvs", "faces": "faces|verts|uvs_faces", "uvs": "uvs|uvs_faces"}
RELATED |= {"verts_colors": "verts_colors|verts", "uvs_faces": "uvs_faces|verts|uvs", "l_pos": "l_pos|l_int"}
RELATED |= {"eye": "eye|lookat|up", "lookat": "lookat|up"}


@pytest.mark.usefixtures("no_device")
@pytest.mark.parametrize(("name", "argument"), CASES)
def test_refused(name, argument):
    for k, value in enumerate(REFUSED[name][argument]):
        with pytest.raises(ValueError, match=rf"^{name}: ") as caught:
            pytest.fail(f"value {k} is taken: {getattr(course, name)(**{**VALID[name], argument: value})}")
        assert isinstance(caught.value, InputError), k
        text = str(caught.value)
        place = RELATED.get(argument, argument)
        assert re.match(rf"{name}: ({place})(\[\d\])?: expected .+, found .+", text), (k, text)
        assert "\n" not in text, k


def test_arguments_that_contradict():
    arguments = VALID["render_object"]
    with pytest.raises(InputError, match=r"render_object: .*layout of"):
        course.render_object(**{**arguments, "verts_colors": arguments["verts_colors"].T})
    with pytest.raises(InputError, match="light: cam_pos: expected a distance from point that float64 can hold"):
        course.light(**{**LIGHT, "point": [1e308, 0, 0], "cam_pos": [-1e308, 0, 0]})
    with pytest.raises(InputError, match="shade_phong: cam_pos: expected a distance from bcoords"):
        course.shade_phong(**{**SHADE, "bcoords": [1e308, 0, 0], "cam_pos": [-1e308, 0, 0]})


# Arguments that do not fit


class Mat:
    """A material as in other years' versions of the course."""


SHADED = [SHADE[name] for name in ("verts_p", "verts_n", "verts_c", "bcoords", "cam_pos")]
UNORDERED = "bilerp: arguments: expected uv, texture_map, in this order, found none: missing uv"


OTHERS = [
    ("light", (*4 * [[0, 0, 0]], Mat(), [Mat(), Mat()]), {}, "k_a = Mat, k_d = list of 2 Mat"),
    ("shade_gouraud", (*SHADED, Mat(), [], SHADE["X"]), {}, "k_s = array (4, 5, 3)"),
    ("shade_phong", (*SHADED, Mat(), [], 1.0, SHADE["X"]), {}, "by its numbers, not as an object"),
    ("bilerp", (), {}, UNORDERED),
    ("bilerp", ([0, 0], 1, 5), {}, "one more = 5: too many positional arguments"),
    ("bilerp", (), {"uv": [0, 0], "texture": 1}, "'texture': did you mean 'texture_map'?"),
    ("light", (LIGHT["point"],), LIGHT, "multiple values for argument 'point'"),
]


@pytest.mark.usefixtures("no_device")
@pytest.mark.parametrize(("name", "arguments", "named", "part"), OTHERS)
def test_arguments_that_do_not_fit(name, arguments, named, part):
    with pytest.raises(TypeError) as caught:
        getattr(course, name)(*arguments, **named)
    assert isinstance(caught.value, InputError)
    assert part in str(caught.value)
    assert ("object" in str(caught.value)) == any(isinstance(value, Mat) for value in arguments)
