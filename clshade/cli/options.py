"""Options declared as attributes of classes, the conversion of their texts, refusals, and the argument parser, whose errors
are one line that says what to write instead."""

from __future__ import annotations

import argparse
import math
import os
import re
import sys
from argparse import ArgumentParser
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NoReturn

from ..base import console
from ..base.spelling import hint, nearest
from ..errors import InputError
from ..measure.defaults import PIXELS
from . import REFUSED


class Option:
    """An option, declared once as the attribute of a class: from it come its help and the argument of `keywords`.

    text: its names, the form of its value and its help, as in "-o, --output OUT: the image". Without a form it is a flag,
    --[no-]flag one that can be taken back; a form such as fit|file lists the choices; a name without dashes is that of an
    argument. default: the help says it too. either: a name; of the options that share it, a command takes at most
    one. facts: further arguments of `add_argument`.
    """

    def __init__(
        self, text: str, read: Callable[[str], Any] = str, default: Any = None, *, either: str = "", **facts: Any
    ) -> None:
        head, about = text.split(": ", 1)
        words = head.replace(", ", " ").split()
        self.names = [word.replace("[no-]", "") for word in words if word.startswith("-")]
        form = " ".join(words[len(self.names) or 1 :])
        self.default, self.either = default, either
        if isinstance(default, (str, int, float)) and default is not False:
            about += f" (default: {default:g})" if isinstance(default, float) else f" (default: {default})"
        self.facts: dict[str, Any] = {"help": about, "default": default}
        if "[no-]" in head:
            self.facts["action"] = argparse.BooleanOptionalAction
        elif "|" in form and form.islower():
            self.facts["choices"] = tuple(form.split("|"))
        elif form:
            self.facts |= {"type": read, "metavar": form}
        elif not {"action", "choices"} & facts.keys():
            self.facts["action"] = "store_true"
        self.facts |= facts
        long = next((name[2:] for name in self.names if name.startswith("--")), words[0])
        self.dest: str = facts.get("dest", long.replace("-", "_"))  # its name among the parsed arguments


class Group:
    """Options beneath a title, as a class with the attribute `title` has them. kinds: options, or classes of some."""

    def __init__(self, title: str, *kinds: Option | type | Group) -> None:
        self.title = title
        for kind in kinds:
            vars(self).update({kind.dest: kind} if isinstance(kind, Option) else options_of(kind))


def options_of(kind: type | Group) -> dict[str, Option]:
    """Return the options of a group, by the names of its attributes."""
    return {name: option for name, option in vars(kind).items() if isinstance(option, Option)}


def names_of(*kinds: type | Group) -> list[str]:
    """Return the names among the parsed arguments of the options of groups."""
    return [option.dest for kind in kinds for option in options_of(kind).values()]


def add_options(parser: ArgumentParser, *kinds: type | Group) -> None:
    """Add options beneath the titles of their groups; those of a class without a title are arguments of the command."""
    for kind in kinds:
        name = getattr(kind, "title", "")
        group = {group.title: group for group in parser._action_groups}.get(name)
        target = group or (parser.add_argument_group(name) if name else parser)
        groups: dict[str, argparse._ActionsContainer] = {"": target}
        for option in options_of(kind).values():
            if option.either not in groups:
                groups[option.either] = target.add_mutually_exclusive_group()
            groups[option.either].add_argument(*(option.names or [option.dest]), **option.facts)


class Arguments(argparse.Namespace):
    """The arguments of a command line, by the names of the options."""

    parser: ArgumentParser  # of the command

    def get(self, name: str) -> Any:
        """Return the value of an option, None if the command lacks it."""
        return getattr(self, name, None)

    def keywords(self, *kinds: type) -> dict[str, Any]:
        """Return the values of the options of classes that are set, by the names of their attributes."""
        options = {name: option for kind in kinds for name, option in options_of(kind).items()}
        values = {name: getattr(self, option.dest) for name, option in options.items()}
        return {name: value for name, value in values.items() if value not in (None, options[name].default)}

    def is_set(self, name: str) -> bool:
        """Return whether an option has another value than its default."""
        return bool(self.get(name) != self.parser.get_default(name))

    def as_options(self, names: Iterable[str]) -> list[str]:
        """Return the arguments of a command that set these options, without those at their defaults."""
        from ..base.declare import as_option

        return [as_option(name, getattr(self, name)) for name in dict.fromkeys(names) if self.is_set(name)]

    def refuse(self, names: Iterable[str], why: str) -> None:
        """Raise InputError for the first of these options that is set. why: what it needs, or cannot go with."""
        for name in filter(self.is_set, names):
            raise InputError(f"--{'no-' * (self.get(name) is False)}{name.replace('_', '-')}: {why}")

    def print_result(self, figures: Callable[[], Any], lines: Callable[[], Iterable[str]]) -> None:
        """Print the figures as JSON if --json asks for it, else the lines."""
        import json

        print(json.dumps(figures(), indent=2) if self.get("json") else "\n".join(lines()))


# Conversion of texts


def reader(convert: Callable[[str], Any], form: str) -> Callable[[str], Any]:
    """Return the conversion, with a refusal that names the form of texts for which it raises ValueError."""

    def read(text: str) -> Any:
        try:
            return convert(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"expected {form}, found {text!r}") from None

    return read


def number_from(kind: Callable[[str], Any], low: float, form: str, *, above: bool = False) -> Callable[[str], Any]:
    """Return a reader of finite numbers from `low` on, or above it."""

    def convert(text: str) -> Any:
        value = kind(text)
        if not low <= value < math.inf or (above and value == low):
            raise ValueError(text)
        return value

    return reader(convert, form)


def _milliseconds(text: str) -> float:
    parts = re.fullmatch(r"\s*([0-9.]+(?:e[+-]?[0-9]+)?)\s*(s|ms|us|)\s*", text, re.IGNORECASE)
    return float(parts[1]) * {"s": 1e3, "ms": 1.0, "us": 1e-3, "": 1.0}[parts[2].lower()] if parts else math.nan


def numbers(kind: type, counts: Sequence[int], form: str, separators: str = ",") -> Callable[[str], Any]:
    """Return a reader of tuples of numbers. counts: how many, if not any number of them."""

    def convert(text: str) -> tuple[Any, ...]:
        values = tuple(kind(part) for part in re.split(f"[{separators}]", text))
        if counts and len(values) not in counts:
            raise ValueError(text)
        return values

    return reader(convert, form)


integer, real = reader(int, "a whole number"), reader(float, "a number")
from_1 = number_from(int, 1, "a whole number from 1 on")
seconds = number_from(float, 0.0, "seconds above 0 such as 30", above=True)
max_error = number_from(float, 0.0, "an error above 0 such as 1e-3", above=True)
milliseconds = number_from(_milliseconds, 0.0, "a time above 0 such as 5ms or 0.005s", above=True)
resolution = numbers(int, [2], "two whole numbers such as 800,600 or 800x600", ",xX×")
point = numbers(float, [3], "three numbers such as 1,2,3")


def names(allowed: Sequence[str], **others: Any) -> Callable[[str], Any]:
    """Return a reader of tuples of names. others: further names known to `spelling.hint`."""

    def read(text: str) -> tuple[str, ...]:
        values = tuple(part.strip() for part in text.split(",") if part.strip())
        for value in values or ("",):
            if value not in allowed:
                near = hint(value, allowed, **others)
                raise argparse.ArgumentTypeError(f"expected names of {', '.join(allowed)}, found {value!r}{near}")
        return values

    return read


def color(text: str, names: Sequence[str] = ()) -> str:
    """Check a color, see `images.colors.linear_rgb`, or one of some names, and return it unchanged."""
    from ..images.colors import linear_rgb

    try:
        if text not in names:
            linear_rgb("", "", text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error).removeprefix(": : ")) from None
    return text


def output_name(text: str) -> str:
    """Check an output name: not empty, which would become the default or `.exr`, nor a device, pipe or socket, beside which
    files would appear: `/dev/null` would become /dev/null.exr."""
    is_device = os.path.exists(text) and not os.path.isfile(text) and not os.path.isdir(text)
    if not text or is_device:
        found = f"{text!r}{', a device, pipe or socket' if is_device else ''}"
        raise argparse.ArgumentTypeError(f"expected the name of a file or folder, found {found}")
    return text


# Options of several commands


_PLATFORMS = "pocl, intel, nvidia, rusticl, part of a platform's name, or P:D"
DEVICE = Group("", Option(f"--device DEVICE: {_PLATFORMS} (default: CLSHADE_DEVICE, PoCL)"))
JSON = Group("", Option("--json: print all figures as JSON"))


class Limits:
    budget = Option(
        "--budget TIME: the most accurate variant within 5ms, 0.005s or 5 (ms) a frame", milliseconds, either="limit"
    )
    tolerance = Option(
        "--tolerance RMSE: the fastest variant with at most this error, such as 1e-3", max_error, either="limit"
    )


def is_scene(name: str) -> bool:
    """Return whether a name is a scene's: of a file with a scene's extension, or without one if there is no such file."""
    from ..scene.formats.table import EXTENSIONS

    ending = os.path.splitext(name)[1].lower()
    return ending in EXTENSIONS or (not ending and not os.path.exists(name))


def check_scene_name(name: str, otherwise: str = "") -> None:
    """Refuse a name without extension that is neither a file's nor a built-in scene's. otherwise: a hint, if no scene has
    a similar name."""
    from ..scene.builtin.scenes import BUILTINS

    if not os.path.splitext(name)[1] and name not in BUILTINS and not os.path.exists(name):
        near = hint(name, BUILTINS) or otherwise
        raise InputError(f"SCENE: expected a file or one of {', '.join(BUILTINS)}, found {name!r}{near}")


def check_output_file(output: str, inputs: Sequence[str], endings: Sequence[str], option: str = "--output") -> None:
    """Refuse, before anything is read, an output file that cannot be written, has none of the endings, or would
    overwrite one of the input files."""
    from ..base import atomic_files

    if os.path.splitext(output)[1].lower() not in endings:
        expected = f"a file name that ends in {' or '.join(endings)}"
        raise InputError(f"{option}: expected {expected}, found {atomic_files.shown(output)}")
    atomic_files.check(output)
    for name in inputs:
        if os.path.exists(output) and os.path.exists(name) and os.path.samefile(output, name):
            raise InputError(f"{option}: {atomic_files.shown(output)} is read: choose another file")


def join_values(arguments: Sequence[str]) -> list[str]:
    """Join options with values that argparse would misread.

    `--up -x` becomes `--up=-x`, and `--camera-position -1,2,3` likewise: argparse takes what begins with a dash and is not
    a single number for an option. `--check SCENE` becomes `--check=4096 SCENE`, unless it is a number.
    """
    joined: list[str] = []
    for argument in arguments:
        before = joined[-1] if joined else ""
        if before == "--check" and not re.fullmatch(r"-.*|all|\s*\+?[\d.]+(e[+-]?\d+)?\s*", argument, re.DOTALL):
            joined[-1:] = [f"--check={PIXELS}", argument]  # the next argument is the scene
        elif re.fullmatch(r"-([xyz]|\.?\d.*)", argument) and re.fullmatch(r"--[a-z-]+", before):
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined


# The parser

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


class Parser(argparse.ArgumentParser):
    """Argument parser with one-line errors, without the usage, and with the nearest valid name as a hint."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._arguments: list[str] = []
        self.register("type", int, integer)
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
        for early in before:
            if early.startswith("-") and early not in self._option_string_actions:
                return f": {early} belongs after the command, as in `clshade render {early} ...`"
        ending = os.path.splitext(name)[1].lower()
        if name in BUILTINS or ending in (*EXTENSIONS, ".exr", ".png"):
            return f": did you mean `clshade {'inspect' if ending in ('.exr', '.png') else 'render'} {name}`?"
        return hint(name, commands, _COMMAND_WORDS, remarks=_REMARKS)

    def parse_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        self._arguments = list(args or ())
        parsed, left = self.parse_known_args(args, namespace or Arguments())
        command: Parser = getattr(parsed, "parser", self)
        option = next((text for text in left if text.startswith("-") and text != "-"), None)
        if option is not None:
            flag = option.partition("=")[0]
            flags = [name[2:] for name in command._option_string_actions if name.startswith("--")]
            near = nearest(flag.lstrip("-"), flags, _WORDS)
            command.error(f"there is no option {flag}" + (f": did you mean --{near}?" if near else ""))
        if getattr(parsed, "command", "") is None:
            self.error("expected a COMMAND, such as render: `clshade --help` lists all")
        if left and getattr(parsed, "cameras", "") is None:  # argparse looks for an optional one beside SCENE alone
            parsed.cameras = left.pop(0)
        if left and hasattr(parsed, "scenes"):  # argparse collects only those before the first option
            try:
                for name in left:  # it may be a further value of an option
                    check_scene_name(name, ": values of one option have commas between them, and no blanks")
            except InputError as error:
                command.error(str(error))
            parsed.scenes = [*parsed.scenes, *left]
        elif left and hasattr(parsed, "files"):
            parsed.files = [*parsed.files, *left]
        elif left:
            names = " and ".join(str(action.metavar) for action in command._get_positional_actions())
            command.error(f"expected {f'{names} alone' if names else 'options alone'}, found {left[0]!r} too")
        return parsed


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
        groups = {str(group.title): group for group in parser._action_groups}
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
