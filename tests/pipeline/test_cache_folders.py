"""Cache folders that are full, vanish or are shared; probing processes that are interrupted."""

from __future__ import annotations

import errno
import os
import pwd
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from types import SimpleNamespace

import pyopencl as cl
import pytest
from processes import ROOT

from clshade.base.atomic_files import lock_file
from clshade.errors import DeviceError
from clshade.pipeline import programs
from clshade.pipeline.opencl import environment, probe
from clshade.pipeline.opencl.probe import DeviceInfo

POCL = DeviceInfo("0:0", "Portable Computing Language", "pthread-Some Processor")


def no_space(*arguments, **options):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


# Full disks


@pytest.fixture
def disks(tmp_path, monkeypatch):
    """Simulate two disks, for the home and for temporary files; free[name] is the number of free bytes."""
    free = {"home": 1 << 30, "tmp": 1 << 30}
    for name in free:
        (tmp_path / name).mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    monkeypatch.setattr(environment, "_home", None)

    def usage(path):
        name = Path(path).relative_to(tmp_path).parts[0]
        return SimpleNamespace(total=1 << 30, used=0, free=free[name])

    monkeypatch.setattr(shutil, "disk_usage", usage)
    return free


def test_a_home_with_room_is_used(disks, tmp_path):
    disks["home"] = environment.ROOM
    assert environment.cache_home() == tmp_path / "home"


@pytest.mark.parametrize("left", [0, 300_000, environment.ROOM - 1])
def test_a_full_home_is_left_for_the_temporary_folder(disks, tmp_path, left):
    disks["home"] = left
    assert environment.cache_home().parent == tmp_path / "tmp"
    assert os.environ["XDG_CACHE_HOME"] == str(environment.cache_home())


def test_a_user_without_a_home_gets_a_temporary_folder_and_a_line(disks, tmp_path, monkeypatch, capsys):
    """As in a container with `--user 12345`: no HOME, and no entry in the list of users."""
    for name in ("XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name)
    monkeypatch.setattr(pwd, "getpwuid", {}.__getitem__)
    home = environment.cache_home()
    assert home.parent == tmp_path / "tmp"
    assert f"compiled kernels are kept in {home} (no HOME): set XDG_CACHE_HOME" in capsys.readouterr().err


def test_a_limit_of_files_is_named(disks, monkeypatch):
    monkeypatch.setattr(resource, "getrlimit", lambda _: (512_000, 512_000))
    with pytest.raises(
        DeviceError, match=r"home: files of at most 0.5 MB, 4 MB needed: raise `ulimit -f`; .*tmp/clshade-"
    ):
        environment.cache_home()


def test_a_build_without_a_message_names_the_cache_that_is_full(opened, tmp_path, monkeypatch):
    """As where the user's quota ends during the build."""

    def refuse(*_: object) -> None:
        raise cl.RuntimeError("x")

    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(programs, "_without_log", refuse)
    pocl = SimpleNamespace(name="CPU", keeps_programs=True, context=opened.context)
    with pytest.raises(DeviceError, match=r"did not build: no message from its compiler$"):
        programs.compiled(pocl, "", [])
    monkeypatch.setattr(tempfile, "TemporaryFile", no_space)
    with pytest.raises(DeviceError, match=f"did not build: {tmp_path}: No space left on device$"):
        programs.compiled(pocl, "", [])


def test_full_disks_are_named(disks, tmp_path):
    disks.update(home=300_000, tmp=0)
    with pytest.raises(DeviceError) as caught:
        environment.cache_home()
    message = str(caught.value)
    assert "\n" not in message
    assert f"{tmp_path}/home: 0.3 MB free, 67 MB needed" in message
    assert f"{tmp_path}/tmp/clshade-" in message
    assert "XDG_CACHE_HOME" in message


def test_a_folder_of_the_process_that_cannot_be_made(fresh_cache, monkeypatch):
    monkeypatch.setattr(tempfile, "mkdtemp", no_space)
    monkeypatch.setattr(environment, "_prepared", False)
    with pytest.raises(DeviceError, match=r"the cache folder .* cannot be used: No space left on device"):
        environment.prepare()


def test_folders_of_earlier_versions_go_unless_one_of_their_processes_runs(fresh_cache, monkeypatch, capfd):
    monkeypatch.setattr(environment, "_prepared", False)
    monkeypatch.setenv("POCL_CACHE_DIR", "")
    for name in ("slot-0", "slot-1", "probe-x", "programs"):
        (fresh_cache / name / "pocl").mkdir(parents=True)
        (fresh_cache / name / "lock").touch()
    lock = lock_file(fresh_cache / "slot-1" / "lock")
    environment.prepare()
    os.close(lock)
    assert {path.name.partition("-")[0] for path in fresh_cache.iterdir()} == {"slot", "programs", "pocl"}
    assert (fresh_cache / "slot-1" / "pocl").is_dir()
    assert capfd.readouterr().err == ""


def test_a_probe_that_cannot_be_started(fresh_cache, monkeypatch):
    monkeypatch.setattr(subprocess, "Popen", no_space)
    with pytest.raises(DeviceError, match=r"0:0 .* cannot be tried out: No space left on device"):
        probe.start(POCL)
    assert not list(fresh_cache.iterdir())
    assert not probe._running


# Other processes


INTERRUPTED = """
import os, signal, sys, threading
from clshade.base import console
from clshade.pipeline.opencl import device; from clshade.pipeline.opencl import probe as probing
from clshade.pipeline.opencl.probe import DeviceInfo
infos = [DeviceInfo(f"{k}:0", "Portable Computing Language", "CPU") for k in range(3)]
device.found_devices = lambda name: infos
device._connect, console.SLOW = lambda *_: None, 60.0
probing.probe_command = lambda info: [sys.executable, "-S", "-c", "import time; time.sleep(60)"]
start = probing.start
def started(info, *more, **options):
    start(info, *more, **options)
    print(probing._running[info.index].pid, flush=True)
    if info.index == sys.argv[2]:
        signal.raise_signal(signal.SIGINT)
probing.start = started
if not sys.argv[2]:
    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
try:
    device.list_devices() if sys.argv[1] == "list" else device.open_device("")
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.mark.sampled
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize(
    ("call", "at"), [("list", ""), ("list", "0:0"), ("list", "1:0"), ("open", ""), ("open", "0:0")]
)
def test_an_interrupt_ends_probes(tmp_path, call, at):
    """at: the device whose probe has just been started; "": while waiting for the first."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(tmp_path)}
    command = [sys.executable, "-c", INTERRUPTED, call, at]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=50)
    assert (done.returncode, done.stderr) == (130, "")
    children = [int(pid) for pid in done.stdout.split()]
    assert children
    for pid in children:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_an_interrupt_that_ends_a_probe_says_nothing_of_its_device(fresh_cache, monkeypatch):
    """As it does in a thread of its own, while the main one waits for the probe."""
    monkeypatch.setattr(
        probe, "probe_command", lambda info: [sys.executable, "-S", "-c", "import time; time.sleep(60)"]
    )
    probe.start(POCL)
    ending = threading.Timer(0.3, probe.end_all)
    ending.start()
    with pytest.raises(KeyboardInterrupt):
        probe.tried_out(POCL)
    ending.join()
    assert not list(fresh_cache.rglob("*")), "no verdict"


def test_a_forked_child_leaves_its_parents_probes_alone(fresh_cache, monkeypatch):
    if not hasattr(os, "fork"):
        pytest.skip("no fork here")
    monkeypatch.setattr(probe, "probe_command", lambda info: [sys.executable, "-S", "-c", "input()"])
    probe.start(POCL)
    running = probe._running[POCL.index]
    try:
        child = os.fork()
        if child == 0:
            probe.end_all()
            os._exit(0)
        os.waitpid(child, 0)
        assert running.poll() is None
    finally:
        probe.end(POCL.index)
