"""Type checkers and editors see the public API as it is."""

from __future__ import annotations

import ast
from dataclasses import MISSING, fields
from pathlib import Path
from typing import get_args

import pytest

from clshade.base.declare import facts_of
from clshade.images import layers
from clshade.scene import camera, environment, lights, material, model, settings, texture


def test_the_keywords_of_render_are_the_fields_of_settings():
    names = [field.name for field in fields(settings.Settings)]
    assert list(settings.SettingsFields.__annotations__) == names
    assert set(settings.RenderOptions.__annotations__) == {*names, "resolution"}
    assert set(settings.FrameOptions.__annotations__) == {*names, "resolution", "preset", "settings"}
    assert not settings.SettingsFields.__required_keys__ | settings.FrameOptions.__required_keys__


CHOICES = {name: known.choices for name, known in facts_of(settings.Settings, "declared").items() if known.choices}


@pytest.mark.parametrize("field", CHOICES)
def test_a_choice_has_the_same_values_for_type_checkers(field):
    """Each value is accepted, and the annotations of the keyword and of the field both name the literal."""
    for value in CHOICES[field]:
        assert getattr(settings.Settings(**{field: value}), field) == {"fast": "float32"}.get(value, value)
    annotation = settings.SettingsFields.__annotations__[field].__forward_arg__
    assert get_args(getattr(settings, annotation)) == CHOICES[field]
    assert settings.Settings.__dataclass_fields__[field].type == annotation


@pytest.mark.parametrize(
    ("literal", "choices"),
    [
        (settings.Shader, settings.SHADERS),
        (settings.Precision, settings.PRECISIONS),
        (settings.Preset, settings.PRESETS),
        (texture.Wrap, texture.WRAPS),
        (material.Sides, material.SIDES),
    ],
)
def test_other_choices_too(literal, choices):
    assert get_args(literal) == choices


def test_layers_have_the_kinds_of_the_table():
    by_kind = {"uint32": layers.NumberLayer, "float64": layers.PointLayer, "real": layers.RealLayer}
    for kind, literal in by_kind.items():
        assert set(get_args(literal)) == {name for name, row in layers.LAYER_TABLE.items() if row.kind == kind}
    assert set(get_args(settings.Layer)) == set(layers.LAYERS)
    assert len(layers.LAYER_WORDS) == sum(len(row.words) for row in layers.LAYER_TABLE.values())


def test_operators_compressions_and_axes():
    from clshade.images import exr, tonemap
    from clshade.scene import framing

    assert get_args(tonemap.Operator) == tonemap.OPERATORS
    assert get_args(exr.Compression) == exr.COMPRESSIONS
    assert exr.COMPRESSIONS[-len(exr.LOSSY) :] == tuple(exr.LOSSY)
    assert get_args(framing.Up) == tuple(framing.UPS)


def typed_constructors(module) -> dict[str, list[tuple[str, str]]]:
    """Return parameters and defaults of the constructors declared for type checkers only, by class."""
    found = {}
    tree = ast.parse(Path(module.__file__).read_text())
    for each in (node for node in tree.body if isinstance(node, ast.ClassDef)):
        for block in (node for node in each.body if isinstance(node, ast.If)):
            assert ast.unparse(block.test) == "TYPE_CHECKING"
            function, *overloads = block.body
            assert isinstance(function, ast.FunctionDef)
            if not overloads:
                given = function.args
                defaults = [None] * (len(given.args) - len(given.defaults)) + given.defaults
                pairs = zip(given.args, defaults, strict=True)
                found[each.name] = [(a.arg, "" if d is None else ast.unparse(d)) for a, d in pairs][1:]
    return found


TYPED = {
    camera: {"Camera"},
    environment: {"Environment"},
    lights: {kind.__name__ for kind in lights.LIGHTS},
    model: {"Scene"},
    texture: {"Texture"},
}


@pytest.mark.parametrize("module", TYPED, ids=lambda module: module.__name__.rpartition(".")[2])
def test_the_constructors_for_type_checkers_are_those_of_the_classes(module):
    found = typed_constructors(module)
    assert set(found) == TYPED[module]
    for name, parameters in found.items():
        own = [(x.name, "" if x.default is MISSING else repr(x.default)) for x in fields(getattr(module, name))]
        shown = [
            (name, default if typed == "..." else typed)
            for (name, typed), (_, default) in zip(parameters, own, strict=True)
        ]
        assert shown == own


def accepted(annotation: str) -> str:
    """Return the type that a field accepts: the first of Converted."""
    tree = ast.parse(ALIASES.get(annotation, annotation)).body[0].value
    converted = isinstance(tree, ast.Subscript) and ast.unparse(tree.value) == "Converted"
    return ast.unparse(tree.slice.elts[0] if converted else tree)


ALIASES = dict.fromkeys(("Rows", "Indices"), "ArrayLike | None")


def test_the_keywords_of_a_mesh_are_its_fields():
    names = [(field.name, accepted(field.type)) for field in fields(model.Mesh)]
    (keywords,) = [
        node
        for node in ast.walk(ast.parse(Path(model.__file__).read_text()))
        if isinstance(node, ast.ClassDef) and node.name == "MeshFields"
    ]
    assert names[2:] == [(line.target.id, ast.unparse(line.annotation)) for line in keywords.body[1:]]
    assert [name for name, _ in names[:2]] == ["verts", "faces"]


RIGHT = """
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import clshade

light = clshade.PointLight((1, 2, 3), 0.5)
camera = clshade.Camera.from_fov((0, 0, 5), [0, 0, 0], np.array([0, 1, 0]), 35.0)
material = replace(clshade.Material(kd=(0.5, 0.4, 0.3), n=40), ks=0.0)
texture = clshade.Texture(np.zeros((2, 2, 3), np.uint8), wrap=("repeat", "clamp"))
mesh = clshade.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.array([[0, 1, 2]]), material=material)
mesh = clshade.Mesh(vertices=mesh.vertices, faces=mesh.faces, name="the same", uvs=[[0, 0]] * 3)
mesh = replace(clshade.Mesh(mesh.verts, mesh.faces, np.ones((3, 3))), instances=None, scalars={"heat": [1, 2, 3]})
scene = clshade.Scene([mesh], camera, [light], ambient=0.2, background=None)
scene = replace(scene, ambient=(0.1, 0.1, 0.1), lights=light)
sun, lamp = clshade.DirectionalLight((0, -1, 0)), clshade.SpotLight((0, 2, 0), (0, -1, 0), 3.0, attenuation="inverse-square")
panel = clshade.RectangleLight([0, 2, 0], right=(1, 0, 0), up=np.array([0, 0, 1]), intensity=3)
scene = replace(scene, lights=[sun, lamp, light, panel], environment=clshade.Environment(np.ones((1, 2, 3)), up=[0, 0, 1]))
frame = clshade.render(scene, shader="phong", layers=["Z", "id"], samples=4, resolution=(64, 48), preset="standard")
frame = clshade.render(scene, settings=clshade.Settings.from_preset("course", layers="all"), device="pocl")
with clshade.Renderer(scene, resolve="weighted", samples=8) as renderer:
    frames = [renderer.render(camera.with_resolution((32, 24)))]
    views = renderer.render_many((camera, camera), out={"Z": np.zeros((2, 600, 800), np.float32)})
shown: clshade.Frame = views[0]
depths: NDArray[np.float32] = views["Z"]
brighter: NDArray[np.floating] = frame.rgb * 2.0
numbers: NDArray[np.uint32] = frame["id"]
places: NDArray[np.float64] = frame["P"]
verts: NDArray[np.floating] = mesh.verts
placed: NDArray[np.float64] = mesh.instances
eye: NDArray[np.float64] = camera.eye
arms: NDArray[np.float64] = panel.right
sky: NDArray[np.float32] = texture.image
parts: tuple[clshade.Mesh, ...] = scene.meshes
wraps: tuple[str, str] = texture.wrap
lines: list[str] = frame.save("image", tonemap="aces", exposure=1.0, half=True, compression="piz")
error: float = clshade.check(frame, "all").error
warnings: list[str] = clshade.exr.write("a.exr", {"R": frame.rgb[..., 0]}, compression="zip", window="drawn")
lit: NDArray[np.float64] = clshade.course.light((0, 0, 0), (0, 0, 1), 1, (0, 0, 5), 0.1, 0.8, 0.5, 20, [], [])
numbered = clshade.farm.parse_frames("1..10")
cameras = clshade.farm.orbit(camera, numbered.numbers, numbered)
run = clshade.farm.draw_frames(scene, cameras, "out.##.exr", saving={"half": True}, preset="course", cull=True)
loaded = clshade.load("a.stl", texture=np.zeros((2, 2, 3)), up="z", crease=30)
"""

WRONG = {
    'clshade.render(scene, shadr="phong")': "shadr",
    'clshade.render(scene, shader="phongg")': "shader",
    'clshade.render(scene, layers=["z"])': "List item 0",
    'clshade.render(scene, preset="courses")': "preset",
    "clshade.Renderer(scene, sampels=4)": "sampels",
    'clshade.Settings(visibility="z-buffer")': "visibility",
    'clshade.Settings.from_preset("standard", resolution=(4, 4))': "resolution",
    'frame.rgb + "a"': "__add__",
    'frame.save("image", tonmap="aces")': "tonmap",
    'frame.save("image", compression="zap")': "compression",
    'clshade.load("a.stl", up="w")': "up",
    "clshade.Camera((0, 0, 5), (0, 0, 0), (0, 1, 0))": "Missing positional arguments",
    "clshade.PointLight()": "position",
    "clshade.Mesh(vertices=[], verts=[], faces=[])": "overload",
    "clshade.Mesh([], [], colour=None)": "overload",
    "clshade.Mesh(vertices=[], faces=[], name=1)": "overload",
    "clshade.Environment()": "image",
    "clshade.Texture(np.zeros((1, 1, 3)), wrap=1)": "wrap",
    "clshade.Scene()": "meshes",
    'clshade.course.render_object("phongg", **{})': "Literal",
    'clshade.farm.draw_frames(scene, {}, "a", saving={"halb": True})': "saving",
}


def checked_by_mypy(folder: Path, text: str) -> list[str]:
    """Return mypy's errors for a user's script, in the order of its lines."""
    from mypy import api

    script = folder / "script.py"
    script.write_text(text)
    given = ["--strict", "--no-incremental", "--config-file", "", "--ignore-missing-imports", "--follow-imports=silent"]
    out, problems, _ = api.run([*given, "--no-error-summary", "--hide-error-context", str(script)])
    assert not problems
    return [line for line in out.splitlines() if ": error: " in line]


@pytest.mark.long
def test_mypy_takes_right_calls_and_refuses_wrong_ones(tmp_path):
    pytest.importorskip("mypy", reason="mypy is not installed: pip install -e '.[lint]'")
    lines = RIGHT.splitlines()
    errors = checked_by_mypy(tmp_path, "\n".join([*lines, *WRONG]) + "\n")
    by_line: dict[int, list[str]] = {}
    for error in errors:
        by_line.setdefault(int(error.split("script.py:")[1].split(":")[0]), []).append(error)
    assert [error for number, found in by_line.items() if number <= len(lines) for error in found] == []
    for number, (call, named) in enumerate(WRONG.items(), len(lines) + 1):
        assert any(named in error for error in by_line.get(number, [])), (call, by_line.get(number))
