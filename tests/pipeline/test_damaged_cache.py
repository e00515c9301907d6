"""Damaged kernel caches: a run that finds one still draws the correct image, and reports it in one line."""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from processes import ROOT

from clshade.pipeline.opencl.device import Device

SMALL = ["render", "quads", "--resolution", "64,48", "--shader", "nolight", "--samples", "1", "--deterministic"]
Damage = Callable[[Path], object]


class Run(NamedTuple):
    code: int
    images: tuple[bytes, ...]
    said: list[str]


def run(folder: Path, device: str, before: str = "") -> Run:
    """Run with the cache in `folder`. before: Python code to run first."""
    for name in ("image.exr", "image.png"):
        (folder / name).unlink(missing_ok=True)
    # Without a writable cache the temporary folder is used, which tests must not share.
    variables = {"PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(folder / "cache"), "TMPDIR": str(folder)}
    code = f"import sys, resource; resource.setrlimit(resource.RLIMIT_CORE, (0, 0)); sys.argv[0] = 'clshade'\n{before}"
    code += "\nfrom clshade.base import console; console.SLOW = 1e6  # no word about slow steps"
    code += "\nfrom clshade.__main__ import entry; entry()"
    done = subprocess.run(
        [sys.executable, "-c", code, *SMALL, "-o", "image", "--device", device],
        env={**os.environ, **variables},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=200,
    )
    images = tuple(path.read_bytes() for path in sorted(folder.glob("image.*")))
    return Run(done.returncode, images, done.stderr.splitlines())


@pytest.fixture(scope="module")
def kept(opened: Device, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Run]:
    """Return a folder with the cache of a run, and the result of a run that finds everything in it."""
    if "portable computing" not in opened.platform.lower():
        pytest.skip("only PoCL keeps its kernels in our folder")
    folder = tmp_path_factory.mktemp("kept")
    first = run(folder, opened.index)
    assert first.code == 0, first.said
    second = run(folder, opened.index)
    assert (second.code, second.images, second.said) == (0, first.images, [])
    return folder, second


@pytest.fixture
def cached(kept: tuple[Path, Run], tmp_path: Path) -> Path:
    """Return a folder with a copy of that cache."""
    shutil.copytree(kept[0] / "cache", tmp_path / "cache")
    return tmp_path


# Ways to damage files


def cut(share: float) -> Damage:
    return lambda path: os.truncate(path, int(path.stat().st_size * share))


def flip(path: Path) -> None:
    """Flip thirty random bits."""
    drawn, data = random.Random(path.name), bytearray(path.read_bytes())
    for _ in range(30):
        data[drawn.randrange(len(data))] ^= 1 << drawn.randrange(8)
    path.write_bytes(data)


def fill(path: Path) -> None:
    path.write_bytes(random.Random(path.name).randbytes(path.stat().st_size))


def make_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def every(change: Damage, pattern: str = "*") -> Damage:
    """Apply the change to every file that is not empty and matches the pattern."""

    def apply(cache: Path) -> None:
        paths = [path for path in cache.rglob(pattern) if path.is_file() and path.stat().st_size]
        assert paths
        for path in paths:
            change(path)

    return apply


def file_instead(name: str) -> Damage:
    def apply(cache: Path) -> None:
        shutil.rmtree(cache / name)
        (cache / name).write_text("x")

    return apply


def spoil_pyopencls(cache: Path) -> None:
    """Damage the file in which pyopencl would cache generated code."""
    version = ".".join(map(str, sys.version_info))
    path = cache / "pytools" / f"pdict-v5-pyopencl-invoker-cache-v42-nano-{version}.sqlite"
    path.parent.mkdir()
    path.write_bytes(random.Random(1).randbytes(20_000))


PROGRAMS = "[0-9a-f]" * 64
KINDS: dict[str, Damage] = {  # of verdicts: test_device.py
    "all empty": every(cut(0)),
    "all garbage": every(fill),
    "programs empty": every(cut(0), PROGRAMS),
    "programs half": every(cut(0.5), PROGRAMS),
    "programs flips": every(flip, PROGRAMS),
    "programs folders": every(make_folder, PROGRAMS),
    "sqlite garbage": spoil_pyopencls,
    "clshade a file": file_instead("clshade"),
    "no folder of programs": file_instead("clshade/programs"),
    "one program lost": lambda cache: next(cache.glob("clshade/programs/*")).unlink(),
}


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_damage(kept: tuple[Path, Run], cached: Path, opened: Device, kind: str) -> None:
    KINDS[kind](cached / "cache")
    first = run(cached, opened.index)
    assert (first.code, first.images) == (0, kept[1].images), first.said
    thrown = [line for line in first.said if "is thrown away and compiled anew: " in line]
    assert bool(thrown) == kind.startswith("programs"), "a trial of the device throws away without a word"
    remarks = [line for line in first.said if line not in thrown]
    elsewhere = "clshade: warning: compiled kernels are kept in "
    prefixes = ("clshade: compiling kernels for ", "clshade: trying out ", elsewhere)
    assert all(line.startswith(prefixes) for line in remarks), first.said
    second = run(cached, opened.index)
    assert (second.code, second.images) == (0, kept[1].images)
    assert all(line.startswith(elsewhere) for line in second.said), "the next one has nothing to compile"
    assert bool(second.said) == (kind == "clshade a file")


def test_a_flipped_bit_is_found_before_it_is_run(kept: tuple[Path, Run], cached: Path, opened: Device) -> None:
    """In any compiled file, even one that would only draw wrong pixels."""
    path = max((cached / "cache").rglob(PROGRAMS))
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 4
    path.write_bytes(data)
    outcome = run(cached, opened.index)
    assert (outcome.code, outcome.images) == (0, kept[1].images)
    assert outcome.said[0] == (
        f"clshade: warning: a compiled program in {path.parent} is thrown away and compiled anew: it is damaged"
    )
    assert all("compiling kernels" in line for line in outcome.said[1:])


CRASHES = """
import os
import pyopencl as cl
cl.{function} = lambda *arguments, **options: os.abort()
"""


@pytest.mark.long
@pytest.mark.parametrize("function", ["Program", "enqueue_nd_range_kernel"], ids=["loading", "launching"])
def test_a_run_that_died_of_what_is_cached(kept: tuple[Path, Run], cached: Path, opened: Device, function: str) -> None:
    died = run(cached, opened.index, before=CRASHES.format(function=function))
    assert died.code == -6
    outcome = run(cached, opened.index)
    assert (outcome.code, outcome.images) == (0, kept[1].images)
    assert outcome.said[0].endswith("is thrown away and compiled anew: a run that began to use it ended abruptly")


@pytest.mark.long
def test_only_the_first_use_counts(kept: tuple[Path, Run], cached: Path, opened: Device) -> None:
    """A run that is killed later, here while writing, discards nothing."""
    crash = (
        "import os; from clshade.pipeline import frame; frame.Frame.write = lambda *_, **__: os.kill(os.getpid(), 9)"
    )
    assert run(cached, opened.index, before=crash).code == -9
    assert run(cached, opened.index) == kept[1]
