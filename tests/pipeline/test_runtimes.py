"""Cache folders claimed by single processes, and the runtimes made known to the loader."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from processes import OPEN, python

from clshade.pipeline.opencl import environment

CLAIM = (
    "import os; from clshade.pipeline.opencl import environment as runtimes; runtimes.prepare(); "
    "print(runtimes.cache_root(), os.environ['POCL_CACHE_DIR'], flush=True)"
)


def test_no_home(homeless: tuple[Path, str]) -> None:
    home = f"{homeless[0]}/clshade-{os.getuid()}"
    opened, folders = homeless[1].splitlines()
    assert opened.startswith("opened ")
    assert folders.startswith(f"{home} {home}/clshade/pocl-")


@pytest.mark.sampled
@pytest.mark.parametrize("kind", ["others can write", "group can write", "link", "file", "another user's"])
def test_a_temporary_folder_of_someone_else_is_not_used(tmp_path: Path, kind: str) -> None:
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
    for deed in ("", "; os.kill(os.getpid(), 9)", "", ""):
        done = python(CLAIM + deed, "/proc/nowhere", TMPDIR=str(tmp_path))
        assert done.returncode == (-9 if deed else 0), done.stderr
        folder = Path(done.stdout.split()[0])
        assert folder.parent.parent == tmp_path
        assert folder.parent.name.startswith(f"clshade-{os.getuid()}-")
        assert len(done.stderr.splitlines()) == 1
        assert done.stderr.startswith("clshade: warning: compiled kernels are not kept (/proc/nowhere: ")
        assert len(list(tmp_path.iterdir())) == (3 if deed else 2)
    assert not list(private_folder.iterdir())


def test_a_temporary_folder_that_others_can_read_is_made_private(tmp_path: Path) -> None:
    folder = tmp_path / f"clshade-{os.getuid()}"
    folder.mkdir()
    folder.chmod(0o755)
    for _ in range(2):
        done = python(CLAIM, "/proc/nowhere", TMPDIR=str(tmp_path))
        assert done.stdout.split()[0] == str(folder / "clshade")
        said = f"compiled kernels are kept in {folder} (/proc/nowhere: No such file or directory): set XDG_CACHE_HOME"
        assert said in done.stderr
        assert folder.stat().st_mode & 0o777 == 0o700
    assert list(tmp_path.iterdir()) == [folder]


def test_nowhere_to_write(tmp_path: Path) -> None:
    code = "import tempfile; tempfile.tempdir = '/proc/nowhere'\n" + OPEN
    done = python(code, "/proc/nowhere")
    assert done.stdout.startswith("refused no folder for caches can be written"), done.stderr


def test_processes_at_once_have_folders_of_their_own(tmp_path: Path) -> None:
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


def test_what_the_user_set_is_kept_but_for_the_folder_of_pocls_cache(tmp_path: Path) -> None:
    """Which other processes may share."""
    code = CLAIM + "; print(os.environ['OCL_ICD_VENDORS'])"
    done = python(code, tmp_path, POCL_CACHE_DIR=f"{tmp_path}/own", OCL_ICD_VENDORS="/users/vendors")
    root, cache, vendors = done.stdout.split()
    assert (root, vendors) == (f"{tmp_path}/clshade", "/users/vendors"), done.stderr
    assert cache.startswith(f"{root}/pocl-")


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="the system cannot say which processors may be used")
def test_threads_are_pinned_where_each_processor_has_one(tmp_path: Path) -> None:
    """Not if there are fewer threads or processors, and not against the user's will; a parent's choice is not taken for
    the user's."""
    code = (
        "import os; from clshade.pipeline.opencl import environment; environment.prepare(); {}environment.starting(); "
        "print(os.environ.get('POCL_AFFINITY'))"
    )
    unset = {"POCL_AFFINITY": "", "CLSHADE_SET_POCL_AFFINITY": "", **dict.fromkeys(environment.THREADS, "")}
    all_of_them = os.sched_getaffinity(0) == set(range(os.cpu_count() or 0))
    parents = {"POCL_AFFINITY": "1", "CLSHADE_SET_POCL_AFFINITY": "1"}

    def chosen(before: str = "", **changes: str) -> str:
        return python(code.format(before), tmp_path, **{**unset, **changes}).stdout.strip()

    assert chosen() == ("1" if all_of_them else "None")
    for name in environment.THREADS:
        assert chosen(**{name: "1"}) == "None"
        assert chosen(**parents, **{name: "1"}) == "None"
    if (os.cpu_count() or 1) > 1:
        assert chosen("os.sched_setaffinity(0, [min(os.sched_getaffinity(0))]); ") == "None"
    assert chosen(POCL_AFFINITY="0") == "0"


# Runtimes


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Intel's runtime is pointed to on Linux only")
def test_intel_is_exposed_beside_the_others(fresh_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
