"""`Scene.to_glb`: what is written is read back, by this reader and by trimesh's."""

from __future__ import annotations

import json
import math
import struct
import warnings
from dataclasses import fields, replace

import numpy as np
import pytest
from every_light import EVERY
from mesh_writers import textured, triangle
from scene_files import course_dict, save_npy

import clshade
from clshade.errors import InputError, OutputError
from clshade.images.decode import srgb_to_linear
from clshade.scene.contents import object_names
from clshade.scene.formats.gltf_writer import Glb, float32_frame, unify_vertices
from clshade.scene.geometry import bounding_box, camera_axes, vertex_normals
from clshade.scene.lights import DirectionalLight, PointLight, RectangleLight, SpotLight
from clshade.scene.material import MAPS, TERMS
from clshade.scene.model import Material, Mesh, MetallicRoughness, Scene, Texture

RNG = np.random.default_rng(11)
CAMERA = clshade.Camera.from_fov((0, 1, 5), (0, 0, 0), (0, 1, 0), 40, (640, 480))
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.5]], np.float32)
FACES = np.array([[0, 1, 2], [2, 1, 3]])
UVS = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], np.float32)


def mesh(**changes) -> Mesh:
    return Mesh(**{"verts": CORNERS, "faces": FACES, "material": Material(pbr=MetallicRoughness()), **changes})


def written(folder, *meshes, **changes) -> tuple[Scene, list[str]]:
    """Write a scene of meshes and load it; return it, and the warnings of writing."""
    path = folder / "a.glb"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        Scene(meshes, **{"camera": CAMERA, "ambient": 0.1, **changes}).to_glb(path)
    return clshade.load(path), [str(record.message) for record in caught]


def content(path) -> dict:
    """Return the JSON of a GLB file, whose container is checked."""
    data = path.read_bytes()
    magic, version, length, size, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    document = json.loads(data[20 : 20 + size])
    if "buffers" in document:
        assert struct.unpack_from("<I4s", data, 20 + size) == (document["buffers"][0]["byteLength"], b"BIN\0")
    return document


def corners_in_world(scene: Scene) -> np.ndarray:
    """Return the corners of all triangles, (F, 3, 3), in the order of meshes, placements and faces."""
    corners = []
    for part in scene.meshes:
        verts = np.asarray(part.verts, np.float64)
        for placement in np.asarray(part.instances):
            corners.append((verts @ placement[:3, :3].T + placement[:3, 3])[part.faces])
    return np.concatenate(corners)


def at_corners(part: Mesh, name: str) -> np.ndarray:
    """Return an attribute at the corners of the faces, (F, 3, K)."""
    indices = {"normals": part.normal_faces, "uvs": part.uv_faces, "tangents": part.tangent_faces}.get(name)
    return np.asarray(getattr(part, name))[part.faces if indices is None else indices]


def assert_same_camera(camera, expected) -> None:
    """Eye, axes and field of view; the resolution is 600 rows of the same shape, within half a column."""
    np.testing.assert_allclose(camera.eye, expected.eye, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(camera_axes(camera), camera_axes(expected), atol=1e-9)
    height, width = expected.plane
    lens = 1.0 if expected.orthographic else expected.focal
    tolerance = 0.5 / (600 * width / height)
    np.testing.assert_allclose(camera.plane[0] / camera.focal, height / lens, rtol=1e-12 + tolerance)
    np.testing.assert_allclose(camera.plane[1] / camera.plane[0], width / height, rtol=2 * tolerance)
    assert camera.orthographic == expected.orthographic


def assert_same_texture(texture: Texture | None, expected: Texture | None) -> None:
    assert (texture is None) == (expected is None)
    if expected is not None and texture is not None:
        assert texture.image.tobytes() == expected.image.tobytes()
        assert (texture.wrap, texture.filter, texture.name) == (expected.wrap, expected.filter, expected.name)


def assert_same_material(material: Material, expected: Material) -> None:
    """All that glTF says of a material, and Phong's parameters, which the reader derives from it."""
    for name in ("color", "ka", "kd", "ks", "n", "opacity"):
        np.testing.assert_allclose(getattr(material, name), getattr(expected, name), rtol=1e-12, err_msg=name)
    for name in ("name", "sides", "two_sided", "alpha_cutoff", "blend"):
        assert getattr(material, name) == getattr(expected, name), name
    assert_same_texture(material.texture, expected.texture)
    for field in fields(MetallicRoughness):
        one, reference = getattr(material.microfacets, field.name), getattr(expected.microfacets, field.name)
        if field.name in MAPS:
            assert_same_texture(one, reference)
        else:
            np.testing.assert_allclose(one, reference, rtol=1e-12, err_msg=field.name)


def eight_bits(shape, *, srgb: bool, name: str = "", **fields) -> Texture:
    """Return a texture of 8 bits per channel, as a PNG file has them."""
    codes = RNG.integers(0, 256, shape) / 255.0
    codes[0, 0, -1] = 0.0  # alpha that is not opaque, if it is one
    if srgb:
        codes[..., :3] = srgb_to_linear(codes[..., :3])
    return Texture(codes, name=name, **fields)


# Scenes as they are


@pytest.mark.parametrize("name", ["teapot", "icosphere", "box_room", "course"])
@pytest.mark.filterwarnings("ignore:.*not in the file as in the scene")
def test_a_builtin_scene_comes_back(tmp_path, name):
    options = {"level": 3} if name in ("teapot", "icosphere", "course") else {"divisions": 2}
    scene = clshade.builtin(name, **options)
    scene.to_glb(tmp_path / "a.glb")
    back = clshade.load(tmp_path / "a.glb")
    assert corners_in_world(back).tobytes() == corners_in_world(scene).tobytes()
    assert_same_camera(back.camera, scene.camera)
    assert [part.name for part in back.meshes] == [part.name for part in scene.meshes]
    for copy, expected in zip(back.meshes, scene.meshes, strict=True):
        normals = expected.normals
        if normals is None:
            normals, indices = vertex_normals(expected.verts, expected.faces), expected.faces
        else:
            indices = expected.faces if expected.normal_faces is None else expected.normal_faces
        unit = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        np.testing.assert_allclose(at_corners(copy, "normals"), unit[indices], atol=2e-7)
        if not expected.material.kd.any():  # a lamp, which is unlit
            continue
        one, reference = copy.material.microfacets, expected.material.microfacets
        assert (one.metallic, one.roughness, one.ior) == (reference.metallic, reference.roughness, reference.ior)
        np.testing.assert_allclose(one.dielectric_f0, reference.dielectric_f0, rtol=1e-12)
        color = np.clip(expected.material.color * expected.material.diffuse, 0.0, 1.0)
        np.testing.assert_allclose(copy.material.color, color, rtol=1e-12)


def test_a_course_file_becomes_a_mesh_of_the_same_look(tmp_path):
    scene = clshade.load(save_npy(tmp_path / "a.npy", course_dict()))
    scene.to_glb(tmp_path / "a.glb")
    back = clshade.load(tmp_path / "a.glb")
    (copy,), (expected,) = back.meshes, scene.meshes
    assert corners_in_world(back).tobytes() == corners_in_world(scene).tobytes()
    assert_same_camera(back.camera, scene.camera)
    colors = srgb_to_linear(np.asarray(expected.colors)).astype(np.float32)
    assert at_corners(copy, "colors").tobytes() == colors[expected.faces].tobytes()
    document = content(tmp_path / "a.glb")
    extras = document["materials"][0]["extras"]["clshade"]
    assert (extras["kd"], extras["n"], extras["two_sided"]) == ([0.8] * 3, 7.0, False)
    assert document["scenes"][0]["extras"]["clshade"] == {
        "preset": "course",
        "ambient": [0.2, 0.3, 0.4],
        "background": [1.0, 0.9, 0.8],
    }
    assert document["cameras"][0]["extras"]["clshade"]["resolution"] == [64, 48]


def test_a_course_texture_is_looked_up_at_the_same_texels(tmp_path):
    image = RNG.integers(0, 256, (3, 4, 3)).astype(np.uint8)
    scene = clshade.load(save_npy(tmp_path / "a.npy", course_dict()), texture=image)
    scene.to_glb(tmp_path / "a.glb")
    (copy,), (expected,) = clshade.load(tmp_path / "a.glb").meshes, scene.meshes
    assert copy.colors is None  # texels replace them
    texture = copy.material.texture
    assert texture.wrap == ("clamp", "clamp")
    assert texture.image.tobytes() == srgb_to_linear(image / 255.0).astype(np.float32).tobytes()
    texels = at_corners(expected, "uvs") * [3, 2] + 0.5  # in texels: centers are at halves
    np.testing.assert_allclose(at_corners(copy, "uvs") * [4, 3], texels, atol=1e-6)


def test_what_was_loaded_is_written_as_it_was(tmp_path):
    """Twice: the second file has the arrays and images of the first, bit for bit."""
    document = triangle()
    textured(document, RNG.integers(0, 256, (4, 5, 4)).astype(np.uint8), {"alphaMode": "MASK", "alphaCutoff": 0.25})
    first = clshade.load(document.glb(tmp_path / "a.glb"))
    first.to_glb(tmp_path / "b.glb")
    second = clshade.load(tmp_path / "b.glb")
    second.to_glb(tmp_path / "c.glb")
    for one, copy in zip(first.meshes, second.meshes, strict=True):
        assert one.verts.tobytes() == copy.verts.tobytes()
        assert_same_material(copy.material, one.material)
    assert not second.own_lights  # the stand-ins were not written
    one, copy = ((tmp_path / name).read_bytes().split(b"BIN\0", 1)[1] for name in ("b.glb", "c.glb"))
    assert one == copy


def test_the_same_scene_gives_the_same_bytes(tmp_path):
    for name in ("a.glb", "b.glb"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            clshade.builtin("box_room", divisions=1).to_glb(tmp_path / name)
    assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()


def test_a_scene_without_triangles_is_a_camera(tmp_path):
    path = tmp_path / "a.glb"
    Scene((Mesh(CORNERS, np.zeros((0, 3), int)), mesh(instances=np.zeros((0, 4, 4)))), CAMERA).to_glb(path)
    document = content(path)
    assert "meshes" not in document
    assert "buffers" not in document
    assert document["nodes"][0]["camera"] == 0
    with pytest.raises(InputError, match="at least one triangle"):
        clshade.load(path)


# Meshes


def test_vertices_are_split_only_where_attributes_differ(tmp_path):
    normals = np.array([[0, 0, 2], [0, 3, 0]], np.float64)
    split = mesh(normals=normals, normal_faces=np.array([[0, 0, 0], [1, 1, 1]]), uvs=UVS)
    plain = mesh(
        normals=np.tile([[0.0, 0, 5]], (4, 1)), uvs=UVS, material=Material(texture=Texture(np.ones((1, 1, 3))))
    )
    back, messages = written(tmp_path, split, plain)
    assert messages == []
    assert [len(part.verts) for part in back.meshes] == [6, 4]
    expected = [[[0, 0, 1]] * 3, [[0, 1, 0]] * 3]
    assert at_corners(back.meshes[0], "normals").tolist() == expected
    assert corners_in_world(back).tobytes() == np.concatenate([CORNERS[FACES].astype(float)] * 2).tobytes()
    np.testing.assert_array_equal(at_corners(back.meshes[1], "uvs"), UVS[FACES])


@pytest.mark.parametrize("far", [1e9, 1e300])
def test_vertices_without_faces_are_left_out(tmp_path, far):
    """They cost the others no digits."""
    verts = np.vstack([[far] * 3, CORNERS + 1 / 3, [-far] * 3])
    back, _ = written(tmp_path, mesh(verts=verts, faces=FACES + 1, colors=np.linspace(0, 1, 18).reshape(6, 3)))
    np.testing.assert_allclose(corners_in_world(back), verts[FACES + 1], rtol=1e-7)
    (copy,) = back.meshes
    assert (len(copy.verts), copy.faces.tolist()) == (4, FACES.tolist())
    np.testing.assert_allclose(copy.colors, np.linspace(0, 1, 18).reshape(6, 3)[1:5], rtol=1e-7)


def test_unified_vertices_keep_their_order():
    faces = np.array([[3, 1, 0], [0, 1, 2]], np.int32)
    indices = np.array([[0, 0, 0], [0, 0, 1]], np.int32)
    rows, new_faces = unify_vertices(faces, 4, {"a": (np.arange(4), None), "b": (np.array([7, 8]), indices)})
    assert new_faces.tolist() == [[3, 1, 0], [0, 1, 2]]
    assert (rows["a"].tolist(), rows["b"].tolist()) == ([0, 1, 2, 3], [7, 7, 8, 7])


def test_colors_and_alphas(tmp_path):
    colors = RNG.random((4, 4)).astype(np.float32)
    material = Material(blend=True, opacity=0.5, pbr=MetallicRoughness())
    back, messages = written(
        tmp_path, mesh(colors=colors, material=material), mesh(alphas=colors[:, 3], material=material)
    )
    assert messages == []
    for copy, rgb in zip(back.meshes, (colors[:, :3], np.ones((4, 3))), strict=True):
        np.testing.assert_array_equal(copy.colors, rgb.astype(np.float32))
        np.testing.assert_array_equal(copy.alphas, colors[:, 3])
        assert (copy.material.blend, copy.material.opacity) == (True, 0.5)


def test_placements_are_nodes(tmp_path):
    sheared = np.eye(4)
    sheared[:3] = RNG.normal(size=(3, 4))
    mirrored = np.diag([-1.0, 2.0, 3.0, 1.0])
    placements = np.stack([np.eye(4), mirrored, sheared])
    back, _ = written(tmp_path, mesh(instances=placements, name="thing"))
    (copy,) = back.meshes
    assert copy.name == "thing"
    np.testing.assert_allclose(copy.instances, placements, atol=1e-14)
    nodes = content(tmp_path / "a.glb")["nodes"]
    assert "matrix" not in nodes[0]
    for node in nodes:  # a rotation or reflection and a scale each, as the specification wants
        linear = np.reshape(node.get("matrix", np.eye(4)), (4, 4)).T[:3, :3]
        squares = linear.T @ linear
        np.testing.assert_allclose(squares, np.diag(np.diag(squares)), atol=1e-12)


def test_placements_that_only_move_are_short(tmp_path):
    moved = np.tile(np.eye(4), (3, 1, 1))
    moved[1:, :3, 3] = [[0.1, 1e-300, -1e200], [0, 0, 0]]
    moved[2, 0, 1] = 1e-9
    back, _ = written(tmp_path, mesh(instances=moved))
    assert back.meshes[0].instances.tobytes() == moved.tobytes()
    nodes = content(tmp_path / "a.glb")["nodes"][:3]
    assert [sorted(node) for node in nodes] == [["mesh"], ["mesh", "translation"], ["matrix", "mesh"]]


@pytest.mark.parametrize(
    ("offset", "scale"), [(1e6, 1.0), (-4.5e5, 1e-3), (0.0, 1.0), (0.0, 1e100), (1e-60, 1e-60), (1e60, 1e59)]
)
def test_float64_positions_keep_their_accuracy(tmp_path, offset, scale):
    """Each within 2^-24 of the mesh's size, which is float32's rounding relative to its middle."""
    verts = RNG.random((50, 3)) * scale + offset
    faces = RNG.integers(0, 50, (30, 3))
    middle, exponent = float32_frame([verts])
    narrow = np.ldexp(verts - middle, -exponent).astype(np.float32)
    back = np.ldexp(narrow.astype(np.float64), exponent) + middle
    assert np.abs(back - verts).max() <= 2.0**-24 * scale * 1.01 + 4e-16 * abs(offset)
    if scale == 1.0:
        scene, _ = written(tmp_path, mesh(verts=verts, faces=faces))
        error = np.abs(corners_in_world(scene) - verts[faces]).max()
        assert error <= 2.0**-24 * 1.01 + 4e-16 * abs(offset)


def test_positions_that_float32_holds_stay(tmp_path):
    verts = np.array([[1e6, 0, 0], [1e6 + 1, 0, 0], [1e6, 1, 0]])
    middle, exponent = float32_frame([verts])
    assert (middle.tolist(), exponent) == ([0, 0, 0], 0)


def test_parts_in_float64_stay_one_object(tmp_path):
    """Their positions are moved together, and their instances have the names of whichever part has some."""
    parts = [mesh(verts=RNG.random((3, 3)) + 1e6 + k, faces=[[0, 1, 2]], name="car", part_of="car") for k in range(2)]
    parts[1] = replace(parts[1], instance_names=("left",))
    scene, _ = written(tmp_path, *parts)
    assert object_names(scene) == ["car"]
    assert content(tmp_path / "a.glb")["nodes"][0]["name"] == "left"
    assert np.abs(corners_in_world(scene)[1] - parts[1].verts).max() <= 2.0**-22


@pytest.mark.parametrize("count", [65535, 65536, 70000])
def test_indices_are_as_wide_as_they_need(tmp_path, count):
    """The largest of 16 bits is no index: it restarts strips."""
    verts = np.zeros((count, 3), np.float32)
    verts[:, 0] = np.arange(count)
    verts[-1, 1] = 1.0
    rest = np.minimum(np.arange(2, 2 + count // 3 * 3), count - 1).reshape(-1, 3)
    back, _ = written(tmp_path, mesh(verts=verts, faces=np.vstack([[[0, 1, count - 1]], rest])))
    assert corners_in_world(back)[0].tolist() == [[0, 0, 0], [1, 0, 0], [count - 1, 1, 0]]
    accessors = content(tmp_path / "a.glb")["accessors"]
    assert accessors[-1]["componentType"] == (5123 if count == 65535 else 5125)


def test_scalars_are_attributes(tmp_path):
    at_points, of_faces = np.array([1.5, -2.0, 0.25, 8.0]), np.array([3.0, 4.0])
    of_corners = np.array([[1.0, 2, 3], [3, 2, 5]])
    scalars = {"height": at_points, "part": of_faces, "corner": of_corners}
    back, messages = written(tmp_path, mesh(scalars=scalars))
    (copy,) = back.meshes
    assert copy.scalars["height"][copy.faces].tolist() == at_points[FACES].tolist()
    assert copy.scalars["part"][copy.faces].tolist() == [[3.0] * 3, [4.0] * 3]
    assert copy.scalars["corner"][copy.faces].tolist() == of_corners.tolist()
    assert messages == []
    back, (message,) = written(tmp_path, mesh(scalars={"height": np.array([1.0, np.nan, 2.0, 3.0])}))
    assert "NaN in scalars height" in message
    assert np.isnan(back.meshes[0].scalars["height"]).tolist() == [False, True, False, False]


def test_texture_coordinates_that_are_no_numbers_are_zero(tmp_path):
    uvs = np.array([[0, np.nan], [np.inf, 0], [1e300, -1e300], [0.5, 0.5]])
    texture = Texture(np.ones((1, 1, 3)))
    (copy,) = written(tmp_path, mesh(uvs=uvs, material=Material(texture=texture)))[0].meshes
    assert copy.uvs.tolist() == [[0, 0], [0, 0], [2.0**40, -(2.0**40)], [0.5, 0.5]]


# Materials


def maps(**changes) -> MetallicRoughness:
    defaults = {
        "metallic": 0.25,
        "roughness": 0.625,
        "metallic_roughness_texture": eight_bits((4, 3, 3), srgb=False, name="worn", wrap="clamp"),
        "ior": 1.25,
        "specular": 0.5,
        "specular_color": (0.25, 1.0, 2.0),
        "emission": (0.0, 3.0, 4.0),
        "normal_texture": eight_bits((2, 3, 3), srgb=False, name="bumps", filter="nearest"),
        "normal_scale": 0.75,
        "occlusion_texture": eight_bits((5, 2, 3), srgb=False, wrap=("mirror", "repeat")),
        "occlusion_strength": 0.5,
        "emission_texture": eight_bits((2, 2, 3), srgb=True, name="glow"),
    }
    return MetallicRoughness(**{**defaults, **changes})


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"sides": "both", "two_sided": True},
        {"alpha_cutoff": 0.375},
        {"alpha_cutoff": 1.5, "opacity": 0.5},
        {"blend": True, "opacity": 0.25},
        {"pbr": maps(ior=0.0, specular=1.0, specular_color=1.0)},
        {"pbr": MetallicRoughness(0.0, 0.0)},
        {"texture": eight_bits((3, 3, 3), srgb=True, wrap=("clamp", "mirror"), filter="nearest")},
    ],
)
def test_a_material_comes_back(tmp_path, changes):
    texture = eight_bits((6, 4, 4), srgb=True, name="skin")
    opaque = not changes.get("blend") and "alpha_cutoff" not in changes
    if opaque:
        texture = replace(texture, image=texture.image[..., :3])
    defaults = {"color": (0.5, 0.25, 1.0), "sides": "front", "texture": texture, "pbr": maps(), "name": "paint"}
    material = Material(**{**defaults, **changes})
    path = tmp_path / "once"
    path.mkdir()
    first = written(path, mesh(uvs=UVS, material=material))[0].meshes[0].material
    expected = replace(material, ka=first.ka, kd=first.kd, ks=first.ks, n=first.n)  # which the reader derives
    assert_same_material(first, expected)
    again, messages = written(tmp_path, mesh(uvs=UVS, material=first))
    assert_same_material(again.meshes[0].material, first)
    assert messages == []


def test_phong_becomes_what_shader_pbr_draws(tmp_path):
    """The file's picture is that of the scene in shader pbr: the same base color, roughness and reflectance."""
    material = Material(0.2, (0.5, 0.25, 0.125), (0.5, 0.25, 0.0), 30.0, color=(1.0, 0.5, 0.25))
    copy = written(tmp_path, mesh(material=material))[0].meshes[0].material
    one, reference = copy.microfacets, material.microfacets
    assert (one.metallic, one.roughness) == (0.0, reference.roughness)
    np.testing.assert_allclose(one.dielectric_f0, reference.dielectric_f0, rtol=1e-12)
    np.testing.assert_allclose(copy.color * copy.diffuse, material.color * material.diffuse, rtol=1e-12)
    (entry,) = content(tmp_path / "a.glb")["materials"]
    assert entry["extras"]["clshade"] == {
        "ka": [0.2] * 3,
        "kd": [0.5, 0.25, 0.125],
        "ks": [0.5, 0.25, 0.0],
        **dict.fromkeys(list(TERMS)[2:], [0.0] * 3),
        "n": 30.0,
        "color": [1.0, 0.5, 0.25],
        "two_sided": False,
    }


def test_unlit_materials(tmp_path):
    material = Material(ka=10.0, kd=0.0, ks=0.0, color=(0.25, 0.5, 0.75), sides="front")
    copy = written(tmp_path, mesh(material=material))[0].meshes[0].material
    assert content(tmp_path / "a.glb")["extensionsUsed"] == ["KHR_materials_unlit"]
    for name in ("color", "ka", "kd", "ks", "pbr", "sides", "two_sided"):
        np.testing.assert_array_equal(getattr(copy, name), getattr(material, name), err_msg=name)


def test_textures_of_further_coordinates(tmp_path):
    occlusion = eight_bits((2, 2, 3), srgb=False, coordinates=1)
    material = Material(texture=eight_bits((2, 2, 3), srgb=True), pbr=MetallicRoughness(occlusion_texture=occlusion))
    flipped = UVS[::-1].copy()
    copy = written(tmp_path, mesh(uvs=UVS, more_uvs=[flipped], material=material), mesh(uvs=UVS, material=material))[0]
    both, one = copy.meshes
    assert both.material.pbr.occlusion_texture.coordinates == 1
    assert both.more_uvs[0].tolist() == flipped.tolist()
    assert one.material.pbr.occlusion_texture is None  # that mesh lacks its coordinates
    assert len(content(tmp_path / "a.glb")["images"]) == 2


def test_an_image_is_written_once(tmp_path):
    image = RNG.integers(0, 256, (4, 4, 3)).astype(np.uint8)
    facets = MetallicRoughness(metallic_roughness_texture=Texture(image), occlusion_texture=Texture(image))
    meshes = [mesh(uvs=UVS, material=Material(pbr=replace(facets))) for _ in range(3)]
    written(tmp_path, *meshes)
    document = content(tmp_path / "a.glb")
    assert [len(document[name]) for name in ("images", "textures", "samplers", "materials", "meshes")] == [
        1,
        1,
        1,
        1,
        3,
    ]


def test_bright_images_keep_their_brightness(tmp_path):
    glow = Texture(np.array([[[8.0, 0.0, 0.0], [0.0, 4.0, 0.0]]]))
    facets = MetallicRoughness(emission=(0.5, 0.5, 0.5), emission_texture=glow)
    copy = written(tmp_path, mesh(uvs=UVS, material=Material(pbr=facets)))[0].meshes[0].material.pbr
    light = copy.emission * copy.emission_texture.image
    np.testing.assert_allclose(light, 0.5 * glow.image, rtol=0.01)


# Camera and lights


@pytest.mark.parametrize(
    "camera",
    [
        CAMERA,
        clshade.Camera((3, 2, 1), (0.2, 0.3, 0), (0.5, 1, 0.1), 2.0, (1.0, 2.0), (300, 150)),
        clshade.Camera((3, 2, 1), (0, 0, 0), (0, 1, 0), 2.0, (3.0, 2.0), (100, 150), orthographic=True),
        clshade.Camera((0, 9, 0), (0, 0, 0), (0, 0, -1), 1.0, (1.0, 1.0), (64, 64)),
    ],
)
def test_a_camera_comes_back(tmp_path, camera):
    back, messages = written(tmp_path, mesh(), camera=camera)
    assert_same_camera(back.camera, camera)
    assert messages == []
    assert not back.fitted
    (lens,) = (entry[entry["type"]] for entry in content(tmp_path / "a.glb")["cameras"])
    depths = (bounding_box(back) - camera.eye) @ camera_axes(camera)[2]
    assert 0.0 <= lens["znear"] < depths.min()
    assert lens.get("zfar", math.inf) > depths.max()


def test_a_principal_point_is_told(tmp_path):
    _, (message,) = written(tmp_path, mesh(), camera=replace(CAMERA, principal=(0.25, 0.5)))
    assert message.endswith(
        "a.glb: not in the file as in the scene: the camera's principal point (the middle of the image)"
    )
    assert content(tmp_path / "a.glb")["cameras"][0]["extras"]["clshade"]["principal"] == [0.25, 0.5]


LIGHTS = (
    DirectionalLight((1.0, -2.0, 0.5), (0.5, 0.25, 0.75)),
    PointLight((1.0, 2.0, 3.0), (10.0, 0.0, 5.0), "inverse-square", 20.0),
    SpotLight((0.0, 4.0, 0.0), (0.0, -3.0, 0.1), (3.0, 3.0, 3.0), 10.0, 30.0, "inverse-square"),
    SpotLight((0.0, 4.0, 1.0), (0.0, 0.0, -1.0), (3.0, 3.0, 3.0), 45.0, 90.0, "inverse-square", 9.0),
)


def test_lights_come_back_up_to_one_factor(tmp_path):
    back, messages = written(tmp_path, mesh(), lights=LIGHTS)
    assert messages == []
    for light, expected in zip(back.lights, LIGHTS, strict=True):
        assert type(light) is type(expected)
        np.testing.assert_allclose(light.intensity / back.light_scale, expected.intensity, rtol=1e-12)
        for name in ("position", "range", "inner_cone", "outer_cone", "attenuation"):
            if getattr(expected, name, None) is not None and name != "attenuation":
                np.testing.assert_allclose(getattr(light, name), getattr(expected, name), rtol=1e-12, err_msg=name)
            elif name == "attenuation":
                assert getattr(light, name, None) == getattr(expected, name, None)
        if hasattr(expected, "direction"):
            unit = expected.direction / np.linalg.norm(expected.direction)
            np.testing.assert_allclose(light.direction, unit, atol=1e-12)
    back.to_glb(tmp_path / "b.glb")
    again = clshade.load(tmp_path / "b.glb")
    for light, expected in zip(again.lights, back.lights, strict=True):
        np.testing.assert_allclose(light.intensity, expected.intensity, rtol=1e-12)


def test_every_kind_comes_back_as_the_type_that_it_names(tmp_path):
    for light in EVERY:
        (copy,) = written(tmp_path, mesh(), lights=(replace(light, intensity=(1, 1, 1)),))[0].lights
        assert (copy.gltf, copy.gltf_loss) == (light.gltf, "")
        if light.axis is not None:
            np.testing.assert_allclose(copy.axis, light.axis, atol=1e-12)


def test_lights_without_attenuation_are_as_bright_at_the_center(tmp_path):
    lights = PointLight((0.5, 0.5, 10.25), (2.0, 1.0, 0.0)), SpotLight((30.5, 0.5, 0.25), (-1, 0, 0))
    back, _ = written(tmp_path, mesh(), lights=lights)
    for light, original, away in zip(back.lights, lights, (10.0, 30.0), strict=True):
        np.testing.assert_allclose(light.intensity / back.light_scale / away**2, original.intensity, rtol=1e-12)
        assert light.attenuation == "inverse-square"


def test_what_the_file_cannot_say_is_told_once(tmp_path):
    lights = [
        PointLight((1, 2, 3), (-1, -2, 0)),
        PointLight((1, 2, 3), radius=0.5),
        PointLight((1, 2, 4), radius=0.5),
        RectangleLight((0, 3, 0), (1, 0, 0), (0, 0, 1)),
    ]
    material = Material(color=2.0, blend=True, alpha_cutoff=0.5, pbr=MetallicRoughness())
    environment = clshade.Environment(np.ones((2, 4, 3)))
    back, (message,) = written(tmp_path, mesh(material=material), lights=lights, environment=environment)
    losses = message.split("not in the file as in the scene: ")[1].split(", ")
    assert losses == [
        "the environment (none)",
        "alpha tests of materials that blend",
        "colors beyond 0 to 1 (clamped)",
        "negative light (none)",
        "radii of lights (points)",
        "rectangle lights (spots of 90 degrees)",
    ]
    np.testing.assert_allclose(back.lights[-1].direction, [0, -1, 0], atol=1e-12)
    assert back.lights[-1].outer_cone == 90.0


# Files


@pytest.mark.parametrize("name", ["a.gltf", "a", "a.obj", ".glb", ""])
def test_other_names_are_refused(tmp_path, name):
    with pytest.raises(InputError, match=r"^to_glb: path: expected a name ending in \.glb, found "):
        clshade.builtin("icosphere", level=0).to_glb(tmp_path / name if name else "")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("path", [3, None, b"a.glb"])
def test_what_is_no_path_is_refused(path):
    with pytest.raises(InputError, match=r"^to_glb: path: expected a path"):
        clshade.builtin("icosphere", level=0).to_glb(path)


def test_files_that_cannot_be_written(tmp_path):
    scene = clshade.builtin("icosphere", level=0)
    with pytest.raises(OutputError, match="there is no folder"):
        scene.to_glb(tmp_path / "none" / "a.glb")
    (tmp_path / "b.glb").mkdir()
    with pytest.raises(OutputError, match="it is a folder"):
        scene.to_glb(tmp_path / "b.glb")


def test_too_large_a_file_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("clshade.scene.formats.gltf_writer.MAX_BYTES", 1000)
    with pytest.raises(InputError, match="to_glb: scene: expected a file of at most 1000 bytes"):
        clshade.builtin("icosphere", level=0).to_glb(tmp_path / "a.glb")
    assert list(tmp_path.iterdir()) == []


def beyond_float64() -> Mesh:
    far = np.eye(4)
    far[:3, :3] *= 1e200
    return mesh(verts=np.asarray(CORNERS, np.float64) * 1e200, instances=far[None])


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"meshes": beyond_float64()}, "meshes: expected placements within 1e"),
        ({"camera": replace(CAMERA, plane=(1e-200, 1e200))}, "camera: expected angles of view above 0 and below 180"),
        ({"camera": replace(CAMERA, plane=(1e200, 1e200))}, "camera: expected angles of view"),
        ({"camera": replace(CAMERA, focal=1e200, plane=(1e-200, 1e-200))}, "camera: expected angles of view"),
        ({"camera": replace(CAMERA, eye=(0, 0, 1e305))}, "camera: expected placements within 1e"),
        ({"lights": PointLight((0, 0, 1e305))}, "lights: expected placements within 1e"),
        ({"lights": DirectionalLight((0, 0, 1)), "light_scale": 1e-320}, "scene: expected materials and lights within"),
        (
            {"meshes": mesh(material=Material(ka=1e300, kd=0, ks=0, color=0)), "ambient": 1e300},
            "scene: expected materials and lights within the range of float64, found others",
        ),
    ],
)
def test_what_is_beyond_float64_is_refused(tmp_path, changes, part):
    with pytest.raises(InputError, match=f"^to_glb: {part}"):
        Scene(**{"meshes": mesh(), "camera": CAMERA, **changes}).to_glb(tmp_path / "a.glb")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_colors_that_overflow_are_clamped(tmp_path):
    material = Material(kd=1e300, color=1e300)
    back, (message,) = written(tmp_path, mesh(material=material))
    assert message.endswith("colors beyond 0 to 1 (clamped)")
    assert back.meshes[0].material.color.tolist() == [1, 1, 1]


@pytest.mark.long
def test_a_hundred_thousand_placements_come_back(tmp_path):
    turned = np.tile(np.eye(4), (100_000, 1, 1))
    turned[:, :2, :2] = [[0.6, -0.8], [0.8, 0.6]]
    turned[:, :3, 3] = RNG.normal(size=(100_000, 3))
    names = [f"tree {k}" for k in range(100_000)]
    copy = written(tmp_path, mesh(instances=turned, instance_names=names))[0].meshes[0]
    np.testing.assert_array_equal(copy.instances, turned)
    assert copy.instance_names == tuple(names)


def test_padding_is_as_the_format_wants():
    glb = Glb()
    glb.view(b"abc")
    assert glb.lists["bufferViews"][glb.view(b"defg")]["byteOffset"] == 4


# Another reader


def test_trimesh_reads_it(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    texture = eight_bits((4, 5, 3), srgb=True, name="skin")
    placements = np.stack([np.eye(4), np.diag([2.0, 2.0, 2.0, 1.0])])
    placements[1, :3, 3] = 1, 2, 3
    painted = mesh(uvs=UVS, material=Material(texture=texture, pbr=MetallicRoughness(0.25, 0.5)), name="painted")
    colored = mesh(colors=np.eye(4)[:, :3], instances=placements, name="colored")
    Scene((painted, colored), CAMERA, LIGHTS).to_glb(tmp_path / "a.glb")
    loaded = trimesh.load(tmp_path / "a.glb")
    assert len(loaded.graph.nodes_geometry) == 3
    corners = corners_in_world(clshade.load(tmp_path / "a.glb"))
    assert sorted(np.reshape(loaded.triangles, (-1, 9)).tolist()) == sorted(np.reshape(corners, (-1, 9)).tolist())
    one, second = loaded.geometry["painted"], loaded.geometry["colored"]
    codes = np.asarray(one.visual.material.baseColorTexture.convert("RGB"))
    assert srgb_to_linear(codes / 255.0).astype(np.float32).tobytes() == texture.image.tobytes()
    assert (one.visual.material.metallicFactor, one.visual.material.roughnessFactor) == (0.25, 0.5)
    np.testing.assert_allclose(one.visual.uv, UVS * [1, -1] + [0, 1], atol=1e-7)
    assert second.visual.vertex_attributes["color"].tolist() == np.eye(4)[:, :3].tolist()
    assert loaded.has_camera
    np.testing.assert_allclose(loaded.camera.fov[1], 40.0, rtol=1e-9)


def test_trimesh_reads_halves_of_surrogate_pairs(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    named = mesh(name='a\ud800"\n\0', instance_names=["\udfff"], scalars={"t\ud800": np.arange(4.0)})
    back, _ = written(tmp_path, named, name="\ud801é")
    loaded = trimesh.load(tmp_path / "a.glb")
    assert list(loaded.geometry) == [back.meshes[0].name] == ['a\\ud800"\n\0']
    assert back.meshes[0].instance_names == ("\\udfff",)
    assert list(back.meshes[0].scalars) == ["t\\ud800"]
