"""The argument parser: errors in one line that say what to write instead, and `--help` by topic."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from ..base import console
from ..base.spelling import hint, nearest
from . import REFUSED
from .options import Arguments, real, whole

# Names of options in other programs -> the option, if the command has it.
_WORDS = {
    **dict.fromkeys(("size", "width", "height", "dimensions", "res"), "resolution"),
    **dict.fromkeys(("spp", "aa", "msaa", "antialiasing"), "samples"),
    **dict.fromkeys(("aov", "aovs", "passes", "channels"), "layers"),
    **dict.fromkeys(("cmap", "lut"), "colormap"),
    **dict.fromkeys(("scalar", "data", "field", "array"), "scalars"),
    **dict.fromkeys(("range", "vmin", "vmax", "limits"), "clim"),
    **dict.fromkeys(("eye", "camera", "camera_eye"), "camera-position"),
    **dict.fromkeys(("lookat", "look_at", "target"), "camera-focal-point"),
    **dict.fromkeys(("fov", "fovy", "view_angle"), "camera-view-angle"),
    **dict.fromkeys(("azimuth",), "camera-azimuth-angle"),
    **dict.fromkeys(("elevation",), "camera-elevation-angle"),
    **dict.fromkeys(("ortho", "parallel"), "orthographic"),
    **dict.fromkeys(("format", "file", "outfile", "outdir", "output_dir", "o"), "output"),
    **dict.fromkeys(("force", "clobber"), "overwrite"),
    **dict.fromkeys(("jobs", "processes", "threads"), "workers"),
    **dict.fromkeys(("platform", "gpu", "cpu"), "device"),
    **dict.fromkeys(("eps", "epsilon", "atol", "tolerance", "max_error"), "threshold"),
    **dict.fromkeys(("silent",), "quiet"),
}
_COMMAND_WORDS = {
    **dict.fromkeys(("draw", "rendering"), "render"),
    **dict.fromkeys(("info", "stats"), "inspect"),
    **dict.fromkeys(("show", "open", "viewer", "display"), "view"),
    **dict.fromkeys(("diff", "cmp", "difference"), "compare"),
    **dict.fromkeys(("benchmark", "speed", "time"), "bench"),
    **dict.fromkeys(("device", "platforms", "list"), "devices"),
    **dict.fromkeys(("orbit", "spin"), "turntable"),
}
_REMARKS = {
    "help": "`clshade --help` lists all, `clshade COMMAND --help` explains one",
    "version": "`clshade --version` prints it",
}
_IMAGES = (".exr", ".png")


class Parser(argparse.ArgumentParser):
    """Argument parser with one-line errors, without the usage, and with the nearest valid name as a hint."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._arguments: list[str] = []
        self.register("type", int, whole)
        self.register("type", float, real)

    def error(self, message: str) -> NoReturn:
        self.exit(REFUSED, f"{self.prog}: {console.in_one_line(message)}\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Check as argparse does, with a hint; called for options with choices, and for the command's name."""
        if action.choices is None or value in action.choices:
            return
        allowed = tuple(map(str, action.choices))
        is_command = isinstance(action, argparse._SubParsersAction)
        near = self._command_hint(value, allowed) if is_command else hint(value, allowed)
        raise argparse.ArgumentError(action, f"expected one of {', '.join(allowed)}, found {value!r}{near}")

    def _command_hint(self, name: str, commands: Sequence[str]) -> str:
        """Return a hint for an unknown command: another command, a file, or the value of an option placed too early."""
        from ..scene.builtin.scenes import BUILTINS
        from ..scene.formats.table import EXTENSIONS

        before = self._arguments[: self._arguments.index(name)] if name in self._arguments else []
        early = next(
            (text for text in before if text.startswith("-") and text not in self._option_string_actions), None
        )
        if early is not None:
            return f": {early} belongs after the command, as in `clshade render {early} ...`"
        ending = os.path.splitext(name)[1].lower()
        if name in BUILTINS or ending in (*EXTENSIONS, *_IMAGES):
            return f": did you mean `clshade {'inspect' if ending in _IMAGES else 'render'} {name}`?"
        return hint(name, commands, _COMMAND_WORDS, remarks=_REMARKS)

    def parse_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        self._arguments = list(args or ())
        parsed, left = self.parse_known_args(args, namespace or Arguments())
        command: Parser = getattr(parsed, "parser", self)
        option = next((text for text in left if text.startswith("-") and text != "-"), None)
        if option is not None:
            named = option.partition("=")[0]
            known = [name[2:] for name in command._option_string_actions if name.startswith("--")]
            near = nearest(named.lstrip("-"), known, _WORDS)
            command.error(f"there is no option {named}" + (f": did you mean --{near}?" if near else ""))
        if getattr(parsed, "command", "") is None:
            self.error("expected a COMMAND, such as render: `clshade --help` lists all")
        if left and getattr(parsed, "cameras", "") is None:  # argparse looks for an optional one beside SCENE alone
            parsed.cameras = left.pop(0)
        if left and hasattr(parsed, "scenes"):  # argparse collects only those before the first option
            parsed.scenes = [*parsed.scenes, *map(command._scene, left)]
        elif left and hasattr(parsed, "files"):
            parsed.files = [*parsed.files, *left]
        elif left:
            names = " and ".join(str(action.metavar) for action in command._get_positional_actions())
            command.error(f"expected {f'{names} alone' if names else 'options alone'}, found {left[0]!r} too")
        return parsed

    def _scene(self, name: str) -> str:
        """Check a scene that follows options: it may be a further value of an option, separated by a blank."""
        from ..scene.builtin.scenes import BUILTINS

        if not os.path.splitext(name)[1] and name not in BUILTINS and not os.path.exists(name):
            near = hint(name, BUILTINS) or ": values of one option have commas between them, and no blanks"
            self.error(f"argument SCENE: expected a file or a built-in scene, found {name!r}{near}")
        return name


_SHOWN_AT_ONCE = 30  # options; the help of a command with more shows the first ones
_FIRST = (  # names in the namespace, in the order of the short help
    *("output", "out", "frames", "count", "fps", "against", "resolution", "preset", "samples", "camera"),
    *("look", "camera_azimuth_angle", "camera_elevation_angle", "background", "layers", "scalars", "views"),
    *("workers", "open", "details", "html", "course", "case", "device", "check"),
)
_TOPIC_WORDS = {
    "scenes": "scene",
    "light": "lights",
    "shadows": "lights",
    "environment": "lights",
    "files": "output",
    "data": "scalars",
}


def add_help(parser: argparse.ArgumentParser) -> None:
    """Add `--help [TOPIC]`. A topic is the first word in the title of an argument group."""
    about = "show the first options, those of a topic, or `all`, and exit"
    parser.add_argument("-h", "--help", action=_Help, nargs="?", default=argparse.SUPPRESS, metavar="TOPIC", help=about)


class _Help(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, namespace: Any, topic: Any, option: str | None = None) -> None:
        """Print the help, and exit."""
        usual = parser._positionals, parser._optionals
        groups = {str(each.title): each for each in parser._action_groups}
        topics = {title.partition(":")[0].split()[0]: title for title, g in groups.items() if g not in usual}
        if topic not in (None, "all", *topics):
            near = hint(topic, topics, _TOPIC_WORDS)
            raise argparse.ArgumentError(self, f"expected one of all, {', '.join(topics)}, found {topic!r}{near}")
        options = {action.dest: action for action in parser._actions if action.option_strings}
        sections = {title: group._group_actions for title, group in groups.items()}
        more = ""
        if topic in topics:
            sections = {topics[topic]: sections[topics[topic]]}
        elif topic is None and len(options) > _SHOWN_AT_ONCE:
            first = [options[name] for name in _FIRST if name in options]
            sections = {"arguments": parser._get_positional_actions(), "first options": first}
            count = sum(bool(action.option_strings) for action in parser._actions)
            width = max(map(len, topics))
            more = f"\nall {count} options: --help all; those of one topic: --help TOPIC\n"
            for name, title in topics.items():
                more += f"  {name:<{width}}  {title.partition(': ')[2]}".rstrip() + "\n"
        parser._print_message(_formatted(parser, sections) + more, sys.stdout)
        parser.exit()


def _formatted(parser: argparse.ArgumentParser, sections: dict[str, list[argparse.Action]]) -> str:
    """Return the help on some actions, by the titles of their sections."""
    formatter = parser._get_formatter()
    options = argparse._StoreAction([], "options", nargs="*", metavar="OPTION")
    formatter.add_usage(None, [options, *parser._get_positional_actions()], [])
    for title, actions in sections.items():
        formatter.start_section(title)
        formatter.add_arguments(actions)
        formatter.end_section()
    return formatter.format_help()
