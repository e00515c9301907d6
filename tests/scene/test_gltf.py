"""glTF and GLB: the meaning of handwritten files. Containers, nodes, meshes, cameras and lights."""

import math

import numpy as np
import pytest
from mesh_writers import CORNERS, INDICES, Gltf, triangle
from scene_files import scene_and_warnings

from clshade.scene.contents import first_instances, format_contents, object_names, object_numbers, scene_contents
from clshade.scene.formats.load import load
from clshade.scene.geometry import camera_axes
from clshade.scene.lights import DirectionalLight, PointLight, SpotLight
from clshade.view.sheet import scene_facts

RNG = np.random.default_rng(5)
HALF = math.sqrt(0.5)


@pytest.mark.parametrize("form", ["data", "beside", "a glb by its content"])
def test_containers(tmp_path, form):
    document = triangle()
    if "glb" in form:
        path = document.glb(tmp_path / "a.gltf")
    else:
        path = document.gltf(tmp_path / "a.gltf", None if form == "data" else "my data.bin")
        text = (tmp_path / "a.gltf").read_text().replace("my data.bin", "my%20data.bin")
        (tmp_path / "a.gltf").write_text(text)
    scene, messages = scene_and_warnings(path)
    (mesh,) = scene.meshes
    assert messages == []
    assert (scene.preset, scene.name, scene.ignored) == ("pbr", "a", ())
    assert (mesh.verts.dtype, mesh.verts.tolist()) == (np.float32, CORNERS.tolist())
    assert mesh.faces.tolist() == [[0, 1, 2]]
    assert mesh.normals[mesh.normal_faces].tolist() == [[[0, 0, 1]] * 3]  # flat, as glTF requires
    assert (mesh.material.sides, mesh.material.two_sided) == ("front", False)
    assert load(path, crease=40).meshes[0].normals.tolist() == [[0, 0, 1]] * 3


# Nodes


def test_nodes_place_meshes_in_their_order(tmp_path):
    document = triangle()
    document.add("nodes", {"children": [1, 2], "translation": [1, 2, 3]})
    document.add("nodes", {"mesh": 0, "rotation": [0, 0, HALF, HALF], "scale": [2, 3, 4]})
    matrix = np.array([[-1, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]])  # it mirrors
    document.add("nodes", {"mesh": 0, "matrix": matrix.T.reshape(-1).tolist(), "children": [3]})
    document.add("nodes", {"mesh": 0})
    document.add("nodes", {"mesh": 0, "translation": [99, 0, 0]})  # in no scene
    document.add("scenes", {"nodes": []})
    document.add("scenes", {"nodes": [0]})
    document.json["scene"] = 1
    (mesh,) = load(document.glb(tmp_path / "a.glb")).meshes
    turned = np.array([[0, -3, 0, 1], [2, 0, 0, 2], [0, 0, 4, 3], [0, 0, 0, 1]])
    moved = np.array([[-1, 0, 0, 6], [0, 1, 0, 8], [0, 0, 1, 10], [0, 0, 0, 1]])
    np.testing.assert_allclose(mesh.instances, [turned, moved, moved], atol=1e-12)
    assert (mesh.faces.tolist(), mesh.instance_names) == ([[0, 1, 2]], ())


def test_an_object_is_a_mesh_of_the_file(tmp_path):
    """Its primitives are parts of it, its placements instances with the nodes' names; two meshes of one name are two
    objects."""
    document = Gltf()
    for _ in range(3):
        document.mesh({"POSITION": CORNERS}, INDICES)
    primitives = [entry["primitives"][0] for entry in document.json["meshes"]]
    document.json["meshes"] = [{"name": "car", "primitives": primitives[:2]}, {"name": "car", "primitives": primitives}]
    for mesh, name in ((0, "left"), (0, ""), (1, "right"), (1, "far")):
        document.add("nodes", {"mesh": mesh, "translation": [1, 0, 0], **({"name": name} if name else {})})
    path, copy = document.glb(tmp_path / "a.glb"), tmp_path / "b.glb"
    load(path).to_glb(copy)
    for scene in (load(path), load(copy)):
        assert object_numbers(scene) == [1, 1, 2, 2, 2]
        assert object_names(scene) == ["car", "car"]
        assert first_instances(scene) == [1, 1, 3, 3, 3]
        counts = scene_facts(scene)["counts"]
        assert (counts["objects"], counts["meshes"], counts["instances"]) == (2, 5, 4)
    scene = load(path)
    assert [mesh.instance_names for mesh in scene.meshes] == [("left", "")] * 2 + [("right", "far")] * 3
    lines = [line.split() for line in format_contents(scene_contents(scene)).splitlines()]
    assert [line for line in lines if line and line[0] in ("left", "right", "far")][-3:] == [
        *(["left", "1", "1"], ["right", "3", "2"], ["far", "4", "2"])
    ]
    assert object_names(load(triangle().glb(tmp_path / "c.glb"))) == ["c"]


# Meshes


def test_strips_fans_and_types_of_indices(tmp_path):
    """Indices are whole numbers, whatever `normalized` says."""
    strip, fan = [[0, 1, 2], [1, 3, 2], [2, 3, 4]], [[1, 2, 0], [2, 3, 0], [3, 4, 0]]
    for kind, mode, expected in ((np.uint8, 5, strip), (np.uint32, 6, fan)):
        document = Gltf()
        verts = RNG.random((5, 3), np.float32)
        document.mesh({"POSITION": verts}, np.arange(5, dtype=kind), mode=mode)
        document.json["accessors"][-1]["normalized"] = True
        document.mesh({"POSITION": verts}, mode=mode)
        meshes = load(document.glb(tmp_path / "a.glb")).meshes
        assert [mesh.faces.tolist() for mesh in meshes] == [expected, expected]


def test_interleaved_quantized_and_sparse_accessors(tmp_path):
    document = Gltf()
    rows = np.zeros(3, [("p", "<f4", 3), ("c", "u1", 4)])
    rows["p"], rows["c"] = CORNERS, [[255, 0, 51, 255], [0, 255, 0, 255], [0, 0, 0, 255]]
    view = document.view(rows.tobytes())
    document.json["bufferViews"][view]["byteStride"] = 16
    entry = {"bufferView": view, "count": 3}
    position = document.add("accessors", {**entry, "componentType": 5126, "type": "VEC3"})
    fields = {"byteOffset": 12, "componentType": 5121, "type": "VEC4", "normalized": True}
    color = document.add("accessors", {**entry, **fields})
    document.mesh({"POSITION": position, "COLOR_0": color}, INDICES)
    short = document.accessor(np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0]], np.int16))
    normal = document.accessor(np.array([[0, 0, 127]] * 3, np.int8), normalized=True)
    document.mesh({"POSITION": short, "NORMAL": normal}, INDICES)
    document.mesh({"POSITION": document.sparse(np.uint16([2]), np.float32([[7, 8, 9]]), 3)}, INDICES)
    verts = RNG.random((100, 3), np.float32)
    document.mesh({"POSITION": verts, "COLOR_0": verts}, np.array([50, 3, 90], np.uint16))
    path = document.glb(tmp_path / "a.glb")
    one, second, third, share = load(path).meshes
    assert one.verts.tolist() == CORNERS.tolist()
    np.testing.assert_allclose(one.colors, [[1, 0, 0.2], [0, 1, 0], [0, 0, 0]], atol=1e-7)
    np.testing.assert_allclose(load(path, vertex_colors="srgb").meshes[0].colors[0], [1, 0, 0.0331048], atol=1e-6)
    assert second.verts.tolist() == [[0, 0, 0], [9, 0, 0], [0, 9, 0]]
    assert second.normals.tolist() == [[0, 0, 1]] * 3
    assert third.verts.tolist() == [[0, 0, 0], [0, 0, 0], [7, 8, 9]]
    assert np.array_equal(share.verts[share.faces[0]], verts[[50, 3, 90]])
    assert (len(share.verts), share.colors.tolist()) == (3, share.verts.tolist())


def test_normals_that_are_none_are_computed(tmp_path):
    document = Gltf()
    document.mesh({"POSITION": CORNERS, "NORMAL": np.float32([[0, 0, 0], [0, np.nan, 0], [0, 0, 0]])}, INDICES)
    scene, (message,) = scene_and_warnings(document.glb(tmp_path / "a.glb"))
    assert scene.meshes[0].normals.tolist() == [[0, 0, 1]] * 3
    remark = "normals that are 0 or not finite were computed from the faces: 3"
    assert message.endswith(f"primitives[0].attributes.NORMAL: {remark}")


def test_what_is_not_rendered_is_told_once(tmp_path):
    for mode in (0, 3):
        document = triangle()
        document.mesh({"POSITION": CORNERS}, INDICES, mode=mode)
        document.json["extensionsUsed"] = ["KHR_materials_clearcoat", "KHR_texture_transform"]
        scene, messages = scene_and_warnings(document.glb(tmp_path / "a.glb"))
        assert set(scene.ignored) == {"KHR_materials_clearcoat", "points and lines"}, mode
        assert [message.partition("a.glb: not rendered: ")[1] for message in messages] == ["a.glb: not rendered: "]


# Cameras


def seen_by(folder, *cameras, **node) -> str:
    """Write a triangle and a node with each camera, (kind, its fields)."""
    document = triangle({"mesh": 0})
    for kind, lens in cameras:
        camera = document.add("cameras", {"type": kind, kind: lens})
        document.add("nodes", {"camera": camera, **({"translation": [1, 2, 9]} | node)})
    return document.glb(folder / "a.glb")


def test_cameras(tmp_path):
    lens = {"yfov": 1.0, "aspectRatio": 2.0, "znear": 0.1}
    scene, messages = scene_and_warnings(seen_by(tmp_path, ("perspective", lens), ("perspective", {"yfov": 2.0})))
    assert "cameras" in " ".join(messages)  # of several the first is taken
    camera = scene.camera
    assert (camera.eye.tolist(), camera.up.tolist()) == ([1, 2, 9], [0, 1, 0])
    assert (camera.lookat - camera.eye)[:2].tolist() == [0, 0]
    assert camera.lookat[2] < 9
    height = 2 * math.tan(0.5)
    assert (camera.plane, camera.resolution) == (pytest.approx((height, 2 * height)), (1200, 600))
    narrow = load(tmp_path / "a.glb", resolution=(300, 300)).camera  # the whole view stays visible
    assert narrow.plane == pytest.approx((2 * height, 2 * height))
    camera = load(seen_by(tmp_path, ("perspective", lens), translation=[1, 2, -9])).camera
    assert (camera.lookat - camera.eye)[:2].tolist() == [0, 0]  # with the triangle behind it
    assert -1.0 < (camera.lookat - camera.eye)[2] < -0.1


def test_lenses_at_their_limits(tmp_path):
    mirrored = load(seen_by(tmp_path, ("orthographic", {"xmag": -2, "ymag": -1}))).camera
    assert (mirrored.orthographic, mirrored.plane, mirrored.resolution) == (True, (2.0, 4.0), (1200, 600))
    for lens, resolution in (({}, (800, 600)), ({"aspectRatio": 1e-9}, (1, 600)), ({"aspectRatio": 1e9}, (16384, 600))):
        camera = load(seen_by(tmp_path, ("perspective", {"yfov": math.pi / 2, **lens}))).camera
        assert camera.resolution == resolution
        columns, rows = resolution
        assert camera.plane[1] / camera.plane[0] == pytest.approx(columns / rows)
        assert camera.plane[0] == pytest.approx(2.0 * max(1.0, lens.get("aspectRatio", 0.0) * rows / columns))


@pytest.mark.parametrize("roll", [0.0, 0.1])
def test_what_is_up_for_a_camera_that_looks_down(tmp_path, roll):
    """From above and the side, by angles that float32 rounds: +y, with the image of the camera's own axes; not if it is
    rolled."""
    around, down, twist = (
        np.append(np.sin(angle / 2) * np.array(axis), np.cos(angle / 2))
        for angle, axis in ((0.7, (0, 1, 0)), (-1.2, (1, 0, 0)), (roll, (0, 0, 1)))
    )

    def product(a, b):
        return np.append(a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3]), a[3] * b[3] - a[:3] @ b[:3])

    rotation = np.float32(product(product(around, down), twist)).tolist()
    camera = load(seen_by(tmp_path, ("perspective", {"yfov": 1.0}), rotation=rotation)).camera
    assert (camera.up.tolist() == [0, 1, 0]) is (roll == 0.0)
    right, up, forward = camera_axes(camera)
    assert forward == pytest.approx([-math.cos(1.2) * math.sin(0.7), -math.sin(1.2), -math.cos(1.2) * math.cos(0.7)])
    assert right[1] == pytest.approx(math.cos(1.2) * math.sin(roll), abs=1e-6)
    assert up[1] == pytest.approx(math.cos(1.2) * math.cos(roll), abs=1e-6)


# Lights


def lit_by(tmp_path, *lights):
    """Write the triangle (0, 0, 0) (1, 0, 0) (0, 1, 0), whose center is (0.5, 0.5, 0), lit by these (light, node)."""
    document = triangle({"mesh": 0})
    for index, (_, node) in enumerate(lights):
        document.add("nodes", {**node, "extensions": {"KHR_lights_punctual": {"light": index}}})
    document.json["extensions"] = {"KHR_lights_punctual": {"lights": [light for light, _ in lights]}}
    return document.glb(tmp_path / "a.glb")


def test_kinds_places_and_ratios_of_lights(tmp_path):
    cones = {"innerConeAngle": 0.1, "outerConeAngle": math.pi / 2}
    path = lit_by(
        tmp_path,
        # The range is not scaled.
        ({"type": "point", "intensity": 100, "range": 30}, {"translation": [0.5, 0.5, 10], "scale": [9, 9, 9]}),
        ({"type": "point", "intensity": 100, "color": [1, 0.5, 0]}, {"translation": [0.5, 20.5, 0]}),
        ({"type": "directional", "intensity": 0.5}, {"rotation": [-HALF, 0, 0, HALF]}),  # -z turned to -y
        ({"type": "spot", "intensity": 4, "spot": cones}, {"translation": [0, 0, 5], "scale": [1, 1, 2]}),
        ({"type": "spot"}, {"translation": [0, 0, 50]}),
    )
    scene, messages = scene_and_warnings(path)
    assert (messages, scene.ignored) == ([], ())
    lamp, warm, sun, spot, default = scene.lights
    assert isinstance(lamp, PointLight)
    assert scene.light_scale == pytest.approx(1.0)  # 100 candela at 10: 1 lux already
    assert (lamp.position.tolist(), lamp.attenuation, lamp.range) == ([0.5, 0.5, 10], "inverse-square", 30)
    np.testing.assert_allclose(lamp.intensity, [100] * 3)
    np.testing.assert_allclose(warm.intensity, [100, 50, 0])
    assert warm.range is None
    assert isinstance(sun, DirectionalLight)
    np.testing.assert_allclose(sun.direction, [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(sun.intensity, [0.5] * 3)
    assert isinstance(spot, SpotLight)
    assert (spot.position.tolist(), (spot.direction / 2).tolist()) == ([0, 0, 5], [0, 0, -1])
    assert (spot.inner_cone, spot.outer_cone) == (pytest.approx(math.degrees(0.1)), 90.0)
    assert (default.inner_cone, default.outer_cone) == (0.0, pytest.approx(45.0))


def test_one_factor_exposes_all_lights(tmp_path):
    """Whatever the sun's lux, it arrives with 1, and the lamp keeps its ratio; a lamp among the meshes is measured at their
    radius, sqrt(0.5)."""
    lux = 1e5
    sun, lamp = ({"type": kind, "intensity": lux} for kind in ("directional", "point"))
    scene = load(lit_by(tmp_path, (sun, {}), (lamp, {"translation": [0.5, 0.5, 2]})))
    assert scene.light_scale == pytest.approx(1.0 / lux)
    assert [light.intensity.tolist() for light in scene.lights] == [[pytest.approx(1.0)] * 3] * 2
    (light,) = load(lit_by(tmp_path, (lamp, {"translation": [0.5, 0.5, 0.01]}))).lights
    assert light.intensity[0] == pytest.approx(0.5)


def test_lights_that_do_not_shine_leave_the_default_ones(tmp_path):
    scene = load(lit_by(tmp_path, ({"type": "directional", "intensity": 0.0}, {})))
    assert (len(scene.lights), scene.light_scale) == (3, 1.0)
    with pytest.warns(UserWarning, match="lights of an unknown type"):
        assert load(lit_by(tmp_path, ({"type": "area"}, {}))).ignored == ("lights of an unknown type",)
