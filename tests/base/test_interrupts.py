"""Ctrl-C and killing signals at any moment of a run: leftovers, and that the next run works."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import ROOT

# Every run compiles: without light and with one sample that takes half the time.
COMMAND = ("render", "box_room", "--resolution", "160,120", "--shader", "nolight", "--samples", "1")
COMMAND += ("--deterministic", "--quiet")
OUTPUTS = ("out.exr", "out.png")
EARLIER = b"earlier"

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals")

# Reports its start, then blocks in C, where Python cannot handle a signal, for half a minute unless it is killed.
START = """
import sys
print("started", flush=True)
sys.argv[0] = "clshade"
def stuck(*arguments, **options):
    import hashlib
    print("stuck", file=sys.__stdout__, flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 60_000_000)
from clshade import __main__
from clshade.cli import main as cli
run = cli.main
def main():
    {hook}
    return run()
cli.main = main
__main__.entry()
"""
BUILDING = "from clshade.pipeline import programs; programs.build = stuck"
WRITING = "import os; os.fsync = stuck"
# Exit functions, for which an interrupted process does not wait; and cleanup, which is cut short if it hangs.
WAITING = "import atexit; atexit.register(__import__('time').sleep, 60); " + WRITING
CLEARING = "from clshade.base import interrupts; interrupts.at_end(lambda: __import__('time').sleep(60)); " + WRITING
# As while OpenEXR reads: its own messages are then kept from standard error.
# The main thread goes on meanwhile, and fails.
GOING_ON = """import time
    from clshade.base import interrupts
    from clshade.pipeline import programs
    late = []
    interrupts.at_end(lambda: (late.append(1), time.sleep(0.5)))
    def stuck(*_, **__):
        try:
            print("stuck", file=sys.__stdout__, flush=True)
            while True:
                time.sleep(0.01)
        except KeyboardInterrupt:
            while not late:
                time.sleep(0.01)
            raise RuntimeError from None
    programs.build = stuck
"""
UNHEARD = "import os; os.dup2(os.open(os.devnull, os.O_WRONLY), 2); " + BUILDING
FAILING = "from clshade.base import interrupts; interrupts.at_end(lambda: 1 / 0); " + WRITING


def start(folder: Path, cache: Path, hook: str = "") -> subprocess.Popen[str]:
    """Start a run in `folder` with this cache, and wait until it reports its start."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(cache)}
    process = subprocess.Popen(
        [sys.executable, "-c", START.format(hook=hook), *COMMAND],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "started\n"
    return process


def finish(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Wait for the process; return exit code and standard error."""
    _, err = process.communicate(timeout=240)
    return process.returncode, err


@pytest.fixture
def folder(tmp_path):
    """Return a folder with earlier output."""
    folder = tmp_path / "folder"
    folder.mkdir()
    for name in OUTPUTS:
        (folder / name).write_bytes(EARLIER)
    return folder


def contents(folder: Path) -> list[bytes]:
    return [(folder / name).read_bytes() for name in OUTPUTS]


def assert_kept(folder: Path) -> None:
    assert contents(folder) == [EARLIER] * len(OUTPUTS)


def assert_ends_soon(process: subprocess.Popen[str]) -> None:
    """Assert that an interrupt ends a blocked run, with one line, long before it would unblock (30 s)."""
    assert process.stdout.readline() == "stuck\n"
    sent = time.perf_counter()
    process.send_signal(signal.SIGINT)
    assert finish(process) == (130, "clshade: interrupted\n")
    assert time.perf_counter() - sent < 15.0


@pytest.mark.sampled
@pytest.mark.parametrize(
    "hook",
    [BUILDING, WRITING, WAITING, FAILING, UNHEARD, GOING_ON],
    ids=["building", "writing", "waiting", "failing", "unheard", "going on"],
)
def test_an_interrupt_while_python_cannot_handle_it(opened, folder, tmp_path, hook):
    assert_ends_soon(start(folder, tmp_path / "cache", hook))
    assert_kept(folder)
    assert sorted(os.listdir(folder)) == sorted(OUTPUTS)


# Runs a demo as a script. {hook} is run when it imports NumPy.
DEMO = """
import hashlib, runpy, sys
def stuck():
    print("stuck", flush=True)
    hashlib.pbkdf2_hmac("sha256", b"", b"", 60_000_000)
class Numpy:
    def find_spec(self, name, path=None, target=None):
        if name == "numpy":
            {hook}
def interrupt(*arguments):
    raise KeyboardInterrupt
def interrupted():
    sys.meta_path.remove(numpy)
    import argparse
    argparse.ArgumentParser.parse_args = interrupt
sys.meta_path.insert(0, numpy := Numpy())
del sys.argv[1:]
runpy.run_path({path!r}, run_name="__main__")
"""


@pytest.mark.sampled
@pytest.mark.parametrize("demo", sorted(path.name for path in (ROOT / "demos").glob("*.py")))
def test_an_interrupt_of_a_demo(tmp_path, demo):
    """While it imports, stuck in C, and when it begins."""
    for hook in ("stuck()", "interrupted()"):
        code = DEMO.format(hook=hook, path=str(ROOT / "demos" / demo))
        process = subprocess.Popen(
            [sys.executable, "-c", code],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        if hook == "stuck()":
            assert_ends_soon(process)
        else:
            assert finish(process) == (130, "clshade: interrupted\n")


def test_little_is_imported_before_interrupts_are_handled(tmp_path):
    """Meanwhile an interrupt prints a traceback."""
    code = "import sys; sys.path.insert(0, sys.argv[1]); import clshade.base.interrupts; print('typing' in sys.modules)"
    done = subprocess.run([sys.executable, "-ISc", code, str(ROOT)], capture_output=True, text=True, timeout=60)
    assert done.stdout == "False\n", done.stderr


@pytest.mark.long
def test_clearing_up_that_hangs_is_cut_short(opened, folder, tmp_path):
    assert_ends_soon(start(folder, tmp_path / "cache", CLEARING))
    assert_kept(folder)


def test_an_interrupt_removes_the_folder_of_its_process(opened, folder, tmp_path):
    process = start(folder, tmp_path / "cache", BUILDING)
    assert process.stdout.readline() == "stuck\n"
    assert list((tmp_path / "cache" / "clshade").glob("pocl-*"))
    process.send_signal(signal.SIGINT)
    assert finish(process) == (130, "clshade: interrupted\n")
    assert not list((tmp_path / "cache" / "clshade").glob("pocl-*"))


@pytest.mark.sampled
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_killed_while_writing(opened, folder, tmp_path, number):
    """A temporary file may stay: the next process to write there an hour later removes it."""
    process = start(folder, tmp_path / "cache", WRITING)
    assert process.stdout.readline() == "stuck\n"
    process.send_signal(number)
    assert finish(process) == (-number, "")
    assert_kept(folder)
    assert all(name in OUTPUTS or name.startswith(".clshade-") for name in os.listdir(folder))


@pytest.fixture(scope="module")
def undisturbed(opened, tmp_path_factory):
    """Return the seconds of a run with an empty cache, and the bytes of its files."""
    folder = tmp_path_factory.mktemp("undisturbed")
    began = time.perf_counter()
    assert finish(start(folder, folder / "cache")) == (0, "")
    return time.perf_counter() - began, contents(folder)


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
@pytest.mark.parametrize("share", [0.05, 0.2, 0.4, 0.6, 0.8, 0.95])
def test_stopped_at_any_moment(undisturbed, folder, tmp_path, number, share):
    """With an empty cache. share: fraction of a run's time. Each file is either the earlier or the new one, complete;
    after an interrupt all are earlier ones or all new."""
    seconds, expected = undisturbed
    process = start(folder, tmp_path / "cache")
    time.sleep(share * seconds)
    process.send_signal(number)
    code, err = finish(process)
    left = contents(folder)
    if code == 0:  # it was faster
        assert left == expected
    elif number == signal.SIGINT:
        assert (code, err) == (130, "clshade: interrupted\n")
        assert left in ([EARLIER] * len(OUTPUTS), expected)
    else:
        assert (code, err) == (-number, "")
        assert all(content in (EARLIER, new) for content, new in zip(left, expected, strict=True))
    assert finish(start(folder, tmp_path / "cache")) == (0, "")
    assert contents(folder) == expected
