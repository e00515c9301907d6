"""The command line: command dispatch, exit codes, one-line errors. A command's modules are imported when it runs."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Any, TextIO

from ..base import console, interrupts
from ..base.interrupts import INTERRUPTED
from ..errors import ClshadeError
from . import REFUSED, UNREAD
from .options import Parser, add_help, add_options, join_values

COMMANDS = {
    "render": "render a scene to OUT.exr and OUT.png",
    "turntable": "frames of a camera that goes round a scene, out.####.exr",
    "animate": "frames of the cameras in a JSON file, or of an animation in a glTF file, out.####.exr",
    "poster": "an image of any size, drawn in tiles and joined, poster.exr and poster.png",
    "devices": "what OpenCL devices were found, and which work",
    "report": "error against run time: which way of drawing a scene is worth its time",
    "bench": "how fast frames of your scene are, stage by stage, and beside OpenGL of the same picture",
    "stability": "stiff and extreme cases with their measured errors, or where and why a scene amplifies rounding",
    "conform": "whether an OpenCL device computes what it has to: a card, and scripts that show what is wrong",
    "view": "a scene live in the browser; or an HTML page for inspecting and comparing EXR and PNG images",
    "inspect": "what an EXR or PNG holds: statistics, header, pixels, a figure; or what is in a scene",
    "compare": "how far an image is from another, layer by layer; an image regression test with --threshold",
    "grade": "an image of the course against the right one, and the mistake named",
    "verify": "whether an EXR shows what its header says: random pixels computed again in float64, without OpenCL",
    "coco": "masks of the instances in rendered images as a COCO data set, for training detectors",
}
_MODULES = {
    **dict.fromkeys(("render",), "clshade.cli.render"),
    **dict.fromkeys(("turntable", "animate", "poster"), "clshade.cli.frames"),
    **dict.fromkeys(("bench", "report", "stability", "grade"), "clshade.cli.measuring"),
    **dict.fromkeys(("inspect", "compare", "coco", "devices", "conform", "verify"), "clshade.cli.checking"),
    **dict.fromkeys(("view",), "clshade.cli.view"),
}


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser for these arguments; only the command that they name gets its options."""
    from .. import __version__

    parser = Parser(prog="clshade", description="Render triangle meshes with OpenCL kernels to linear HDR images.")
    parser.add_argument("-V", "--version", action="version", version=f"clshade {__version__}")
    parser.set_defaults(debug=False, quiet=False, verbose=False)
    _general_options(parser)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", parser_class=Parser)
    named = next((argument for argument in arguments if not argument.startswith("-")), None)
    for name, about in COMMANDS.items():
        command = commands.add_parser(name, help=about, add_help=False)
        if name == named:
            add_help(command)
            module = import_module(_MODULES[name])
            add_options(command, *module.OPTIONS[name])
            _general_options(command)
            command.set_defaults(run=getattr(module, f"run_{name}"), parser=command)
    return parser


def _general_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that every command takes, before or after its name."""
    group = parser.add_argument_group("general: what is printed")
    either = group.add_mutually_exclusive_group()
    # Without SUPPRESS, the subparser's default would override an option given before the command's name.
    flag: dict[str, Any] = {"action": "store_true", "default": argparse.SUPPRESS}
    either.add_argument(
        "-q", "--quiet", **flag, help="print errors alone, and what --json asks for: no summary, progress or warnings"
    )
    either.add_argument("-v", "--verbose", **flag, help="say on standard error what is done and how long it takes")
    group.add_argument("--debug", **flag, help="show the traceback of an error")


@contextlib.contextmanager
def _verbosity(parsed: argparse.Namespace) -> Iterator[None]:
    """Set the verbosity of standard output and error within the block. Unless for debugging, a warning that passes Python's
    filters is one line, without its source location."""

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        console.warning(str(message))

    with contextlib.ExitStack() as stack:
        stack.enter_context(console.at_level(parsed.verbose - parsed.quiet + console.NORMAL))
        if not parsed.debug:
            stack.enter_context(warnings.catch_warnings())
            warnings.simplefilter("ignore" if parsed.quiet else "always", UserWarning)
            warnings.simplefilter("ignore", DeprecationWarning)  # of libraries, for those who call them
            warnings.showwarning = show
        if parsed.quiet and not getattr(parsed, "json", False):
            stack.enter_context(contextlib.redirect_stdout(stack.enter_context(open(os.devnull, "w"))))
        yield


class _Unwritable(Exception):
    """Standard output cannot be written; the cause holds the reason."""


class _Stdout:
    """Standard output that can print any text, and whose errors raise an exception of their own."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        try:
            self.stream.write(console.printable(text, getattr(self.stream, "encoding", None) or "utf-8"))
        except OSError as error:
            raise _Unwritable from error
        return len(text)

    def flush(self) -> None:
        try:
            self.stream.flush()
        except OSError as error:
            raise _Unwritable from error

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line (default: the process's own) and return its exit code.

    0: done. 1: a check failed. 2: bad usage or input. 130: interrupted. 141: broken pipe, as a shell reports it.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    stdout = sys.stdout  # may be None
    try:
        with contextlib.redirect_stdout(_Stdout(stdout) if stdout else None):
            code = _run(arguments)
            if stdout:
                sys.stdout.flush()
            return code
    except _Unwritable as error:
        # Python would write what is buffered again at exit, and complain.
        with contextlib.suppress(OSError, ValueError), open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), stdout.fileno())
        if isinstance(error.__cause__, BrokenPipeError):
            return UNREAD
        reason = getattr(error.__cause__, "strerror", None) or error.__cause__
        console.error(f"standard output: cannot be written: {reason}")
        return REFUSED
    except KeyboardInterrupt:
        interrupts.tell()
        return INTERRUPTED


def _run(arguments: Sequence[str]) -> int:
    try:
        os.getcwd()
    except OSError as error:  # it has been removed: then no relative path, compiler or import works
        console.error(f"the current folder: {error.strerror}: go to one that exists")
        return REFUSED
    try:
        words = join_values(arguments)
        parser = _parser(words)
        parsed = parser.parse_args(words)
        if parsed.quiet and parsed.verbose:  # one before the command's name, one after it
            parser.error("argument -v/--verbose: not allowed with argument -q/--quiet")
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else REFUSED
    try:
        with _verbosity(parsed):
            code: int = parsed.run(parsed)
            return code
    except (ClshadeError, MemoryError) as error:
        if parsed.debug:
            raise
        console.error(f"out of memory: {error}".rstrip(": ") if isinstance(error, MemoryError) else str(error))
        return REFUSED
