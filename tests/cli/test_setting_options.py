"""Each setting has an option, as its declaration says."""

from __future__ import annotations

import argparse
from dataclasses import fields

import pytest

from clshade.cli.main import _parser
from clshade.scene.edges import Edges
from clshade.scene.settings import LIGHT_FIELDS, PRESET_FIELDS, Settings


def options_of(command: str) -> dict[str, argparse.Action]:
    return {action.dest: action for action in _parser([command]).parse_args([command, "teapot"]).parser._actions}


@pytest.mark.parametrize("command", ["render", "turntable", "animate", "stability", "poster"])
def test_each_setting_has_an_option(command):
    found = options_of(command)
    for each in fields(Settings):
        declared, option = each.metadata["declared"], found[each.name]
        if each.name == "edges":  # whose option is that of Edges.kinds
            declared = Edges.__dataclass_fields__["kinds"].metadata["declared"]
        assert option.help.startswith(declared.about)
        assert option.default is None
        assert option.metavar == declared.form
        assert tuple(option.choices or ()) == declared.choices


def test_what_options_say_of_defaults():
    found = {name: option.help.partition(" (default: ")[2].rstrip(")") for name, option in options_of("render").items()}
    assert found["light_samples"] == "16"
    assert found["resolve"] == "mean"
    assert found["ambient_occlusion"] == "0, or 16 with --shadows where an environment is the light"
    assert found["shader"] == found["cull"] == found["scalars"] == ""  # the preset's, off, none


def test_flags_that_a_preset_or_pictures_set_can_be_taken_back():
    found = options_of("render")
    by_presets = {name for changed in PRESET_FIELDS.values() for name in changed}
    flags = {each.name for each in fields(Settings) if isinstance(each.default, bool)}
    assert {name for name in flags if len(found[name].option_strings) == 2} == {"shadows", "sample_shading"}
    assert flags & by_presets == {"shadows"}


def test_a_report_takes_the_settings_of_light_alone():
    assert options_of("report").keys() & Settings.__dataclass_fields__.keys() == set(LIGHT_FIELDS)
