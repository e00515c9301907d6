"""`render_object` and `render_object_map` against the oracle, the course's figures, properties and closed forms."""

from __future__ import annotations

import warnings
from dataclasses import replace

import course_reference as reference
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image
from scene_files import png16

import clshade
from clshade import cli, course, exr, oracle
from clshade.checks import compare
from clshade.images import read_image
from clshade.renderer import Renderer
from clshade.scene import Material, Mesh, PointLight, Scene, Settings
from clshade.scenes import builtin

pytestmark = pytest.mark.usefixtures("on_each_device")
few = settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])

SCENE = builtin("course", level=4, resolution=(72, 64))
LIGHTS = (*SCENE.lights, PointLight((3.0, -2.0, 4.0), (0.1, 0.2, 3.0)))
SHADERS = ("gouraud", "phong", "nolight")
ULP = 2.0**-23


@pytest.fixture
def on_each_device(device, monkeypatch):
    monkeypatch.setattr(course, "shared_device", lambda: device)
    yield
    course.release()


def surfaced(scene: Scene, **fields) -> Scene:
    """The scene with another material and no texture."""
    mesh = scene.meshes[0]
    return replace(scene, meshes=(replace(mesh, material=replace(mesh.material, **{"texture": None, **fields})),))


def drawn(scene: Scene = SCENE, **changes) -> np.ndarray:
    return course.render_object(**reference.scene_arguments(surfaced(scene), **changes))


# Against the oracle


def assert_like_the_oracle(device, scene: Scene, shader: str, image: np.ndarray) -> None:
    """The image is the renderer's frame, whose ids are the oracle's and whose colors are within the bound."""
    chosen = Settings.from_preset("course", shader=shader, layers=("Z", "id"))
    with Renderer(scene, device=device, settings=chosen) as renderer:
        frame = renderer.render()
    compare.assert_frame(frame, oracle.render(scene, chosen), scene, chosen)
    assert image.shape == (*frame.alpha.shape, 3)
    assert image.dtype == np.float64
    assert image.flags.c_contiguous
    assert (image == frame.rgb[::-1]).all()
    assert (frame["id"] > 0).mean() > 0.1


@pytest.mark.parametrize("shader", ["gouraud", "phong"])
@pytest.mark.parametrize("n", [1, 20, 200, 1e4])
def test_render_object_is_the_oracles(device, shader, n):
    scene = surfaced(SCENE, n=n)
    arguments = reference.scene_arguments(scene, shader=shader)
    assert_like_the_oracle(device, scene, shader, course.render_object(**arguments))


@pytest.mark.parametrize("shader", SHADERS)
@pytest.mark.parametrize("count", range(5))
def test_any_number_of_lights(shader, count):
    scene = replace(surfaced(SCENE, n=20), lights=LIGHTS[:count])
    image = course.render_object(**reference.scene_arguments(scene, shader=shader))
    expected = oracle.render(scene, Settings.from_preset("course", shader=shader))
    compare.assert_colors_within(image[::-1].astype(np.float32), expected)


@pytest.mark.parametrize("shader", SHADERS)
def test_render_object_map_is_the_oracles(device, shader):
    texture = SCENE.meshes[0].material.texture
    arguments = reference.map_arguments(SCENE, texture.image, shader=shader)
    assert_like_the_oracle(device, SCENE, shader, course.render_object_map(**arguments))


def test_cat(device, data_folder):
    """The course's own scene: every vertex color, and every texel at a corner, at its place."""
    scene = clshade.load(data_folder / "cat.npy", texture=data_folder / "cat_diff.png", resolution=(160, 160))
    texels = scene.meshes[0].material.texture.image
    for shader in SHADERS:
        chosen = Settings.from_preset("course", shader=shader)
        image = course.render_object_map(**reference.map_arguments(scene, texels, shader=shader))
        compare.assert_colors_within(image[::-1].astype(np.float32), oracle.render(scene, chosen))
        image = course.render_object(**reference.scene_arguments(scene, shader=shader))
        compare.assert_colors_within(image[::-1].astype(np.float32), oracle.render(surfaced(scene), chosen))


# Closed forms


def quad_arguments(**changes) -> dict:
    """A white square of side 2 about the origin, facing the eye at (0, 0, 4); it fills the middle half of 16 x 16."""
    arguments = {"shader": "phong", "focal": 1, "eye": [0, 0, 4], "lookat": [0, 0, 0], "up": [0, 1, 0]}
    arguments |= {"bg_color": [0.5, 0.25, 2.0], "M": 16, "N": 16, "H": 1, "W": 1}
    arguments["verts"] = np.array([[-1, 1, 1, -1], [-1, -1, 1, 1], [0, 0, 0, 0]])
    arguments |= {"verts_colors": np.ones((3, 4)), "faces": np.array([[0, 0], [1, 2], [2, 3]])}
    arguments |= {"k_a": 0.1, "k_d": 0.5, "k_s": 0.0, "n": 1, "light_amb": [1, 2, 3]}
    arguments |= {"l_pos": [[0.0, 0.0, 1e6]], "l_int": [[1.0, 0.5, 4.0]]}
    return {**arguments, **changes}


@pytest.mark.parametrize("shader", ["gouraud", "phong"])
def test_a_facing_quad_under_a_far_light(shader):
    """N.L = 1 everywhere: ka*Ia + Ip*kd, over the background, drawn on exactly its pixels."""
    image = course.render_object(**quad_arguments(shader=shader))
    square = np.zeros((16, 16), bool)
    square[4:12, 4:12] = True
    assert np.allclose(image[square], np.array([0.1, 0.2, 0.3]) + 0.5 * np.array([1, 0.5, 4]), rtol=1e-6)
    assert (image[~square] == [0.5, 0.25, 2.0]).all()


def test_rows_go_up_and_columns_to_the_right():
    """Bottom left red, bottom right green, top blue, seen unlit."""
    verts = np.array([[-1, 1, 0], [-1, -1, 1], [0, 0, 0.0]])
    image = course.render_object(
        **quad_arguments(shader="nolight", verts=verts, verts_colors=np.eye(3), faces=[[0], [1], [2]], M=32, N=64, W=2)
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
            **quad_arguments(shader="nolight", verts=verts, verts_colors=colors, faces=faces[:, order])
        )
        assert (image[7, 8] == [0, 1, 0]).all()
    verts[2] = 0
    for order, seen in (([0, 1], 0), ([1, 0], 1)):
        image = course.render_object(
            **quad_arguments(shader="nolight", verts=verts, verts_colors=colors, faces=faces[:, order])
        )
        assert image[7, 8].argmax() == seen


def test_nothing_to_draw():
    for changes in (
        {"faces": np.zeros((3, 0), int)},
        {"verts": np.zeros((3, 0)), "verts_colors": np.zeros((3, 0)), "faces": np.zeros((3, 0), int)},
        {"lookat": [0, 0, 9]},
        {"verts": np.zeros((3, 4))},
    ):
        image = course.render_object(**quad_arguments(**changes))
        assert (image == [0.5, 0.25, 2.0]).all()


# The course's figures


def figures(scene: Scene, shader: str) -> list[np.ndarray]:
    """Figures 1 to 8 (or 9 to 16): ambient, diffuse, specular, all; first, second, third light, all."""
    arguments = reference.scene_arguments(scene, shader=shader)
    images = [
        course.render_object(**{**arguments, **{k: 0.0 for k in ("k_a", "k_d", "k_s") if k != only}})
        for only in ("k_a", "k_d", "k_s")
    ]
    images.append(course.render_object(**arguments))
    for k in ([0], [1], [2], [0, 1, 2]):
        lights = {name: arguments[name][k] for name in ("l_pos", "l_int")}
        images.append(course.render_object(**{**arguments, **lights}))
    return images


@pytest.mark.parametrize("n", [1, 20])
@pytest.mark.parametrize("shader", ["gouraud", "phong"])
def test_a_lights_color_shows_in_its_figure(shader, n):
    ambient, _, _, everything, first, second, third, lights = figures(surfaced(SCENE, n=n), shader)
    red = second - ambient
    assert (red[..., 1:] == 0.0).all()
    assert red[..., 0].max() > 0.1
    ulp = np.spacing(lights.astype(np.float32)).astype(np.float64)
    assert (np.abs(first + second + third - 2.0 * ambient - lights) <= 8.0 * ulp).all()
    assert (lights == everything).all()


@pytest.mark.parametrize("shader", ["gouraud", "phong"])
def test_the_terms_add_up(shader):
    ambient, diffuse, specular, everything, *_ = figures(surfaced(SCENE, n=20), shader)
    covered = (diffuse != SCENE.background).any(axis=2)
    assert covered.any()
    total = (ambient + diffuse + specular)[covered]
    assert np.allclose(total, everything[covered], rtol=8 * ULP, atol=1e-12)


# Properties


@few
@given(factor=st.floats(1e-3, 1e3), shader=st.sampled_from(["gouraud", "phong"]))
def test_linear_in_the_intensity(factor, shader):
    one = drawn(shader=shader, k_a=0.0, n=20)
    arguments = reference.scene_arguments(surfaced(SCENE))
    scaled = drawn(shader=shader, k_a=0.0, n=20, l_int=arguments["l_int"] * factor)
    covered = (one != SCENE.background).any(axis=2)
    assert np.allclose(scaled[covered], one[covered] * factor, rtol=16 * ULP, atol=1e-12)
    for power in (2.0**-20, 2.0**30):
        scaled = drawn(shader=shader, k_a=0.0, n=20, l_int=arguments["l_int"] * power)
        assert (scaled[covered] == one[covered] * power).all()


@few
@given(order=st.permutations(range(4)), shader=st.sampled_from(["gouraud", "phong"]))
def test_the_order_of_lights_is_only_rounding(order, shader):
    positions, intensities = (
        np.array([getattr(light, name) for light in LIGHTS]) for name in ("position", "intensity")
    )
    one = drawn(shader=shader, n=20, l_pos=positions, l_int=intensities)
    other = drawn(shader=shader, n=20, l_pos=positions[order], l_int=intensities[order])
    assert np.allclose(one, other, rtol=16 * ULP, atol=1e-12)
    as_lists = drawn(shader=shader, n=20, l_pos=[list(p) for p in positions], l_int=list(intensities[:, :, None]))
    assert (as_lists == one).all()


@few
@given(seed=st.integers(0, 2**32 - 1), shader=st.sampled_from(SHADERS))
def test_the_order_of_faces_of_different_depth_is_only_rounding(seed, shader):
    mesh = SCENE.meshes[0]
    depth = mesh.verts[mesh.faces].mean(axis=1) @ (SCENE.camera.lookat - SCENE.camera.eye)
    faces = mesh.faces[np.unique(depth, return_index=True)[1]]
    shuffled = np.random.default_rng(seed).permutation(faces)
    one, other = (drawn(shader=shader, n=20, faces=f.T) for f in (faces, shuffled))
    # The order in which normals are summed up moves them by 1e-16: the drawn faces agree, colors to rounding.
    assert np.allclose(one, other, rtol=1e-5, atol=1e-6)


@few
@given(scale=st.integers(-100, 100), shader=st.sampled_from(SHADERS))
def test_a_power_of_two_changes_no_bit(scale, shader):
    arguments = reference.scene_arguments(surfaced(SCENE), shader=shader, n=20)
    scaled = dict(arguments)
    for name in ("eye", "lookat", "verts", "l_pos", "focal", "H", "W"):
        scaled[name] = np.asarray(arguments[name], np.float64) * 2.0**scale
    assert (course.render_object(**arguments) == course.render_object(**scaled)).all()


# Layout


def test_arrays_may_come_transposed():
    arguments = reference.scene_arguments(surfaced(SCENE))
    turned = {name: arguments[name].T for name in ("verts", "verts_colors", "faces")}
    assert (course.render_object(**arguments) == course.render_object(**{**arguments, **turned})).all()
    mapped = reference.map_arguments(SCENE, SCENE.meshes[0].material.texture.image)
    turned = {name: mapped[name].T for name in ("verts", "faces", "uvs", "uvs_faces")}
    assert (course.render_object_map(**mapped) == course.render_object_map(**{**mapped, **turned})).all()


def test_square_arrays_are_columns():
    """Three vertices, three faces, three lights: nothing is transposed unless an array that is not square says so."""
    verts = np.array([[-1.0, 1, 0], [-1, -0.9, 1], [0, 0.1, 0.2]])
    colors = np.array([[1.0, 0, 0.2], [0.1, 1, 0], [0, 0.3, 1]])
    faces = np.array([[0, 2, 0], [1, 1, 1], [2, 0, 2]])
    positions = np.array([[0.0, 0, 5], [-7, 0, 1], [0, 5, 2]])
    intensities = np.array([[1.0, 1, 1], [1, 0, 0], [0.9, 0.7, 0.5]])
    square = {"verts": verts, "verts_colors": colors, "faces": faces, "l_pos": positions, "l_int": intensities}
    image = course.render_object(**quad_arguments(**square, k_s=0.5, n=20))
    mesh = Mesh(verts.T, faces.T, colors.T, material=Material(0.1, 0.5, 0.5, 20))
    lights = tuple(PointLight(*light) for light in zip(positions, intensities, strict=True))
    camera = clshade.Camera((0, 0, 4), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0), (16, 16))
    scene = Scene((mesh,), camera, lights, np.array([1.0, 2, 3]), np.array([0.5, 0.25, 2]), "course")
    expected = oracle.render(scene, Settings.from_preset("course"))
    error = np.abs(image[::-1] - expected.rgb)
    assert (error <= 32 * compare.color_bound(expected) + 1e-30).all()
    four = {name: np.concatenate([square[name], square[name][:, :1]], axis=1) for name in ("verts", "verts_colors")}
    assert (course.render_object(**quad_arguments(**{**square, **four}, k_s=0.5, n=20)) == image).all()
    rows = {name: four[name].T for name in four}
    turned = {**square, **rows, "faces": faces.T}
    assert (course.render_object(**quad_arguments(**turned, k_s=0.5, n=20)) == image).all()


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


# What is kept between calls


def test_arrays_may_be_changed_between_calls():
    arguments = quad_arguments(verts=np.array([[-1, 1, 1, -1], [-1, -1, 1, 1], [0, 0, 0, 0]], np.float32))
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
        course.render_object(**quad_arguments(k_d=0.1 * k + 0.1))
    assert len(course._renderers._kept) <= 4
    course.release()
    assert not course._renderers._kept
    assert np.isfinite(course.render_object(**quad_arguments())).all()


# Files


def test_render_of_a_saved_scene_is_render_object(tmp_path, capsys):
    scene = surfaced(SCENE, n=20, kd=np.array([0.8, 0.7, 0.6]))
    course.save(scene, tmp_path / "scene.npy")
    assert cli.main(["render", str(tmp_path / "scene.npy"), "-o", str(tmp_path / "out")]) == 0
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
        assert cli.main(["render", str(data_folder / "cat.npy"), *words, "-o", str(tmp_path / "out")]) == 0
        channels, _ = exr.read(tmp_path / "out.exr")
        assert (np.stack([channels[name] for name in "RGB"], axis=2)[::-1] == image).all()
    capsys.readouterr()


# Texture images


def textured_quad(texture_map, **changes) -> np.ndarray:
    """The quad unlit with (u, v) = (0, 0) at its top left corner, as course files have it."""
    arguments = quad_arguments(shader="nolight", M=18, N=18, **changes)
    del arguments["verts_colors"]
    uvs = np.array([[0, 1, 1, 0], [1, 1, 0, 0.0]])
    return course.render_object_map(**arguments, uvs=uvs, uvs_faces=arguments["faces"], texture_map=texture_map)


TEXELS = np.array([[[200, 10, 20], [30, 210, 40]], [[50, 60, 220], [250, 90, 150]]], np.uint8)


@pytest.mark.parametrize("kind", ["RGB", "RGBA", "L", "P", "16", "16 grey"])
def test_texture_images(tmp_path, kind):
    """Texel (0, 0) is seen top left, (0, 1) top right, and red stays red, whatever the file's type."""
    path = tmp_path / "texture.png"
    expected = TEXELS / 255.0
    if kind == "16":
        path.write_bytes(png16(TEXELS.astype(np.uint16) * 257))
    elif kind == "16 grey":
        path.write_bytes(png16(TEXELS[:, :, :1].astype(np.uint16) * 257))
        expected = np.repeat(expected[:, :, :1], 3, axis=2)
    else:
        image = Image.fromarray(TEXELS)
        if kind == "L":
            expected = np.repeat(np.asarray(image.convert("L"))[:, :, None], 3, axis=2) / 255.0
        image = image.quantize(4) if kind == "P" else image.convert(kind)
        if kind == "RGBA":
            image.putalpha(77)
        image.save(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that alpha is left out
        texture_map = read_image(path, srgb=False)
    assert np.allclose(course.bilerp([0, 0], texture_map), expected[0, 0], atol=1e-6)
    found = textured_quad(texture_map)
    half = 18 / 4
    for row, column, y, x in ((-1, 0, 0, 0), (-1, -1, 0, 1), (0, 0, 1, 0), (0, -1, 1, 1)):
        inside = found[5:13, 5:13][row, column]
        # The pixel is half a pixel (of a quad of 9) inside the corner: a mean of the corners by affine weights.
        assert np.abs(inside - expected[y, x]).max() < 1.5 / half
        assert inside.argmax() == expected[y, x].argmax()


def test_integer_textures_are_divided_by_their_maximum():
    as_bytes = textured_quad(TEXELS)
    assert np.allclose(as_bytes, textured_quad(TEXELS / 255.0), atol=1e-6)
    assert np.allclose(as_bytes, textured_quad(TEXELS.astype(np.uint16) * 257), atol=1e-6)
    assert textured_quad(TEXELS.astype(np.float64)).max() > 200.0


def test_a_texture_replaces_the_color_and_lies_as_it_should():
    """Gouraud under a far light: ka*Ia + Ip*kd*texel at the corners, whose texels are those of the image."""
    texture_map = np.zeros((5, 7, 3))
    texture_map[0, 0] = [1, 0, 0]
    found = textured_quad(texture_map)
    square = found[5:13, 5:13]
    brightest = np.unravel_index(square[:, :, 0].argmax(), (8, 8))
    assert brightest == (7, 0)
    assert square[:, :, 1:].max() == 0.0
    lit = quad_arguments(shader="gouraud", M=18, N=18)
    del lit["verts_colors"]
    uvs = np.array([[0, 1, 1, 0], [1, 1, 0, 0.0]])
    lit_image = course.render_object_map(**lit, uvs=uvs, uvs_faces=lit["faces"], texture_map=texture_map)
    ambient = np.array([0.1, 0.2, 0.3])
    assert np.allclose(lit_image[5:13, 5:13], ambient + 0.5 * np.array([1, 0.5, 4]) * square, rtol=1e-5)
