"""All maps of shader pbr: lookups that they share, closed forms, and maps that change nothing."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import oracle_asserts
import pytest
from devices import rendered
from mapped_scenes import mapped, mapped_scene, noise, sheet

import clshade
from clshade import Camera, Material, Mesh, MetallicRoughness, PointLight, Scene, Texture
from clshade.pipeline.frame import same_bits
from clshade.pipeline.shading_tables import texture_tables
from clshade.scene.material import MAPS


def with_maps(mesh: Mesh, **changes: Any) -> Mesh:
    return replace(mesh, material=replace(mesh.material, pbr=mapped(**changes)))


def test_maps_that_are_looked_up_alike_agree_with_the_oracle(device):
    """Of the size and the wrap modes of the normal map, which share its lookup; and of its size alone."""
    shared = {
        name: Texture(noise(8, 11, seed))
        for seed, name in enumerate(("metallic_roughness_texture", "emission_texture"))
    }
    scene = mapped_scene(with_maps(sheet(), **shared, occlusion_texture=Texture(noise(8, 11, 7), wrap="clamp")))
    oracle_asserts.assert_all(rendered(scene, device=device, shader="pbr", layers=("Z", "id", "N")))
    facets = scene.meshes[0].material.pbr
    names = list(MAPS)[:4]
    textures = [getattr(facets, name) for name in names]
    alike = texture_tables(textures)[0]["alike"]
    assert {name: names[k] for name, k in zip(names, alike, strict=True)} == {
        "metallic_roughness_texture": "metallic_roughness_texture",
        "normal_texture": "metallic_roughness_texture",
        "occlusion_texture": "occlusion_texture",
        "emission_texture": "metallic_roughness_texture",
    }
    alternatives = [
        {"wrap": "mirror"},
        {"filter": "nearest"},
        {"coordinates": 1},
        {"image": noise(11, 8)},
        {"lookup": "course"},
    ]
    alone = [replace(facets.normal_texture, **changes) for changes in alternatives]
    assert texture_tables([facets.normal_texture, *alone])[0]["alike"].tolist() == list(range(6))


# Closed forms: a square from -1 to 1 that faces the eye, 6 pixels for each of 4 x 4 texels

CORNERS = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
QUAD = [[0, 1, 2], [0, 2, 3]]
UPRIGHT = np.array([[0.0, 1], [1, 1], [1, 0], [0, 0]])
FRONT = Camera((0, 0, 3), (0, 0, 0), (0, 1, 0), 3.0, (2.0, 2.0), (24, 24))
DARK: dict[str, Any] = {"lights": (), "background": None}
LIT: dict[str, Any] = {"lights": PointLight((1, 2, 4)), "ambient": 0.0, "background": None}


def square(pbr: MetallicRoughness, *, lighting: dict[str, Any], **fields: Any) -> Scene:
    mesh = Mesh(CORNERS, QUAD, **{"uvs": UPRIGHT, "material": Material(ka=1.0, pbr=pbr), **fields})
    return Scene(mesh, FRONT, **lighting)


def texels(image: np.ndarray) -> np.ndarray:
    return image[3::6, 3::6]


def nearest(image: np.ndarray, **fields: Any) -> Texture:
    return Texture(image, filter="nearest", **fields)


TURNS = [(mirrored, quarter) for mirrored in (False, True) for quarter in range(4)]


@pytest.mark.long
@pytest.mark.parametrize(("mirrored", "quarter"), TURNS)
@pytest.mark.parametrize("placement", [(1, 1, 1), (-1, 1, 1), (1, -1, 1), (-1, -1, 1), (1, 1, -1)], ids=str)
def test_the_normals_shown_are_those_that_were_baked(device, mirrored, quarter, placement):
    """As the Khronos tests NormalTangentTest, NormalTangentMirrorTest and NegativeScaleTest: however the image lies on the
    square and however that is placed, a texel says in which directions of the image the normal leans."""
    lean = np.random.default_rng(5).uniform(-0.5, 0.5, (4, 4, 2))
    image = 0.5 + 0.5 * np.dstack([lean, np.sqrt(1.0 - (lean**2).sum(axis=2))])
    uvs = np.roll(np.abs(UPRIGHT - [1, 0]) if mirrored else UPRIGHT, quarter, axis=0)
    matrix = np.diag([*placement, 1.0])
    pbr = MetallicRoughness(normal_texture=nearest(image))
    scene = square(pbr, lighting=LIT, uvs=uvs, instances=[matrix], normals=[[0, 0, 1.0]] * 4)
    scene = replace(scene, camera=replace(FRONT, eye=(0, 0, 3.0 * placement[2])))
    normals = texels(clshade.render(scene, shader="pbr", layers="N", device=device)["N"])
    x, y = np.meshgrid(np.arange(4) * 0.5 - 0.75, 0.75 - np.arange(4) * 0.5)
    at = np.stack([x * placement[2], y], axis=-1) * placement[:2]  # of the pixels, in the square's own space
    to_uv = np.linalg.lstsq(np.column_stack([CORNERS[:, :2], np.ones(4)]), uvs, rcond=None)[0]
    u, v = np.moveaxis(at @ to_uv[:2] + to_uv[2], -1, 0)
    texel = lean[np.int32(v * 4), np.int32(u * 4)]
    right, down = 0.5 * np.linalg.inv(to_uv[:2])  # where they point in space
    flat = texel[..., :1] * right - texel[..., 1:] * down
    expected = np.dstack([flat, np.sqrt(1.0 - (texel**2).sum(axis=-1))]) * placement
    np.testing.assert_allclose(normals, expected, atol=1e-5)


@pytest.mark.long
def test_occlusion_dims_the_ambient_light_alone(device):
    image = noise(4, 4)
    plain, occluded = (
        MetallicRoughness(0.0, 0.5, occlusion_texture=nearest(image), occlusion_strength=strength)
        for strength in (0.0, 0.75)
    )
    frames = [
        clshade.render(square(pbr, lighting={**DARK, "ambient": (0.5, 1.0, 0.25)}), shader="pbr", device=device).rgb
        for pbr in (plain, occluded)
    ]
    share = 1.0 - 0.75 * (1.0 - image[..., :1])
    np.testing.assert_allclose(texels(frames[1]), texels(frames[0]) * share, rtol=1e-6)
    bare = replace(occluded, occlusion_texture=None)
    lit = [clshade.render(square(pbr, lighting=LIT), shader="pbr", device=device) for pbr in (bare, occluded)]
    assert same_bits(*lit)
    assert "OCCLUSION_MAP" in lit[1].stats["left_out"]


@pytest.mark.long
def test_emission_is_added_and_looked_up_at_its_own_coordinates(device):
    """As the Khronos tests EmissiveStrengthTest and MultiUVTest: the second set turns the image upside down."""
    image = noise(4, 4)
    glowing = MetallicRoughness(0.0, 0.5, emission=(4.0, 0.5, 1.0), emission_texture=nearest(image, coordinates=1))
    scene = square(glowing, lighting=LIT, more_uvs=[UPRIGHT * [1, -1] + [0, 1]])
    plain = square(MetallicRoughness(0.0, 0.5), lighting=LIT)
    both, alone = (clshade.render(variant, shader="pbr", device=device).rgb for variant in (scene, plain))
    np.testing.assert_allclose(texels(both - alone), image[::-1] * [4.0, 0.5, 1.0], atol=1e-6)


@pytest.mark.long
def test_a_flat_map_changes_no_bit(device):
    """Its texels are exactly (1/2, 1/2, 1)."""
    plain: dict[str, Any] = dict.fromkeys(("occlusion_texture", "emission_texture", "metallic_roughness_texture"))
    flat = with_maps(sheet(), **plain, normal_texture=Texture(np.full((2, 2, 3), [0.5, 0.5, 1.0])))
    bare = with_maps(sheet(), **plain, normal_texture=None)
    assert same_bits(*(clshade.render(mapped_scene(mesh), shader="pbr", device=device) for mesh in (flat, bare)))


@pytest.mark.long
def test_other_shaders_show_no_maps(device):
    with_all, without = (mapped_scene(sheet(material=Material(pbr=pbr))) for pbr in (mapped(), None))
    assert same_bits(*(clshade.render(scene, device=device) for scene in (with_all, without)))
