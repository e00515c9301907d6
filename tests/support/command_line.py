"""The command line for tests, in this process and in a child process."""

import os
import subprocess
import sys
from pathlib import Path
from typing import IO, Any
from unittest import mock

import numpy as np
import pytest
from devices import working_devices
from processes import ROOT

import clshade
from clshade.cli import scene as selected
from clshade.cli.main import _parser, main
from clshade.cli.options import join_values
from clshade.scene import look

# With these options the scene needs the program that tests of frames build anyway.
SMALL = ("render", "quads", "--resolution", "32,24", "--preset", "course", "--layers", "Z,id")

needs_device = pytest.mark.skipif(not working_devices(), reason="no OpenCL device works here")


def listing(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, list[str]]:
    """Run a command line; return its exit code, its standard output, and the lines of its standard error."""
    capsys.readouterr()
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    return code, out, err.splitlines()


def scene_of(*arguments: object) -> clshade.Scene:
    """Return the scene selected by a command line of `render`; a contact shadow, which takes a while, is nowhere dark."""
    command = join_values(["render", *map(str, arguments)])
    parsed = _parser(command).parse_args(command)
    with mock.patch.object(look, "_share_of_light", return_value=np.ones((2, 2))):
        return selected.load_scene(parsed, parsed.scenes[0])


def settings_of(*arguments: object) -> dict[str, Any]:
    """Return the settings that a command line of `render` chooses for its picture."""
    command = join_values(["render", *map(str, arguments)])
    return selected.picture_settings(_parser(command).parse_args(command), scene_of(*arguments))


def process(
    *arguments: object, cwd: Path, stdout: IO[str] | int = subprocess.PIPE, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run a command line in a child process, with further environment variables."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **variables}
    command = [sys.executable, "-m", "clshade", *map(str, arguments)]
    options = {"cwd": cwd, "env": environment, "stdout": stdout, "stderr": subprocess.PIPE}
    return subprocess.run(command, **options, text=True, timeout=120)


def without_notices(err: str) -> list[str]:
    """Return the lines of standard error, without those on slow steps, compiling among them."""
    return [line for line in err.splitlines() if not (line.startswith("clshade: ") and line.endswith(" ..."))]


def assert_refused(outcome: tuple[int, str, list[str]], *parts: str) -> None:
    code, out, err = outcome
    assert code == 2, (out, err)
    assert out == ""
    assert len(err) == 1, err
    assert all(part in err[0] for part in parts), err[0]
    assert "Traceback" not in err[0]
