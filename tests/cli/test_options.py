"""Options as classes declare them; each setting has one, as its declaration says."""

from __future__ import annotations

import argparse
from dataclasses import fields

import pytest

from clshade.cli.main import _parser
from clshade.cli.options import Arguments, Option, add_options
from clshade.scene.settings import LIGHT_FIELDS, PRESET_FIELDS, Edges, Settings


class Fields:
    title = "some: of a test"
    path = Option("-o, --output FILE: where to: a file", default="out")
    size = Option("--size N: pixels", int, 3, either="size")
    full = Option("--full-size: all of them", either="size")
    lit = Option("--[no-]lit: with light (default: by day)")
    kind = Option("--kind fast|exact: of the arithmetic")
    names = Option("names NAME: of scenes", nargs="*")


def parsed(*arguments: str) -> Arguments:
    parser = argparse.ArgumentParser()
    add_options(parser, Fields)
    parser.set_defaults(parser=parser)
    return parser.parse_args(arguments, Arguments())


def test_options_that_are_set_are_keyword_arguments(capsys):
    assert parsed().keywords(Fields) == {"names": []}
    assert parsed("-o", "out", "--size", "3", "a").keywords(Fields) == {"names": ["a"]}
    keywords = parsed("--full-size", "--no-lit", "--kind", "exact", "-o", "x").keywords(Fields)
    assert keywords == {"path": "x", "full": True, "lit": False, "kind": "exact", "names": []}
    with pytest.raises(SystemExit):
        parsed("--size", "4", "--full-size")
    assert "not allowed with" in capsys.readouterr().err


# Settings


def options_of(command: str) -> dict[str, argparse.Action]:
    return {action.dest: action for action in _parser([command]).parse_args([command, "teapot"]).parser._actions}


@pytest.mark.parametrize("command", ["render", "turntable", "stability", "poster"])
def test_each_setting_has_an_option(command):
    options = options_of(command)
    for field in fields(Settings):
        declared, option = field.metadata["declared"], options[field.name]
        if field.name == "edges":  # whose option is that of Edges.kinds
            declared = Edges.__dataclass_fields__["kinds"].metadata["declared"]
        assert option.help.startswith(declared.help)
        assert option.default is None
        assert option.metavar == declared.form
        assert tuple(option.choices or ()) == declared.choices


def test_flags_that_a_preset_or_pictures_set_can_be_taken_back():
    options = options_of("render")
    by_presets = {name for changed in PRESET_FIELDS.values() for name in changed}
    flags = {field.name for field in fields(Settings) if isinstance(field.default, bool)}
    assert {name for name in flags if len(options[name].option_strings) == 2} == {"shadows", "sample_shading"}
    assert flags & by_presets == {"shadows"}


def test_a_report_takes_the_settings_of_light_alone():
    assert options_of("report").keys() & Settings.__dataclass_fields__.keys() == set(LIGHT_FIELDS)
