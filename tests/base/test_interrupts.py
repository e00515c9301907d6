"""Ctrl-C and killing signals at any moment of a run: leftovers, and that the next run works."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import ROOT

from clshade.pipeline.opencl import environment

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
AT_END = "from clshade.base import interrupts; interrupts.at_end(lambda: {}); " + WRITING
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
HOOKS = {
    "building": BUILDING,
    "writing": WRITING,
    "exit functions, not waited for": f"import atexit; atexit.register(__import__('time').sleep, 60); {WRITING}",
    "cleanup that fails": AT_END.format("1 / 0"),
    "cleanup that hangs and is cut short": AT_END.format("__import__('time').sleep(60)"),
    "no standard error, as OpenEXR reads": f"import os; os.dup2(os.open(os.devnull, os.O_WRONLY), 2); {BUILDING}",
    "going on": GOING_ON,
}


def popen(code: str, *arguments: str, cwd: Path, **variables: str) -> subprocess.Popen[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **variables}
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([sys.executable, "-c", code, *arguments], cwd=cwd, env=environment, **streams)


def start(folder: Path, cache: Path, hook: str = "") -> subprocess.Popen[str]:
    """Start a run in `folder` with this cache, and wait until it reports its start."""
    process = popen(START.format(hook=hook), *COMMAND, cwd=folder, XDG_CACHE_HOME=str(cache))
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


@pytest.fixture(scope="module")
def cache(opened, tmp_path_factory):
    """Return a cache that holds at first what is known of devices, which takes seconds to try."""
    folder = tmp_path_factory.mktemp("cache")
    shutil.copytree(environment.cache_root() / "verdicts", folder / "clshade" / "verdicts")
    return folder


def assert_ends_soon(process: subprocess.Popen[str], cache: Path | None = None) -> None:
    """Assert that an interrupt soon ends a run blocked for 30 s, with one line. cache: where it has a folder until then."""
    assert process.stdout.readline() == "stuck\n"
    assert cache is None or list(cache.glob("clshade/pocl-*"))
    sent = time.perf_counter()
    process.send_signal(signal.SIGINT)
    assert finish(process) == (130, "clshade: interrupted\n")
    assert time.perf_counter() - sent < 15.0


@pytest.mark.long
@pytest.mark.parametrize("hook", HOOKS.values(), ids=HOOKS)
def test_an_interrupt_while_python_cannot_handle_it(folder, cache, hook):
    assert_ends_soon(start(folder, cache, hook), cache)
    assert contents(folder) == [EARLIER] * len(OUTPUTS)
    assert sorted(os.listdir(folder)) == sorted(OUTPUTS)
    assert not list((cache / "clshade").glob("pocl-*"))


# Runs a demo as a script, which blocks when it imports NumPy.
DEMO = """
import hashlib, runpy, sys
class Numpy:
    def find_spec(self, name, path=None, target=None):
        if name == "numpy":
            print("stuck", flush=True)
            hashlib.pbkdf2_hmac("sha256", b"", b"", 60_000_000)
sys.meta_path.insert(0, Numpy())
path = sys.argv.pop()
runpy.run_path(path, run_name="__main__")
"""


@pytest.mark.sampled
@pytest.mark.parametrize("demo", sorted((ROOT / "demos").glob("*.py")), ids=lambda path: path.name)
def test_an_interrupt_of_a_demo(tmp_path, demo):
    assert_ends_soon(popen(DEMO, str(demo), cwd=tmp_path))


def test_little_is_imported_before_interrupts_are_handled(tmp_path):
    """Meanwhile an interrupt prints a traceback."""
    code = "import sys; sys.path.insert(0, sys.argv[1]); import clshade.base.interrupts; print('typing' in sys.modules)"
    done = subprocess.run([sys.executable, "-ISc", code, str(ROOT)], capture_output=True, text=True, timeout=60)
    assert done.stdout == "False\n", done.stderr


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_killed_while_writing(folder, cache, number):
    """A temporary file may stay: the next process to write there an hour later removes it."""
    process = start(folder, cache, WRITING)
    assert process.stdout.readline() == "stuck\n"
    process.send_signal(number)
    assert finish(process) == (-number, "")
    assert contents(folder) == [EARLIER] * len(OUTPUTS)
    assert all(name in OUTPUTS or name.startswith(".clshade-") for name in os.listdir(folder))


@pytest.fixture(scope="module")
def undisturbed(opened, tmp_path_factory):
    """Return the seconds of a run with an empty cache, and the bytes of its files."""
    folder = tmp_path_factory.mktemp("undisturbed")
    began = time.perf_counter()
    assert finish(start(folder, folder / "cache")) == (0, "")
    return time.perf_counter() - began, contents(folder)


@pytest.mark.long
@pytest.mark.parametrize(
    ("share", "number"), [(0.05, signal.SIGKILL), (0.4, signal.SIGINT), (0.8, signal.SIGKILL), (0.95, signal.SIGINT)]
)
def test_stopped_at_any_moment(undisturbed, folder, tmp_path, share, number):
    """share: fraction of a run's time. Each file is the earlier or the new one, complete; after an interrupt all alike."""
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
