"""`Scene.to_glb`: what is written is read back, by this reader and by trimesh's (test_from_trimesh.py)."""

import dataclasses
import json
import math
import struct
import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from every_light import EVERY
from scene_files import corners_in_world, course_dict, save_npy

import clshade
from clshade.errors import InputError, OutputError
from clshade.images.decode import srgb_to_linear
from clshade.scene.contents import object_names
from clshade.scene.formats.gltf_writer import float32_frame
from clshade.scene.geometry import bounding_box, camera_axes, vertex_normals
from clshade.scene.lights import DirectionalLight, PointLight, RectangleLight, SpotLight
from clshade.scene.model import Material, Mesh, MetallicRoughness, Scene, Texture

RNG = np.random.default_rng(11)
CAMERA = clshade.Camera.from_fov((0, 1, 5), (0, 0, 0), (0, 1, 0), 40, (640, 480))
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.5]], np.float32)
FACES = np.array([[0, 1, 2], [2, 1, 3]])
UVS = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], np.float32)
UP = np.float32([[0, 0, 1]] * 4)


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
    views = document.get("bufferViews", ())
    assert all(view["byteOffset"] % 4 == 0 for view in views)
    for part in (part for mesh in document.get("meshes", ()) for part in mesh["primitives"]):
        for target, index in ((34963, part["indices"]), *((34962, index) for index in part["attributes"].values())):
            assert views[document["accessors"][index]["bufferView"]]["target"] == target
    assert not any("target" in views[image["bufferView"]] for image in document.get("images", ()))
    return document


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


def eight_bits(shape, *, srgb: bool, name: str = "", **fields) -> Texture:
    """Return a texture of 8 bits per channel, as a PNG file has them."""
    codes = RNG.integers(0, 256, shape) / 255.0
    codes[0, 0, -1] = 0.0  # alpha that is not opaque, if it is one
    if srgb:
        codes[..., :3] = srgb_to_linear(codes[..., :3])
    return Texture(codes, name=name, **fields)


def differing(a: Any, b: Any, name: str = "") -> Iterator[str]:
    """Yield the names, Class.field, of what differs by more than rounding between two values."""
    if dataclasses.is_dataclass(a) and type(a) is type(b):
        for field in dataclasses.fields(a):
            yield from differing(getattr(a, field.name), getattr(b, field.name), f"{type(a).__name__}.{field.name}")
    elif isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        for one, second in zip(a, b, strict=True):
            yield from differing(one, second, name)
    elif isinstance(a, dict) and list(a) == list(b):
        for key in a:
            yield from differing(a[key], b[key], name)
    elif isinstance(a, (np.ndarray, float)) and isinstance(b, (np.ndarray, float)):
        if np.shape(a) != np.shape(b) or not np.allclose(a, b, rtol=1e-12, atol=1e-13):
            yield name
    elif not np.array_equal(a, b):
        yield name


# Scenes as they are

LIGHTS = (
    DirectionalLight((1.0, -2.0, 0.5), (0.5, 0.25, 0.75)),
    PointLight((1.0, 2.0, 3.0), (10.0, 0.0, 5.0), "inverse-square", 20.0),
    PointLight((1.0, 2.0, 3.0), (10.0, 0.0, 5.0), "inverse-square"),
    SpotLight((0.0, 4.0, 0.0), (0.0, -3.0, 0.1), (3.0, 3.0, 3.0), 10.0, 30.0, "inverse-square"),
    SpotLight((0.0, 4.0, 1.0), (0.0, 0.0, -1.0), (3.0, 3.0, 3.0), 45.0, 90.0, "inverse-square", 9.0),
)


def full_scene() -> Scene:
    """Return a scene with all that a GLB file can say: of each field another value than its default."""
    pbr = MetallicRoughness(
        *(0.25, 0.625, eight_bits((4, 3, 3), srgb=False, name="worn", wrap="clamp"), 1.25, 0.5, (0.25, 1.0, 2.0)),
        *((0.0, 3.0, 4.0), eight_bits((2, 3, 3), srgb=False, name="bumps", filter="nearest"), 0.75),
        *(eight_bits((5, 2, 3), srgb=False, wrap=("mirror", "repeat"), coordinates=1), 0.5),
        eight_bits((2, 2, 3), srgb=True, name="glow"),
    )
    skin = eight_bits((6, 4, 4), srgb=True, name="skin", wrap=("clamp", "mirror"), filter="nearest")
    opaque = replace(skin, image=skin.image[..., :3])
    paint = Material(color=(0.5, 0.25, 1.0), sides="front", texture=opaque, pbr=pbr, name="paint")
    mirror = replace(pbr, ior=0.0, specular=1.0, specular_color=1.0, occlusion_texture=None, occlusion_strength=1.0)
    materials = [
        paint,
        replace(paint, sides="both", two_sided=True),
        replace(paint, texture=skin, alpha_cutoff=0.375),
        replace(paint, texture=skin, alpha_cutoff=1.5, opacity=0.5),
        replace(paint, texture=skin, blend=True, opacity=0.25, pbr=mirror),
        Material(texture=opaque, pbr=MetallicRoughness(0.0, 0.0), sides="front"),
        Material(ka=10.0, kd=0.0, ks=0.0, color=(0.25, 0.5, 0.75), sides="front"),  # unlit
    ]
    placements = np.tile(np.eye(4), (4, 1, 1))
    placements[1] = np.diag([-1.0, 2.0, 3.0, 1.0])
    placements[2, :3] = RNG.normal(size=(3, 4))  # it shears
    placements[3, :3, 3] = 0.1, 1e-300, -70.0
    fields: dict[str, Any] = {
        "normals": UP,
        "colors": RNG.random((4, 3)).astype(np.float32),
        "scalars": {"height": np.float64([1.5, -2.0, 0.25, 8.0]), "é": np.arange(4.0)},
        "instances": placements[:3],
        "instance_names": ("left", "", "ü"),
        "uvs": UVS,
        "tangents": np.float32([[1, 0, 0, -1]] * 4),
    }
    meshes = [
        *(mesh(**fields, more_uvs=(UVS[::-1].copy(),), material=material) for material in materials[:4]),
        mesh(**fields, material=materials[4], alphas=RNG.random(4).astype(np.float32)),
        mesh(normals=UP, uvs=UVS, material=materials[5], instance_names=["a"]),
        mesh(normals=UP, material=materials[6], instances=placements[[0, 3]], instance_names=["", "b"]),
    ]
    meshes = [replace(part, name=f"mesh {number}") for number, part in enumerate(meshes)]
    camera = clshade.Camera((3, 2, 1), (0.2, 0.3, 0), (0.5, 1, 0.1), 2.0, (1.0, 2.0), (1200, 600))
    return Scene(meshes, camera, LIGHTS, ambient=0.1, preset="pbr", name="a")


DERIVED = {f"Material.{name}" for name in ("ka", "kd", "ks", "n")}  # Phong's parameters, by the reader


@pytest.mark.filterwarnings("error")
def test_all_that_a_file_can_say_comes_back(tmp_path):
    scene = full_scene()
    scene.to_glb(tmp_path / "a.glb")
    back = clshade.load(tmp_path / "a.glb")
    back.to_glb(tmp_path / "b.glb")
    assert set(differing(scene.meshes[:6], back.meshes[:6])) == DERIVED
    assert set(differing(scene.meshes[6], back.meshes[6])) == {"Material.n"}
    alone, copy = (replace(entry, meshes=(), camera=CAMERA, lights=()) for entry in (scene, back))
    assert set(differing(alone, copy)) == {"Scene.background", "Scene.light_scale"}  # which the reader chooses
    assert_same_camera(back.camera, scene.camera)
    for light, expected in zip(back.lights, scene.lights, strict=True):
        axis = {} if isinstance(light, PointLight) else {"direction": light.axis * np.linalg.norm(expected.direction)}
        unscaled = replace(light, intensity=light.intensity / back.light_scale, **axis)
        assert not set(differing(unscaled, expected))
    again = clshade.load(tmp_path / "b.glb")
    assert set(differing(back, again)) == {"Scene.name"}  # the file's
    again.to_glb(tmp_path / "c.glb")
    first = content(tmp_path / "b.glb")
    one, copy = ((tmp_path / name).read_bytes().split(b"BIN\0", 1)[1] for name in ("b.glb", "c.glb"))
    assert one == copy
    scene.to_glb(tmp_path / "c.glb")
    assert (tmp_path / "c.glb").read_bytes() == (tmp_path / "a.glb").read_bytes()
    for node in first["nodes"]:  # a rotation or reflection and a scale each, as the specification wants
        linear = np.reshape(node.get("matrix", np.eye(4)), (4, 4)).T[:3, :3]
        squares = linear.T @ linear
        np.testing.assert_allclose(squares, np.diag(np.diag(squares)), atol=1e-12)
    assert [len(first[name]) for name in ("images", "samplers", "materials", "meshes")] == [6, 5, 7, 7]


def test_a_course_file_becomes_a_mesh_of_the_same_look(tmp_path):
    scene = clshade.load(save_npy(tmp_path / "a.npy", course_dict()))
    scene.to_glb(tmp_path / "a.glb")
    back = clshade.load(tmp_path / "a.glb")
    (copy,), (expected,) = back.meshes, scene.meshes
    assert corners_in_world(back.meshes).tobytes() == corners_in_world(scene.meshes).tobytes()
    assert_same_camera(back.camera, scene.camera)
    normals = vertex_normals(expected.verts, expected.faces)[expected.faces]
    np.testing.assert_allclose(at_corners(copy, "normals"), normals, atol=2e-7)
    colors = srgb_to_linear(np.asarray(expected.colors)).astype(np.float32)
    assert at_corners(copy, "colors").tobytes() == colors[expected.faces].tobytes()
    document = content(tmp_path / "a.glb")
    unsaid = {"preset": "course", "ambient": [0.2, 0.3, 0.4], "background": [1.0, 0.9, 0.8]}
    assert document["scenes"][0]["extras"]["clshade"] == unsaid
    assert document["cameras"][0]["extras"]["clshade"]["resolution"] == [64, 48]
    # Its texture replaces the colors, and is looked up at the same texels.
    image = RNG.integers(0, 256, (3, 4, 3)).astype(np.uint8)
    scene = clshade.load(tmp_path / "a.npy", texture=image)
    scene.to_glb(tmp_path / "a.glb")
    (copy,) = clshade.load(tmp_path / "a.glb").meshes
    assert copy.colors is None
    texture = copy.material.texture
    assert texture.wrap == ("clamp", "clamp")
    assert texture.image.tobytes() == srgb_to_linear(image / 255.0).astype(np.float32).tobytes()
    texels = at_corners(scene.meshes[0], "uvs") * [3, 2] + 0.5  # in texels: centers are at halves
    np.testing.assert_allclose(at_corners(copy, "uvs") * [4, 3], texels, atol=1e-6)


def test_a_scene_without_triangles_is_a_camera(tmp_path):
    path = tmp_path / "a.glb"
    Scene((Mesh(CORNERS, np.zeros((0, 3), int)), mesh(instances=np.zeros((0, 4, 4)))), CAMERA).to_glb(path)
    document = content(path)
    assert "meshes" not in document
    assert "buffers" not in document
    assert document["nodes"][0]["camera"] == 0


# Meshes


def test_vertices_are_split_only_where_attributes_differ(tmp_path):
    """Those without faces are left out, and cost the others no digits. Scalars may be of vertices, faces or corners."""
    normals = np.array([[0, 0, 2], [0, 3, 0]], np.float64)
    split = mesh(normals=normals, normal_faces=np.array([[0, 0, 0], [1, 1, 1]]), uvs=UVS)
    image = Texture(np.ones((1, 1, 3)))
    plain = mesh(normals=np.tile([[0.0, 0, 5]], (4, 1)), uvs=UVS, material=Material(texture=image))
    verts, colors = np.vstack([[1e300] * 3, CORNERS + 1 / 3, [-1e300] * 3]), np.linspace(0, 1, 18).reshape(6, 3)
    unused = mesh(verts=verts, faces=FACES[:, [2, 1, 0]] + 1, colors=colors)
    of_corners = np.array([[1.0, 2, 3], [3, 2, 5]])
    scalars = {"height": np.array([1.5, -2.0, 0.25, 8.0]), "part": np.array([3.0, 4.0]), "corner": of_corners}
    back, messages = written(tmp_path, split, plain, unused, mesh(scalars=scalars))
    assert messages == []
    one, second, third, measured = back.meshes
    assert [len(part.verts) for part in back.meshes] == [6, 4, 4, 6]
    assert at_corners(one, "normals").tolist() == [[[0, 0, 1]] * 3, [[0, 1, 0]] * 3]
    assert one.verts[one.faces].tolist() == second.verts[second.faces].tolist() == CORNERS[FACES].tolist()
    np.testing.assert_array_equal(at_corners(second, "uvs"), UVS[FACES])
    np.testing.assert_allclose(corners_in_world(back.meshes)[4:6], verts[unused.faces], rtol=1e-7)
    assert third.faces.tolist() == FACES[:, [2, 1, 0]].tolist()
    np.testing.assert_allclose(third.colors, colors[1:5], rtol=1e-7)
    assert measured.scalars["height"][measured.faces].tolist() == scalars["height"][FACES].tolist()
    assert measured.scalars["part"][measured.faces].tolist() == [[3.0] * 3, [4.0] * 3]
    assert measured.scalars["corner"][measured.faces].tolist() == of_corners.tolist()


@pytest.mark.parametrize(("offset", "scale"), [(1e6, 1.0), (-4.5e5, 1e-3), (0.0, 1e100), (1e-60, 1e-60)])
def test_float64_positions_keep_their_accuracy(tmp_path, offset, scale):
    """Each within 2^-24 of the mesh's size, which is float32's rounding relative to its middle."""
    verts = RNG.random((50, 3)) * scale + offset
    middle, exponent = float32_frame([verts])
    narrow = np.ldexp(verts - middle, -exponent).astype(np.float32)
    back = np.ldexp(narrow.astype(np.float64), exponent) + middle
    assert np.abs(back - verts).max() <= 2.0**-24 * scale * 1.01 + 4e-16 * abs(offset)
    middle, exponent = float32_frame([np.array([[1e6, 0, 0], [1e6 + 1, 0, 0], [1e6, 1, 0]])])
    assert (middle.tolist(), exponent) == ([0, 0, 0], 0)  # float32 holds these
    if scale == 1.0:
        faces = RNG.integers(0, 50, (30, 3))
        scene, _ = written(tmp_path, mesh(verts=verts, faces=faces))
        error = np.abs(corners_in_world(scene.meshes) - verts[faces]).max()
        assert error <= 2.0**-24 * 1.01 + 4e-16 * abs(offset)


def test_parts_in_float64_stay_one_object(tmp_path):
    """Their positions are moved together, and their instances have the names of whichever part has some."""
    parts = [mesh(verts=RNG.random((3, 3)) + 1e6 + k, faces=[[0, 1, 2]], name="car", part_of="car") for k in range(2)]
    parts[1] = replace(parts[1], instance_names=("left",))
    scene, _ = written(tmp_path, *parts)
    assert object_names(scene) == ["car"]
    assert content(tmp_path / "a.glb")["nodes"][0]["name"] == "left"
    assert np.abs(corners_in_world(scene.meshes)[1] - parts[1].verts).max() <= 2.0**-22


@pytest.mark.parametrize("count", [65535, 65536])
def test_indices_are_as_wide_as_they_need(tmp_path, count):
    """The largest of 16 bits is no index: it restarts strips."""
    verts = np.zeros((count, 3), np.float32)
    verts[:, 0] = np.arange(count)
    verts[-1, 1] = 1.0
    rest = np.minimum(np.arange(2, 2 + count // 3 * 3), count - 1).reshape(-1, 3)
    back, _ = written(tmp_path, mesh(verts=verts, faces=np.vstack([[[0, 1, count - 1]], rest])))
    assert corners_in_world(back.meshes)[0].tolist() == [[0, 0, 0], [1, 0, 0], [count - 1, 1, 0]]
    accessors = content(tmp_path / "a.glb")["accessors"]
    assert accessors[-1]["componentType"] == (5123 if count == 65535 else 5125)


# Materials, camera and lights


def test_phong_becomes_what_shader_pbr_draws(tmp_path):
    """The file's picture is that of the scene in shader pbr: the same base color, roughness and reflectance."""
    material = Material(0.2, (0.5, 0.25, 0.125), (0.5, 0.25, 0.0), 30.0, color=(1.0, 0.5, 0.25))
    back, _ = written(tmp_path, mesh(material=material), lights=LIGHTS, own_lights=False)
    assert not back.own_lights  # the stand-ins were not written
    copy = back.meshes[0].material
    one, reference = copy.microfacets, material.microfacets
    assert (one.metallic, one.roughness) == (0.0, reference.roughness)
    np.testing.assert_allclose(one.dielectric_f0, reference.dielectric_f0, rtol=1e-12)
    np.testing.assert_allclose(copy.color * copy.diffuse, material.color * material.diffuse, rtol=1e-12)
    (entry,) = content(tmp_path / "a.glb")["materials"]
    extras = entry["extras"]["clshade"]
    assert (extras["kd"], extras["n"], extras["color"]) == ([0.5, 0.25, 0.125], 30.0, [1.0, 0.5, 0.25])


def test_textures_that_are_bright_or_without_sound_coordinates(tmp_path):
    glow = Texture(np.array([[[8.0, 0.0, 0.0], [0.0, 4.0, 0.0]]]))
    occlusion = eight_bits((2, 2, 3), srgb=False, coordinates=1)
    facets = MetallicRoughness(emission=(0.5, 0.5, 0.5), emission_texture=glow, occlusion_texture=occlusion)
    uvs = np.array([[0, np.nan], [np.inf, 0], [1e300, -1e300], [0.5, 0.5]])
    copy = written(tmp_path, mesh(uvs=uvs, material=Material(pbr=facets)))[0].meshes[0]
    assert copy.uvs.tolist() == [[0, 0], [0, 0], [2.0**40, -(2.0**40)], [0.5, 0.5]]
    assert copy.material.pbr.occlusion_texture is None  # the mesh lacks its coordinates
    light = copy.material.pbr.emission * copy.material.pbr.emission_texture.image
    np.testing.assert_allclose(light, 0.5 * glow.image, rtol=0.01)


@pytest.mark.parametrize(
    "camera",
    [
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


def test_lights_come_back_as_far_as_the_file_can_say(tmp_path):
    """Each kind as the type that it names; those without attenuation as bright at the center."""
    for light in EVERY:
        (copy,) = written(tmp_path, mesh(), lights=(replace(light, intensity=(1, 1, 1)),))[0].lights
        assert (copy.gltf, copy.gltf_loss) == (light.gltf, "")
        if light.axis is not None:
            np.testing.assert_allclose(copy.axis, light.axis, atol=1e-12)
    lights = PointLight((0.5, 0.5, 10.25), (2.0, 1.0, 0.0)), SpotLight((30.5, 0.5, 0.25), (-1, 0, 0))
    back, _ = written(tmp_path, mesh(), lights=lights)
    for light, original, away in zip(back.lights, lights, (10.0, 30.0), strict=True):
        np.testing.assert_allclose(light.intensity / back.light_scale / away**2, original.intensity, rtol=1e-12)
        assert light.attenuation == "inverse-square"
    entries = content(tmp_path / "a.glb")["extensions"]["KHR_lights_punctual"]["lights"]
    assert entries[0]["extras"]["clshade"] == {"attenuation": "none", "radius": 0.0}


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_what_the_file_cannot_say_is_told_once(tmp_path):
    lights = [PointLight((1, 2, 3), (-1, -2, 0)), *(PointLight((1, 2, z), radius=0.5) for z in (3, 4))]
    lights.append(RectangleLight((0, 3, 0), (1, 0, 0), (0, 0, 1)))
    material = Material(kd=1e300, color=1e300, blend=True, alpha_cutoff=0.5)
    lossy = mesh(material=material, scalars={"height": np.array([1.0, np.nan, 2.0, 3.0])})
    environment, camera = clshade.Environment(np.ones((2, 4, 3))), replace(CAMERA, principal=(0.25, 0.5))
    back, (message,) = written(tmp_path, lossy, lights=lights, environment=environment, camera=camera)
    losses = message.split("a.glb: not in the file as in the scene: ")[1].split(", ")
    assert losses == [
        "the environment (none)",
        "alpha tests of materials that blend",
        "colors beyond 0 to 1 (clamped)",
        "NaN in scalars height (kept",
        "though glTF forbids it)",
        "the camera's principal point (the middle of the image)",
        "negative light (none)",
        "radii of lights (points)",
        "rectangle lights (spots of 90 degrees)",
    ]
    assert content(tmp_path / "a.glb")["cameras"][0]["extras"]["clshade"]["principal"] == [0.25, 0.5]
    assert np.isnan(back.meshes[0].scalars["height"]).tolist() == [False, True, False, False]
    assert back.meshes[0].material.color.tolist() == [1, 1, 1]
    assert back.lights[-1].outer_cone == 90.0


FAR = np.diag([1e200, 1e200, 1e200, 1.0])[None]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"path": ".glb"}, r"path: expected a name ending in \.glb, found "),
        ({"path": "none/a.glb"}, "there is no folder"),
        ({"most": 1000}, "scene: expected a file of at most 1000 bytes"),
        ({"meshes": mesh(verts=np.float64(CORNERS) * 1e200, instances=FAR)}, "meshes: expected placements within 1e"),
        ({"camera": replace(CAMERA, plane=(1e-200, 1e200))}, "camera: expected angles of view above 0 and below 180"),
        ({"lights": PointLight((0, 0, 1e305))}, "lights: expected placements within 1e"),
        ({"lights": DirectionalLight((0, 0, 1)), "light_scale": 1e-320}, "scene: expected materials and lights within"),
    ],
)
def test_refused(folder, monkeypatch, changes, message):
    fields = {"meshes": mesh(), "camera": CAMERA, **changes}
    monkeypatch.setattr("clshade.scene.formats.gltf_writer.MAX_BYTES", fields.pop("most", 1 << 32))
    path = fields.pop("path", "a.glb")
    with pytest.raises((InputError, OutputError), match=message) as caught:
        Scene(**fields).to_glb(path)
    assert isinstance(caught.value, OutputError) or str(caught.value).startswith("to_glb: ")
    assert not list(folder.iterdir())


def test_trimesh_reads_halves_of_surrogate_pairs(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    named = mesh(name='a\ud800"\n\0', instance_names=["\udfff"], scalars={"t\ud800": np.arange(4.0)})
    back, _ = written(tmp_path, named, name="\ud801é")
    loaded = trimesh.load(tmp_path / "a.glb")
    assert list(loaded.geometry) == [back.meshes[0].name] == ['a\\ud800"\n\0']
    assert back.meshes[0].instance_names == ("\\udfff",)
    assert list(back.meshes[0].scalars) == ["t\\ud800"]
