"""The variants of `report`: which exist, which change the image of a scene, which the device can draw."""

from __future__ import annotations

from dataclasses import replace

import pytest
from studies import SMALL, sphere

from clshade.errors import InputError
from clshade.measure.report import variants
from clshade.measure.report.variants import BASE, base_settings, named, possible, variants_for
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Settings


def test_every_variant_is_another_way_and_names_are_unique():
    names = [variant.name for variant in variants.VARIANTS]
    assert len(set(names)) == len(names)
    changes = [tuple(sorted(variant.changes.items())) for variant in variants.VARIANTS]
    assert len(set(changes)) == len(changes)
    assert {*variants.COMMON, *variants.LIMITED} <= set(names)


def test_variants_are_those_that_change_something(device):
    plain, textured = (
        {variant.name for variant in variants_for(builtin(name, resolution=SMALL), Settings(), device)}
        for name in ("quads", "course")
    )
    assert {BASE, "gouraud", "painter", "affine", "course"} <= plain
    assert textured - plain == {"vertex-texture", "trilinear", "trilinear-4", "trilinear-16"}


def test_what_settings_or_device_refuse_is_left_out(device):
    assert possible({"shader": "gouraud"}, Settings(), device)
    assert not possible({"texture_filter": "trilinear"}, Settings(texture_at="vertex"), device)
    assert not possible({"shader": "flat"}, Settings(), device)
    assert not possible({"precision": "float64"}, Settings(), replace(device, has_fp64=False))


def test_the_base_keeps_what_approximates_nothing():
    assert base_settings(builtin("course")).ambient == "plain"
    assert base_settings(builtin("quads")) == Settings()
    assert base_settings(replace(builtin("quads"), preset="pbr")) == Settings(shader="pbr", shadows=True)
    assert base_settings(builtin("box_room", soft=True)) == Settings(shadows=True)
    assert base_settings(builtin("box_room", soft=True), shadows=False) == Settings()


def test_unknown_variants(device):
    candidates = variants_for(sphere(), Settings(), device)
    assert named(candidates, []) == candidates
    assert [variant.name for variant in named(candidates, ["gouraud", BASE, "gouraud"])] == ["gouraud", BASE]
    with pytest.raises(
        InputError, match=r"--only: expected names of standard, .*gouraud.* found .guro.: did you mean .gouraud.\?$"
    ):
        named(candidates, ["guro"])
    with pytest.raises(InputError, match=r"--only: .*found 'vertex-texture', which changes nothing of this scene"):
        named(candidates, ["vertex-texture"])
    with pytest.raises(InputError, match=r"--only: .*found 'gouraud', which is another picture than shader pbr's"):
        named(variants_for(sphere(), Settings(shader="pbr"), device), ["gouraud"])
    without = variants_for(sphere(), Settings(), replace(device, has_fp64=False))
    with pytest.raises(InputError, match=r"--only: .*found 'float64', which needs a device with float64"):
        named(without, ["float64"])
