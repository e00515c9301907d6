"""The features that a scene needs, and the reasons why others are left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.pipeline import features
from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera
from clshade.scene.material import TERMS
from clshade.scene.model import (
    DirectionalLight,
    Environment,
    Material,
    Mesh,
    PointLight,
    RectangleLight,
    Scene,
    Settings,
    Texture,
)

CAMERA = Camera((0, 0, -3), (0, 0, 0), (0, 1, 0), 1.0, (1.0, 1.0))
LIGHT, SUN = PointLight((1, 2, -3)), DirectionalLight((0, -1, 0))
PANEL = RectangleLight((1, 2, -3), (1, 0, 0), (0, 1, 0))
TEXTURE = Texture(np.full((2, 2, 3), 0.5))
PLAIN = Mesh(np.eye(3), [[0, 1, 2]])
COLORED = replace(PLAIN, colors=np.full((3, 3), 0.5))
TEXTURED = replace(COLORED, uvs=np.zeros((3, 2)), material=Material(texture=TEXTURE))
INDEXED = replace(COLORED, normals=np.eye(3)[:1], normal_faces=np.zeros((1, 3), int))
MEASURED = replace(PLAIN, scalars={"data": np.arange(3)})
CUT_OUT = Texture(np.full((2, 2, 4), 0.5))
COURSE = replace(TEXTURED, material=Material(texture=replace(TEXTURE, lookup="course")))
CUT = replace(TEXTURED, colors=None, uv_faces=[[0, 0, 0]], material=Material(texture=CUT_OUT, alpha_cutoff=0.5))
ONE_TEXEL = replace(TEXTURED, material=Material(texture=Texture(np.ones((1, 1, 3)))))
SKY, BLACK = Environment(np.ones((2, 4, 3))), Environment(np.zeros((2, 4, 3)))
NO_LEVELS, TRILINEAR = "textures of one texel or with the course's lookup", {"texture_filter": "trilinear"}
NO_TERM, NO_POWER = "kd and ks are 0", "no specular term: ks is 0"
NOLIGHT, AT_VERTEX = "shader nolight", {"texture_at": "vertex"}
OCCLUDED = {"ambient_occlusion": 4}


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
    *((scene(material(**{name: 0})), {}, term.feature, f"{name} is 0") for name, term in TERMS.items()),
    (scene(material(ks=0)), {}, "POWER", NO_POWER),
    (scene(material(n=1)), {}, "POWER", "no exponent but 1"),
    (scene(COLORED), {}, "LIGHT_SHAPES", "only points without attenuation shine"),
    (scene(COLORED, lights=(SUN,)), {"shader": "nolight"}, "LIGHT_SHAPES", NOLIGHT),
    (scene(material(kd=0, ks=0), lights=(SUN,)), {}, "LIGHT_SHAPES", NO_TERM),
    (scene(COLORED, lights=(SUN, LIGHT)), {}, "AREA_LIGHTS", "no light has a size"),
    (scene(COLORED, lights=(PANEL,)), {"shader": "nolight"}, "AREA_LIGHTS", NOLIGHT),
    (scene(COLORED), {}, "AMBIENT_OCCLUSION", "no ambient occlusion asked for"),
    (scene(COLORED, ambient=0), OCCLUDED, "AMBIENT_OCCLUSION", "no ambient light"),
    (scene(COLORED), {"shader": "nolight", **OCCLUDED}, "AMBIENT_OCCLUSION", NOLIGHT),
    (scene(), OCCLUDED, "AMBIENT_OCCLUSION", "no triangle"),
    (scene(COLORED), {}, "SHADOWS", "no shadows asked for"),
    (scene(COLORED, lights=()), {"shadows": True}, "SHADOWS", "no light shines"),
    (scene(COLORED), {"shadows": True, "shader": "nolight"}, "SHADOWS", NOLIGHT),
    (scene(), {"shadows": True}, "SHADOWS", "no triangle"),
    (scene(COLORED), {"shadows": True}, "SHADOW_ALPHA", "all that casts shadows is opaque"),
    (scene(COLORED), {}, "MATERIALS", "a single material"),
    (scene(COLORED), {"shader": "nolight"}, "LIT", NOLIGHT),
    (scene(material(two_sided=True)), {"shader": "nolight"}, "TWO_SIDED", NOLIGHT),
    (scene(material(two_sided=True, kd=0, ks=0)), {}, "TWO_SIDED", NO_TERM),
    (scene(COLORED), {}, "TWO_SIDED", "no two-sided material"),
    (scene(COLORED, lights=()), {}, "NORMAL_INDICES", "no light shines"),
    (scene(INDEXED, preset="course"), {}, "NORMAL_INDICES", "a normal per vertex"),
    (scene(PLAIN), {}, "UV_INDICES", "no texture"),
    (scene(TEXTURED), {}, "UV_INDICES", "texture coordinates per vertex"),
    (scene(TEXTURED), {}, "MIPMAPS", "texture_filter bilinear"),
    (scene(PLAIN), TRILINEAR, "MIPMAPS", "no texture"),
    (scene(material(texture=TEXTURE)), TRILINEAR, "MIPMAPS", "no texture coordinates"),
    (scene(COURSE), TRILINEAR, "MIPMAPS", NO_LEVELS),
    (scene(ONE_TEXEL), TRILINEAR, "MIPMAPS", NO_LEVELS),
    (scene(PLAIN), {}, "ALPHA_TEST", "no alpha test"),
    (scene(material(texture=CUT_OUT, alpha_cutoff=0.5)), {}, "ALPHA_TEST", "no alpha test"),
    (scene(material(opacity=0.5)), {}, "ALPHA_TEST", "no alpha test"),
    (scene(material(opacity=0.5)), {}, "BLEND", "nothing is transparent"),
    (scene(material(blend=True)), {}, "BLEND", "nothing is transparent"),
    (scene(material(texture=CUT_OUT, blend=True)), {}, "BLEND", "nothing is transparent"),
    (scene(replace(PLAIN, alphas=[0.5, 1, 1])), {}, "VERTEX_ALPHA", "no alpha at vertices counts"),
    (scene(material(opacity=0.5, blend=True)), {}, "VERTEX_ALPHA", "no alpha at vertices counts"),
    (scene(replace(TEXTURED, material=Material(texture=TEXTURE, alpha_cutoff=0.5))), {}, "ALPHA_TEST", "no alpha test"),
    (scene(replace(TEXTURED, material=Material(texture=CUT_OUT))), {}, "ALPHA_TEST", "no alpha test"),
    (scene(COLORED), {}, "SIDES", "both sides of every material are drawn"),
    (scene(material(sides="front")), {}, "SIDES", "all that is seen from behind is culled"),
    (scene(COLORED, material(sides="front")), {"cull": True}, "SIDES", "all that is seen from behind is culled"),
    (scene(COLORED), {}, "DOUBLE_POSITIONS", "float32 holds the positions"),
    (scene(COLORED, background=None), {}, "BACKGROUND", "no background"),
    (scene(COLORED), {}, "BACKGROUND", "the background is black"),
    (scene(COLORED), {}, "OWNERS", "no layer asked for"),
    (scene(COLORED, environment=SKY), {}, "ENVIRONMENT", "shader phong"),
    (scene(COLORED), {"shader": "pbr"}, "ENVIRONMENT", "no environment"),
    (scene(COLORED, environment=BLACK), {"shader": "pbr"}, "ENVIRONMENT", "it is black"),
    (scene(MEASURED), {}, "SCALARS", "no scalars asked for"),
    (scene(COLORED), {"scalars": "data"}, "SCALARS", "no face has the scalars"),
]


@pytest.mark.parametrize(("input_scene", "fields", "name", "reason"), CASES)
def test_the_reason_is_the_one_that_holds(input_scene, fields, name, reason):
    feature_set = features.derive(input_scene, Settings(**fields), double_positions=False)
    assert feature_set[name] == 0
    assert dict(feature_set.left_out)[name] == reason


@pytest.mark.parametrize(
    ("input_scene", "fields", "used"),
    [
        (scene(COLORED), {}, {"LIT", "AMBIENT", "DIFFUSE", "SPECULAR", "POWER", "VERTEX_COLORS"}),
        (
            scene(COLORED, lights=(LIGHT, SUN)),
            {},
            {"LIT", "AMBIENT", "DIFFUSE", "SPECULAR", "POWER", "LIGHT_SHAPES", "VERTEX_COLORS"},
        ),
        (
            scene(COLORED, lights=(LIGHT, PANEL)),
            {},
            {"LIT", "AMBIENT", "DIFFUSE", "SPECULAR", "POWER", "LIGHT_SHAPES", "AREA_LIGHTS", "VERTEX_COLORS"},
        ),
        (scene(material(color=0.5)), {"shader": "nolight"}, {"VERTEX_COLORS"}),
        (
            scene(COLORED, lights=(), ambient=0, environment=SKY),
            {"shader": "pbr"},
            {"LIT", "DIFFUSE", "SPECULAR", "ENVIRONMENT", "VERTEX_COLORS"},
        ),
        (scene(MEASURED), {"shader": "nolight", "scalars": "data"}, {"VERTEX_COLORS", "SCALARS"}),
        (scene(replace(PLAIN, material=Material(color=0.5))), {"shader": "nolight"}, {"VERTEX_COLORS"}),
        (scene(TEXTURED), {"shader": "nolight"}, {"VERTEX_COLORS", "TEXTURED"}),
        (scene(TEXTURED), {"shader": "nolight", **TRILINEAR}, {"VERTEX_COLORS", "TEXTURED", "MIPMAPS"}),
        (scene(COURSE), {"shader": "nolight"}, {"TEXTURED"}),
        (scene(COURSE, COLORED), {"shader": "nolight"}, {"TEXTURED", "VERTEX_COLORS", "MATERIALS"}),
        (scene(TEXTURED), {"shader": "nolight", **AT_VERTEX, "layers": ("Z",)}, {"OWNERS"}),
        (scene(material(n=1, kd=0)), {}, {"LIT", "AMBIENT", "SPECULAR", "VERTEX_COLORS"}),
        (
            scene(replace(INDEXED, material=Material(two_sided=True, ka=0, ks=0))),
            {},
            {"LIT", "DIFFUSE", "TWO_SIDED", "NORMAL_INDICES", "VERTEX_COLORS"},
        ),
        (
            scene(CUT, replace(PLAIN, material=Material(sides="front")), background=0.5),
            {"shader": "nolight"},
            {"TEXTURED", "UV_INDICES", "ALPHA_TEST", "MATERIALS", "SIDES", "BACKGROUND"},
        ),
        (
            scene(replace(PLAIN, alphas=[0.5, 1, 1], material=Material(blend=True))),
            {"shader": "nolight"},
            {"BLEND", "VERTEX_ALPHA", "SORTED"},
        ),
        (
            scene(replace(PLAIN, alphas=[0.5, 1, 1], material=Material(alpha_cutoff=0.5))),
            {"shader": "nolight"},
            {"ALPHA_TEST", "VERTEX_ALPHA"},
        ),
        (scene(CUT), {"shader": "nolight", **AT_VERTEX}, {"UV_INDICES", "ALPHA_TEST"}),
    ],
)
def test_what_is_needed_is_used_and_all_else_has_a_reason(input_scene, fields, used):
    feature_set = features.derive(input_scene, Settings(**fields), double_positions=False)
    assert set(feature_set.used) & set(features.OPTIONAL) == used
    assert {name for name, _ in feature_set.left_out} == set(features.OPTIONAL) - used
    assert all(reason for _, reason in feature_set.left_out)


@pytest.mark.parametrize("mesh", [COLORED, TEXTURED])
def test_with_everything_forced_nothing_is_left_out(mesh):
    settings = Settings(texture_at="vertex", shader="nolight")
    feature_set = features.derive(scene(mesh), settings, double_positions=False, forced=features.OPTIONAL)
    assert feature_set.left_out == ()
    assert set(features.OPTIONAL) <= set(feature_set.used)


def test_one_feature_forced_is_one_left_out_less():
    lean = features.derive(scene(PLAIN), Settings(), double_positions=False)
    for name in features.OPTIONAL:
        feature_set = features.derive(scene(PLAIN), Settings(), double_positions=False, forced={name})
        along = {"SORTED"} if name == "BLEND" else set()  # transparent triangles are looked for in sorted lists
        assert dict(feature_set.left_out) == {k: why for k, why in lean.left_out if k not in {name, *along}}


def test_normals_that_are_read_keep_their_indices():
    """Without a light they are unused; if lighting is forced, the kernels must find them."""
    dark = scene(INDEXED, lights=())
    assert not features.derive(dark, Settings(), double_positions=False)["NORMAL_INDICES"]
    for name in ("DIFFUSE", "SPECULAR"):
        assert features.derive(dark, Settings(), double_positions=False, forced={name})["NORMAL_INDICES"]


def test_an_unknown_feature_is_refused():
    with pytest.raises(InputError, match=r"^Renderer: forced: DEPTH_TEST: expected one of LIT, "):
        Renderer(scene(PLAIN), forced={"DEPTH_TEST"})
