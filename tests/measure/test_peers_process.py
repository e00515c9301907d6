"""Renderers of `report --peers` in processes of their own, which may crash, hang or print what they like."""

from __future__ import annotations

import signal
import subprocess
import sys
from contextlib import ExitStack, closing

import pytest

from clshade.measure import child_process
from clshade.measure.peers import measure, process
from clshade.measure.peers.measure import Failure, Result
from clshade.measure.peers.process import PeerError, Process

# A renderer of four pixels that does as told: FAULT stands for a line in `draw`.
FAKE = """
import os, sys, time
import numpy as np
from clshade.errors import ClshadeError
from clshade.measure.peers.child import serve
from clshade.measure.peers.drawing import Picture

class Fake:
    title, frames = "Fake 1.0", 0
    def draw(self):
        self.frames += 1
        FAULT
        return Picture(np.zeros((2, 2, 3), np.float32), np.full((2, 2), np.inf), np.zeros((2, 2), np.float32))

def open_():
    START
    return Fake()

sys.exit(serve(open_))
"""


def fake(fault="pass", start="pass"):
    return [sys.executable, "-c", FAKE.replace("FAULT", fault).replace("START", start)]


def failure(command, limit=30.0):
    """Return the message of the first error of a renderer that is asked for two frames."""

    def draw_twice():
        made = Process("fake", command, limit=limit)
        made.draw()
        made.draw()

    with pytest.raises(PeerError) as raised:
        draw_twice()
    message = str(raised.value)
    assert "\n" not in message
    return message


def test_a_frame_comes_back_with_its_time():
    made = Process("fake", fake())
    assert made.title == "Fake 1.0"
    assert made.draw() >= 0.0
    picture = made.picture()
    assert picture.rgb.shape == (2, 2, 3)
    assert measure.same_bits(picture, made.picture())
    made.close()


@pytest.mark.parametrize(
    ("fault", "start", "message"),
    [
        ("raise ValueError('no such pixel')", "pass", "fake: ended with exit code 1: ValueError: no such pixel"),
        ("os.abort()", "pass", "fake: ended with SIGABRT"),
        ("os._exit(3)", "pass", "fake: ended with exit code 3"),
        ("pass", "raise ClshadeError('fake: fake is not installed')", "fake: fake is not installed"),
        ("pass", "import no_such_module", "fake: ended with exit code 1: ModuleNotFoundError: No module named"),
    ],
)
def test_what_a_renderer_fails_with_is_one_line(fault, start, message):
    assert failure(fake(fault, start)).startswith(message)


def test_a_renderer_that_hangs_is_ended():
    assert failure(fake("time.sleep(60) if self.frames == 2 else None"), limit=3.0) == "fake: no answer within 3 s"


def test_a_renderer_that_closes_its_output_and_stays_is_ended():
    deaf = [sys.executable, "-c", "import os, time; os.close(1); time.sleep(60)"]
    assert failure(deaf, limit=1.0) == "fake: no answer within 1 s"


@pytest.mark.parametrize("asked", ["_answer", "draw"])
def test_an_interrupt_while_opening_ends_the_process(asked, monkeypatch, tmp_path):
    started = []

    class Recorded(subprocess.Popen):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            started.append(self)

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(subprocess, "Popen", Recorded)
    monkeypatch.setattr(process, "command", lambda *_: (fake(), {}))
    monkeypatch.setattr(Process, asked, interrupted)
    with pytest.raises(KeyboardInterrupt), ExitStack() as stack:
        measure._opened("numpy", tmp_path, 1, 30.0, stack)
    (child,) = started
    assert child.returncode is not None


def test_an_interrupt_that_cannot_be_handled_ends_all_processes():
    with closing(Process("fake", fake())) as made:
        child_process._end_all()
        assert made._child._process.wait(timeout=10.0) == -signal.SIGKILL


def test_what_a_renderer_says_is_escaped():
    said = failure([sys.executable, "-c", r"import sys; sys.exit('an \x1b[31merror')"])
    assert said == r"fake: ended with exit code 1: an \x1b[31merror"


def test_what_a_renderer_prints_is_no_answer():
    made = Process("fake", fake("print('{}'); os.write(1, b'garbage')", "print('hello')"))
    assert made.draw() >= 0.0
    made.close()
    garbage = failure([sys.executable, "-c", "print('[1, 2]')"])
    assert garbage == "fake: expected a line of JSON with 'title', found b'[1, 2]\\n'"


def test_an_answer_that_is_no_number_or_has_two_lines_is_an_error_of_one():
    program = 'print(\'{"title": "Fake"}\', flush=True); input(); print(\'{"ms": "soon"}\', flush=True); input()'
    made = Process("fake", [sys.executable, "-c", program])
    with pytest.raises(PeerError, match="fake: expected a line of JSON with 'ms', found"):
        made.draw()
    assert failure(fake(start=r"raise ClshadeError('two\nlines')")) == r"fake: two\nlines"


def test_the_others_go_on(monkeypatch, tmp_path):
    """Of four renderers one is missing, one crashes at once and one in its turns; the other is measured."""
    commands = {
        "numpy": fake(),
        "vtk": fake(start="raise ClshadeError('vtk: vtk is not installed')"),
        "riley": fake("os.abort()"),
        "mitsuba": fake("assert self.frames < 4, 'tired'"),
    }
    monkeypatch.setattr(process, "command", lambda name, *_: (commands[name], {}))
    errors = measure.Errors(color=0.5)
    found = list(measure._at("teapot", tmp_path, 1, list(commands), lambda picture: errors, 2, 30.0))
    failed = {each.reason.partition(":")[0]: each.reason for each in found if isinstance(each, Failure)}
    assert failed["vtk"] == "vtk: vtk is not installed"
    assert failed["riley"].startswith("riley: ended with SIGABRT")
    assert failed["mitsuba"] == "mitsuba: ended with exit code 1: AssertionError: tired"
    (drawn,) = (each for each in found if isinstance(each, Result))
    assert (drawn.renderer, drawn.same_runs, drawn.same_threads, len(drawn.times)) == ("numpy", True, None, 2)


def test_bits_that_change_are_found(monkeypatch, tmp_path):
    """A renderer whose frames differ, and one whose processes do."""
    commands = {
        "riley": fake("np.zeros = lambda shape, kind: np.full(shape, self.frames, kind)"),
        "mitsuba": fake("np.zeros = lambda shape, kind: np.full(shape, os.getpid(), kind)"),
    }
    monkeypatch.setattr(process, "command", lambda name, *_: (commands[name], {}))
    found = measure._at("teapot", tmp_path, 1, list(commands), lambda picture: measure.Errors(), 1, 30.0)
    assert [(each.same_runs, each.same_threads) for each in found] == [(False, True), (True, False)]


def test_threads_are_set_by_the_renderers_variables():
    command, variables = process.command("llvmpipe", "scene", 16, 1)
    assert command[2:] == ["clshade.measure.peers.child", "llvmpipe", "scene", "16", "1"]
    assert variables == {"LP_NUM_THREADS": "1"}
    assert process.command("clshade", "scene", 1, 0)[1] == {}
    assert process.command("riley", "scene", 1, 1)[1] == {}
