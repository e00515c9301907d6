"""Type checkers and editors see the public API as it is; mypy reads `typed_calls.py`."""

import ast
from dataclasses import fields
from pathlib import Path
from typing import get_args

from clshade.base.declare import facts_of
from clshade.images import exr, layers, tonemap
from clshade.scene import framing, material, model, settings, texture


def test_the_keywords_of_render_are_the_fields_of_settings():
    names = [field.name for field in fields(settings.Settings)]
    assert list(settings.SettingsFields.__annotations__) == names
    assert set(settings.RenderOptions.__annotations__) == {*names, "resolution"}
    assert set(settings.FrameOptions.__annotations__) == {*names, "resolution", "preset", "settings"}
    assert not settings.SettingsFields.__required_keys__ | settings.FrameOptions.__required_keys__
    choices = {name: facts.choices for name, facts in facts_of(settings.Settings, "declared").items() if facts.choices}
    assert "shader" in choices
    for name, values in choices.items():
        annotation = settings.SettingsFields.__annotations__[name].__forward_arg__
        assert get_args(getattr(settings, annotation)) == values
        assert settings.Settings.__dataclass_fields__[name].type == annotation


def test_choices_are_the_values_that_are_taken():
    for literal, values in (
        (settings.Shader, settings.SHADERS),
        (settings.Precision, settings.PRECISIONS),
        (settings.Preset, settings.PRESETS),
        (settings.Layer, layers.LAYERS),
        (texture.Wrap, texture.WRAPS),
        (material.Sides, material.SIDES),
        (tonemap.Operator, tonemap.OPERATORS),
        (exr.Compression, exr.COMPRESSIONS),
        (framing.Up, framing.UPS),
    ):
        assert set(get_args(literal)) == set(values)
    for kind, literal in {"uint32": layers.NumberLayer, "float64": layers.PointLayer, "real": layers.RealLayer}.items():
        assert set(get_args(literal)) == {name for name, row in layers.LAYER_TABLE.items() if row.kind == kind}
    assert len(layers.LAYER_WORDS) == sum(len(row.words) for row in layers.LAYER_TABLE.values())


def accepted(annotation: str) -> str:
    """Return the type that a field accepts: the first of Converted."""
    tree = ast.parse("ArrayLike | None" if annotation in ("Rows", "Indices") else annotation).body[0].value
    converted = isinstance(tree, ast.Subscript) and ast.unparse(tree.value) == "Converted"
    return ast.unparse(tree.slice.elts[0] if converted else tree)


def test_the_keywords_of_a_mesh_are_its_fields():
    names = [(field.name, accepted(field.type)) for field in fields(model.Mesh)]
    nodes = ast.walk(ast.parse(Path(model.__file__).read_text()))
    (keywords,) = (node for node in nodes if isinstance(node, ast.ClassDef) and node.name == "MeshFields")
    assert names[2:] == [(line.target.id, ast.unparse(line.annotation)) for line in keywords.body[1:]]
    assert [name for name, _ in names[:2]] == ["verts", "faces"]
