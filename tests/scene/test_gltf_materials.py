"""Materials of glTF files: colors, textures and maps, where they are found, and what is missing or beyond its range."""

import math
from typing import Any

import numpy as np
import pytest
from mesh_writers import CORNERS, INDICES, UP, UVS, Gltf, png, triangle
from scene_files import refusal, scene_and_warnings

from clshade import Material, Mesh
from clshade.images.decode import srgb_to_linear
from clshade.scene.formats.gltf_materials import phong
from clshade.scene.formats.load import load
from clshade.scene.framing import AMBIENT

PIXELS = np.random.default_rng(3).integers(0, 256, (3, 2, 4), dtype=np.uint8)
LINEAR = srgb_to_linear(PIXELS[..., :3] / 255)
OTHER = np.array([[0.5, 0], [1, 0.25], [0, 1]], np.float32)
TANGENTS = np.array([[1, 0, 0, -1.0]] * 3, np.float32)
COLORED = {"baseColorTexture": {"index": 0}}


def written(tmp_path, attributes: dict[str, Any] | None = None, *, pixels=PIXELS, sampler=None, **material: Any) -> str:
    """Write a triangle with two sets of texture coordinates, these attributes besides or instead (None: without)."""
    document = Gltf()
    document.texture(pixels)
    if sampler is not None:
        document.json["textures"][0]["sampler"] = document.add("samplers", sampler)
    document.add("materials", material)
    arrays = {"POSITION": CORNERS, "NORMAL": UP, "TEXCOORD_0": UVS, "TEXCOORD_1": OTHER, **(attributes or {})}
    document.mesh({name: array for name, array in arrays.items() if array is not None}, INDICES, material=0)
    return document.glb(tmp_path / "a.glb")


def loaded(tmp_path, attributes: dict[str, Any] | None = None, **material: Any) -> Mesh:
    scene, messages = scene_and_warnings(written(tmp_path, attributes, **material))
    assert (scene.ignored, messages) == ((), [])
    return scene.meshes[0]


def extension(name: str, **fields: Any) -> dict[str, Any]:
    return {"extensions": {f"KHR_{name}": fields}}


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


@pytest.mark.parametrize(("metallic", "roughness"), [(0.0, 0.5), (None, None)])
def test_a_material_and_what_it_leaves_out(tmp_path, metallic, roughness):
    """Defaults: white, metallic, rough, visible from the front, repeated."""
    reflection: dict[str, Any] = {"baseColorTexture": {"index": 0}}
    fields: dict[str, Any] = {"sampler": {"minFilter": 9728}, "name": "m"}
    if metallic is not None:
        reflection |= {"baseColorFactor": [0.5, 1, 0.25, 1], "metallicFactor": metallic, "roughnessFactor": roughness}
        fields |= {"doubleSided": True, "sampler": {"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}}
    mesh = loaded(tmp_path, pbrMetallicRoughness=reflection, **fields)
    material, color = mesh.material, [1.0] * 3 if metallic is None else [0.5, 1, 0.25]
    assert mesh.uvs.tolist() == UVS.tolist()  # v = 0 is row 0 in glTF and here
    assert (material.alpha_cutoff, material.name, mesh.has_alpha) == (None, "m", False)
    assert (material.sides, material.two_sided) == (("front", False) if metallic is None else ("both", True))
    assert material.color.tolist() == color
    assert material.texture.wrap == (("repeat", "repeat") if metallic is None else ("clamp", "mirror"))
    assert material.texture.filter == ("linear" if metallic is None else "nearest")
    np.testing.assert_allclose(material.texture.image, LINEAR, atol=1e-6)
    kd, ks, n = phong(*((1.0, 1.0) if metallic is None else (metallic, roughness)), float((LINEAR * color).mean()))
    assert (material.ka.tolist(), material.kd.tolist(), material.n) == ([1.0] * 3, [kd] * 3, n)
    np.testing.assert_allclose(material.ks, ks, rtol=1e-6)


@pytest.mark.parametrize(
    ("mode", "cutoff", "blend", "opacity"),
    [("MASK", 0.25, False, 0.5), ("BLEND", None, True, 0.5), ("OPAQUE",) + (None,) * 3],
)
def test_alpha_counts_where_its_mode_says(tmp_path, mode, cutoff, blend, opacity):
    """That of the color, of texels and of vertices."""
    colors = np.float32([[1, 1, 1, 1], [1, 1, 1, 1], [1, 1, 1, 0.25]])
    reflection = {**COLORED, "baseColorFactor": [1, 1, 1, 0.5]}
    fields = {"alphaMode": mode, "alphaCutoff": 0.25, "pbrMetallicRoughness": reflection}
    mesh = loaded(tmp_path, {"COLOR_0": colors}, **fields)
    assert mesh.has_alpha == (mode != "OPAQUE")
    assert mesh.material.texture.image.shape[2] == (3 if mode == "OPAQUE" else 4)
    if mode == "OPAQUE":
        assert mesh.alphas is None
        return
    assert (mesh.material.alpha_cutoff, mesh.material.opacity, mesh.material.blend) == (cutoff, opacity, blend)
    np.testing.assert_allclose(mesh.material.texture.image[..., 3], PIXELS[..., 3] / 255, atol=1e-7)
    assert mesh.alphas.tolist() == [1, 1, 0.25]
    assert loaded(tmp_path, {"COLOR_0": np.ones((3, 4), np.float32)}, alphaMode="BLEND").alphas is None


@pytest.mark.parametrize("cutoff", [None, 0.0, -1.0, 1e-9])
def test_a_cutoff_of_0_discards_nothing(cutoff):
    """No alpha is below it, but rounding may make an interpolated one -1e-9."""
    colors = np.ones((3, 4)) * [1.0, 1.0, 1.0, 0.0]
    mesh = Mesh(np.eye(3), [[0, 1, 2]], colors=colors, material=Material(alpha_cutoff=cutoff))
    assert mesh.tests_alpha is (cutoff == 1e-9)


def test_texture_transforms_and_coordinate_sets(tmp_path):
    moved = {"offset": [0.25, 0.5], "rotation": math.pi / 2, "scale": [2, 3], "texCoord": 0}
    info = {"index": 0, "texCoord": 1, **extension("texture_transform", **moved)}
    uvs = loaded(tmp_path, pbrMetallicRoughness={"baseColorTexture": info}).uvs
    # The specification's translation * rotation * scale of (0, 0), (1, 0) and (0, 1).
    np.testing.assert_allclose(uvs, [[0.25, 0.5], [0.25, -1.5], [3.25, 0.5]], atol=1e-12)


def test_images_beside_and_in_place_of_the_files(tmp_path):
    document = triangle(material=0)
    document.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = document.accessor(UVS)
    document.add("images", {"uri": "my%20image.png"})
    document.add("textures", {"source": 0})
    document.add("materials", {"pbrMetallicRoughness": COLORED})
    path = document.glb(tmp_path / "a.glb")
    (tmp_path / "my image.png").write_bytes(png(np.full((3, 2, 3), 255, np.uint8)))
    assert load(path).meshes[0].material.texture.image.shape == (3, 2, 3)
    assert load(path, texture=np.ones((6, 7, 3))).meshes[0].material.texture.image.shape == (6, 7, 3)
    plain = load(written(tmp_path), texture=np.ones((6, 7, 3))).meshes[0]  # which has no texture of its own
    assert (plain.material.texture.image.shape, plain.uvs.tolist()) == ((6, 7, 3), UVS.tolist())
    refusal(triangle().glb(tmp_path / "b.glb"), "b.glb: TEXCOORD_0: ", texture=np.ones((1, 1, 3)))


def test_unlit_shows_the_color(tmp_path):
    """Without the texture's coordinates, too."""
    unlit = {**extension("materials_unlit"), "pbrMetallicRoughness": COLORED}
    scene = load(written(tmp_path, **unlit))
    with pytest.warns(UserWarning, match="textures of meshes without their texture coordinates"):
        (plain,) = load(written(tmp_path, {"TEXCOORD_0": None}, **unlit)).meshes
    assert (plain.material.texture, scene.ambient[0]) == (None, AMBIENT)
    for material in (scene.meshes[0].material, plain.material):
        assert (material.ka * scene.ambient).tolist() == [1.0] * 3
        assert not material.diffuse.any()
        assert not material.ks.any()
        assert not material.microfacets.dielectric_f0.any()


# Maps


def test_all_maps_are_read(tmp_path):
    mesh = loaded(
        tmp_path,
        {"TANGENT": TANGENTS},
        normalTexture={"index": 0, "scale": 0.5},
        occlusionTexture={"index": 0, "strength": 0.25, "texCoord": 1},
        emissiveTexture={"index": 0, **extension("texture_transform", rotation=math.pi / 2)},
        emissiveFactor=[0.5, 1, 0],
        pbrMetallicRoughness=COLORED,
        **extension("materials_emissive_strength", emissiveStrength=8),
    )
    pbr = mesh.material.pbr
    np.testing.assert_allclose(pbr.normal_texture.image, PIXELS[..., :3] / 255, atol=1e-7)
    np.testing.assert_allclose(pbr.occlusion_texture.image, PIXELS[..., :3] / 255, atol=1e-7)
    np.testing.assert_allclose(pbr.emission_texture.image, LINEAR, atol=1e-6)
    assert (pbr.normal_scale, pbr.occlusion_strength) == (0.5, 0.25)
    assert pbr.emission.tolist() == [4, 8, 0]
    textures = mesh.material.texture, pbr.normal_texture, pbr.occlusion_texture, pbr.emission_texture
    assert [texture.coordinates for texture in textures] == [0, 0, 1, 2]
    assert np.array_equal(mesh.uvs, UVS)
    assert np.array_equal(mesh.more_uvs[0], OTHER)
    np.testing.assert_allclose(mesh.more_uvs[1], UVS[:, ::-1] * [1, -1], atol=1e-12)
    assert np.array_equal(mesh.tangents, TANGENTS)
    assert loaded(tmp_path, emissiveTexture={"index": 0}).material.pbr.emission_texture is None  # as the factor is 0


@pytest.mark.parametrize("alone", ["normal", "emissive"])
def test_a_map_without_a_color_texture_has_the_first_coordinates(tmp_path, alone):
    mesh = loaded(tmp_path, emissiveFactor=[1, 1, 1], **{f"{alone}Texture": {"index": 0, "texCoord": 1}})
    assert np.array_equal(mesh.uvs, OTHER)
    assert mesh.more_uvs == ()


def test_a_map_without_its_coordinates_is_left_out(tmp_path):
    maps = {"normalTexture": {"index": 0, "texCoord": 1}, "occlusionTexture": {"index": 0}}
    for missing, is_missing in ((("TEXCOORD_1",), False), (("TEXCOORD_0", "TEXCOORD_1"), True)):
        with pytest.warns(UserWarning, match="not rendered: textures of meshes without their texture coordinates"):
            (mesh,) = load(written(tmp_path, dict.fromkeys(missing), **maps)).meshes
        assert mesh.material.pbr.normal_texture is None
        assert (mesh.material.pbr.occlusion_texture is None, mesh.uvs is None) == (is_missing, is_missing)


def test_tangents_without_normals_do_not_count(tmp_path):
    """glTF 2.0, section 3.7.2.1: flat normals, tangents ignored."""
    attributes = {"NORMAL": None, "TANGENT": TANGENTS}
    assert loaded(tmp_path, attributes, normalTexture={"index": 0}).tangents is None


LARGEST = float(np.finfo(np.float32).max)


@pytest.mark.parametrize(
    ("material", "field", "name", "clamped"),
    [
        ({"pbrMetallicRoughness": {"metallicFactor": 7.0}}, "metallicFactor", "metallic", 1.0),
        ({"normalTexture": {"index": 0, "scale": -1e30}}, "normalTexture.scale", "normal_scale", -1e6),
        ({"occlusionTexture": {"index": 0, "strength": 7}}, "occlusionTexture.strength", "occlusion_strength", 1.0),
        ({"emissiveFactor": [-1, 2, 0]}, "emissiveFactor", "emission", [0, 2, 0]),
        (
            {"emissiveFactor": [1, 0, 1], **extension("materials_emissive_strength", emissiveStrength=1e300)},
            *("KHR_materials_emissive_strength.emissiveStrength", "emission", [LARGEST, 0, LARGEST]),
        ),
        (extension("materials_ior", ior=0.5), "KHR_materials_ior.ior", "ior", 1.0),
        (
            extension("materials_specular", specularColorFactor=[-1, 0, 9]),
            *("KHR_materials_specular.specularColorFactor", "specular_color", [0, 0, 9]),
        ),
    ],
)
def test_factors_beyond_their_range_are_clamped_with_a_warning(tmp_path, material, field, name, clamped):
    with pytest.warns(UserWarning, match=f"{field}: expected numbers from .*, found .*: clamped") as warned:
        pbr = load(written(tmp_path, **material)).meshes[0].material.pbr
    assert len(warned) == 1
    assert np.array_equal(getattr(pbr, name), clamped)
