"""What a scene needs, and why the rest is left out: each reason is the one that holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clshade import features
from clshade.camera import Camera
from clshade.scene import Material, Mesh, PointLight, Scene, Settings, Texture

CAMERA = Camera((0, 0, -3), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0))
LIGHT = PointLight((1, 2, -3))
TEXTURE = Texture(np.full((2, 2, 3), 0.5))
PLAIN = Mesh(np.eye(3), [[0, 1, 2]])
COLORED = replace(PLAIN, colors=np.full((3, 3), 0.5))
TEXTURED = replace(COLORED, uvs=np.zeros((3, 2)), material=Material(texture=TEXTURE))
COURSE = replace(TEXTURED, material=Material(texture=replace(TEXTURE, lookup="course")))
NOLIGHT, AT_VERTEX = "shader nolight", {"texture_at": "vertex"}


def material(**fields) -> Mesh:
    return replace(COLORED, material=Material(**fields))


def scene(*meshes: Mesh, lights=(LIGHT,), **fields) -> Scene:
    return Scene(meshes, CAMERA, lights, **fields)


CASES = [
    (scene(PLAIN), {}, "VERTEX_COLORS", "no vertex or material colors other than white"),
    (scene(COURSE), {}, "VERTEX_COLORS", "texels take the place of vertex colors"),
    (scene(COURSE), AT_VERTEX, "VERTEX_COLORS", "texture_at vertex: they are in the corners' colors"),
    (scene(TEXTURED), AT_VERTEX, "VERTEX_COLORS", "texture_at vertex: they are in the corners' colors"),
    (scene(TEXTURED), AT_VERTEX, "TEXTURED", "texture_at vertex: looked up at the corners"),
    (scene(PLAIN), AT_VERTEX, "VERTEX_COLORS", "no vertex or material colors other than white"),
    (scene(PLAIN), AT_VERTEX, "TEXTURED", "no texture"),
    (scene(material(texture=TEXTURE)), {}, "TEXTURED", "no texture coordinates"),
    (scene(COLORED), {"shader": "nolight"}, "AMBIENT", NOLIGHT),
    (scene(COLORED), {"shader": "nolight"}, "DIFFUSE", NOLIGHT),
    (scene(COLORED), {"shader": "nolight"}, "SPECULAR", NOLIGHT),
    (scene(COLORED), {"shader": "nolight"}, "POWER", "no specular term: shader nolight"),
    (scene(material(kd=0, ks=0)), {"shader": "nolight"}, "DIFFUSE", NOLIGHT),
    (scene(COLORED, lights=()), {}, "DIFFUSE", "no light shines"),
    (scene(COLORED, lights=(PointLight((1, 2, 3), (0, 0, 0)),)), {}, "SPECULAR", "no light shines"),
    (scene(COLORED, lights=()), {}, "POWER", "no specular term: no light shines"),
    (scene(COLORED, ambient=0), {}, "AMBIENT", "no ambient light"),
    (scene(material(ka=0)), {}, "AMBIENT", "ka is 0"),
    (scene(material(ka=(1, 0, 0)), ambient=(0, 1, 1)), {}, "AMBIENT", "ka*Ia is 0"),
    (scene(material(kd=0)), {}, "DIFFUSE", "kd is 0"),
    (scene(material(ks=0)), {}, "SPECULAR", "ks is 0"),
    (scene(material(ks=0)), {}, "POWER", "no specular term: ks is 0"),
    (scene(material(n=1)), {}, "POWER", "no exponent but 1"),
    (scene(COLORED), {}, "MATERIALS", "a single material"),
    (scene(COLORED), {}, "OWNERS", "no layer asked for"),
]


@pytest.mark.parametrize(("given", "fields", "name", "reason"), CASES)
def test_the_reason_is_the_one_that_holds(given, fields, name, reason):
    found = features.derive(given, Settings(**fields), double_positions=False)
    assert found[name] == 0
    assert dict(found.left_out)[name] == reason


@pytest.mark.parametrize(
    ("given", "fields", "used"),
    [
        (scene(COLORED), {}, {"AMBIENT", "DIFFUSE", "SPECULAR", "POWER", "VERTEX_COLORS"}),
        (scene(material(color=0.5)), {"shader": "nolight"}, {"VERTEX_COLORS"}),
        (scene(replace(PLAIN, material=Material(color=0.5))), {"shader": "nolight"}, {"VERTEX_COLORS"}),
        (scene(TEXTURED), {"shader": "nolight"}, {"VERTEX_COLORS", "TEXTURED"}),
        (scene(COURSE), {"shader": "nolight"}, {"TEXTURED"}),
        (scene(COURSE, COLORED), {"shader": "nolight"}, {"TEXTURED", "VERTEX_COLORS", "MATERIALS"}),
        (scene(TEXTURED), {"shader": "nolight", **AT_VERTEX, "layers": ("Z",)}, {"OWNERS"}),
        (scene(material(n=1, kd=0)), {}, {"AMBIENT", "SPECULAR", "VERTEX_COLORS"}),
    ],
)
def test_what_is_needed_is_used_and_all_else_has_a_reason(given, fields, used):
    found = features.derive(given, Settings(**fields), double_positions=False)
    assert set(found.used) & set(features.OPTIONAL) == used
    assert {name for name, _ in found.left_out} == set(features.OPTIONAL) - used
    assert all(reason for _, reason in found.left_out)


@pytest.mark.parametrize("mesh", [COLORED, TEXTURED])
def test_with_everything_on_only_what_the_corners_hold_is_left_out(mesh):
    settings = Settings(texture_at="vertex", shader="nolight")
    found = features.derive(scene(mesh), settings, double_positions=False, everything=True)
    held = {"VERTEX_COLORS", "TEXTURED"} if mesh is TEXTURED else set()
    assert {name for name, _ in found.left_out} == held
    assert all(reason.startswith("texture_at vertex") for _, reason in found.left_out)


@pytest.mark.parametrize(
    ("mesh", "texture_filter", "needed"),
    [
        (TEXTURED, "trilinear", 1),
        (TEXTURED, "bilinear", 0),
        (COURSE, "trilinear", 0),
        (PLAIN, "trilinear", 0),
        (material(texture=TEXTURE), "trilinear", 0),
        (replace(TEXTURED, material=Material(texture=Texture(np.ones((1, 1, 3))))), "trilinear", 0),
    ],
    ids=["textured", "bilinear", "course lookup", "no texture", "no coordinates", "one texel"],
)
def test_mipmaps_where_a_level_may_be_looked_up(mesh, texture_filter, needed):
    found = features.derive(scene(mesh), Settings(texture_filter=texture_filter), double_positions=False)
    assert found["MIPMAPS"] == needed
