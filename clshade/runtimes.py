"""What has to be in place before OpenCL starts: cache folders of this process's own, and every runtime in sight.

Nothing here imports pyopencl: its ICD loader and PoCL read the environment once, when OpenCL starts. `prepare` sets it
up, and leaves alone whatever the user has set. Environment variables set here are inherited by child processes; each is
noted in `CLSHADE_SET_<name>`, by which a child tells them from the user's own and replaces them.
"""

from __future__ import annotations

import glob
import hashlib
import os
import shutil
import site
import stat
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from . import interrupts
from .errors import DeviceError

SLOTS = 256  # cache folders before a process gets a throw-away one
ROOM = 64 << 20  # bytes: PoCL ends the process, without a word, when it cannot write what it compiles
SYSTEM_VENDORS = Path("/etc/OpenCL/vendors")


@dataclass(frozen=True)
class Slot:
    """A cache folder that this process alone uses, for as long as it lives.

    folder: holds `pocl` (PoCL's kernel cache) and `programs` (pyopencl's cache of built programs).
    lock: descriptor of the locked file, or None where files cannot be locked.
    """

    folder: Path
    lock: int | None

    @property
    def pocl(self) -> Path:
        return self.folder / "pocl"

    @property
    def programs(self) -> Path:
        return self.folder / "programs"


_guard = threading.RLock()
_slot: Slot | None = None
_home: Path | None = None
_prepared = False
_started_in: int | None = None  # the process that started OpenCL


def is_users(name: str) -> bool:
    """Whether the environment variable was set by the user rather than by clshade, here or in a parent process."""
    value = os.environ.get(name)
    return bool(value) and value != os.environ.get(f"CLSHADE_SET_{name}")


def _set(name: str, value: str) -> None:
    os.environ[name] = os.environ[f"CLSHADE_SET_{name}"] = value


# Where the caches are


def _default_cache_home() -> Path:
    """The folder that pyopencl and PoCL would use: the platform's cache folder of this user."""
    named = os.environ.get("XDG_CACHE_HOME", "").strip()
    if not named and sys.platform == "win32":
        named = os.environ.get("LOCALAPPDATA", "")
    # expanduser leaves the ~ where a user has no home; such a path is found unusable.
    return Path(named or os.path.expanduser("~/Library/Caches" if sys.platform == "darwin" else "~/.cache"))


def unusable(folder: Path, error: OSError) -> DeviceError:
    """The complaint about a cache folder."""
    return DeviceError(f"the cache folder {folder} cannot be used: {error.strerror or error}")


def _fault(home: Path) -> str:
    """Why caches cannot be kept there, by clshade and by pyopencl (which keeps one in `pytools`); "" if they can."""
    try:
        if not home.is_absolute():
            return "not an absolute path"
        (home / "clshade").mkdir(parents=True, exist_ok=True, mode=0o700)
        trial = home / "clshade" / f"trial-{os.getpid()}-{threading.get_native_id()}"
        trial.touch()
        trial.unlink()
        free = shutil.disk_usage(home / "clshade").free
        if free < ROOM:
            return f"{free / 1e6:.1f} MB free, {ROOM / 1e6:.0f} MB needed"
        pytools = home / "pytools"
        writable = os.access(pytools if pytools.exists() else home, os.W_OK | os.X_OK)
        if writable and pytools.exists():
            writable = all(os.access(file, os.W_OK) for file in pytools.iterdir())
        return "" if writable else "not writable"
    except (OSError, RuntimeError) as error:
        return getattr(error, "strerror", None) or str(error)


def _temporary_cache_home(instead: str) -> Path:
    """A folder of this user in the system's temporary folder: the same one each time unless someone else made it.

    instead: what was wrong with the other folder, for the message.

    What is cached is code that gets loaded, so a folder that others can write to is not used.
    """
    import tempfile

    try:
        if not hasattr(os, "getuid"):
            return Path(tempfile.mkdtemp(prefix="clshade-"))
        folder = Path(tempfile.gettempdir()) / f"clshade-{os.getuid()}"
        try:
            folder.mkdir(mode=0o700)
        except FileExistsError:
            status = folder.lstat()
            if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o077:
                folder = Path(tempfile.mkdtemp(prefix="clshade-"))
        fault = _fault(folder)
        if not fault:
            return folder
        fault = f"{folder}: {fault}"
    except OSError as error:
        fault = f"the temporary folder: {error.strerror or error}"
    found = f"{instead}; {fault}"
    raise DeviceError(f"no folder for caches can be written ({found}): set XDG_CACHE_HOME to a folder that can")


def cache_home() -> Path:
    """A writable cache folder. Where the user's own is missing, unwritable or full: one in the temporary folder, which is
    then also set as XDG_CACHE_HOME, because pyopencl fails without."""
    global _home
    with _guard:
        if _home is None:
            home = _default_cache_home()
            fault = _fault(home)
            if fault:
                home = _temporary_cache_home(f"{home}: {fault}")
                os.environ["XDG_CACHE_HOME"] = str(home)
            _home = home
        return _home


def cache_root() -> Path:
    """clshade's own folder in `cache_home`; it exists."""
    return cache_home() / "clshade"


# One cache folder per process


def _lock(path: Path) -> int | None:
    """The descriptor of the file at `path`, locked until it is closed or the process ends. None: another has it.

    Raises OSError where the file cannot be made, or its file system knows no locks.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)  # not inherited by programs that are started
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        os.close(descriptor)
        return None
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def _take(folder: Path) -> Slot | None:
    """Claims the folder for this process, made if need be; None: another process has it."""
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    lock = _lock(folder / "lock")
    if lock is None:
        return None
    slot = Slot(folder, lock)
    for kept in (slot.pocl, slot.programs):
        kept.mkdir(exist_ok=True, mode=0o700)
    # Left by processes that were killed. pyopencl would wait a minute for its lock file, and then fail.
    for left in [slot.programs / "lock", *slot.pocl.glob("tempfile*")]:
        if not left.is_dir():
            left.unlink(missing_ok=True)
    return slot


def _throw_away_slot() -> Slot:
    """A folder for this process only, removed when it exits."""
    import tempfile

    try:
        slot = Slot(Path(tempfile.mkdtemp(prefix="once-", dir=cache_root())), None)
        for folder in (slot.pocl, slot.programs):
            folder.mkdir()
    except OSError as error:
        raise unusable(cache_root(), error) from None
    owner = os.getpid()

    def remove() -> None:
        if os.getpid() == owner:
            shutil.rmtree(slot.folder, ignore_errors=True)

    interrupts.at_end(remove)
    return slot


def _claim() -> Slot:
    """The first folder of `slot-0`, `slot-1`, ... that no running process has. Two processes that share PoCL's cache
    can crash; a process on its own always gets slot-0, and so finds what the last one compiled."""
    try:
        for number in range(SLOTS):
            slot = _take(cache_root() / f"slot-{number}")
            if slot is not None:
                return slot
    except OSError:
        pass
    return _throw_away_slot()


def _adopt(slot: Slot) -> Slot:
    global _slot
    _slot = slot
    if not is_users("POCL_CACHE_DIR"):
        _set("POCL_CACHE_DIR", str(slot.pocl))
    return slot


def isolate_cache(folder: str | os.PathLike[str]) -> Path:
    """Makes this process keep its caches in `folder` instead of a claimed one: for workers, before OpenCL starts.

    Raises DeviceError if it is too late, another running process uses the folder, or it cannot be written.
    """
    path = Path(folder).absolute()
    with _guard:
        if _slot is not None and _slot.folder == path:
            return path
        if _started_in == os.getpid():
            raise DeviceError("isolate_cache came too late: OpenCL has started in this process")
        try:
            slot = _take(path)
        except OSError as error:
            raise unusable(path, error) from None
        if slot is None:
            raise DeviceError(f"the cache folder {path} is in use by another process: give each its own")
        if _slot is not None and _slot.lock is not None:
            os.close(_slot.lock)
        os.environ.pop("POCL_CACHE_DIR", None)
        _adopt(slot)
        return path


def _forget() -> None:
    """In a forked child: the folder is the parent's. Closing its descriptor here leaves the parent's lock in place."""
    global _slot, _guard, _prepared
    _guard = threading.RLock()
    _prepared = False
    if _slot is not None and _slot.lock is not None:
        os.close(_slot.lock)
    _slot = None


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


# Which runtimes the ICD loader sees


def intel_library() -> Path | None:
    """Intel's CPU runtime as pip or conda install it (`intel-opencl-rt`), or None."""
    prefixes = dict.fromkeys((sys.prefix, sys.base_prefix, site.getuserbase(), "/usr/local"))
    return next((p for p in (Path(prefix, "lib", "libintelocl.so") for prefix in prefixes) if p.is_file()), None)


def _registered(folders: Sequence[Path]) -> dict[str, str]:
    """The .icd files of the folders, name to library. Left out: those with the path of a library that does not exist
    (the ones of Intel's PyPI package), and libraries named before."""
    found: dict[str, str] = {}
    for folder in folders:
        for path in sorted(folder.glob("*.icd")):
            try:
                library = path.read_text(errors="replace").strip()
            except OSError:
                continue
            missing = os.path.isabs(library) and not os.path.exists(library)
            if library and not missing and library not in found.values():
                found[path.name if path.name not in found else f"{folder.parent.parent.name}-{path.name}"] = library
    return found


def expose_runtimes() -> None:
    """Makes Intel's runtime visible where it is installed, beside PoCL and the system's runtimes.

    The .icd files that come with it name a folder of its build machine, so OCL_ICD_VENDORS is set to a folder of
    working ones. PyPI's pyopencl adds the PoCL it carries to whatever folder that is.
    """
    if not sys.platform.startswith("linux") or is_users("OCL_ICD_VENDORS") or os.environ.get("OPENCL_VENDOR_PATH"):
        return
    os.environ.pop("OCL_ICD_VENDORS", None)
    library = intel_library()
    if library is None:
        return
    files = _registered((SYSTEM_VENDORS, Path(sys.prefix, "etc", "OpenCL", "vendors")))
    if any(os.path.basename(known).startswith("libintelocl.so") for known in files.values()):
        if all((SYSTEM_VENDORS / name).exists() for name in files):
            return
    else:
        files["clshade-intel.icd"] = str(library)
    digest = hashlib.sha256(repr(sorted(files.items())).encode()).hexdigest()[:16]
    folder = cache_root() / f"vendors-{digest}"
    if not folder.is_dir():
        import tempfile

        try:
            made = Path(tempfile.mkdtemp(prefix="vendors-", dir=cache_root()))
            for name, content in files.items():
                (made / name).write_text(content + "\n")
        except OSError as error:
            raise unusable(cache_root(), error) from None
        try:
            made.rename(folder)
        except OSError:  # another process was first
            shutil.rmtree(made, ignore_errors=True)
    _set("OCL_ICD_VENDORS", str(folder))


def prepare(name: str = "") -> Slot:
    """Sets the environment up for OpenCL and claims this process's cache folder; later calls only return it. Call it
    before importing pyopencl. `name`: the device asked for, as for `device.open_device`."""
    global _prepared
    with _guard:
        slot = _slot or _adopt(_claim())
        if not _prepared:
            expose_runtimes()
            # pyopencl looks this up unguarded when its cache fails; empty: it warns and goes on without the cache.
            os.environ.setdefault("PYOPENCL_CACHE_FAILURE_FATAL", "")
            if "rusticl" in name.lower():
                os.environ.setdefault("RUSTICL_ENABLE", "swrast")  # Mesa hides its CPU device otherwise
            _prepared = True
        return slot


def starting() -> None:
    """Notes that OpenCL starts in this process.

    Raises DeviceError in a child forked after it had started: a runtime's threads do not survive the fork.
    """
    global _started_in
    if _started_in not in (None, os.getpid()):
        raise DeviceError(
            "this process was forked after OpenCL had started: start workers with multiprocessing's `spawn` method"
        )
    _started_in = os.getpid()


def fingerprint(package: str) -> list[list[object]]:
    """What a device's working depends on besides its driver's version, cheaply found: [path, time of change] of the
    runtimes' libraries in pip's folders (`package`: pyopencl's folder), of `ld`, and of the C library's linker script
    and compiler support files, which PyPI's PoCL links its kernels with."""
    paths = [*glob.glob(os.path.join(package, ".libs", "libpocl*")), str(intel_library() or "")]
    paths += [shutil.which("ld") or "", shutil.which("x86_64-unknown-linux-gnu-ld") or ""]
    for pattern in (
        "/usr/lib/libc.so",
        "/usr/lib64/libc.so",
        "/usr/lib/*-linux-gnu*/libc.so",
        "/usr/lib/gcc*/*/*/libgcc.a",
    ):
        paths += sorted(glob.glob(pattern))
    result: list[list[object]] = []
    for path in filter(None, paths):
        try:
            result.append([path, os.stat(path).st_mtime_ns])
        except OSError:
            result.append([path, None])
    return result
