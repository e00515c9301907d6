"""`--help` of a command with many options: those that people use first, one topic, or all."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from ...base.spelling import hint

_SHOWN_AT_ONCE = 30  # options; a command with more shows the first ones
_FIRST = (  # names in the namespace, in the order of the short help
    *("output", "out", "frames", "count", "fps", "against", "resolution", "preset", "samples", "camera"),
    *("look", "camera_azimuth_angle", "camera_elevation_angle", "background", "layers", "scalars", "views"),
    *("workers", "open", "details", "html", "course", "case", "device", "check"),
)
_WORDS = {"light": "lights", "shadows": "lights", "environment": "lights", "files": "output", "data": "scalars"}


def add_help(parser: argparse.ArgumentParser) -> None:
    """Add `--help [TOPIC]`. A topic is the first word in the title of an argument group."""
    parser.add_argument(
        "-h",
        "--help",
        action=_Help,
        nargs="?",
        default=argparse.SUPPRESS,
        metavar="TOPIC",
        help="show the first options, those of a topic, or `all`, and exit",
    )


class _Help(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, namespace: Any, topic: Any, option: str | None = None) -> None:
        """Print what was asked for, and exit."""
        topics = _topics(parser)
        if topic is not None and topic != "all" and topic not in topics:
            near = hint(topic, topics, _WORDS)
            raise argparse.ArgumentError(self, f"expected one of all, {', '.join(topics)}, found {topic!r}{near}")
        options = [action for action in parser._actions if action.option_strings]
        if topic in topics:
            text = _formatted(parser, {str(topics[topic].title): topics[topic]._group_actions})
        elif topic == "all" or len(options) <= _SHOWN_AT_ONCE:
            text = _formatted(parser, {str(group.title): group._group_actions for group in parser._action_groups})
        else:
            by_name = {action.dest: action for action in options}
            first = [by_name[name] for name in _FIRST if name in by_name]
            text = _formatted(parser, {"arguments": parser._get_positional_actions(), "first options": first})
            text += f"\nall {len(options)} options: --help all; those of one topic: --help TOPIC\n"
            abouts = {name: str(group.title).partition(": ")[2] for name, group in topics.items()}
            text += "".join(
                f"  {name:<{max(map(len, topics))}}  {about}".rstrip() + "\n" for name, about in abouts.items()
            )
        parser._print_message(text, sys.stdout)
        parser.exit()


def _topics(parser: argparse.ArgumentParser) -> dict[str, argparse._ArgumentGroup]:
    """Return the argument groups with a title of the command's own, by its first word."""
    usual = parser._positionals, parser._optionals
    return {str(g.title).partition(":")[0].split()[0]: g for g in parser._action_groups if g not in usual}


def _formatted(parser: argparse.ArgumentParser, shown: dict[str, list[argparse.Action]]) -> str:
    """Return the help on these actions, by the title of their section."""
    formatter = parser._get_formatter()
    options = argparse._StoreAction([], "options", nargs="*", metavar="OPTION")
    formatter.add_usage(None, [options, *parser._get_positional_actions()], [])
    for title, actions in shown.items():
        formatter.start_section(title)
        formatter.add_arguments(actions)
        formatter.end_section()
    return formatter.format_help()
