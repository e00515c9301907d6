"""The command line as tests use it, in this process and in one of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from devices import working_devices
from processes import ROOT

import clshade
from clshade.cli.commands import scene_options
from clshade.cli.commands.arguments import with_values
from clshade.cli.main import _parser, main

# With these options the program is the one that tests of frames build for the scene.
SMALL = ("render", "quads", "--resolution", "32,24", "--preset", "course", "--layers", "Z,id")

needs_device = pytest.mark.skipif(not working_devices(), reason="no OpenCL device works here")


def listing(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, list[str]]:
    """The exit code of a command line, its standard output, and the lines of its standard error."""
    capsys.readouterr()
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, out, err.splitlines()


def scene_of(*arguments: object) -> clshade.Scene:
    """The scene that a command line of `render` leads to."""
    given = with_values(["render", *map(str, arguments)])
    parsed = _parser(given).parse_args(given)
    return scene_options.load_scene(parsed, parsed.scenes[0])


def process(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "clshade", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=120)


def without_compiling(err: str) -> list[str]:
    """The lines of standard error, but the one that is there where no run before has compiled the kernels."""
    return [line for line in err.splitlines() if not line.startswith("clshade: compiling kernels for ")]


def assert_refused(found: tuple[int, str, list[str]], *parts: str) -> None:
    code, out, err = found
    assert code == 2, (out, err)
    assert out == ""
    assert len(err) == 1, err
    assert all(part in err[0] for part in parts), err[0]
    assert "Traceback" not in err[0]
