"""Cache folders that are full, vanish or are shared, and the environment in which OpenCL starts."""

import errno
import os
import pwd
import resource
import shutil
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pyopencl as cl
import pytest
from processes import OPEN, python

from clshade.errors import DeviceError
from clshade.pipeline import programs
from clshade.pipeline.opencl import environment

no_space = Mock(side_effect=OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))


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
    monkeypatch.setattr(
        shutil, "disk_usage", lambda path: SimpleNamespace(free=free[Path(path).relative_to(tmp_path).parts[0]])
    )
    return free


def test_a_full_home_is_left_for_the_temporary_folder(disks, tmp_path, monkeypatch):
    disks["home"] = environment.ROOM
    assert environment.cache_home() == tmp_path / "home"
    disks["home"] -= 1
    monkeypatch.setattr(environment, "_home", None)
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


def test_full_disks_and_limits_are_named(disks, tmp_path, monkeypatch):
    disks.update(home=300_000, tmp=0)
    line = rf"{tmp_path}/home: 0\.3 MB free, 67 MB needed; {tmp_path}/tmp/clshade-[^\n]*: set XDG_CACHE_HOME[^\n]*$"
    with pytest.raises(DeviceError, match=line):
        environment.cache_home()
    disks.update(home=1 << 30, tmp=1 << 30)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (512_000, 512_000))
    line = r"home: files of at most 0.5 MB, 4 MB needed: raise `ulimit -f`; .*/tmp/clsh"
    with pytest.raises(DeviceError, match=line):
        environment.cache_home()


def test_a_build_without_a_message_names_the_cache_that_is_full(opened, tmp_path, monkeypatch):
    """As where the user's quota ends during the build."""
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(programs, "_without_log", Mock(side_effect=cl.RuntimeError("x")))
    pocl = SimpleNamespace(name="CPU", keeps_programs=True, context=opened.context)
    with pytest.raises(DeviceError, match=r"did not build: no message from its compiler$"):
        programs.compiled(pocl, "", [])
    monkeypatch.setattr(tempfile, "TemporaryFile", no_space)
    with pytest.raises(DeviceError, match=f"did not build: {tmp_path}: No space left on device$"):
        programs.compiled(pocl, "", [])


def test_a_folder_of_the_process_that_cannot_be_made(fresh_cache, monkeypatch):
    monkeypatch.setattr(tempfile, "mkdtemp", no_space)
    monkeypatch.setattr(environment, "_prepared", False)
    with pytest.raises(DeviceError, match=r"the cache folder .* cannot be used: No space left on device"):
        environment.prepare()


# Temporary folders

CLAIM = (
    "import os; from clshade.pipeline.opencl import environment as runtimes; runtimes.prepare(); "
    "print(runtimes.cache_root(), os.environ['POCL_CACHE_DIR'], flush=True)"
)


@pytest.mark.sampled
@pytest.mark.parametrize("kind", ["others can write", "group can write", "link", "file", "another user's"])
def test_a_temporary_folder_of_someone_else_is_not_used(tmp_path, kind):
    """Anyone who can write to it could plant code. The replacement folders do not accumulate."""
    taken = tmp_path / f"clshade-{os.getuid()}"
    private_folder = tmp_path / "own"
    private_folder.mkdir(mode=0o700)
    if kind == "link":
        taken.symlink_to(private_folder)
    elif kind == "file":
        taken.touch()
    else:
        taken.mkdir()
        taken.chmod({"others can write": 0o777, "group can write": 0o770}.get(kind, 0o700))
    if kind == "another user's":
        if os.getuid() != 0:
            pytest.skip("only root can give folders away")
        os.chown(taken, 4711, 4711)
    for deed in ("", "; os.kill(os.getpid(), 9)", ""):
        done = python(CLAIM + deed, "/proc/nowhere", TMPDIR=str(tmp_path))
        assert done.returncode == (-9 if deed else 0), done.stderr
        folder = Path(done.stdout.split()[0])
        assert folder.parent.parent == tmp_path
        assert folder.parent.name.startswith(f"clshade-{os.getuid()}-")
        assert len(done.stderr.splitlines()) == 1
        assert done.stderr.startswith("clshade: warning: compiled kernels are not kept (/proc/nowhere: ")
        assert len(list(tmp_path.iterdir())) == (3 if deed else 2)
    assert not list(private_folder.iterdir())


def test_a_temporary_folder_that_others_can_read_is_made_private(tmp_path):
    folder = tmp_path / f"clshade-{os.getuid()}"
    folder.mkdir()
    folder.chmod(0o755)
    for variables in ({"XDG_CACHE_HOME": "/proc/nowhere"}, {"XDG_CACHE_HOME": "", "HOME": "/proc/nowhere"}):
        done = python(CLAIM, "", TMPDIR=str(tmp_path), **variables)
        root, pocl = done.stdout.split()
        assert root == str(folder / "clshade")
        assert pocl.startswith(f"{root}/pocl-")
        assert f"compiled kernels are kept in {folder} (/proc/nowhere" in done.stderr
        assert "No such file or directory): set XDG_CACHE_HOME" in done.stderr
        assert folder.stat().st_mode & 0o777 == 0o700
    assert list(tmp_path.iterdir()) == [folder]


def test_nowhere_to_write():
    code = "import tempfile; tempfile.tempdir = '/proc/nowhere'\n" + OPEN
    assert python(code, "/proc/nowhere").stdout.startswith("refused no folder for caches can be written")


# Folders of single processes


def test_processes_at_once_have_folders_of_their_own(tmp_path):
    """Children of a process and its forks, too; all go with their processes, or with the next."""
    code = f"""
import os, subprocess, sys
{CLAIM}
subprocess.run([sys.executable, "-c", {CLAIM!r}])
if os.fork() == 0:
    {CLAIM}
    os._exit(0)  # it leaves its folder behind
os.wait()
runtimes.starting()
if os.fork() == 0:
    try: runtimes.starting()
    except runtimes.DeviceError as error: print(error, flush=True)
    os._exit(0)
os.wait()
"""
    done = python(code, tmp_path)
    *lines, message = done.stdout.splitlines()
    folders = {line.split()[1] for line in lines}
    assert len(folders) == 3, done.stderr
    assert all(folder.startswith(f"{tmp_path}/clshade/pocl-") for folder in folders)
    assert "spawn" in message
    python(CLAIM, tmp_path)
    assert not list((tmp_path / "clshade").glob("pocl-*"))


PRIVATE = """
import os, signal, sys
from pathlib import Path
from clshade.pipeline.opencl import environment
print(environment.private_folder(Path({folder!r}), "once-"), flush=True)
{deed}
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_private_folders_go_with_their_process_or_with_the_next(tmp_path):
    def run(deed: str) -> Path:
        return Path(python(PRIVATE.format(folder=str(tmp_path), deed=deed), tmp_path / "home").stdout.strip())

    assert not run("").exists()
    left = run("os.kill(os.getpid(), signal.SIGKILL)")
    assert left.is_dir()
    used = environment.private_folder(tmp_path, "once-")
    assert not left.exists()
    forked = run("os.fork() or os._exit(0); os.wait()")
    assert used.is_dir(), "its process lives"
    assert not forked.exists()


@pytest.mark.parametrize("locked", [False, True])
def test_a_private_folder_that_another_process_removes_is_made_anew(tmp_path, monkeypatch, locked):
    """Between creating the lock file and locking it; locked: or while it holds the lock."""
    lock_file, robbed = environment.lock_file, []

    def lock_too_late(path):
        if robbed:
            return lock_file(path)
        robbed.append(path.parent)
        path.touch()
        with path.open("rb") as file:
            shutil.rmtree(path.parent)
            return None if locked else os.dup(file.fileno())

    monkeypatch.setattr(environment, "lock_file", lock_too_late)
    folder = environment.private_folder(tmp_path, "once-")
    assert folder.is_dir()
    assert robbed != [folder]


def test_private_folders_without_locks_go_when_they_are_old(tmp_path):
    for name in ("once-old", "once-new", "other"):
        (tmp_path / name).mkdir()
    for name in ("once-old", "other"):
        os.utime(tmp_path / name, (1, 1))
    (tmp_path / "once-link").symlink_to(tmp_path / "other")
    used = environment.private_folder(tmp_path, "once-")
    assert sorted(os.listdir(tmp_path)) == sorted(["once-new", "once-link", "other", used.name])


# Variables of the environment


def test_what_the_user_set_is_kept_but_for_the_folder_of_pocls_cache(tmp_path):
    """Which other processes may share."""
    code = CLAIM + "; print(os.environ['OCL_ICD_VENDORS'])"
    done = python(code, tmp_path, POCL_CACHE_DIR=f"{tmp_path}/own", OCL_ICD_VENDORS="/users/vendors")
    root, cache, vendors = done.stdout.split()
    assert (root, vendors) == (f"{tmp_path}/clshade", "/users/vendors"), done.stderr
    assert cache.startswith(f"{root}/pocl-")


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="the system cannot say which processors may be used")
def test_threads_are_pinned_where_each_processor_has_one(monkeypatch):
    """Not if there are fewer threads or processors, and not against the user's will; a parent's choice is not taken for
    the user's."""
    processors = set(range(os.cpu_count() or 0))
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: processors)
    parents = {"POCL_AFFINITY": "1", "CLSHADE_SET_POCL_AFFINITY": "1"}

    def chosen(**variables: str) -> str | None:
        for name in (*parents, *environment.THREADS):
            monkeypatch.setenv(name, variables.get(name, ""))
        environment._pin_threads()
        return os.environ.get("POCL_AFFINITY")

    assert chosen() == chosen(**parents) == "1"
    assert all(chosen(**parents, **{name: "1"}) is None for name in environment.THREADS)
    assert chosen(POCL_AFFINITY="0") == "0"
    processors.discard(0)
    assert chosen(**parents) is None


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Intel's runtime is pointed to on Linux only")
def test_intel_is_exposed_beside_the_others(fresh_cache, tmp_path, monkeypatch):
    library, system = tmp_path / "libintelocl.so", tmp_path / "vendors"
    library.touch()
    system.mkdir()
    (system / "mesa.icd").write_text("libMesaOpenCL.so.1\n")
    (system / "broken.icd").write_text("/opt/anaconda1anaconda2/lib/libintelocl.so")
    monkeypatch.setattr(environment, "SYSTEM_VENDORS", system)
    monkeypatch.setattr(environment, "intel_library", lambda: library)
    monkeypatch.setattr("sys.prefix", str(tmp_path / "prefix"))
    for name in ("OCL_ICD_VENDORS", "CLSHADE_SET_OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH"):
        monkeypatch.setenv(name, "")
    for _ in range(2):
        environment.expose_runtimes()
        folder = Path(os.environ["OCL_ICD_VENDORS"])
        assert folder.parent == fresh_cache
        contents = {path.name: path.read_text().strip() for path in folder.glob("*.icd")}
        assert contents == {"mesa.icd": "libMesaOpenCL.so.1", "clshade-intel.icd": str(library)}
    # Already registered by the system: nothing to do. The variable set above is not mistaken for the user's.
    (system / "intel.icd").write_text(str(library))
    environment.expose_runtimes()
    assert "OCL_ICD_VENDORS" not in os.environ
    monkeypatch.setenv("OCL_ICD_VENDORS", "/users/own")
    environment.expose_runtimes()
    assert os.environ["OCL_ICD_VENDORS"] == "/users/own"
