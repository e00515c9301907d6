"""The argument parser: each error is one line that says what to write instead."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from typing import Any, NoReturn

from ...base import console
from ...base.spelling import hint, nearest
from . import REFUSED
from .arguments import real, whole

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

    def __init__(self, *given: Any, **options: Any) -> None:
        super().__init__(*given, **options)
        self._given: list[str] = []
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
        from ...scene.builtin.scenes import BUILTINS
        from ...scene.formats.table import EXTENSIONS

        before = self._given[: self._given.index(name)] if name in self._given else []
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
        self._given = list(args or ())
        parsed, left = self.parse_known_args(args, namespace)
        command: Parser = getattr(parsed, "parser", self)
        option = next((text for text in left if text.startswith("-") and text != "-"), None)
        if option is not None:
            command.error(f"there is no option {option.partition('=')[0]}{command._option_hint(option)}")
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

    def _option_hint(self, option: str) -> str:
        known = [name[2:] for name in self._option_string_actions if name.startswith("--")]
        near = nearest(option.partition("=")[0].lstrip("-"), known, _WORDS)
        return f": did you mean --{near}?" if near else ""

    def _scene(self, name: str) -> str:
        """Check a scene that follows options: it may be a further value of an option, separated by a blank."""
        from ...scene.builtin.scenes import BUILTINS

        if not os.path.splitext(name)[1] and name not in BUILTINS and not os.path.exists(name):
            near = hint(name, BUILTINS) or ": values of one option have commas between them, and no blanks"
            self.error(f"argument SCENE: expected a file or a built-in scene, found {name!r}{near}")
        return name
