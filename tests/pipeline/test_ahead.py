"""Programs for a first picture, and those that a process compiles after it for the next ones."""

from __future__ import annotations

import io
import pickle
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from processes import python

import clshade
from clshade.base.atomic_files import lock_file
from clshade.pipeline import ahead, programs
from clshade.pipeline.opencl import environment
from clshade.pipeline.opencl.device import Device
from clshade.scene.model import Settings

SCENE = clshade.builtin("icosphere", resolution=(32, 24))

# Draws as the command line's first picture, another scene's too, then as others; prints the pixels' digest, and how many
# programs are built.
DRAWN = """
import contextlib, hashlib
import clshade
from clshade.pipeline import programs
first, others = programs.first_picture, contextlib.nullcontext
for name, block in (({name!r}, first), ("icosphere", first), ({name!r}, others), ({name!r}, first)):
    with block():
        frame = clshade.render(clshade.builtin(name, resolution=(32, 24)), samples=4)
    assert not any(program.warnings for program in programs.built())
    print(hashlib.sha256(frame.rgba.tobytes()).hexdigest(), len(programs.built()), programs.this_thread.has_first)
"""


@pytest.mark.long
@pytest.mark.parametrize("name", ["quads", "teapot"])
def test_a_first_picture_takes_programs_of_its_own(opened: Device, tmp_path: Path, name: str) -> None:
    """With the bits of the others, which it takes where they are at hand. Another scene's first picture shares them."""
    if not opened.keeps_programs:
        pytest.skip("other runtimes compile alike")
    done = python(DRAWN.format(name=name), tmp_path, CLSHADE_DEVICE=opened.index, **{programs.QUICK: ""})
    lines = [line.split() for line in done.stdout.splitlines()]
    assert [int(built) for _, built, _ in lines] == [2, 2, 4, 4], done.stderr
    assert len({digest for digest, *_ in lines[:1] + lines[2:]}) == 1
    assert {first for *_, first in lines} == {"True"}


def test_a_frame_from_inside_a_scene_launches_what_a_sorted_one_needs(
    opened: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also with the process's small images of other scenes."""
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO()))
    monkeypatch.setattr(ahead, "_leave_processors", lambda: None)
    monkeypatch.setattr(ahead, "_likely", lambda: [{"scene": SCENE, "device": opened}])
    for program in programs.built():
        monkeypatch.setattr(program, "launched", set())
    ahead.main()
    launched = {name for program in programs.built() for name, *_ in program.launched}
    assert {"setup", "setup_pieces", "bin_count", "bin_fill", "setup_count"} <= launched


@pytest.fixture
def started(fresh_cache: Path, monkeypatch: pytest.MonkeyPatch) -> list[bytes]:
    """Return what processes that would start are given on standard input."""
    inputs: list[bytes] = []
    monkeypatch.setattr(subprocess, "Popen", lambda command, stdin, **_: inputs.append(stdin.read()))
    monkeypatch.setenv(ahead.AHEAD, "1")
    monkeypatch.setattr(programs, "this_thread", type(programs.this_thread)())
    monkeypatch.setattr(programs, "built", lambda: (SimpleNamespace(folder=fresh_cache),))
    return inputs


def test_what_is_compiled_ahead(started: list[bytes], fresh_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The scene that was drawn comes first. Once all is done nothing starts, but after another first picture."""
    drawn: list[Any] = []

    class Renderer:
        def __init__(self, **arguments: Any) -> None:
            drawn.append(arguments)
            self.scene = arguments["scene"]
            if len(drawn) == 2:
                raise clshade.ClshadeError("the others are compiled nevertheless")

        __enter__ = __exit__ = render = lambda self, *_: self

    monkeypatch.setattr(ahead, "Renderer", Renderer)
    monkeypatch.setattr(ahead, "_leave_processors", lambda: None)
    ahead.start(SCENE, Settings())
    (trial,) = started
    lock = lock_file(fresh_cache / "compiled-ahead.lock")
    assert lock is not None
    for free in (False, True):
        monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(trial)))
        ahead.main()
        assert bool(drawn) == free, "one process at a time"
        ahead.os.close(lock) if not free else None
    assert drawn[0].keys() == pickle.loads(trial)[0].keys()
    assert drawn[0]["scene"].camera.resolution == (64, 48)
    kinds = [(options["preset"], options["samples"], options["shadows"]) for options in drawn[1:]]
    assert len(set(kinds)) == 5
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO()))
    monkeypatch.setattr(ahead, "lock_file", lambda path: 1)  # this process holds it
    ahead.main()
    assert len(drawn) == 6 + 5, "without the trial of a large scene"
    ahead.start(SCENE, Settings())
    assert len(started) == 1
    programs.this_thread.has_first = True
    ahead.start(SCENE, Settings())
    assert len(started) == 2


@pytest.mark.parametrize(
    ("variables", "starts"), [({"CI": ""}, True), ({"CI": "true"}, False), ({ahead.AHEAD: "0"}, False)]
)
def test_it_can_be_turned_off(
    started: list[bytes], monkeypatch: pytest.MonkeyPatch, variables: dict[str, str], starts: bool
) -> None:
    monkeypatch.delenv(ahead.AHEAD)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    ahead.start(SCENE, Settings())
    assert bool(started) == starts


@pytest.mark.parametrize("reason", ["another runtime", "a cache that is not kept", "no Python"])
def test_nothing_starts_where_nothing_would_be_kept(
    started: list[bytes], monkeypatch: pytest.MonkeyPatch, reason: str
) -> None:
    if reason == "no Python":
        monkeypatch.setattr(sys, "frozen", True, raising=False)
    elif reason == "a cache that is not kept":
        monkeypatch.setattr(environment, "_home_is_kept", False)
    else:
        monkeypatch.setattr(programs, "built", lambda: (SimpleNamespace(folder=None),))
    ahead.start(SCENE, Settings())
    assert not started


def test_it_yields_to_all_other_processes(tmp_path: Path) -> None:
    code = "import os; from clshade.pipeline import ahead; ahead._leave_processors(); "
    group = Path("/proc/self/autogroup")
    before = group.read_text() if group.exists() else ""
    done = python(code + "print(os.nice(0), os.sched_getscheduler(0) == os.SCHED_IDLE)", tmp_path)
    assert done.stdout.split() == ["19", "True"], done.stderr
    assert not before or group.read_text() == before, "but to those of its own session"
