"""`render --explain`: the features left out, and that leaving them out saves work and changes no bit."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import SMALL, needs_device, run
from devices import rendered

from clshade.cli import FAILED
from clshade.images.layers import LAYERS
from clshade.measure import timing
from clshade.measure.conform.content import GoldenScene
from clshade.measure.conform.scenes import golden
from clshade.measure.report import feature_savings
from clshade.measure.report.feature_savings import explain
from clshade.pipeline import gather, programs
from clshade.pipeline.features import OPTIONAL, Features, derive
from clshade.pipeline.frame import same_bits
from clshade.pipeline.opencl.program_store import StoredProgram
from clshade.pipeline.renderer import Renderer
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, PointLight, Scene, Texture


def plain_scene() -> Scene:
    """Return sixty white triangles of one material, lit by one term of plain points, on black."""
    generator = np.random.default_rng(4)
    material = Material(ka=0.0, kd=0.6, ks=0.0)
    verts = np.float32(generator.uniform(-1, 1, (2, 90, 3)))
    meshes = tuple(Mesh(vertices, np.arange(90).reshape(-1, 3), material=material) for vertices in verts)
    camera = Camera((0.2, 0.5, -4.0), (0, 0, 0), (0, 1, 0), 4.0, (3.0, 3.0), (61, 47))
    return Scene(meshes, camera, (PointLight((1, 2, -3)), PointLight((-3, 1, -2), (0.4, 0.5, 0.9))))


# Features left out


def varied(number: int, golden: GoldenScene) -> GoldenScene:
    """Return a golden scene with some terms of 0, some of one material, some without layers: all those without light, where
    no map turns the layer of normals."""
    zero = {name: 0.0 for bit, name in enumerate(("ka", "kd", "ks")) if number >> bit & 1}
    power = {"n": 1.0} if number % 5 == 0 else {}
    scene, settings = golden.scene, golden.settings
    meshes = [replace(mesh, material=replace(mesh.material, **zero, **power)) for mesh in scene.meshes]
    layers = settings.layers if scene.lights and number % 3 else ()
    return replace(
        golden,
        scene=replace(scene, meshes=tuple(meshes[: 2 if number % 4 else 1])),
        settings=replace(settings, layers=layers),
    )


SCENES = [varied(number, golden_scene) for number, (golden_scene, _) in enumerate(golden(True))]
ELSEWHERE = {"ENVIRONMENT", "UV_SETS"}  # features that none of these needs: test_maps.py, test_image_light.py


def test_every_feature_is_left_out_of_some_scene_and_needed_by_another():
    left_out = [
        {name for name, _ in derive(scene.scene, scene.settings, double_positions=double).left_out}
        for scene in SCENES
        for double in [scene.choice["positions"] == "float64"]
    ]
    assert set.union(*left_out) == set(OPTIONAL)
    assert set.intersection(*left_out) == ELSEWHERE


@pytest.mark.parametrize(
    "golden",
    [
        pytest.param(
            scene, id=scene.name, marks=() if scene.choice["program"] in ("phong", "nolight") else pytest.mark.long
        )
        for scene in SCENES
    ],
)
def test_leaving_out_what_a_scene_does_not_need_changes_no_bit(device, golden):
    if golden.needs_float64 and not device.has_fp64:
        golden = golden.without_float64()
    lean = rendered(golden.scene, device=device, settings=golden.settings)
    full = rendered(golden.scene, device=device, settings=golden.settings, forced=OPTIONAL)
    assert lean.stats["left_out"]
    assert not full.stats["left_out"]
    assert same_bits(lean, full)


def test_a_forced_feature_works_where_it_is_not_needed(device, monkeypatch):
    """Forced on white triangles, anything not white is visible: this is how the tests above can fail."""
    lean = rendered(plain_scene(), device=device, shader="nolight")
    monkeypatch.setattr(gather, "WHITE", Texture(np.full((1, 1, 3), 0.5)))
    grey = rendered(plain_scene(), device=device, shader="nolight", forced={"TEXTURED"})
    covered = lean.alpha > 0
    assert (lean.rgb[covered] == 1.0).all()
    assert (grey.rgb[covered] == 0.5).all()


def test_indices_of_what_nobody_reads_are_not_taken_for_vertices(device):
    """Ten normals and one texture coordinate, each with indices, in a mesh of 90 vertices that is lit and textured only
    because these features are forced."""
    first, second = plain_scene().meshes
    indices = {"normal_faces": np.full((30, 3), 9), "uv_faces": np.zeros((30, 3), int)}
    mesh = replace(first, normals=np.eye(3)[np.arange(10) % 3], uvs=[[0.3, 0.4]], **indices)
    scene = replace(plain_scene(), meshes=(mesh, second), lights=())
    assert same_bits(
        rendered(scene, device=device, shader="phong"), rendered(scene, device=device, shader="phong", forced=OPTIONAL)
    )


# Messages


def test_what_is_left_out_and_what_it_saves(device, monkeypatch):
    monkeypatch.setattr(feature_savings, "FRAMES", 3)
    explanation = explain(plain_scene(), device=device, shader="phong")
    assert explanation.passed
    assert set(explanation.left_out) == set(OPTIONAL) - {"LIT", "DIFFUSE"}
    assert explanation.needed == ("LIT", "DIFFUSE")
    assert explanation.left_out["SPECULAR"] == "ks is 0"
    assert explanation.frames == 3
    assert explanation.bytes[1] - explanation.bytes[0] >= 61 * 47 * 4  # the owners, at least
    lean, full = explanation.ms
    assert {"frame", "sort"} <= set(lean) <= set(full)
    saved = full["frame"] - lean["frame"]
    low, middle, high = explanation.saved_ms
    assert low <= middle <= high
    assert abs(middle - saved) <= max(full["frame"], lean["frame"])
    text = "\n".join(explanation.lines())
    for words in ("highlights (SPECULAR): ks is 0", "the same bits", "medians of 3 frames"):
        assert words in text


def test_work_that_the_view_and_the_settings_do_without(device):
    scene = plain_scene()
    spare = replace(scene.meshes[0], verts=np.concatenate([scene.meshes[0].verts, np.zeros((7, 3))]))
    scene = replace(scene, meshes=(spare, scene.meshes[1]), lights=(*scene.lights, PointLight((0, 0, 1), (0, 0, 0))))
    unneeded = explain(scene, device=device).unneeded
    assert unneeded["vertices"] == "7 of 187 in no face"
    assert unneeded["lights"] == "1 of 3 of intensity 0"
    assert unneeded["clipping"].startswith("60 of 60 triangles")
    assert unneeded["layers"] == f"{', '.join(LAYERS)} not asked for"
    assert unneeded["shading"].endswith(f"of {61 * 47:,} pixels show no triangle")
    assert "perspective division" not in unneeded
    away = replace(scene, camera=replace(scene.camera, lookat=np.array([0.0, 0.0, -9.0])))
    unneeded = explain(away, device=device).unneeded
    assert "60 behind the eye, of 60" in unneeded["triangles"]
    assert unneeded["tiles"] == "12 of 12 hold no triangle"


@pytest.mark.long
def test_what_the_course_preset_does_without(device):
    frame = rendered(plain_scene(), device=device, preset="course", shader="nolight")
    savings = feature_savings._unneeded(frame)
    assert savings["depth at every pixel"] == f"visibility painter, {61 * 47:,} pixels"
    covered = np.count_nonzero(rendered(plain_scene(), device=device, shader="nolight").alpha)
    assert savings["perspective division"] == f"interpolation affine, {covered:,} pixels"
    assert savings["shading"].startswith(f"{61 * 47 - covered:,} of")


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
    assert explain(plain_scene(), device=device).frames == timing.FEWEST


def test_a_program_is_built_for_what_is_compiled_and_for_nothing_else(device, monkeypatch):
    """Not for another size, camera, light, material or texture, nor for layers or lines."""
    monkeypatch.setattr(programs, "_built", {})
    scene = plain_scene()
    rendered(scene, device=device, shader="phong")
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
        replace(SCENES[1].scene, preset="standard"),
    ):
        assert rendered(changed, device=device, shader="phong").alpha.any()
        assert programs.built() == before
    rendered(scene, device=device, shader="phong", samples=4)  # geometry and pixels again
    assert len(programs.built()) == len(before) + 2


@pytest.mark.parametrize("keeps_programs", [False, True], ids=["by us", "by the runtime"])
def test_a_program_is_compiled_once_and_then_loaded(opened, tmp_path, monkeypatch, keeps_programs):
    opened = replace(opened, keeps_programs=keeps_programs)
    monkeypatch.setattr(programs, "_built", {})
    monkeypatch.setattr(programs, "_stored_program", lambda *_: StoredProgram(tmp_path / "program"))
    text = f"kernel void new_{tmp_path.name}(void) {{}}"  # PoCL may know any other of this process
    loaded = []
    for _ in range(2):
        programs._built.clear()
        program = programs.build(opened, Features.of(), text)
        loaded.append(program.loaded)
    assert loaded == [False, True]


# The command line


@needs_device
def test_explain_is_printed_after_the_summary_and_in_the_figures(tmp_path, capsys):
    code, out, err = run(capsys, *SMALL, "-o", tmp_path / "a", "--explain")
    assert (code, err) == (0, [])
    assert out.startswith("scene")
    assert "texture lookups (TEXTURED): no texture" in out
    explanation = json.loads(run(capsys, *SMALL, "-o", tmp_path / "a", "--explain", "--stats")[1])["explain"]
    assert explanation["identical"] is True
    assert explanation["left_out"]["TEXTURED"] == "no texture"


@needs_device
def test_images_that_differ_are_a_failure(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(feature_savings, "same_bits", lambda *_: False)
    code, out, _ = run(capsys, *SMALL, "-o", tmp_path / "a", "--explain")
    assert code == FAILED
    assert "images: FAILED, they differ" in out


def test_every_feature_has_a_name_for_people():
    assert set(feature_savings.WORK) == {*OPTIONAL, "BACKDROP"}
