"""Normal maps, occlusion and emission of glTF files: where they are found, and what is missing or beyond its range."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mesh_writers import CORNERS, INDICES, Gltf, png
from scene_files import refusal

from clshade import Mesh, load
from clshade.images.decode import srgb_to_linear

PIXELS = np.random.default_rng(3).integers(0, 256, (3, 2, 3), dtype=np.uint8)
UVS = np.array([[0, 0], [1, 0], [0, 1]], np.float32)
OTHER = np.array([[0.5, 0], [1, 0.25], [0, 1]], np.float32)
NORMALS = np.array([[0, 0, 1.0]] * 3, np.float32)
TANGENTS = np.array([[1, 0, 0, -1.0]] * 3, np.float32)
QUARTER = {"extensions": {"KHR_texture_transform": {"rotation": math.pi / 2}}}


def written(tmp_path, attributes: dict[str, Any] | None = None, **material: Any) -> str:
    """Write a triangle with two sets of texture coordinates, these attributes besides or instead (None: without)."""
    document = Gltf()
    document.add("images", {"bufferView": document.view(png(PIXELS)), "mimeType": "image/png"})
    document.add("textures", {"source": 0})
    document.add("materials", material)
    arrays = {"POSITION": CORNERS, "NORMAL": NORMALS, "TEXCOORD_0": UVS, "TEXCOORD_1": OTHER, **(attributes or {})}
    document.mesh({name: array for name, array in arrays.items() if array is not None}, INDICES, material=0)
    return document.glb(tmp_path / "a.glb")


def extension(name: str, **fields: Any) -> dict[str, Any]:
    return {"extensions": {f"KHR_materials_{name}": fields}}


def with_maps(tmp_path, attributes: dict[str, Any] | None = None, **material: Any) -> Mesh:
    scene = load(written(tmp_path, attributes, **material))
    assert scene.ignored == ()
    return scene.meshes[0]


def test_all_maps_are_read(tmp_path):
    mesh = with_maps(
        tmp_path,
        {"TANGENT": TANGENTS},
        normalTexture={"index": 0, "scale": 0.5},
        occlusionTexture={"index": 0, "strength": 0.25, "texCoord": 1},
        emissiveTexture={"index": 0, **QUARTER},
        emissiveFactor=[0.5, 1, 0],
        extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 8}},
        pbrMetallicRoughness={"baseColorTexture": {"index": 0}},
    )
    pbr = mesh.material.pbr
    np.testing.assert_allclose(pbr.normal_texture.image, PIXELS / 255, atol=1e-7)
    np.testing.assert_allclose(pbr.occlusion_texture.image, PIXELS / 255, atol=1e-7)
    np.testing.assert_allclose(pbr.emission_texture.image, srgb_to_linear(PIXELS / 255), atol=1e-6)
    assert (pbr.normal_scale, pbr.occlusion_strength) == (0.5, 0.25)
    assert pbr.emission.tolist() == [4, 8, 0]
    textures = mesh.material.texture, pbr.normal_texture, pbr.occlusion_texture, pbr.emission_texture
    assert [texture.coordinates for texture in textures] == [0, 0, 1, 2]
    assert np.array_equal(mesh.uvs, UVS)
    assert np.array_equal(mesh.more_uvs[0], OTHER)
    np.testing.assert_allclose(mesh.more_uvs[1], UVS[:, ::-1] * [1, -1], atol=1e-12)
    assert np.array_equal(mesh.tangents, TANGENTS)


@pytest.mark.parametrize("alone", ["normal", "occlusion", "emissive"])
def test_a_map_without_a_color_texture_has_the_first_coordinates(tmp_path, alone):
    mesh = with_maps(tmp_path, emissiveFactor=[1, 1, 1], **{f"{alone}Texture": {"index": 0, "texCoord": 1}})
    assert np.array_equal(mesh.uvs, OTHER)
    assert mesh.more_uvs == ()


def test_a_map_without_its_coordinates_is_left_out(tmp_path):
    maps = {"normalTexture": {"index": 0, "texCoord": 1}, "occlusionTexture": {"index": 0}}
    words = "not rendered: textures of meshes without their texture coordinates"
    with pytest.warns(UserWarning, match=words):
        pbr = load(written(tmp_path, {"TEXCOORD_1": None}, **maps)).meshes[0].material.pbr
    assert pbr.normal_texture is None
    assert pbr.occlusion_texture is not None
    with pytest.warns(UserWarning, match=words):
        (both_missing,) = load(written(tmp_path, {"TEXCOORD_0": None, "TEXCOORD_1": None}, **maps)).meshes
    assert both_missing.uvs is None
    assert both_missing.material.pbr.occlusion_texture is None


@pytest.mark.parametrize("attributes", [{"NORMAL": None, "TANGENT": TANGENTS}, {}], ids=["without normals", "none"])
def test_tangents_without_normals_do_not_count(tmp_path, attributes):
    """glTF 2.0, section 3.7.2.1: flat normals, tangents ignored."""
    assert with_maps(tmp_path, attributes, normalTexture={"index": 0}).tangents is None


@pytest.mark.parametrize(
    ("material", "field", "clamped"),
    [
        ({"normalTexture": {"index": 0, "scale": -1e30}}, "normalTexture.scale", {"normal_scale": -1e6}),
        ({"occlusionTexture": {"index": 0, "strength": 7}}, "occlusionTexture.strength", {"occlusion_strength": 1.0}),
        ({"emissiveFactor": [-1, 2, 0]}, "emissiveFactor", {"emission": [0, 2, 0]}),
        (
            {"emissiveFactor": [1, 0, 1], **extension("emissive_strength", emissiveStrength=1e300)},
            "KHR_materials_emissive_strength.emissiveStrength",
            {"emission": float(np.finfo(np.float32).max) * np.array([1, 0, 1])},
        ),
        (extension("ior", ior=0.5), "KHR_materials_ior.ior", {"ior": 1.0}),
        (extension("specular", specularFactor=2), "KHR_materials_specular.specularFactor", {"specular": 1.0}),
        (
            extension("specular", specularColorFactor=[-1, 0, 9]),
            "KHR_materials_specular.specularColorFactor",
            {"specular_color": [0, 0, 9]},
        ),
    ],
)
def test_factors_beyond_their_range_are_clamped_with_a_warning(tmp_path, material, field, clamped):
    with pytest.warns(UserWarning, match=f"{field}: expected numbers from .*, found .*: clamped") as warned:
        pbr = load(written(tmp_path, **material)).meshes[0].material.pbr
    assert len(warned) == 1
    for name, value in clamped.items():
        assert np.array_equal(getattr(pbr, name), value)


def test_an_emission_of_0_needs_no_texture(tmp_path):
    assert with_maps(tmp_path, emissiveTexture={"index": 0}).material.pbr.emission_texture is None


BAD = np.array([[1, 0, 0, 1], [np.nan, 0, 0, 1], [1, 0, 0, 1]], np.float32)


@pytest.mark.parametrize(
    ("attributes", "material", "words"),
    [
        ({"TANGENT": BAD}, {"normalTexture": {"index": 0}}, "TANGENT: expected finite numbers"),
        ({"TANGENT": BAD[:, :3]}, {"normalTexture": {"index": 0}}, "TANGENT: expected 3 of 4 numbers"),
        ({}, {"normalTexture": {"index": 0, "scale": "x"}}, "normalTexture.scale"),
        ({}, {"normalTexture": {"index": 4}}, "normalTexture.index: expected an index of the 1 textures"),
        ({}, {"occlusionTexture": {}}, "occlusionTexture.index: expected an index"),
        ({}, {"occlusionTexture": {"index": 0, "strength": -1}}, "occlusionTexture.strength"),
        ({}, {"emissiveFactor": [1, 1]}, "emissiveFactor"),
        ({}, {"extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": -1}}}, "emissiveStrength"),
    ],
)
def test_broken_maps_are_refused(tmp_path, attributes, material, words):
    refusal(written(tmp_path, attributes, **material), words)
