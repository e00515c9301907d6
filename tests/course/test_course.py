"""`render_object` and `render_object_map` against the oracle, the course's figures, properties and closed forms."""

from __future__ import annotations

import inspect
from dataclasses import replace
from functools import partial

import course_reference as reference
import numpy as np
import oracle_asserts
import pytest
from devices import rendered
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

import clshade
from clshade import course, oracle
from clshade.cli.main import main
from clshade.images import exr
from clshade.measure.check import oracle_bounds
from clshade.pipeline import single_primitive
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Material, Mesh, PointLight, Scene, Settings

pytestmark = pytest.mark.usefixtures("on_each_device")
few = settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])

SCENE = builtin("course", level=4, resolution=(72, 64))
LIGHTS = (*SCENE.lights, PointLight((3.0, -2.0, 4.0), (0.1, 0.2, 3.0)))
SHADERS = ("gouraud", "phong", "nolight")
ULP = 2.0**-23


def surfaced(scene: Scene, **fields) -> Scene:
    """Return the scene with another material and no texture."""
    mesh = scene.meshes[0]
    return replace(scene, meshes=(replace(mesh, material=replace(mesh.material, **{"texture": None, **fields})),))


def drawn(scene: Scene = SCENE, **changes) -> np.ndarray:
    return course.render_object(**reference.scene_arguments(surfaced(scene), **changes))


# Against the oracle


def assert_like_the_oracle(device, scene: Scene, shader: str, image: np.ndarray, minimum: float = 0.1) -> None:
    """Assert that the image is the renderer's frame, with the oracle's ids and colors within the bound."""
    chosen = Settings.from_preset("course", shader=shader, layers=("Z", "id"))
    frame = rendered(scene, device=device, settings=chosen)
    oracle_asserts.assert_frame(frame, oracle.render(scene, chosen), scene, chosen)
    assert image.shape == (*frame.alpha.shape, 3)
    assert image.dtype == np.float64
    assert image.flags.c_contiguous
    assert (image == frame.rgb[::-1]).all()
    assert (frame["id"] > 0).mean() > minimum


@pytest.mark.sampled
@pytest.mark.parametrize("shader", ["gouraud", "phong"])
@pytest.mark.parametrize("n", [20, 1, 200, 1e4])
def test_render_object_is_the_oracles(device, shader, n):
    scene = surfaced(SCENE, n=n)
    arguments = reference.scene_arguments(scene, shader=shader)
    assert_like_the_oracle(device, scene, shader, course.render_object(**arguments))


@pytest.mark.sampled
@pytest.mark.parametrize("shader", SHADERS)
def test_render_object_map_is_the_oracles(device, shader):
    texture = SCENE.meshes[0].material.texture
    arguments = reference.map_arguments(SCENE, texture.image, shader=shader)
    assert_like_the_oracle(device, SCENE, shader, course.render_object_map(**arguments))


@pytest.mark.sampled
@pytest.mark.parametrize("n", [1, 20, 200, 1e4])
def test_cat(device, data_folder, n):
    """The course's own scene, with its vertex colors, and with its texels at the corners."""
    scene = clshade.load(data_folder / "cat.npy", texture=data_folder / "cat_diff.png", resolution=(160, 160))
    for one, render in ((surfaced(scene, n=n), course.render_object), (scene, course.render_object_map)):
        textured = render is course.render_object_map
        for shader in SHADERS:
            image = render(shader, **course.arguments(one, textured))
            assert_like_the_oracle(device, one, shader, image, minimum=0.05)


# Closed forms


@pytest.mark.sampled
@pytest.mark.parametrize("shader", ["gouraud", "phong"])
def test_a_facing_quad_under_a_far_light(shader):
    """N.L = 1 everywhere: ka*Ia + Ip*kd over the background, on exactly its pixels."""
    image = course.render_object(**reference.quad_arguments(shader=shader))
    square = np.zeros((16, 16), bool)
    square[4:12, 4:12] = True
    assert np.allclose(image[square], np.array([0.1, 0.2, 0.3]) + 0.5 * np.array([1, 0.5, 4]), rtol=1e-6)
    assert (image[~square] == [0.5, 0.25, 2.0]).all()


def test_rows_go_up_and_columns_to_the_right():
    """Bottom left red, bottom right green, top blue, unlit."""
    verts = np.array([[-1, 1, 0], [-1, -1, 1], [0, 0, 0.0]])
    image = course.render_object(
        **reference.quad_arguments(
            shader="nolight", verts=verts, verts_colors=np.eye(3), faces=[[0], [1], [2]], M=32, N=64, W=2
        )
    )
    assert image.shape == (32, 64, 3)
    bottom = np.flatnonzero((image != [0.5, 0.25, 2.0]).any(axis=(1, 2)))[0]
    across = np.flatnonzero((image[bottom] != [0.5, 0.25, 2.0]).any(axis=1))
    assert image[bottom, across[0]].argmax() == 0
    assert image[bottom, across[-1]].argmax() == 1
    top = np.flatnonzero((image != [0.5, 0.25, 2.0]).any(axis=(1, 2)))[-1]
    assert image[top, 31].argmax() == 2
    assert top > bottom


def test_the_nearer_triangle_and_of_equals_the_later():
    verts = np.array([[-1, 1, 0, -1, 1, 0], [-1, -1, 1, -1, -1, 1], [0, 0, 0, 1, 1, 1.0]])
    colors = np.repeat(np.eye(3)[:, :2], 3, axis=1)
    faces = np.array([[3, 0], [4, 1], [5, 2]])
    for order in ([0, 1], [1, 0]):
        image = course.render_object(
            **reference.quad_arguments(shader="nolight", verts=verts, verts_colors=colors, faces=faces[:, order])
        )
        assert (image[7, 8] == [0, 1, 0]).all()
    verts[2] = 0
    for order, seen in (([0, 1], 0), ([1, 0], 1)):
        image = course.render_object(
            **reference.quad_arguments(shader="nolight", verts=verts, verts_colors=colors, faces=faces[:, order])
        )
        assert image[7, 8].argmax() == seen


@pytest.mark.long
def test_nothing_to_draw():
    for changes in (
        {"faces": np.zeros((3, 0), int)},
        {"verts": np.zeros((3, 0)), "verts_colors": np.zeros((3, 0)), "faces": np.zeros((3, 0), int)},
        {"lookat": [0, 0, 9]},
        {"verts": np.zeros((3, 4))},
    ):
        image = course.render_object(**reference.quad_arguments(**changes))
        assert (image == [0.5, 0.25, 2.0]).all()


# Properties


@few
@given(order=st.permutations(range(4)), shader=st.sampled_from(["gouraud", "phong"]))
def test_the_order_of_lights_is_only_rounding(order, shader):
    positions, intensities = (
        np.array([getattr(light, name) for light in LIGHTS]) for name in ("position", "intensity")
    )
    one = drawn(shader=shader, n=20, l_pos=positions, l_int=intensities)
    reordered = drawn(shader=shader, n=20, l_pos=positions[order], l_int=intensities[order])
    assert np.allclose(one, reordered, rtol=16 * ULP, atol=1e-12)
    as_lists = drawn(shader=shader, n=20, l_pos=[list(p) for p in positions], l_int=list(intensities[:, :, None]))
    assert (as_lists == one).all()


# What the kernels leave out


@pytest.mark.parametrize("shader", ["gouraud", "phong"])
@pytest.mark.parametrize(("name", "term"), [("k_a", "AMBIENT"), ("k_d", "DIFFUSE"), ("k_s", "SPECULAR")])
def test_a_coefficient_of_0_is_left_out_of_the_kernel(monkeypatch, shader, name, term):
    """For scenes, triangles and points: the test inspects what would be drawn, and builds nothing."""
    built = []

    class Enough(Exception):
        pass

    def compiled(features, *names):
        built.append(features[term])
        raise Enough

    monkeypatch.setattr("clshade.pipeline.features.Features.compiled", compiled)
    scene = course.arguments(surfaced(SCENE))
    light = {key: scene[key] for key in ("k_a", "k_d", "k_s", "n", "l_pos", "l_int")}
    corners = {"verts_p": [[1, 1], [9, 1], [1, 9]], "verts_n": np.eye(3), "verts_c": np.eye(3)}
    place = {"bcoords": [0, 0, 0], "cam_pos": [0, 0, 9], "l_amb": 1.0, "X": np.zeros((12, 12, 3))}
    shade = course.shade_phong if shader == "phong" else course.shade_gouraud
    for value, expected in ((0.5, 1), ([0, 0.5, 0], 1), (0, 0), ([0, 0, 0], 0)):
        chosen = {**light, name: value}
        for call in (
            partial(course.render_object, shader, **{**scene, **chosen}),
            partial(shade, **corners, **place, **chosen),
            partial(course.light, [0, 0, 0], [0, 0, 1], [1, 1, 1], [0, 0, 9], **chosen),
        ):
            course.release()
            single_primitive._light_stages.cache_clear()
            with pytest.raises(Enough):
                call()
            assert built.pop() == expected


# Arguments


SIGNATURES = """
light(point, normal, color, cam_pos, k_a, k_d, k_s, n, l_pos, l_int)
calculate_normals(verts, faces)
render_object(shader, focal, eye, lookat, up, bg_color, M, N, H, W, verts, verts_colors, faces,
 k_a, k_d, k_s, n, l_pos, l_int, light_amb)
gouraud_shading(verts_p, verts_c, X)
shade_gouraud(verts_p, verts_n, verts_c, bcoords, cam_pos, k_a, k_d, k_s, n, l_pos, l_int, l_amb, X)
shade_phong(verts_p, verts_n, verts_c, bcoords, cam_pos, k_a, k_d, k_s, n, l_pos, l_int, l_amb, X)
bilerp(uv, texture_map)
render_object_map(shader, focal, eye, lookat, up, bg_color, M, N, H, W, verts, faces, uvs, uvs_faces, texture_map,
 k_a, k_d, k_s, n, l_pos, l_int, light_amb)
"""


@pytest.mark.parametrize("signature", SIGNATURES.replace("\n ", " ").split("\n")[1:-1])
def test_names_and_order_are_the_courses(signature):
    name, names = signature.rstrip(")").split("(")
    parameters = inspect.signature(getattr(course, name)).parameters.values()
    assert [parameter.name for parameter in parameters] == names.split(", ")
    assert {(p.kind, p.default) for p in parameters} == {(p.POSITIONAL_OR_KEYWORD, p.empty) for p in parameters}


def test_arguments_of_a_scene():
    scene = replace(surfaced(SCENE), lights=LIGHTS)
    assert_same_arguments(course.arguments(scene), reference.scene_arguments(scene))
    texels = SCENE.meshes[0].material.texture.image
    assert_same_arguments(course.arguments(SCENE, textured=True), reference.map_arguments(SCENE, texels))
    bare = replace(scene, meshes=(replace(scene.meshes[0], colors=None, uv_faces=None),), lights=())
    arguments = course.arguments(bare)
    assert (arguments["verts_colors"] == 1.0).all()
    assert arguments["l_pos"].shape == arguments["l_int"].shape == (0, 3)
    for refused in (replace(scene, preset="standard"), replace(scene, meshes=()), replace(scene, background=None)):
        with pytest.raises(ValueError, match=r"arguments: .*: expected"):
            course.arguments(refused)
    with pytest.raises(ValueError, match="arguments: scene: expected a mesh with a texture"):
        course.arguments(scene, textured=True)


def assert_same_arguments(arguments: dict, expected: dict) -> None:
    expected = {name: value for name, value in expected.items() if name != "shader"}
    assert arguments.keys() == expected.keys()
    for name, value in expected.items():
        assert np.array_equal(arguments[name], value), name


# Layout


def test_arrays_may_come_transposed():
    arguments = reference.scene_arguments(surfaced(SCENE))
    turned = {name: arguments[name].T for name in ("verts", "verts_colors", "faces")}
    assert (course.render_object(**arguments) == course.render_object(**{**arguments, **turned})).all()
    mapped = reference.map_arguments(SCENE, SCENE.meshes[0].material.texture.image)
    turned = {name: mapped[name].T for name in ("verts", "faces", "uvs", "uvs_faces")}
    assert (course.render_object_map(**mapped) == course.render_object_map(**{**mapped, **turned})).all()


def test_square_arrays_are_columns():
    """Three vertices, three faces, three lights: nothing is transposed unless a non-square array requires it."""
    verts = np.array([[-1.0, 1, 0], [-1, -0.9, 1], [0, 0.1, 0.2]])
    colors = np.array([[1.0, 0, 0.2], [0.1, 1, 0], [0, 0.3, 1]])
    faces = np.array([[0, 2, 0], [1, 1, 1], [2, 0, 2]])
    positions = np.array([[0.0, 0, 5], [-7, 0, 1], [0, 5, 2]])
    intensities = np.array([[1.0, 1, 1], [1, 0, 0], [0.9, 0.7, 0.5]])
    square = {"verts": verts, "verts_colors": colors, "faces": faces, "l_pos": positions, "l_int": intensities}
    image = course.render_object(**reference.quad_arguments(**square, k_s=0.5, n=20))
    mesh = Mesh(verts.T, faces.T, colors.T, material=Material(0.1, 0.5, 0.5, 20))
    lights = tuple(PointLight(*light) for light in zip(positions, intensities, strict=True))
    camera = clshade.Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (16, 16))
    scene = Scene((mesh,), camera, lights, np.array([1.0, 2, 3]), np.array([0.5, 0.25, 2]), "course")
    expected = oracle.render(scene, Settings.from_preset("course"))
    error = np.abs(image[::-1] - expected.rgb)
    assert (error <= 32 * oracle_bounds.color_bound(expected) + 1e-30).all()
    four = {name: np.concatenate([square[name], square[name][:, :1]], axis=1) for name in ("verts", "verts_colors")}
    assert (course.render_object(**reference.quad_arguments(**{**square, **four}, k_s=0.5, n=20)) == image).all()
    rows = {name: four[name].T for name in four}
    turned = {**square, **rows, "faces": faces.T}
    assert (course.render_object(**reference.quad_arguments(**turned, k_s=0.5, n=20)) == image).all()


def test_vectors_and_coefficients_in_every_shape():
    arguments = reference.scene_arguments(surfaced(SCENE))
    plain = course.render_object(**arguments)
    for shape in ((3,), (1, 3), (3, 1)):
        names = ("eye", "lookat", "up", "bg_color", "light_amb", "k_a", "k_d", "k_s")
        shaped = {name: np.reshape(np.broadcast_to(arguments[name], 3), shape) for name in names}
        assert (course.render_object(**{**arguments, **shaped}) == plain).all()
    apart = course.render_object(**{**arguments, "k_d": [0.8, 0.0, 0.8], "light_amb": [0.2, 0.2, 0.4]})
    assert (apart[..., 0] == plain[..., 0]).all()
    assert not (apart[..., 1:] == plain[..., 1:]).all()


# Kept between calls


def test_arrays_may_be_changed_between_calls():
    arguments = reference.quad_arguments(verts=np.array([[-1, 1, 1, -1], [-1, -1, 1, 1], [0, 0, 0, 0]], np.float32))
    first = course.render_object(**arguments)
    arguments["verts"][0] += 4.0
    assert not (course.render_object(**arguments) == first).all()
    arguments["verts"][0] -= 4.0
    again = course.render_object(**arguments)
    assert (again == first).all()
    again[:] = 7.0
    assert (course.render_object(**arguments) == first).all()


def test_only_the_last_scenes_are_kept():
    for k in range(7):
        course.render_object(**reference.quad_arguments(k_d=0.1 * k + 0.1))
    assert len(course._renderers._kept) <= 4
    course.release()
    assert not course._renderers._kept
    assert np.isfinite(course.render_object(**reference.quad_arguments())).all()


# Files


def test_render_of_a_saved_scene_is_render_object(tmp_path, capsys):
    scene = surfaced(SCENE, n=20, kd=np.array([0.8, 0.7, 0.6]))
    course.save(scene, tmp_path / "scene.npy")
    assert main(["render", str(tmp_path / "scene.npy"), "-o", str(tmp_path / "out")]) == 0
    capsys.readouterr()
    channels, _ = exr.read(tmp_path / "out.exr")
    written = np.stack([channels[name] for name in "RGB"], axis=2)
    assert (written[::-1] == course.render_object(**reference.scene_arguments(scene))).all()
    loaded = clshade.load(tmp_path / "scene.npy")
    assert (course.render_object(**reference.scene_arguments(loaded)) == written[::-1]).all()


def test_render_of_the_cat_is_render_object(tmp_path, data_folder, capsys):
    content = np.load(data_folder / "cat.npy", allow_pickle=True)[()]
    texture = np.asarray(Image.open(data_folder / "cat_diff.png").convert("RGB"))
    view = {name: content[f"cam_{name}"] for name in ("eye", "lookat", "up")}
    view |= {name: content[name] for name in ("focal", "bg_color", "M", "N", "H", "W", "n")}
    light = {"k_a": content["ka"], "k_d": content["kd"], "k_s": content["ks"], "light_amb": content["Ia"]}
    light |= {"l_pos": content["light_positions"], "l_int": content["light_intensities"]}
    mesh = {"verts": content["verts"], "faces": content["face_indices"]}
    mapped = {"uvs": content["uvs"], "uvs_faces": content["face_uv_indices"], "texture_map": texture}
    images = {
        "": course.render_object(shader="phong", **view, **light, **mesh, verts_colors=content["vertex_colors"]),
        "--texture": course.render_object_map(shader="phong", **view, **light, **mesh, **mapped),
    }
    for option, image in images.items():
        words = [option, str(data_folder / "cat_diff.png")] if option else []
        assert main(["render", str(data_folder / "cat.npy"), *words, "-o", str(tmp_path / "out")]) == 0
        channels, _ = exr.read(tmp_path / "out.exr")
        assert (np.stack([channels[name] for name in "RGB"], axis=2)[::-1] == image).all()
    capsys.readouterr()
