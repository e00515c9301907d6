"""Programs for a first picture, and those that a process compiles after it for the next ones."""

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
from clshade.scene.model import Settings

SCENE = clshade.builtin("icosphere", resolution=(32, 24))

# Draws as the command line's first picture, another scene's too, then as others; prints the pixels' digest, and how many
# programs are built.
DRAWN = """
import contextlib, hashlib
import clshade
from clshade.pipeline import programs
first, others = programs.first_picture, contextlib.nullcontext
for name, block in (("quads", first), ("icosphere", first), ("quads", others), ("quads", first)):
    with block():
        frame = clshade.render(clshade.builtin(name, resolution=(32, 24)), samples=4)
    assert not any(program.warnings for program in programs.built())
    print(hashlib.sha256(frame.rgba.tobytes()).hexdigest(), len(programs.built()), programs.this_thread.has_first)
"""


@pytest.mark.long
def test_a_first_picture_takes_programs_of_its_own(opened, tmp_path):
    """With the bits of the others, which it takes where they are at hand. Another scene's first picture shares them."""
    if not opened.keeps_programs:
        pytest.skip("other runtimes compile alike")
    done = python(DRAWN, tmp_path, timeout=300.0, CLSHADE_DEVICE=opened.index, **{programs.QUICK: ""})
    lines = [line.split() for line in done.stdout.splitlines()]
    assert [int(built) for _, built, _ in lines] == [2, 2, 4, 4], done.stderr
    assert len({digest for digest, *_ in lines[:1] + lines[2:]}) == 1
    assert {first for *_, first in lines} == {"True"}


@pytest.fixture
def started(fresh_cache, monkeypatch) -> list[bytes]:
    """Return what processes that would start are given on standard input."""
    inputs: list[bytes] = []
    monkeypatch.setattr(subprocess, "Popen", lambda command, stdin, **_: inputs.append(stdin.read()))
    monkeypatch.setenv(ahead.AHEAD, "1")
    monkeypatch.setattr(programs, "this_thread", type(programs.this_thread)())
    monkeypatch.setattr(programs, "built", lambda: (SimpleNamespace(folder=fresh_cache),))
    return inputs


def test_what_is_compiled_ahead(started, fresh_cache, monkeypatch):
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
    ahead.start(SCENE, Settings())
    assert len(started) == 1
    programs.this_thread.has_first = True
    ahead.start(SCENE, Settings())
    assert len(started) == 2


@pytest.mark.parametrize(("always", "ci", "starts"), [("1", "true", 1), ("", "true", 0), ("", "", 1), ("0", "", 0)])
def test_it_can_be_turned_off_and_starts_only_where_its_work_is_kept(started, monkeypatch, always, ci, starts):
    monkeypatch.setenv("CI", ci)
    monkeypatch.setenv(ahead.AHEAD, always) if always else monkeypatch.delenv(ahead.AHEAD)
    for holder, name, value in (
        (sys, "frozen", True),  # no Python can be started
        (environment, "_home_is_kept", False),
        (programs, "built", lambda: (SimpleNamespace(folder=None),)),  # another runtime
    ):
        with monkeypatch.context() as patch:
            patch.setattr(holder, name, value, raising=False)
            ahead.start(SCENE, Settings())
            assert not started, name
    ahead.start(SCENE, Settings())
    assert len(started) == starts


def test_it_yields_to_all_other_processes(tmp_path):
    code = "import os; from clshade.pipeline import ahead; ahead._leave_processors(); "
    group = Path("/proc/self/autogroup")
    before = group.read_text() if group.exists() else ""
    done = python(code + "print(os.nice(0), os.sched_getscheduler(0) == os.SCHED_IDLE)", tmp_path)
    assert done.stdout.split() == ["19", "True"], done.stderr
    assert not before or group.read_text() == before, "but to those of its own session"
