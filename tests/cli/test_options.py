"""Options as classes declare them."""

from __future__ import annotations

import argparse

import pytest

from clshade.cli.options import Arguments, Option, add_options


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


def test_options_have_the_names_forms_and_defaults_of_their_text():
    actions = {action.dest: action for action in parsed().parser._actions}
    output, size, lit = actions["output"], actions["size"], actions["lit"]
    assert (output.option_strings, output.metavar, output.help) == (
        ["-o", "--output"],
        "FILE",
        "where to: a file (default: out)",
    )
    assert (size.metavar, size.type, size.help) == ("N", int, "pixels (default: 3)")
    assert (lit.option_strings, lit.help) == (["--lit", "--no-lit"], "with light (default: by day)")
    assert actions["kind"].choices == ("fast", "exact")
    assert (actions["names"].option_strings, actions["names"].metavar) == ([], "NAME")
    (group,) = (group for group in parsed().parser._action_groups if group.title == Fields.title)
    assert len(group._group_actions) == 6


def test_options_that_are_set_are_keyword_arguments():
    assert parsed().keywords(Fields) == {"names": []}
    assert parsed("-o", "out", "--size", "3", "a").keywords(Fields) == {"names": ["a"]}
    found = parsed("--full-size", "--no-lit", "--kind", "exact", "-o", "x").keywords(Fields)
    assert found == {"path": "x", "full": True, "lit": False, "kind": "exact", "names": []}


def test_of_options_that_exclude_each_other_one_is_given(capsys):
    with pytest.raises(SystemExit):
        parsed("--size", "4", "--full-size")
    assert "not allowed with" in capsys.readouterr().err
