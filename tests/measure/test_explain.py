"""`render --explain`: the features left out, and that leaving them out saves work and changes no bit."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import replace
from math import comb
from typing import Any

import numpy as np
import pytest
from command_line import run
from devices import working_devices

from clshade.cli import commands
from clshade.images.layers import LAYERS
from clshade.measure import timing
from clshade.measure.report import feature_savings
from clshade.pipeline import gather, programs
from clshade.pipeline.features import GROUPS, OPTIONAL, Features
from clshade.pipeline.frame import Frame, same_bits
from clshade.pipeline.renderer import Renderer
from clshade.scene.material import POWERED, TERMS
from clshade.scene.model import Camera, Material, Mesh, PointLight, Scene, Texture

needs_device = pytest.mark.skipif(not working_devices(), reason="no OpenCL device works here")
SMALL = ("render", "quads", "--resolution", "32,24", "--preset", "course")


# Features left out

WITHOUT_SCALARS = ("SCALARS", "VERTEX_COLORS", "MATERIALS")  # meshes with scalars need these


# Needed by shader pbr alone, which shows no scalars here: tests/pipeline/test_maps.py.
OF_PBR = {"EMISSION", "ENVIRONMENT", "UV_SETS", *GROUPS["MAPS"]}


def rich_scene(*without: str) -> Scene:
    """Return sixty triangles whose image needs every optional feature except these and those that depend on them."""
    generator = np.random.default_rng(4)
    given: dict[str, Any] = {"ka": 0.3, **dict.fromkeys(TERMS, 0.5), "n": 12.0, "two_sided": "TWO_SIDED" not in without}
    plain = {"AMBIENT": {"ka": 0.0}, "POWER": {"n": 1.0}, **{term.feature: {k: 0.0} for k, term in TERMS.items()}}
    for name in without:
        given |= plain.get(name, {})
    filter = "linear" if "NEAREST" in without else "nearest"
    texture = Texture(generator.uniform(0.2, 1, (5, 6, 4)), filter=filter)
    given["alpha_cutoff"] = None if {"ALPHA_TEST", "SHADOW_ALPHA"} & set(without) else 0.4
    if "TEXTURED" not in without:
        given["texture"] = texture
    sides = "both" if "SIDES" in without else "front"
    materials = (
        Material(**given),
        Material(
            **{**given, "ka": 1.5 * given["ka"], "kd": 0.5 * given["kd"]},
            sides=sides,
            blend=not {"BLEND", "MATERIALS", "SORTED", "SHADOW_ALPHA"} & set(without),
        ),
    )
    faces = np.arange(90).reshape(-1, 3)
    meshes = []
    for material in materials if "MATERIALS" not in without else (materials[0], materials[0]):
        colors = None if "VERTEX_COLORS" in without else generator.uniform(0.2, 1, (90, 3))
        verts, uvs = generator.uniform(-1, 1, (90, 3)), generator.uniform(0, 2, (90, 2))
        normals = {"normals": generator.normal(size=(40, 3)), "normal_faces": generator.integers(40, size=(30, 3))}
        meshes.append(
            Mesh(
                np.float32(verts) if "DOUBLE_POSITIONS" in without else verts,
                faces,
                colors=colors,
                uvs=uvs,
                uv_faces=None if "UV_INDICES" in without else faces[::-1],
                material=material,
                alphas=None if "VERTEX_ALPHA" in without else generator.uniform(0.3, 1, 90),
                **({} if "NORMAL_INDICES" in without else normals),
            )
        )
    if not set(WITHOUT_SCALARS) & set(without):
        verts = 0.7 * meshes[0].verts
        verts = np.float32(verts) if "DOUBLE_POSITIONS" in without else verts
        meshes.append(replace(meshes[0], verts=verts, scalars={"data": generator.uniform(0, 1, 90)}))
    camera = Camera((0.2, 0.5, -4.0), (0, 0, 0), (0, 1, 0), 4.0, (3.0, 3.0), (61, 47))
    ends = {} if "LIGHT_SHAPES" in without else {"attenuation": "inverse-square", "range": 9.0}
    radius = 0.0 if {"LIGHT_SHAPES", "AREA_LIGHTS"} & set(without) else 0.5
    lights = (PointLight((1, 2, -3)), PointLight((-3, 1, -2), (0.4, 0.5, 0.9), radius=radius, **ends))
    background = None if "BACKGROUND" in without else (0.1, 0.2, 0.3)
    return Scene(tuple(meshes), camera, lights, ambient=0.7, background=background)


# Settings with which all features but these are needed.
NEEDS = {
    "LIT": {"shader": "nolight"},
    "OWNERS": {"layers": ()},
    "MIPMAPS": {"texture_filter": "bilinear"},
    "SORTED": {"visibility": "depth"},
    "SHADOWS": {"shadows": False},
    "AMBIENT_OCCLUSION": {"ambient_occlusion": 0},
    **{name: {"scalars": None} for name in WITHOUT_SCALARS},
}
ALONG = {  # features left out with another, without which they are meaningless
    "LIT": {"AMBIENT", *GROUPS["TERMS"], "POWER", "LIGHT_SHAPES", "AREA_LIGHTS", "SHADOWS", "SHADOW_ALPHA"}
    | {"TWO_SIDED", "NORMAL_INDICES", "AMBIENT_OCCLUSION"},
    "AMBIENT": {"AMBIENT_OCCLUSION"},
    "LIGHT_SHAPES": {"AREA_LIGHTS"},
    "SHADOW_ALPHA": {"ALPHA_TEST", "BLEND", "VERTEX_ALPHA"},
    **({TERMS[POWERED[0]].feature: {"POWER"}} if len(POWERED) == 1 else {}),
    "TEXTURED": {"UV_INDICES", "MIPMAPS", "NEAREST"},
    "MATERIALS": {"SIDES", "SCALARS", "BLEND"},
    "VERTEX_COLORS": {"SCALARS"},
    "SORTED": {"BLEND"},
}


def plain_scene() -> Scene:
    """Return sixty white triangles of one material, lit by one term of plain points, on black."""
    scene = rich_scene("VERTEX_COLORS")
    material = Material(ka=0.0, kd=0.6, ks=0.0)
    meshes = [Mesh(np.float32(mesh.verts), mesh.faces, uvs=mesh.uvs, material=material) for mesh in scene.meshes]
    return replace(scene, meshes=tuple(meshes), background=0.0, lights=rich_scene("LIGHT_SHAPES").lights)


def draw(device, scene: Scene, **options: Any) -> Frame:
    with Renderer(scene, device=device, **options) as renderer:
        return renderer.render()


def draw_rich(device, *without: str, **options: Any) -> Frame:
    fields = {"shader": "phong", "layers": ("Z",), "texture_filter": "trilinear", "visibility": "painter"}
    fields |= {"scalars": "data", "shadows": True, "ambient_occlusion": 2}
    for name in without:
        options |= NEEDS.get(name, {})
    return draw(device, rich_scene(*without), **{**fields, **options})


def needed_by(frame: Frame) -> set[str]:
    return set(frame.stats["features"]) & set(OPTIONAL)


# What Gouraud shading computes in kernels of its own; the rest it shares with Phong shading.
OF_CORNERS = {
    "AMBIENT",
    *GROUPS["TERMS"],
    "POWER",
    "LIGHT_SHAPES",
    "AREA_LIGHTS",
    "SHADOWS",
    "SHADOW_ALPHA",
    "AMBIENT_OCCLUSION",
    "TWO_SIDED",
    "VERTEX_COLORS",
    "MATERIALS",
}


@pytest.mark.parametrize(
    ("shader", "name"),
    [
        *(("phong", name) for name in OPTIONAL if name not in OF_PBR),
        *(("gouraud", name) for name in sorted(OF_CORNERS)),
    ],
)
def test_where_all_but_one_are_needed_it_changes_no_bit(device, name, shader):
    """It is off by default; with it forced, the image is the same."""
    if name == "SORTED" and device.lanes == 1:
        assert "SORTED" in needed_by(draw_rich(device, name, shader=shader))  # sorted whatever the scene
        return
    lean = draw_rich(device, name, shader=shader)
    assert set(lean.stats["left_out"]) == set(OPTIONAL) - needed_by(lean) == {name} | ALONG.get(name, set()) | OF_PBR
    full = draw_rich(device, name, shader=shader, forced=OPTIONAL)
    assert needed_by(full) == set(OPTIONAL)
    assert same_bits(lean, full)
    assert len(np.unique(lean.rgb)) > 100


def covering(names: Sequence[str]) -> list[set[str]]:
    """Return few sets of the names: of any two some set holds both, and some each one without the other.

    The number of sets is the least possible if none may hold neither, which the empty set does (Kleitman and Spencer,
    Families of k-independent sets, Discrete Mathematics 6, 1973).
    """
    number = next(n for n in itertools.count(1) if comb(n, n // 2 + 1) >= len(names))
    held_by = dict(zip(names, itertools.combinations(range(number), number // 2 + 1), strict=False))
    return [{name for name in names if k in held_by[name]} for k in range(number)]


def test_the_sets_cover_all_pairs():
    sets = covering(OPTIONAL)
    assert len(sets) < 10
    for pair in itertools.combinations(OPTIONAL, 2):
        assert {tuple(name in each for name in pair) for each in sets} >= {(True, True), (True, False), (False, True)}


def unneeded(shader: str, *needed: str, names: Sequence[str] = OPTIONAL) -> list[Any]:
    """Return cases of the next test. needed: what the plain scene needs. names: what the shader computes by itself."""
    return [(shader, {*needed}, each) for each in covering([name for name in names if name not in needed])]


@pytest.mark.parametrize(
    ("shader", "needed", "names"),
    unneeded("nolight")
    + unneeded("phong", "LIT", "DIFFUSE")
    + unneeded("gouraud", "LIT", "DIFFUSE", "SORTED", names=sorted(OF_CORNERS)),
    ids=lambda value: f"{len(value)} features" if isinstance(value, set) else value,
)
def test_features_that_are_not_needed_change_no_bit(device, names, shader, needed):
    """With any two of them both on, one on, and none on."""
    scene = plain_scene()
    lean = draw(device, scene, shader=shader)
    assert needed_by(lean) == needed
    on = draw(device, scene, shader=shader, forced=names)
    assert needed_by(on) == needed | names | ({"SORTED"} if "BLEND" in names else set())  # transparent ones are sorted
    assert same_bits(lean, on)
    assert lean.alpha.mean() > 0.2


def test_a_forced_feature_works_where_it_is_not_needed(device, monkeypatch):
    """Forced on white triangles, anything not white is visible: this is how the tests above can fail."""
    lean = draw(device, plain_scene(), shader="nolight")
    monkeypatch.setattr(gather, "WHITE", Texture(np.full((1, 1, 3), 0.5)))
    grey = draw(device, plain_scene(), shader="nolight", forced={"TEXTURED"})
    covered = lean.alpha > 0
    assert (lean.rgb[covered] == 1.0).all()
    assert (grey.rgb[covered] == 0.5).all()


def test_indices_of_what_nobody_reads_are_not_taken_for_vertices(device):
    """Ten normals and one texture coordinate, each with indices, in a mesh of 90 vertices that is lit and textured only
    because these features are forced."""
    (first, second) = plain_scene().meshes
    indices = {"normal_faces": np.full((30, 3), 9), "uv_faces": np.zeros((30, 3), int)}
    mesh = replace(first, normals=np.eye(3)[np.arange(10) % 3], uvs=[[0.3, 0.4]], **indices)
    scene = replace(plain_scene(), meshes=(mesh, second), lights=())
    assert same_bits(draw(device, scene, shader="phong"), draw(device, scene, shader="phong", forced=OPTIONAL))


# Messages


def test_what_is_left_out_and_what_it_saves(device):
    found = feature_savings.explain(plain_scene(), frames=3, device=device, shader="phong")
    assert found.passed
    assert set(found.left_out) == set(OPTIONAL) - {"LIT", "DIFFUSE"}
    assert found.needed == ("LIT", "DIFFUSE")
    assert found.alone == {}
    assert found.left_out["SPECULAR"] == "ks is 0"
    assert found.frames == 3
    assert found.full.bytes - found.lean.bytes >= 61 * 47 * 4  # the owners, at least
    assert {"frame", "sort"} <= set(found.lean.ms) <= set(found.full.ms)
    assert found.lean.extra == (0.0, 0.0, 0.0)
    assert found.full.extra.low != 0.0
    text = "\n".join(found.lines())
    assert "highlights (SPECULAR): ks is 0" in text
    assert "the same bits" in text
    assert "medians of 3 frames" in text
    json.dumps(found.stats())


@pytest.fixture
def few_left_out(monkeypatch):
    """Take three features for all that is left out, for each needs a program."""

    class Few(Renderer):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            left_out = tuple(pair for pair in self.features.left_out if pair[0] in FEW)
            self.features = replace(self.features, left_out=left_out)

    monkeypatch.setattr(feature_savings, "Renderer", Few)


FEW = ("DOUBLE_POSITIONS", "OWNERS", "SIDES")


@pytest.mark.long
def test_what_each_costs_alone(device, few_left_out):
    found = feature_savings.explain(plain_scene(), frames=3, each=True, device=device)
    assert found.passed
    assert set(found.alone) == set(found.left_out) == set(FEW)
    assert found.alone["OWNERS"].bytes == found.lean.bytes + 61 * 47 * 4
    assert found.alone["DOUBLE_POSITIONS"].bytes == found.lean.bytes + 180 * 12
    assert all(side.ms["frame"] > 0.0 for side in found.alone.values())
    text = "\n".join(found.lines())
    assert text.count("on alone it costs") == len(found.left_out)
    json.dumps(found.stats())


def test_images_that_differ_are_a_failure(device, monkeypatch):
    monkeypatch.setattr(feature_savings, "same_bits", lambda *_: False)
    found = feature_savings.explain(plain_scene(), frames=1, device=device)
    assert not found.passed
    assert "FAILED" in "\n".join(found.lines())


@pytest.mark.long
def test_where_all_that_phong_has_is_needed_that_of_pbr_is_left_out(device):
    options = {"layers": ("Z",), "texture_filter": "trilinear", "visibility": "painter", "scalars": "data"}
    options |= {"shadows": True, "ambient_occlusion": 2}
    found = feature_savings.explain(rich_scene(), frames=1, device=device, **options)
    assert set(found.left_out) == OF_PBR
    assert found.passed
    nothing = replace(found, frames=0, left_out={}, full=found.lean)
    assert "saved: nothing" in "\n".join(nothing.lines())


def test_work_that_the_view_and_the_settings_do_without(device):
    scene = plain_scene()
    spare = replace(scene.meshes[0], verts=np.concatenate([scene.meshes[0].verts, np.zeros((7, 3))]), uvs=None)
    scene = replace(scene, meshes=(spare, scene.meshes[1]), lights=(*scene.lights, PointLight((0, 0, 1), (0, 0, 0))))
    unneeded = feature_savings.explain(scene, frames=1, device=device).unneeded
    assert unneeded["vertices"] == "7 of 187 in no face"
    assert unneeded["lights"] == "1 of 3 of intensity 0"
    assert unneeded["clipping"].startswith("60 of 60 triangles")
    assert unneeded["layers"] == f"{', '.join(LAYERS)} not asked for"
    assert unneeded["shading"].endswith(f"of {61 * 47:,} pixels show no triangle")
    assert "perspective division" not in unneeded
    away = replace(scene, camera=replace(scene.camera, lookat=np.array([0.0, 0.0, -9.0])))
    unneeded = feature_savings.explain(away, frames=1, device=device).unneeded
    assert "60 behind the eye, of 60" in unneeded["triangles"]
    assert unneeded["tiles"] == "12 of 12 hold no triangle"


@pytest.mark.long
def test_what_the_course_preset_does_without(device):
    frame = draw(device, plain_scene(), preset="course", shader="nolight")
    found = feature_savings._unneeded(frame)
    assert found["depth at every pixel"] == f"visibility painter, {61 * 47:,} pixels"
    covered = np.count_nonzero(draw(device, plain_scene(), shader="nolight").alpha)
    assert found["perspective division"] == f"interpolation affine, {covered:,} pixels"
    assert found["shading"].startswith(f"{61 * 47 - covered:,} of")


def test_empty_tiles_are_counted(device):
    """One small triangle, in one of 5 x 4 tiles, inside or outside the camera's view."""
    mesh = Mesh(np.float32([[0.02, 0.02, 0], [0.1, 0.02, 0], [0.02, 0.1, 0]]), [[0, 1, 2]])
    camera = Camera((0, 0, -3), (0, 0, 0), (0, 1, 0), 3.0, (1.0, 1.0), (80, 64))
    with Renderer(Scene((mesh,), camera), device=device, shader="nolight") as renderer:  # the program of `plain_scene`
        for seen, empty in ((camera, 19), (replace(camera, lookat=(0, 0, -9)), 20), (camera, 19)):
            stats = renderer.render(camera=seen).stats
            assert (stats["tiles"], stats["empty_tiles"]) == (20, empty)


def test_no_more_frames_than_there_is_time_for(device, monkeypatch):
    monkeypatch.setattr(feature_savings, "SECONDS", 0.0)
    assert feature_savings.explain(plain_scene(), device=device).frames == timing.FEWEST


def test_programs_are_counted(device):
    feature_savings.explain(plain_scene(), frames=1, device=device)
    before = programs.built()
    found = feature_savings.explain(plain_scene(), frames=1, device=device)
    assert programs.built() == before  # the second time nothing is built
    assert found.compiled[0] + found.loaded[0] == len(before)
    assert all(program.seconds > 0.0 for program in before)


def test_a_program_is_built_for_what_is_compiled_and_for_nothing_else(device, monkeypatch):
    """Not for another size, camera, light, material or texture, nor for layers or lines."""
    monkeypatch.setattr(programs, "_built", {})
    scene = plain_scene()
    draw(device, scene, shader="phong")
    before = programs.built()
    assert len(before) == 2  # geometry and pixels
    material = replace(scene.meshes[0].material, kd=0.2, n=5.0, name="other")
    for changed in (
        replace(scene, camera=scene.camera.with_resolution((50, 20))),
        replace(scene, camera=replace(scene.camera, eye=(1.0, 2.0, -5.0), focal=2.0)),
        replace(scene, lights=(PointLight((3, 3, -3)),) * 2),
        *(replace(scene, lights=(PointLight((3, 3, -3)),) * count) for count in (1, 3, 40)),
        replace(scene, meshes=tuple(replace(mesh, material=material) for mesh in scene.meshes)),
        replace(scene, meshes=scene.meshes[:1]),
        replace(scene, lights=()),
        rich_scene(),
    ):
        assert draw(device, changed, shader="phong").alpha.any()
        assert programs.built() == before
    draw(device, scene, shader="phong", samples=4)  # geometry and pixels again
    assert len(programs.built()) == len(before) + 2


@pytest.mark.parametrize("keeps_programs", [False, True], ids=["by us", "by the runtime"])
def test_a_program_is_compiled_once_and_then_loaded(opened, tmp_path, monkeypatch, keeps_programs):
    opened = replace(opened, keeps_programs=keeps_programs)
    monkeypatch.setattr(programs, "_built", {})
    monkeypatch.setattr(programs, "_stored_at", lambda *_: tmp_path / "binary")
    stored = []
    for _ in range(2):
        programs._built.clear()
        program = programs.build(opened, Features.of(), ("bilerp.cl",))
        stored.append(program.stored)
    assert stored == [False, True]


# The command line


@pytest.mark.long
@needs_device
def test_explain_is_printed_after_the_summary(tmp_path, capsys):
    code, out, err = run(capsys, *SMALL, "-o", tmp_path / "a", "--explain")
    assert (code, err) == (0, [])
    assert out.startswith("scene")
    assert "texture lookups (TEXTURED): no texture" in out
    assert "the same bits" in out
    assert "loaded from the cache" in out


@needs_device
def test_explain_in_the_figures_as_json(tmp_path, capsys):
    code, out, _ = run(capsys, *SMALL, "-o", tmp_path / "a", "--explain", "--stats")
    found = json.loads(out)["explain"]
    assert code == 0
    assert found["identical"] is True
    assert found["left_out"]["TEXTURED"] == "no texture"
    assert found["everything_on"]["bytes"] > found["lean"]["bytes"]


@needs_device
@pytest.mark.long
def test_explain_each_tells_what_each_costs_alone(tmp_path, capsys, few_left_out):
    code, out, _ = run(capsys, *SMALL, "-o", tmp_path / "a", "--explain-each")
    assert code == 0
    words = " ".join(out.split())  # lines are wrapped
    assert words.count("on alone it costs") == words.count("left out: ") == len(FEW)


@needs_device
def test_images_that_differ_are_an_exit_code(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(feature_savings, "same_bits", lambda *_: False)
    assert run(capsys, *SMALL, "-o", tmp_path / "a", "--explain")[0] == commands.FAILED


def test_every_feature_has_a_name_for_people():
    assert set(feature_savings.WORK) == {*OPTIONAL, "BACKDROP"}
