"""glTF and GLB: the meaning of files, tested with handwritten ones."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from mesh_writers import CORNERS, INDICES, Gltf, png, textured, triangle
from scene_files import refusal, scene_and_warnings

from clshade.images.decode import srgb_to_linear
from clshade.scene.contents import first_instances, format_contents, object_names, object_numbers, scene_contents
from clshade.scene.formats.gltf_materials import phong
from clshade.scene.formats.load import load
from clshade.scene.framing import AMBIENT
from clshade.scene.geometry import camera_axes
from clshade.view.sheet import scene_facts

RNG = np.random.default_rng(5)


@pytest.mark.parametrize("form", ["glb", "data", "beside"])
def test_containers(tmp_path, form):
    document = triangle()
    if form == "glb":
        path = document.glb(tmp_path / "a.glb")
    else:
        path = document.gltf(tmp_path / "a.gltf", None if form == "data" else "my data.bin")
    scene, messages = scene_and_warnings(path)
    (mesh,) = scene.meshes
    assert messages == []
    assert (scene.preset, scene.name, scene.ignored) == ("pbr", "a", ())
    assert (mesh.verts.dtype, mesh.verts.tolist()) == (np.float32, CORNERS.tolist())
    assert mesh.faces.tolist() == [[0, 1, 2]]
    assert mesh.normals[mesh.normal_faces].tolist() == [[[0, 0, 1]] * 3]  # flat, as glTF requires
    assert (mesh.material.sides, mesh.material.two_sided) == ("front", False)


def test_escaped_names_and_a_glb_by_content(tmp_path):
    path = triangle().gltf(tmp_path / "a.gltf", "my data.bin")
    text = (tmp_path / "a.gltf").read_text().replace("my data.bin", "my%20data.bin")
    (tmp_path / "a.gltf").write_text(text)
    assert load(path).face_count == 1
    triangle().glb(tmp_path / "b.gltf")
    assert load(tmp_path / "b.gltf").face_count == 1


def test_nodes_place_meshes_in_their_order(tmp_path):
    document = triangle()
    half = math.sqrt(0.5)
    document.add("nodes", {"children": [1, 2], "translation": [1, 2, 3]})
    document.add("nodes", {"mesh": 0, "rotation": [0, 0, half, half], "scale": [2, 3, 4]})
    matrix = np.array([[1, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]])
    document.add("nodes", {"mesh": 0, "matrix": matrix.T.reshape(-1).tolist(), "children": [3]})
    document.add("nodes", {"mesh": 0})
    document.add("nodes", {"mesh": 0, "translation": [99, 0, 0]})  # in no scene
    document.add("scenes", {"nodes": []})
    document.add("scenes", {"nodes": [0]})
    document.json["scene"] = 1
    (mesh,) = load(document.glb(tmp_path / "a.glb")).meshes
    turned = np.array([[0, -3, 0, 1], [2, 0, 0, 2], [0, 0, 4, 3], [0, 0, 0, 1]])
    moved = np.array([[1, 0, 0, 6], [0, 1, 0, 8], [0, 0, 1, 10], [0, 0, 0, 1]])
    np.testing.assert_allclose(mesh.instances, [turned, moved, moved], atol=1e-12)


def test_nodes_name_instances(tmp_path):
    """Each placement has its node's name, for each primitive of its mesh; inspect lists them by number."""
    document = Gltf()
    document.mesh({"POSITION": CORNERS}, INDICES)
    document.mesh({"POSITION": CORNERS}, INDICES)
    document.json["meshes"] = [{"primitives": [entry["primitives"][0] for entry in document.json["meshes"]]}]
    for name in ("left", "", "right"):
        document.add("nodes", {"mesh": 0, "translation": [1, 0, 0], **({"name": name} if name else {})})
    scene = load(document.glb(tmp_path / "a.glb"))
    assert [mesh.instance_names for mesh in scene.meshes] == [("left", "", "right")] * 2
    lines = [line.split() for line in format_contents(scene_contents(scene)).splitlines()]
    assert [line for line in lines if line and line[0] in ("left", "right")] == [
        *(["left", f"{number}", "1", "3", "3", "1", "1"] for number in (1, 2)),
        ["left", "1", "1"],
        ["right", "3", "1"],
    ]
    assert load(triangle().glb(tmp_path / "b.glb")).meshes[0].instance_names == ()


def test_an_object_is_a_mesh_of_the_file(tmp_path):
    """Its primitives are parts of it, its placements instances; two meshes of one name are two objects."""
    document = Gltf()
    for _ in range(3):
        document.mesh({"POSITION": CORNERS}, INDICES)
    primitives = [entry["primitives"][0] for entry in document.json["meshes"]]
    document.json["meshes"] = [{"name": "car", "primitives": primitives[:2]}, {"name": "car", "primitives": primitives}]
    for mesh in (0, 1, 1):
        document.add("nodes", {"mesh": mesh})
    path, copy = document.glb(tmp_path / "a.glb"), tmp_path / "b.glb"
    load(path).to_glb(copy)
    for scene in (load(path), load(copy)):
        assert object_numbers(scene) == [1, 1, 2, 2, 2]
        assert object_names(scene) == ["car", "car"]
        assert first_instances(scene) == [1, 1, 2, 2, 2]
        assert (
            scene_facts(scene)["counts"] | {"objects": 2, "meshes": 5, "instances": 3} == scene_facts(scene)["counts"]
        )
    named = triangle().glb(tmp_path / "c.glb")
    assert object_names(load(named)) == ["c"]


def test_mirrored_placements_are_placements_of_one_mesh(tmp_path):
    document = Gltf()
    document.mesh({"POSITION": CORNERS, "NORMAL": np.array([[0, 0, 1]] * 3, np.float32)}, INDICES)
    for x in (1, -1):
        document.add("nodes", {"mesh": 0, "scale": [x, 1, 1]})
    (mesh,) = load(document.glb(tmp_path / "a.glb")).meshes
    assert mesh.instances[:, 0, 0].tolist() == [1, -1]
    assert mesh.faces.tolist() == [[0, 1, 2]]
    assert mesh.normals.tolist() == [[0, 0, 1]] * 3


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.uint32])
def test_strips_fans_and_types_of_indices(tmp_path, kind):
    for mode, expected in ((5, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]), (6, [[1, 2, 0], [2, 3, 0], [3, 4, 0]])):
        document = Gltf()
        verts = RNG.random((5, 3), np.float32)
        document.mesh({"POSITION": verts}, np.arange(5, dtype=kind), mode=mode)
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
    sparse = {
        "count": 1,
        "indices": {"bufferView": document.view(struct.pack("<H", 2)), "componentType": 5123},
        "values": {"bufferView": document.view(struct.pack("<3f", 7, 8, 9))},
    }
    empty = document.add("accessors", {"componentType": 5126, "type": "VEC3", "count": 3, "sparse": sparse})
    document.mesh({"POSITION": empty}, INDICES)
    meshes = load(document.glb(tmp_path / "a.glb")).meshes
    assert meshes[0].verts.tolist() == CORNERS.tolist()
    np.testing.assert_allclose(meshes[0].colors, [[1, 0, 0.2], [0, 1, 0], [0, 0, 0]], atol=1e-7)
    assert meshes[1].verts.tolist() == [[0, 0, 0], [9, 0, 0], [0, 9, 0]]
    assert meshes[1].normals.tolist() == [[0, 0, 1]] * 3
    assert meshes[2].verts.tolist() == [[0, 0, 0], [0, 0, 0], [7, 8, 9]]


def test_a_share_of_a_large_array_is_cut_out(tmp_path):
    document = Gltf()
    verts = RNG.random((100, 3), np.float32)
    document.mesh({"POSITION": verts, "COLOR_0": verts}, np.array([50, 3, 90], np.uint16))
    (mesh,) = load(document.glb(tmp_path / "a.glb")).meshes
    assert np.array_equal(mesh.verts[mesh.faces[0]], verts[[50, 3, 90]])
    assert np.array_equal(mesh.colors, mesh.verts)
    assert len(mesh.verts) == 3


def test_materials_and_textures(tmp_path):
    document = Gltf()
    pixels = RNG.integers(0, 256, (2, 4, 4), dtype=np.uint8)
    pixels[0, 0, 3] = 7
    reflection = {"baseColorFactor": [0.5, 1, 0.25, 1], "metallicFactor": 0.0, "roughnessFactor": 0.5}
    textured(document, pixels, {"name": "m", "doubleSided": True, "pbrMetallicRoughness": reflection})
    document.json["textures"][0]["sampler"] = document.add("samplers", {"wrapS": 33071, "wrapT": 33648})
    scene, messages = scene_and_warnings(document.glb(tmp_path / "a.glb"))
    (mesh,) = scene.meshes
    material = mesh.material
    assert messages == []
    assert mesh.uvs.tolist() == [[0, 0], [1, 0], [0, 1]]  # v = 0 is row 0 in glTF and here
    assert (material.sides, material.two_sided, material.alpha_cutoff, material.name) == ("both", True, None, "m")
    assert material.color.tolist() == [0.5, 1, 0.25]
    assert material.texture.wrap == ("clamp", "mirror")
    linear = srgb_to_linear(pixels[..., :3] / 255)
    np.testing.assert_allclose(material.texture.image, linear, atol=1e-6)
    kd, ks, n = phong(0.0, 0.5, float((linear * [0.5, 1, 0.25]).mean()))
    assert (material.ka.tolist(), material.kd.tolist(), material.n) == ([1.0] * 3, [kd] * 3, n)
    np.testing.assert_allclose(material.ks, ks, rtol=1e-6)


def test_phong_of_metallic_roughness():
    assert phong(0.0, 0.4, 1.0)[2] == pytest.approx((1 / 0.4**4 - 1) / 2)
    assert phong(0.0, 0.5, 1.0)[2] == phong(1.0, 1.0, 1.0)[2] == 12.0
    assert phong(0.0, 0.0, 1.0)[2] == pytest.approx(5000.0, rel=1e-3)
    assert phong(1.0, 0.1, 0.5)[:2] == pytest.approx((0.4, 1.0 / 0.5))  # the peak, without the color, is clamped to 1
    exponents = [phong(0.0, roughness, 0.5)[2] for roughness in np.linspace(0, 1, 20)]
    assert exponents == sorted(exponents, reverse=True)


@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("base", [0.1, 0.5, 1.0])
def test_a_wide_lobe_has_no_edge_and_keeps_peak_and_energy(metallic, base):
    """At N.L = 0 a highlight jumps to ks * base * (-L.V)^n; where the light stands 135 degrees from the eye that was up to
    0.7. Of a lobe with exponent m, (1 + ks) is the peak and 1/2 + ks/(m+2) the energy of light at normal incidence."""
    for roughness in np.linspace(0.0, 1.0, 41):
        kd, ks, n = phong(metallic, roughness, base)
        assert ks * base * math.cos(math.radians(45.0)) ** n <= 1.0 / 64.0 + 1e-12
        assert 0.0 <= kd <= 1.0
        wide = (1.0 / max(roughness, 0.1) ** 4 - 1.0) / 2.0
        peak = min((0.04 + metallic * (base - 0.04)) * (wide + 2.0) / 2.0, 1.0) / base
        diffuse = kd - (1.0 - 0.6 * metallic)
        if wide >= n:
            assert (n, ks, diffuse) == (pytest.approx(wide), pytest.approx(peak), 0.0)
        elif kd < 1.0:
            assert diffuse + ks == pytest.approx(peak)
            assert diffuse / 2.0 + ks / (n + 2.0) == pytest.approx(peak / (wide + 2.0))
    assert phong(metallic, 1.0, base)[1] == 0.0


def test_what_a_material_leaves_out(tmp_path):
    """Defaults: white, metallic, rough, visible from the front; factors beyond 1 are clamped to 1."""
    document = Gltf()
    for reflection in ({}, {"metallicFactor": 7.0, "roughnessFactor": 1.5}):
        index = document.add("materials", {"pbrMetallicRoughness": reflection} if reflection else {})
        document.mesh({"POSITION": CORNERS}, INDICES, material=index)
    with pytest.warns(UserWarning, match="Factor: expected numbers from 0 to 1, found .*: clamped") as warned:
        scene = load(document.glb(tmp_path / "a.glb"))
    assert len(warned) == 2
    for mesh in scene.meshes:
        material = mesh.material
        kd, ks, n = phong(1.0, 1.0, 1.0)
        assert (material.color.tolist(), material.ka.tolist(), material.kd.tolist()) == ([1.0] * 3, [1.0] * 3, [kd] * 3)
        assert (material.ks.tolist(), material.n) == ([ks] * 3, n)
        assert (material.sides, material.two_sided, material.texture, material.alpha_cutoff) == (
            "front",
            False,
            None,
            None,
        )


def test_alpha_masks(tmp_path):
    pixels = np.full((2, 2, 4), 255, np.uint8)
    pixels[0, 0, 3] = 0
    document = Gltf()
    factor = {"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.5]}}
    textured(document, pixels, {"alphaMode": "MASK", "alphaCutoff": 0.25, **factor})
    material = load(document.glb(tmp_path / "a.glb")).meshes[0].material
    assert (material.alpha_cutoff, material.opacity, material.blend) == (0.25, 0.5, False)
    assert material.texture.image[:, :, 3].tolist() == [[0, 1], [1, 1]]
    document.json["materials"][0].update(alphaMode="BLEND")
    scene, messages = scene_and_warnings(document.glb(tmp_path / "a.glb"))
    assert (scene.ignored, messages) == ((), [])
    material = scene.meshes[0].material
    assert (material.alpha_cutoff, material.opacity, material.blend) == (None, 0.5, True)
    document.json["materials"][0].update(alphaMode="OPAQUE")
    assert not load(document.glb(tmp_path / "a.glb")).meshes[0].has_alpha
    document.json["materials"][0].update(alphaMode="SHINE")
    refusal(document.glb(tmp_path / "a.glb"), "materials[0].alphaMode: expected one of OPAQUE, MASK, BLEND")


def test_texture_transforms_and_coordinate_sets(tmp_path):
    document = Gltf()
    moved = {"offset": [0.25, 0.5], "rotation": math.pi / 2, "scale": [2, 3]}
    info = {"texCoord": 1, "extensions": {"KHR_texture_transform": {**moved, "texCoord": 0}}}
    textured(document, np.zeros((1, 1, 3), np.uint8), {}, **info)
    document.json["extensionsRequired"] = ["KHR_texture_transform"]
    uvs = load(document.glb(tmp_path / "a.glb")).meshes[0].uvs
    # The specification's translation * rotation * scale of (0, 0), (1, 0) and (0, 1).
    np.testing.assert_allclose(uvs, [[0.25, 0.5], [0.25, -1.5], [3.25, 0.5]], atol=1e-12)
    info["extensions"].clear()
    document.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"].pop("extensions")
    scene, _ = scene_and_warnings(document.glb(tmp_path / "a.glb"))
    assert scene.meshes[0].uvs is None  # there is no set 1


def test_images_beside_and_in_place_of_the_files(tmp_path):
    document = Gltf()
    textured(document, np.zeros((1, 1, 3), np.uint8), {})
    image = document.json["images"][0]
    image.clear()
    image["uri"] = "my%20image.png"
    document.glb(tmp_path / "a.glb")
    (tmp_path / "my image.png").write_bytes(png(np.full((3, 2, 3), 255, np.uint8)))
    assert load(tmp_path / "a.glb").meshes[0].material.texture.image.shape == (3, 2, 3)
    replacement = load(tmp_path / "a.glb", texture=np.ones((6, 7, 3))).meshes[0].material.texture
    assert replacement.image.shape == (6, 7, 3)
    refusal(triangle().glb(tmp_path / "b.glb"), "b.glb: TEXCOORD_0: ", texture=np.ones((1, 1, 3)))


def test_what_is_not_rendered_is_told_once(tmp_path):
    document = triangle(material=0)
    document.mesh({"POSITION": CORNERS}, INDICES, mode=1)
    document.add("materials", {})
    document.json["extensionsUsed"] = ["KHR_materials_clearcoat", "KHR_texture_transform"]
    scene, messages = scene_and_warnings(document.glb(tmp_path / "a.glb"))
    assert set(scene.ignored) == {*("KHR_materials_clearcoat", "points and lines")}
    assert len(messages) == 1
    assert "a.glb: not rendered: " in messages[0]
    document.json["extensionsRequired"] = ["KHR_animation_pointer"]
    refusal(document.glb(tmp_path / "a.glb"), "a.glb: extensionsRequired: ", "'KHR_animation_pointer'")


def test_unlit_shows_the_color(tmp_path):
    document = triangle(material=0)
    document.add("materials", {"extensions": {"KHR_materials_unlit": {}}})
    scene = load(document.glb(tmp_path / "a.glb"))
    material = scene.meshes[0].material
    assert (material.ka * scene.ambient).tolist() == [1.0] * 3
    assert scene.ambient[0] == AMBIENT
    assert not material.kd.any()
    assert not material.ks.any()


def test_unlit_without_texture_coordinates_stays_unlit(tmp_path):
    document = Gltf()
    textured(document, np.zeros((1, 1, 3), np.uint8), {"extensions": {"KHR_materials_unlit": {}}}, texCoord=1)
    with pytest.warns(UserWarning, match="textures of meshes without their texture coordinates"):
        material = load(document.glb(tmp_path / "a.glb")).meshes[0].material
    assert material.texture is None
    assert not material.diffuse.any()
    assert not material.microfacets.dielectric_f0.any()


def test_cameras(tmp_path):
    document = triangle()
    document.add("nodes", {"mesh": 0})
    document.add("nodes", {"camera": 0, "translation": [1, 2, 9]})
    lens = {"yfov": 1.0, "aspectRatio": 2.0, "znear": 0.1}
    document.add("cameras", {"type": "perspective", "perspective": lens})
    camera = load(document.glb(tmp_path / "a.glb")).camera
    assert (camera.eye.tolist(), camera.up.tolist()) == ([1, 2, 9], [0, 1, 0])
    assert (camera.lookat - camera.eye)[:2].tolist() == [0, 0]
    assert camera.lookat[2] < 9
    height = 2 * math.tan(0.5)
    assert (camera.plane, camera.resolution) == (pytest.approx((height, 2 * height)), (1200, 600))
    narrow = load(tmp_path / "a.glb", resolution=(300, 300)).camera  # the whole view stays visible
    assert narrow.plane == pytest.approx((2 * height, 2 * height))
    document.json["cameras"] = [{"type": "orthographic", "orthographic": {"xmag": 2, "ymag": 1}}]
    camera = load(document.glb(tmp_path / "a.glb")).camera
    assert (camera.orthographic, camera.plane) == (True, (2.0, 4.0))
    lens["yfov"] = 4
    document.json["cameras"] = [{"type": "perspective", "perspective": lens}]
    refusal(document.glb(tmp_path / "a.glb"), "cameras[0].perspective.yfov: ")


def test_lenses_at_their_limits(tmp_path):
    document = triangle()
    document.add("nodes", {"mesh": 0})
    node = document.json["nodes"][document.add("nodes", {"camera": 0, "translation": [1, 2, 9]})]

    def written(kind: str, **lens: float) -> str:
        document.json["cameras"] = [{"type": kind, kind: lens}]
        return document.glb(tmp_path / "a.glb")

    for lens, place in (({"yfov": 0.0}, "yfov"), ({"yfov": math.pi}, "yfov"), ({"aspectRatio": 1.0}, "yfov")):
        refusal(written("perspective", **lens), f"cameras[0].perspective.{place}: ")
    refusal(written("orthographic", xmag=1, ymag=0), "cameras[0].orthographic.ymag: expected a number other than 0")
    document.json["cameras"] = [{"type": "perspective"}]
    refusal(document.glb(tmp_path / "a.glb"), "cameras[0].type: ")
    mirrored = load(written("orthographic", xmag=-2, ymag=-1)).camera
    assert (mirrored.plane, mirrored.resolution) == ((2.0, 4.0), (1200, 600))
    for lens, resolution in (({}, (800, 600)), ({"aspectRatio": 1e-9}, (1, 600)), ({"aspectRatio": 1e9}, (16384, 600))):
        camera = load(written("perspective", yfov=math.pi / 2, **lens)).camera
        assert camera.resolution == resolution
        columns, rows = resolution
        assert camera.plane[1] / camera.plane[0] == pytest.approx(columns / rows)
        assert camera.plane[0] == pytest.approx(2.0 * max(1.0, lens.get("aspectRatio", 0.0) * rows / columns))
    node["translation"] = [1, 2, -9]  # with the triangle behind it
    camera = load(written("perspective", yfov=1.0)).camera
    assert (camera.lookat - camera.eye)[:2].tolist() == [0, 0]
    assert -1.0 < (camera.lookat - camera.eye)[2] < -0.1


def test_options(tmp_path):
    path = triangle().glb(tmp_path / "a.glb")
    material = load(path, two_sided=True).meshes[0].material
    assert (material.two_sided, material.sides) == (True, "both")
    assert load(path, up="z").camera.up.tolist() == [0, 0, 1]
    assert load(path, crease=40).meshes[0].normals.tolist() == [[0, 0, 1]] * 3
    refusal(path, "load: up: ", up="w")
    refusal(path, "load: crease: ", crease=181)
    refusal(path, "load: crease: ", crease=-1)


def test_points_and_lines_are_named(tmp_path):
    for mode in range(4):
        document = triangle()
        document.mesh({"POSITION": CORNERS}, INDICES, mode=mode)
        scene, messages = scene_and_warnings(document.glb(tmp_path / "a.glb"))
        assert (len(scene.meshes), scene.ignored) == (1, ("points and lines",)), mode
        assert len(messages) == 1, mode


@pytest.mark.parametrize(
    ("alpha", "mode", "counts"), [(51, "MASK", True), (51, "BLEND", True), (255, "BLEND", False), (51, "OPAQUE", False)]
)
def test_the_alpha_of_vertex_colors_is_read_where_it_counts(tmp_path, alpha, mode, counts):
    document = Gltf()
    document.add("materials", {"alphaMode": mode})
    colors = np.array([[255, 255, 255, 255]] * 2 + [[255, 255, 255, alpha]], np.uint8)
    color = document.accessor(colors, normalized=True)
    document.mesh({"POSITION": CORNERS, "COLOR_0": color}, INDICES, material=0)
    scene = load(document.glb(tmp_path / "a.glb"))
    assert scene.ignored == ()
    assert (scene.meshes[0].alphas is not None) == counts
    if counts:
        np.testing.assert_allclose(scene.meshes[0].alphas, [1, 1, 0.2], atol=1e-6)


def test_indices_are_whole_numbers_whatever_normalized_says(tmp_path):
    document = Gltf()
    document.mesh({"POSITION": CORNERS}, np.arange(3, dtype=np.uint8))
    document.json["accessors"][-1]["normalized"] = True
    (mesh,) = load(document.glb(tmp_path / "a.glb")).meshes
    assert mesh.faces.tolist() == [[0, 1, 2]]


def test_chunks_of_a_glb(tmp_path):
    """A third one belongs to an extension, and is ignored; a file that ends before its first is refused by its
    length."""
    path = tmp_path / "a.glb"
    triangle().glb(path)
    data = path.read_bytes()
    unknown = data + struct.pack("<I4s", 1 << 30, b"MORE")
    path.write_bytes(unknown[:8] + struct.pack("<I", len(unknown)) + unknown[12:])
    assert load(path).face_count == 1
    for length in (19, len(data) + 1):
        path.write_bytes(data[:8] + struct.pack("<I", length) + data[12:])
        refusal(path, "GLB length: ", str(length))
    path.write_bytes(data[:8] + struct.pack("<I", 20) + data[12:])
    assert "GLB length" not in refusal(path, "GLB chunk 0")


@pytest.mark.parametrize("roll", [0.0, 0.1, math.pi])
def test_what_is_up_for_a_camera_that_looks_down(tmp_path, roll):
    """From above and the side, by angles that float32 rounds: +y, with the image of the camera's own axes; not if it is
    rolled."""
    document = triangle()
    document.add("nodes", {"mesh": 0})
    document.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0}})
    around, down, twist = (
        np.append(np.sin(angle / 2) * np.array(axis), np.cos(angle / 2))
        for angle, axis in ((0.7, (0, 1, 0)), (-1.2, (1, 0, 0)), (roll, (0, 0, 1)))
    )

    def product(a, b):
        return np.append(a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3]), a[3] * b[3] - a[:3] @ b[:3])

    rotation = np.float32(product(product(around, down), twist)).tolist()
    document.add("nodes", {"camera": 0, "translation": [1, 5, 2], "rotation": rotation})
    camera = load(document.glb(tmp_path / "a.glb")).camera
    level = roll == 0.0
    assert (camera.up.tolist() == [0, 1, 0]) is level
    right, up, forward = camera_axes(camera)
    assert forward == pytest.approx([-math.cos(1.2) * math.sin(0.7), -math.sin(1.2), -math.cos(1.2) * math.cos(0.7)])
    assert right[1] == pytest.approx(math.cos(1.2) * math.sin(roll), abs=1e-6)
    assert up[1] == pytest.approx(math.cos(1.2) * math.cos(roll), abs=1e-6)


def test_of_several_cameras_the_first_is_taken(tmp_path):
    document = triangle()
    for fov in (0.5, 1.0):
        document.add("cameras", {"type": "perspective", "perspective": {"yfov": fov, "znear": 0.1}})
    document.add("nodes", {"mesh": 0})
    for k in range(2):
        document.add("nodes", {"camera": k, "translation": [0.3, 0.3, 5.0 + k]})
    scene, messages = scene_and_warnings(document.glb(tmp_path / "a.glb"))
    assert scene.camera.eye.tolist() == [0.3, 0.3, 5.0]
    assert "cameras" in " ".join(messages)


def test_a_sampler_that_says_nothing_repeats(tmp_path):
    document = Gltf()
    textured(document, RNG.integers(0, 256, (2, 2, 3), dtype=np.uint8), {})
    document.json["textures"][0]["sampler"] = document.add("samplers", {})
    (mesh,) = load(document.glb(tmp_path / "a.glb")).meshes
    assert mesh.material.texture.wrap == ("repeat", "repeat")
    assert mesh.material.texture.filter == "linear"


@pytest.mark.parametrize(("key", "expected"), [("magFilter", "nearest"), ("minFilter", "linear")])
def test_the_filter_is_that_of_magnification(tmp_path, key, expected):
    document = Gltf()
    textured(document, RNG.integers(0, 256, (2, 2, 3), dtype=np.uint8), {})
    document.json["textures"][0]["sampler"] = document.add("samplers", {key: 9728})
    scene = load(document.glb(tmp_path / "a.glb"))
    assert scene.meshes[0].material.texture.filter == expected
    assert scene.ignored == ()
