"""`render --explain`: the features left out, what leaving them out saves, and programs of what is compiled.

That it changes no bit: tests/pipeline/test_every_feature.py.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import SMALL, needs_device, run
from devices import rendered

from clshade.cli import FAILED
from clshade.images.layers import LAYERS
from clshade.measure.report import feature_savings
from clshade.measure.report.feature_savings import explain
from clshade.pipeline import programs
from clshade.pipeline.features import OPTIONAL
from clshade.scene.camera import Camera
from clshade.scene.model import Material, Mesh, PointLight, Scene

PIXELS = 61 * 47


def plain_scene(**fields) -> Scene:
    """Return sixty white triangles of one material, lit by one term of plain points, on black. fields: of the scene."""
    material = Material(ka=0.0, kd=0.6, ks=0.0)
    verts = np.float32(np.random.default_rng(4).uniform(-1, 1, (2, 90, 3)))
    meshes = tuple(Mesh(vertices, np.arange(90).reshape(-1, 3), material=material) for vertices in verts)
    camera = Camera((0.2, 0.5, -4.0), (0, 0, 0), (0, 1, 0), 4.0, (3.0, 3.0), (61, 47))
    lights = (PointLight((1, 2, -3)), PointLight((-3, 1, -2), (0.4, 0.5, 0.9)))
    return Scene(**{"meshes": meshes, "camera": camera, "lights": lights, **fields})


def test_what_is_left_out_and_what_it_saves(device, monkeypatch):
    monkeypatch.setattr(feature_savings, "FRAMES", 3)
    explanation = explain(plain_scene(), device=device, shader="phong")
    assert explanation.passed
    assert set(explanation.left_out) == set(OPTIONAL) - {"LIT", "DIFFUSE"}
    assert (explanation.needed, explanation.left_out["SPECULAR"]) == (("LIT", "DIFFUSE"), "ks is 0")
    assert explanation.frames == 3
    assert explanation.bytes[1] - explanation.bytes[0] >= PIXELS * 4  # the owners, at least
    text = "\n".join(explanation.lines())
    for words in ("highlights (SPECULAR): ks is 0", "the same bits", "medians of 3 frames"):
        assert words in text


def test_work_that_the_view_and_the_settings_do_without(device):
    first, second = plain_scene().meshes
    scene = plain_scene(meshes=(replace(first, verts=np.concatenate([first.verts, np.zeros((7, 3))])), second))
    scene = replace(scene, lights=(*scene.lights, PointLight((0, 0, 1), (0, 0, 0))))
    unneeded = explain(scene, device=device).unneeded
    assert unneeded["vertices"] == "7 of 187 in no face"
    assert unneeded["lights"] == "1 of 3 of intensity 0"
    assert unneeded["clipping"].startswith("60 of 60 triangles")
    assert unneeded["layers"] == f"{', '.join(LAYERS)} not asked for"
    assert unneeded["shading"].endswith(f"of {PIXELS:,} pixels show no triangle")
    assert "perspective division" not in unneeded
    away = replace(scene, camera=replace(scene.camera, lookat=np.array([0.0, 0.0, -9.0])))
    unneeded = explain(away, device=device).unneeded
    assert "60 behind the eye, of 60" in unneeded["triangles"]
    assert unneeded["tiles"] == "12 of 12 hold no triangle"


def test_a_program_is_built_for_what_is_compiled_and_for_nothing_else(device, monkeypatch):
    monkeypatch.setattr(programs, "_built", {})
    scene = plain_scene()
    rendered(scene, device=device, shader="phong")
    before = programs.built()
    assert len(before) == 2  # geometry and pixels
    material = replace(scene.meshes[0].material, kd=0.2, n=5.0, name="other")
    for changes in (
        {"camera": scene.camera.with_resolution((50, 20))},
        {"camera": replace(scene.camera, eye=(1.0, 2.0, -5.0), focal=2.0)},
        *({"lights": (PointLight((3, 3, -3)),) * count} for count in (0, 1, 2, 3, 40)),
        {"meshes": tuple(replace(mesh, material=material) for mesh in scene.meshes)},
        {"meshes": scene.meshes[:1]},
    ):
        assert rendered(replace(scene, **changes), device=device, shader="phong").alpha.any()
        assert programs.built() == before
    rendered(scene, device=device, shader="phong", samples=4)  # geometry and pixels again
    assert len(programs.built()) == len(before) + 2


@pytest.mark.long
@needs_device
def test_the_command(tmp_path, capsys, monkeypatch):
    command = (*SMALL, "-o", tmp_path / "a", "--explain")
    code, out, err = run(capsys, *command)
    assert (code, err) == (0, [])
    assert out.startswith("scene")
    assert "texture lookups (TEXTURED): no texture" in out
    explanation = json.loads(run(capsys, *command, "--stats")[1])["explain"]
    assert (explanation["identical"], explanation["left_out"]["TEXTURED"]) == (True, "no texture")
    monkeypatch.setattr(feature_savings, "same_bits", lambda *_: False)
    code, out, _ = run(capsys, *command)
    assert (code, "images: FAILED, they differ" in out) == (FAILED, True)
