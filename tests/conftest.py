"""Shared fixtures: every OpenCL device that works, the folder of real scenes, empty caches."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pytest
from browsers import SOFTWARE_GL, chromium
from devices import working_devices
from processes import OPEN, ROOT, python

from clshade import course
from clshade.base import console
from clshade.errors import DeviceError
from clshade.pipeline import ahead, draw, programs
from clshade.pipeline.opencl import environment, program_store
from clshade.pipeline.opencl.device import Device, open_device

if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("POCL_AFFINITY", "0")  # pinned threads of several processes would get in each other's way

draw._MOST_LIT = 0  # no program for one scene alone
os.environ[ahead.AHEAD] = "0"
program_store.MOST_BYTES = 1 << 30  # the tests build some 200 MB of programs, which the next run finds again


# With all tests these take longest, one to several minutes each. They begin first, or else one of them may be left at the
# end for one process alone.
LONGEST = (
    "measure/test_planted_mistakes.py",
    "fuzz/test_fuzz.py",
    "pipeline/test_processors.py",
    "measure/test_conform.py",
    "pipeline/test_oclgrind.py",
    "pipeline/test_every_feature.py",
    "pipeline/test_same_bits.py",
    "measure/test_stability.py",
    "measure/test_checking.py",
    "pipeline/test_transparency.py",
    "pipeline/test_layers.py",
    "view/test_page_browser.py",
    "pipeline/test_kernel_cache.py",
    "course/test_course.py",
    "course/test_demos.py",
    "base/test_interrupts.py",
    "test_readme.py",
)


# Compiling takes most of the tests' time: whoever needs another program does without one that was needed so far.
MOST_PROGRAMS, MOST_EVERY_DAY = 150, 60
_began = time.time()


def is_everyday(config: pytest.Config) -> bool:
    return config.option.markexpr == "not long"


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    terminalreporter.write_line(f"{programs_needed()} different programs of OpenCL C")


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Fail if more programs were needed than are allowed."""
    limit = MOST_EVERY_DAY if is_everyday(session.config) else MOST_PROGRAMS
    if "PYTEST_XDIST_WORKER" not in os.environ and programs_needed() > limit and not exitstatus:
        print(f"\nexpected at most {limit} different programs of OpenCL C")
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def programs_needed() -> int:
    """Return how many programs were built or loaded since the tests began, by all processes with this cache."""
    return sum(path.stat().st_mtime >= _began for path in environment.cache_root().glob("programs/*"))


def pytest_configure(config: pytest.Config) -> None:
    examples = 30 if is_everyday(config) else 100
    # Without a deadline: other processes take their time from an example.
    hypothesis.settings.register_profile("of this run", max_examples=examples, deadline=None)
    hypothesis.settings.load_profile("of this run")
    config.option.loadscopereorder = False  # pytest-xdist's: files with many tests, however quick, would begin first


@pytest.hookimpl(tryfirst=True)  # before -m chooses
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    sampled = set()
    for item in items:
        name = item.nodeid.partition("[")[0]
        if item.get_closest_marker("sampled") is not None and item.get_closest_marker("long") is None:
            if name in sampled:
                item.add_marker("long")
            sampled.add(name)
    if "PYTEST_XDIST_WORKER" in os.environ:
        place = {ROOT / "tests" / name: place for place, name in enumerate(LONGEST)}
        items.sort(key=lambda item: place.get(item.path, len(LONGEST)))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect no garbage while thousands of tests are collected, which stay."""
    gc.disable()
    result = yield
    gc.freeze()
    gc.enable()
    return result


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "device" in metafunc.fixturenames:
        metafunc.parametrize("device", working_devices() or [None], indirect=True, scope="session")


@pytest.hookimpl(tryfirst=True)  # before fixtures
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Every day, build kernels without optimization, which takes half the time, twice the memory, and gives the same bits.
    With long tests, and in tests whose subject is the compiler, they are built as for users."""
    quick = is_everyday(item.config) and item.get_closest_marker("optimized") is None
    os.environ[programs.QUICK] = "1" if quick else ""


@pytest.fixture(scope="session", autouse=True)
def patient() -> None:
    """Suppress notices of slow compilers and slow steps: both depend on earlier runs and on the machine's load."""
    programs.SLOW = console.SLOW = 1e6


@pytest.fixture(scope="session", autouse=True)
def unwarned() -> None:
    """Fail every test that needs a program of which the compiler warns: no further program is compiled for that. Of what
    only we store, rather than the runtime, the log is lost: it is checked when it is compiled."""
    build = programs._built_or_loaded

    def checked(*arguments: Any, **options: Any) -> programs.Program:
        program = build(*arguments, **options)
        assert not program.warnings, "\n".join(program.warnings)
        return program

    programs._built_or_loaded = checked


@pytest.fixture(scope="session")
def device(request: pytest.FixtureRequest) -> Iterator[Device]:
    """Return each device that works, opened once."""
    if request.param is None:
        pytest.skip("no OpenCL device works here: see `python -m clshade devices`")
    return open_device(request.param)


@pytest.fixture
def on_each_device(device: Device, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Run the course's functions on each device that works."""
    monkeypatch.setattr(course, "shared_device", lambda: device)
    yield
    course.release()


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Return the folder of real scenes named by CLSHADE_DATA."""
    name = os.environ.get("CLSHADE_DATA", "")
    if not name or not Path(name).is_dir():
        pytest.skip("CLSHADE_DATA names no folder with scenes")
    return Path(name)


@pytest.fixture(scope="session")
def opened() -> Device:
    """Return the default device."""
    try:
        return open_device()
    except DeviceError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def homeless(opened: Device, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Open a device in a process that cannot write to its home; return its temporary folder, and its output."""
    folder = tmp_path_factory.mktemp("temporary")
    code = OPEN + "import os; print(os.environ['XDG_CACHE_HOME'], os.environ['POCL_CACHE_DIR'])"
    done = python(code, "", HOME="/proc/nowhere", TMPDIR=str(folder), CLSHADE_DEVICE=opened.index)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the test's folder, which becomes the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def fresh_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Use an empty cache folder in this process from now on."""
    (tmp_path / "clshade").mkdir()
    monkeypatch.setattr(environment, "_home", tmp_path)
    return tmp_path / "clshade"


@pytest.fixture(scope="module")  # not longer: see `chromium` on asyncio
def launch() -> Iterator[Callable[..., Any]]:
    """Return a function that starts headless Chromium with the given arguments."""
    with chromium() as start:
        yield start


@pytest.fixture(scope="module")
def browser(launch: Callable[..., Any]) -> Any:
    """Return headless Chromium with WebGL by software."""
    return launch(*SOFTWARE_GL)
