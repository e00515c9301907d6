"""Descriptions of scenes: what is the same, and what differs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clshade.images.decode import CodedImage, srgb_to_linear
from clshade.pipeline.shading_tables import texture_tables
from clshade.scene.builtin import scenes
from clshade.scene.description import digest_of, part_digests
from clshade.scene.environment import Environment
from clshade.scene.model import Mesh, Settings, with_materials
from clshade.scene.texture import Texture


def test_descriptions_tell_values_apart():
    values = [0, 0.0, -0.0, False, None, "", "0", (), (0,), ((0,),), {"0": 0}, np.zeros(1), np.zeros((1, 1))]
    values += [np.zeros(2, np.float32), np.zeros(1, np.int64), ("a", "b"), ("ab",), Settings()]
    assert len({digest_of(value) for value in values}) == len(values)
    big = np.arange(6.0).reshape(2, 3)
    assert digest_of(big.astype(">f8")) == digest_of(np.asfortranarray(big)) == digest_of(big)
    with pytest.raises(TypeError, match="expected plain values"):
        digest_of(object())


def test_digests_are_those_of_files_that_were_drawn_before():
    """Another digest would make every EXR that has one fail."""
    assert digest_of({"a": (1, 2.5, None, "ä"), "b": np.arange(3.0)}).startswith("b76439d05b493628")
    assert digest_of(Mesh(np.eye(3), [[0, 1, 2]], name="one")).startswith("fa81de5edd2ac327")


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("srgb", [False, True])
def test_a_texture_in_codes_is_that_of_its_numbers(channels, srgb):
    codes = np.random.default_rng(2).integers(0, 256, (37, 5, channels), np.uint8)
    linear = (np.arange(256) / 255).astype(np.float32)
    colors = srgb_to_linear(linear).astype(np.float32) if srgb else linear
    numbers = np.concatenate([colors[codes[..., :3]], linear[codes[..., 3:]]], axis=2)
    coded, plain = Texture(CodedImage(codes, colors, linear)), Texture(numbers)
    assert digest_of(coded) == digest_of(plain)
    assert "image" not in vars(coded)
    assert (coded.mean() == plain.mean()).all()
    assert (plain.mean() == numbers[..., :3].mean((0, 1), np.float64)).all()
    texels = [texture_tables([texture])[1] for texture in (coded, plain)]
    assert (texels[0] == texels[1]).all()
    assert (texels[0][:, :channels] == numbers.reshape(-1, channels)).all()
    assert (coded.image == numbers).all()
    assert not coded.image.flags.writeable


def test_only_the_part_that_changed_differs():
    texels = np.full((2, 2, 3), 0.5, np.float32)
    before = with_materials(scenes.teapot(3, (80, 60)), lambda material: replace(material, texture=Texture(texels)))
    changed_texels = texels.copy()
    changed_texels[1, 0, 2] = np.nextafter(changed_texels[1, 0, 2], np.float32(1.0))
    for part, changed in (
        ("camera", replace(before, camera=before.camera.with_resolution((40, 30)))),
        ("lights", replace(before, lights=())),
        ("meshes", replace(before, meshes=tuple(replace(mesh, name="other") for mesh in before.meshes))),
        ("materials", with_materials(before, lambda material: replace(material, kd=0.25))),
        ("materials", with_materials(before, lambda material: replace(material, texture=Texture(changed_texels)))),
        ("environment", replace(before, environment=Environment(np.ones((4, 8, 3))))),
        ("others", replace(before, ambient=0.5)),
    ):
        a, b = part_digests(before), part_digests(changed)
        assert [name for name in a if a[name] != b[name]] == [part]
    assert part_digests(replace(before, preset="pbr", ignored=("a remark",))) == part_digests(before)


def test_meshes_in_memory_that_others_may_write_are_read_again():
    verts = np.eye(3)
    mesh = Mesh(verts, [[0, 1, 2]])
    before = digest_of(mesh)
    verts[0, 0] = 2.0
    assert (digest_of(mesh) == before) == bool(mesh.verts[0, 0] == 1.0)
