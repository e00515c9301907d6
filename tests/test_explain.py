"""`render --explain`: what was left out, and that leaving out saves work and changes no bit."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from devices import working_devices
from test_cli import run

from clshade import commands, features, packing, programs
from clshade.checks import explaining, timing
from clshade.features import CHOICES, OPTIONAL, Features
from clshade.frame import Frame, same_bits
from clshade.renderer import Renderer
from clshade.scene import Camera, Material, Mesh, PointLight, Scene, Texture

needs_device = pytest.mark.skipif(not working_devices(), reason="no OpenCL device works here")
SMALL = ("render", "quads", "--resolution", "32,24", "--preset", "course")


# Each feature alone


def rich_scene(without: str = "") -> Scene:
    """Sixty triangles whose image needs every optional feature but this one."""
    generator = np.random.default_rng(4)
    texture = Texture(generator.uniform(0.2, 1, (5, 6, 3)))
    given = {"ka": 0.3, "kd": 0.6, "ks": 0.5, "n": 12.0, "texture": texture}
    given |= {"AMBIENT": {"ka": 0.0}, "DIFFUSE": {"kd": 0.0}, "SPECULAR": {"ks": 0.0}, "POWER": {"n": 1.0}}.get(
        without, {}
    )
    if without == "TEXTURED":
        given["texture"] = None
    materials = (Material(**given), Material(**{**given, "ka": 1.5 * given["ka"], "kd": 0.5 * given["kd"]}))
    meshes = []
    for material in materials if without != "MATERIALS" else (materials[0], materials[0]):
        colors = None if without == "VERTEX_COLORS" else generator.uniform(0.2, 1, (90, 3))
        verts, uvs = generator.uniform(-1, 1, (90, 3)), generator.uniform(0, 2, (90, 2))
        meshes.append(Mesh(verts, np.arange(90).reshape(-1, 3), colors=colors, uvs=uvs, material=material))
    camera = Camera((0.2, 0.5, -4.0), (0, 0, 0), (0, 1, 0), 4.0, (3.0, 3.0), (61, 47))
    return Scene(tuple(meshes), camera, (PointLight((1, 2, -3)), PointLight((-3, 1, -2), (0.4, 0.5, 0.9))), ambient=0.7)


def plain_scene(term: str) -> Scene:
    """Sixty white triangles of one material, lit by one term alone."""
    scene = rich_scene("VERTEX_COLORS")
    material = Material(ka=0.5 * (term == "AMBIENT"), kd=0.6 * (term == "DIFFUSE"), ks=0.0)
    return replace(scene, meshes=tuple(replace(mesh, material=material) for mesh in scene.meshes))


def with_features(monkeypatch: pytest.MonkeyPatch, on: set[str]) -> None:
    """Renderers made from now on have exactly these optional features."""

    def derive(*arguments, **options) -> Features:
        needed = features.derive(*arguments, **options)
        assert {name for name in OPTIONAL if needed[name]} <= on
        return Features((*((name, needed[name]) for name in CHOICES), *((name, int(name in on)) for name in OPTIONAL)))

    monkeypatch.setattr(packing, "derive", derive)


def draw(device, scene: Scene, shader: str, layers: tuple[str, ...]) -> Frame:
    with Renderer(scene, device=device, shader=shader, layers=layers) as renderer:
        return renderer.render()


def needed_by(device, scene: Scene, shader: str, layers: tuple[str, ...]) -> set[str]:
    return set(draw(device, scene, shader, layers).stats["features"]) & set(OPTIONAL)


EVERY_DAY = ("TEXTURED",)  # each mask is a program to build
SHADERS = ["phong", pytest.param("gouraud", marks=pytest.mark.long)]
NAMES = [pytest.param(name, marks=[] if name in EVERY_DAY else pytest.mark.long) for name in OPTIONAL]


@pytest.mark.parametrize("shader", SHADERS)
@pytest.mark.parametrize("name", NAMES)
def test_a_feature_turned_off_alone_changes_no_bit(device, monkeypatch, name, shader):
    """Where a scene needs all but one, this one on or off gives the same image; and it is off by itself."""
    scene, layers = rich_scene(name), () if name == "OWNERS" else ("Z",)
    lean = draw(device, scene, shader, layers)
    off = {"POWER", "SPECULAR"} if name == "SPECULAR" else {name}
    assert set(lean.stats["left_out"]) == off
    assert set(OPTIONAL) - set(lean.stats["features"]) == off
    with_features(monkeypatch, set(OPTIONAL))
    full = draw(device, scene, shader, layers)
    assert set(OPTIONAL) <= set(full.stats["features"])
    assert same_bits(lean, full)
    assert len(np.unique(lean.rgb)) > 100


@pytest.mark.parametrize("shader", SHADERS)
@pytest.mark.parametrize("name", NAMES)
def test_a_feature_turned_on_alone_changes_no_bit(device, monkeypatch, name, shader):
    """Where a scene needs one other only, this one on or off gives the same image."""
    term = "AMBIENT" if name == "DIFFUSE" else "DIFFUSE"
    scene = plain_scene(term)
    lean = draw(device, scene, shader, ())
    assert set(lean.stats["features"]) & set(OPTIONAL) == {term}
    with_features(monkeypatch, {term, name})
    assert same_bits(lean, draw(device, scene, shader, ()))
    assert lean.alpha.mean() > 0.2


def test_every_feature_can_be_needed(device):
    assert needed_by(device, rich_scene(), "phong", ("Z",)) == set(OPTIONAL)


def test_an_image_that_needs_a_feature_changes_without_it(device, monkeypatch):
    """Which shows that the tests above can fail."""
    scene = rich_scene()
    right = draw(device, scene, "phong", ("Z",))
    without = rich_scene("TEXTURED")
    with_features(monkeypatch, set(OPTIONAL))
    assert not same_bits(right, draw(device, without, "phong", ("Z",)))


# What is said


def test_what_is_left_out_and_what_it_saves(device):
    found = explaining.explain(plain_scene("DIFFUSE"), frames=3, device=device, shader="phong")
    assert found.passed
    assert set(found.left_out) == set(OPTIONAL) - {"DIFFUSE"}
    assert found.needed == ("DIFFUSE",)
    assert found.left_out["SPECULAR"] == "ks is 0"
    assert found.frames == 3
    assert found.bytes_saved >= 61 * 47 * 4  # the owners, at least
    assert set(found.lean.ms) == set(found.full.ms) >= {"frame", "sort"}
    low, saved, high = found.ms_saved
    assert low <= saved <= high
    assert abs(saved) < found.lean.ms["frame"] + found.full.ms["frame"]
    text = "\n".join(found.lines())
    assert "highlights (SPECULAR): ks is 0" in text
    assert "the same bits" in text
    assert "medians of 3 frames" in text
    json.dumps(found.stats())


def test_images_that_differ_are_a_failure(device, monkeypatch):
    monkeypatch.setattr(explaining, "same_bits", lambda *_: False)
    found = explaining.explain(plain_scene("DIFFUSE"), frames=1, device=device)
    assert not found.passed
    assert "FAILED" in "\n".join(found.lines())


def test_where_everything_is_needed_nothing_is_saved(device):
    found = explaining.explain(rich_scene(), device=device, layers=("Z",))
    assert (found.frames, found.left_out, found.ms_saved, found.bytes_saved) == (0, {}, (0.0, 0.0, 0.0), 0)
    assert "saved: nothing" in "\n".join(found.lines())


def test_work_that_the_view_and_the_settings_do_without(device):
    scene = plain_scene("DIFFUSE")
    spare = replace(scene.meshes[0], verts=np.concatenate([scene.meshes[0].verts, np.zeros((7, 3))]), uvs=None)
    scene = replace(scene, meshes=(spare, scene.meshes[1]), lights=(*scene.lights, PointLight((0, 0, 1), (0, 0, 0))))
    unneeded = explaining.explain(scene, frames=1, device=device).unneeded
    assert unneeded["vertices"] == "7 of 187 in no face"
    assert unneeded["lights"] == "1 of 3 of intensity 0"
    assert "clipping" in unneeded
    assert "perspective division" not in unneeded
    away = replace(scene, camera=replace(scene.camera, lookat=np.array([0.0, 0.0, -9.0])))
    assert "60 behind the eye, of 60" in explaining.explain(away, frames=1, device=device).unneeded["triangles"]


def test_no_more_frames_than_there_is_time_for(device, monkeypatch):
    monkeypatch.setattr(explaining, "SECONDS", 0.0)
    assert explaining.explain(plain_scene("DIFFUSE"), device=device).frames == timing.FEWEST


def test_programs_are_counted(device):
    explaining.explain(plain_scene("DIFFUSE"), frames=1, device=device)
    before = programs.built()
    found = explaining.explain(plain_scene("DIFFUSE"), frames=1, device=device)
    assert programs.built() == before  # the second time nothing is built
    assert found.compiled[0] + found.loaded[0] == len(before)
    assert all(program.seconds > 0.0 for program in before)
    moved = plain_scene("DIFFUSE")
    moved = replace(moved, camera=moved.camera.with_resolution((50, 20)), lights=(PointLight((3, 3, -3)),) * 3)
    explaining.explain(moved, frames=1, device=device)
    assert programs.built() == before


def test_a_program_is_compiled_once_and_then_loaded(opened, tmp_path, monkeypatch):
    monkeypatch.setattr(programs, "_built", {})
    monkeypatch.setattr(programs, "_stored_at", lambda *_: tmp_path / "binary")
    stored = []
    for _ in range(2):
        programs._built.clear()
        program = programs.build(opened, Features(tuple((name, 0) for name in CHOICES + OPTIONAL)), ("bilerp.cl",))
        stored.append(program.stored)
    assert stored == [False, True]


# The command line


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
def test_images_that_differ_are_an_exit_code(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(explaining, "same_bits", lambda *_: False)
    assert run(capsys, *SMALL, "-o", tmp_path / "a", "--explain")[0] == commands.FAILED


def test_every_feature_has_a_name_for_people():
    assert set(explaining.WORK) == set(OPTIONAL)
