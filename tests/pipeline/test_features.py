"""The features that a scene needs, and the reasons why others are left out."""

from dataclasses import replace

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.pipeline import features
from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera
from clshade.scene.lights import DirectionalLight, PointLight, RectangleLight
from clshade.scene.material import TERMS
from clshade.scene.model import Environment, Material, Mesh, Scene, Settings, Texture

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
SKY, BLACK = Environment(np.ones((2, 4, 3))), Environment(np.zeros((2, 4, 3)))
NO_LEVELS, TRILINEAR = "textures of one texel or with the course's lookup", {"texture_filter": "trilinear"}
NO_POWER = "no specular term: ks is 0"
NOLIGHT, UNLIT, AT_VERTEX = "shader nolight", {"shader": "nolight"}, {"texture_at": "vertex"}
OCCLUDED = {"ambient_occlusion": 4}


def material(**fields) -> Mesh:
    return replace(COLORED, material=Material(**fields))


def scene(*meshes: Mesh, lights=(LIGHT,), **fields) -> Scene:
    return Scene(meshes, CAMERA, lights, **fields)


CASES = [
    (scene(PLAIN), {}, "VERTEX_COLORS", "no vertex or material colors other than white"),
    (scene(COURSE), {}, "VERTEX_COLORS", "texels take the place of vertex colors"),
    (scene(TEXTURED), AT_VERTEX, "TEXTURED", "texture_at vertex: looked up at the corners"),
    (scene(material(texture=TEXTURE)), {}, "TEXTURED", "no texture coordinates"),
    (scene(COLORED, lights=(PointLight((1, 2, 3), (0, 0, 0)),)), {}, "SPECULAR", "no light shines"),
    (scene(material(ka=0)), {}, "AMBIENT", "ka is 0"),
    (scene(material(ka=(1, 0, 0)), ambient=(0, 1, 1)), {}, "AMBIENT", "ka*Ia is 0"),
    *((scene(material(**{name: 0})), {}, term.feature, f"{name} is 0") for name, term in TERMS.items()),
    (scene(material(ks=0)), {}, "POWER", NO_POWER),
    (scene(material(n=1)), {}, "POWER", "no exponent but 1"),
    (scene(COLORED, lights=(SUN, LIGHT)), {}, "AREA_LIGHTS", "no light has a size"),
    (scene(), OCCLUDED, "AMBIENT_OCCLUSION", "no triangle"),
    (scene(COLORED), {"shadows": True}, "SHADOW_ALPHA", "all that casts shadows is opaque"),
    (scene(COLORED), {}, "MATERIALS", "a single material"),
    (scene(COLORED), UNLIT, "LIT", NOLIGHT),
    (scene(INDEXED, preset="course"), {}, "NORMAL_INDICES", "a normal per vertex"),
    (scene(COURSE), TRILINEAR, "MIPMAPS", NO_LEVELS),
    (scene(material(opacity=0.5)), {}, "ALPHA_TEST", "no alpha test"),
    (scene(material(texture=CUT_OUT, blend=True)), {}, "BLEND", "nothing is transparent"),
    (scene(replace(PLAIN, alphas=[0.5, 1, 1])), {}, "VERTEX_ALPHA", "no alpha at vertices counts"),
    (scene(COLORED, material(sides="front")), {"cull": True}, "SIDES", "all that is seen from behind is culled"),
    (scene(COLORED), {"shader": "pbr"}, "ENVIRONMENT", "no environment"),
    (scene(COLORED, environment=BLACK), {"shader": "pbr"}, "ENVIRONMENT", "it is black"),
    (scene(COLORED), {"scalars": "data"}, "SCALARS", "no face has the scalars"),
]


@pytest.mark.parametrize(("input_scene", "fields", "name", "reason"), CASES)
def test_the_reason_is_the_one_that_holds(input_scene, fields, name, reason):
    feature_set = features.derive(input_scene, Settings(**fields), double_positions=False)
    assert feature_set[name] == 0
    assert dict(feature_set.left_out)[name] == reason


LIGHTING = "LIT AMBIENT DIFFUSE SPECULAR POWER VERTEX_COLORS"
ONE_SIDED = replace(PLAIN, material=Material(sides="front"))
CLEAR = replace(PLAIN, alphas=[0.5, 1, 1], material=Material(blend=True))
TURNED = replace(INDEXED, material=Material(two_sided=True, ka=0, ks=0))
LIT_BY_SKY = scene(COLORED, lights=(), ambient=0, environment=SKY)


@pytest.mark.parametrize(
    ("input_scene", "fields", "used"),
    [
        (scene(COLORED), {}, LIGHTING),
        (scene(COLORED, lights=(LIGHT, PANEL)), {}, f"{LIGHTING} LIGHT_SHAPES AREA_LIGHTS"),
        (LIT_BY_SKY, {"shader": "pbr"}, "LIT DIFFUSE SPECULAR ENVIRONMENT VERTEX_COLORS"),
        (scene(MEASURED), {**UNLIT, "scalars": "data"}, "VERTEX_COLORS SCALARS"),
        (scene(TEXTURED), {**UNLIT, **TRILINEAR}, "VERTEX_COLORS TEXTURED MIPMAPS"),
        (scene(COURSE, COLORED), UNLIT, "TEXTURED VERTEX_COLORS MATERIALS"),
        (scene(TEXTURED), {**UNLIT, **AT_VERTEX, "layers": ("Z",)}, "OWNERS"),
        (scene(TURNED), {}, "LIT DIFFUSE TWO_SIDED NORMAL_INDICES VERTEX_COLORS"),
        (scene(CUT, ONE_SIDED, background=0.5), UNLIT, "TEXTURED UV_INDICES ALPHA_TEST MATERIALS SIDES BACKGROUND"),
        (scene(CLEAR), UNLIT, "BLEND VERTEX_ALPHA SORTED"),
        (scene(CUT), {**UNLIT, **AT_VERTEX}, "UV_INDICES ALPHA_TEST"),
    ],
)
def test_what_is_needed_is_used_and_all_else_has_a_reason(input_scene, fields, used):
    feature_set = features.derive(input_scene, Settings(**fields), double_positions=False)
    assert set(feature_set.used) & set(features.OPTIONAL) == set(used.split())
    assert {name for name, reason in feature_set.left_out if reason} == set(features.OPTIONAL) - set(used.split())


def test_what_is_forced_is_not_left_out():
    """Normals that are read keep their indices: the kernels must find them."""
    settings = Settings(texture_at="vertex", shader="nolight")
    feature_set = features.derive(scene(TEXTURED), settings, double_positions=False, forced=features.OPTIONAL)
    assert feature_set.left_out == ()
    assert set(features.OPTIONAL) <= set(feature_set.used)
    dark = scene(INDEXED, lights=())
    for names in ((), ("DIFFUSE",), ("SPECULAR",)):
        assert features.derive(dark, Settings(), double_positions=False, forced=names)["NORMAL_INDICES"] == len(names)
    with pytest.raises(InputError, match=r"^Renderer: forced: DEPTH_TEST: expected one of LIT, "):
        Renderer(dark, forced={"DEPTH_TEST"})
