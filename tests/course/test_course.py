"""`render_object` and `render_object_map`: the renderer's frame, whatever the shapes of their arguments."""

import inspect
from dataclasses import replace

import course_reference as reference
import numpy as np
import pytest
from devices import rendered
from PIL import Image

import clshade
from clshade import course
from clshade.cli.main import main
from clshade.course import ContentCache, are_equal
from clshade.images import exr
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import PointLight, Scene, Settings

pytestmark = pytest.mark.usefixtures("on_each_device")

SCENE = builtin("course", level=4, resolution=(72, 64))
TEXELS = SCENE.meshes[0].material.texture.image
LIGHTS = (*SCENE.lights, PointLight((3.0, -2.0, 4.0), (0.1, 0.2, 3.0)))
BACKGROUND = [0.5, 0.25, 2.0]


def surfaced(scene: Scene = SCENE, **fields) -> Scene:
    mesh = scene.meshes[0]
    return replace(scene, meshes=(replace(mesh, material=replace(mesh.material, **{"texture": None, **fields})),))


@pytest.mark.sampled
@pytest.mark.parametrize("shader", ["phong", "gouraud", "nolight"])
def test_the_image_is_the_renderers_frame(device, shader):
    """With row 0 at the bottom; that frames are the oracle's is tested with the pipeline."""
    mapped = course.render_object_map(**reference.map_arguments(SCENE, TEXELS, shader=shader))
    scene = replace(surfaced(n=1e4), lights=LIGHTS)
    image = course.render_object(**reference.scene_arguments(scene, shader=shader))
    for drawn_scene, picture in ((SCENE, mapped), (scene, image)):
        chosen = Settings.from_preset("course", shader=shader, layers=("Z", "id"))
        frame = rendered(drawn_scene, device=device, settings=chosen)
        assert (picture == frame.rgb[::-1]).all()
        assert (picture.shape, picture.dtype) == ((64, 72, 3), np.float64)
        assert picture.flags.c_contiguous
        assert (frame["id"] > 0).mean() > 0.1


# Closed forms


@pytest.mark.parametrize(
    "changes",
    [
        {"faces": np.zeros((3, 0), int)},
        {"verts": np.zeros((3, 0)), "verts_colors": np.zeros((3, 0)), "faces": np.zeros((3, 0), int)},
        {"lookat": [0, 0, 9]},
    ],
)
def test_nothing_to_draw(changes):
    assert (course.render_object(**reference.quad_arguments(**changes)) == BACKGROUND).all()


# Textures: (u, v) = (0, 0) is the top left corner of the quad, as in course files


def textured_quad(texture_map, shader="nolight") -> np.ndarray:
    arguments = reference.quad_arguments(shader=shader)
    del arguments["verts_colors"]
    uvs = np.array([[0, 1, 1, 0], [1, 1, 0, 0.0]])
    return course.render_object_map(**arguments, uvs=uvs, uvs_faces=arguments["faces"], texture_map=texture_map)


def test_a_texture_replaces_the_color_and_lies_as_it_should():
    """Integers are divided by their maximum. Gouraud under a far light: ka*Ia + Ip*kd*texel."""
    texels = np.zeros((5, 7, 3), np.uint8)
    texels[0, 0] = [255, 0, 0]
    image = textured_quad(texels)
    square = image[4:12, 4:12]
    assert np.unravel_index(square[:, :, 0].argmax(), (8, 8)) == (7, 0)
    assert square[:, :, 1:].max() == 0.0
    for same in (texels / 255.0, texels.astype(np.uint16) * 257):
        assert np.allclose(image, textured_quad(same), atol=1e-6)
    assert textured_quad(texels.astype(np.float64)).max() > 200.0
    lit = np.array([0.1, 0.2, 0.3]) + 0.5 * np.array([1, 0.5, 4]) * square
    assert np.allclose(textured_quad(texels, "gouraud")[4:12, 4:12], lit, rtol=1e-5)


# What the kernels leave out


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
    scene = replace(surfaced(), lights=LIGHTS)
    assert_same_arguments(course.arguments(scene), reference.scene_arguments(scene))
    assert_same_arguments(course.arguments(SCENE, textured=True), reference.map_arguments(SCENE, TEXELS))
    bare = replace(scene, meshes=(replace(scene.meshes[0], colors=None, uv_faces=None),), lights=())
    arguments = course.arguments(bare)
    assert (arguments["verts_colors"] == 1.0).all()
    assert arguments["l_pos"].shape == arguments["l_int"].shape == (0, 3)
    with pytest.raises(ValueError, match=r"arguments: .*: expected"):
        course.arguments(replace(scene, background=None))
    with pytest.raises(ValueError, match="arguments: scene: expected a mesh with a texture"):
        course.arguments(scene, textured=True)


def assert_same_arguments(arguments: dict, expected: dict) -> None:
    expected = {name: value for name, value in expected.items() if name != "shader"}
    assert arguments.keys() == expected.keys()
    for name, value in expected.items():
        assert np.array_equal(arguments[name], value), name


def test_arrays_may_come_transposed_and_vectors_in_every_shape():
    arguments = reference.scene_arguments(replace(surfaced(), lights=LIGHTS))
    plain = course.render_object(**arguments)
    names = ("eye", "lookat", "up", "bg_color", "light_amb", "k_a", "k_d", "k_s")
    shapes = [{n: np.reshape(np.broadcast_to(arguments[n], 3), to) for n in names} for to in ((3,), (1, 3), (3, 1))]
    shapes.append({name: arguments[name].T for name in ("verts", "verts_colors", "faces")})
    shapes.append({"l_pos": [list(p) for p in arguments["l_pos"]], "l_int": list(arguments["l_int"][:, :, None])})
    for changes in shapes:
        assert (course.render_object(**{**arguments, **changes}) == plain).all()
    apart = course.render_object(**{**arguments, "k_d": [0.8, 0.0, 0.8], "light_amb": [0.2, 0.2, 0.4]})
    assert (apart[..., 0] == plain[..., 0]).all()
    assert not (apart[..., 1:] == plain[..., 1:]).all()
    mapped = reference.map_arguments(SCENE, TEXELS)
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
    four = {name: np.concatenate([square[name], square[name][:, :1]], axis=1) for name in ("verts", "verts_colors")}
    turned = {name: array.T for name, array in four.items()} | {"faces": faces.T}
    for changes in (four, turned):  # an unused vertex makes them rows or columns for certain
        assert (course.render_object(**reference.quad_arguments(**{**square, **changes}, k_s=0.5, n=20)) == image).all()


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


def test_large_arrays_push_others_out():
    dropped = []
    recent = ContentCache(len, dropped.append, max_count=9, max_bytes=1000)
    for count in (50, 60, 500):
        recent.get(np.zeros(count))
    assert dropped == [50, 60]


def test_equality():
    assert are_equal(np.array([np.nan]), np.array([np.nan]))
    assert not any(are_equal(*pair) for pair in ((np.zeros(1), 0.0), (0.0, np.zeros(1)), (1, 1.0), (None, 0)))


# Files


def test_render_of_a_saved_scene_is_render_object(tmp_path, capsys):
    scene = surfaced(n=20, kd=np.array([0.8, 0.7, 0.6]))
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
