"""Programs that another running process has compiled are taken over, if they are intact."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from processes import ROOT, python

from clshade.pipeline.opencl import cache_slots
from clshade.pipeline.opencl.cache_sharing import note, runtime_folders, take_over
from clshade.pipeline.opencl.cache_slots import MARK, SEAL, Slot

PROGRAM, FOLDER = "binaries/0123", "pocl/AB/CD"
CODE = {f"{FOLDER}/program.bc": b"bitcode", f"{FOLDER}/phong/1-1-1/phong.so": bytes(range(256)) * 40}


def take(folder: Path) -> Slot:
    slot = cache_slots.take(folder)
    assert slot is not None
    return slot


@pytest.fixture
def slots(tmp_path: Path) -> tuple[Slot, Slot]:
    """Return a slot with a compiled program and one with nothing, both in use."""
    full, empty = take(tmp_path / "slot-0"), take(tmp_path / "slot-1")
    for name, content in {**CODE, "pocl/EF/GH/program.bc": b"another program"}.items():
        (full.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (full.folder / name).write_bytes(content)
    (full.folder / PROGRAM).parent.mkdir()
    (full.folder / PROGRAM).write_bytes(b"digest\n" + note({FOLDER}))
    full.seal()
    return full, empty


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()} - {"lock", SEAL}


def test_the_program_and_no_other_is_copied(slots):
    full, empty = slots
    assert runtime_folders(full) == {FOLDER, "pocl/EF/GH"}
    assert take_over(empty, PROGRAM)
    assert files(empty.folder) == {PROGRAM, *CODE}
    assert all((empty.folder / name).read_bytes() == content for name, content in CODE.items())
    assert empty.seal()


def test_what_is_there_already_stays(slots):
    empty = slots[1]
    own = empty.folder / FOLDER / "program.bc"
    own.parent.mkdir(parents=True)
    own.write_bytes(b"own")
    assert take_over(empty, PROGRAM)
    assert own.read_bytes() == b"own"


def test_a_kernel_that_is_not_sealed_or_damaged_is_left_to_the_compiler(slots):
    full, empty = slots
    (full.folder / FOLDER / "phong/1-1-1/phong.so").write_bytes(b"cut")
    (full.folder / FOLDER / "new.so").write_bytes(b"being written")
    assert take_over(empty, PROGRAM)
    assert files(empty.folder) == {PROGRAM, f"{FOLDER}/program.bc"}


def test_a_program_that_nobody_has(slots):
    assert not take_over(slots[1], "binaries/4567")
    assert files(slots[1].folder) == set()


@pytest.mark.parametrize(
    "damage",
    [
        lambda folder: (folder / SEAL).write_bytes(b"garbage"),
        lambda folder: (folder / PROGRAM).write_bytes(b"other"),
        lambda folder: (folder / SEAL).unlink(),
    ],
)
def test_a_slot_that_is_not_intact_gives_nothing(slots, damage):
    full, empty = slots
    damage(full.folder)
    assert not take_over(empty, PROGRAM)
    assert files(empty.folder) == set()


def test_a_slot_whose_process_died_gives_nothing(slots):
    full, empty = slots
    with full.using():
        assert take_over(empty, PROGRAM)  # it is compiling something else
    (empty.folder / PROGRAM).unlink()
    full.release()
    (full.folder / MARK).touch()
    assert not take_over(empty, PROGRAM)


def test_names_do_not_lead_out_of_the_slot(slots, tmp_path):
    full, empty = slots
    (tmp_path / "outside").write_bytes(b"outside")
    (full.folder / PROGRAM).write_bytes(b"digest\n" + note({f"{FOLDER}/.."}))
    full.seal()
    assert take_over(empty, PROGRAM)
    assert files(empty.folder) == {PROGRAM}


RENDER = """
import sys
import clshade
from clshade.pipeline import programs
clshade.render(clshade.builtin("icosphere", resolution=(16, 16)))
print(*[program.stored for program in programs.built()], flush=True)
sys.stdin.readline()
"""


@pytest.mark.long
def test_processes_that_run_at_once(tmp_path, opened):
    """The second process draws without compiling what the first, which still runs, has compiled."""
    if not opened.keeps_programs:
        pytest.skip("only PoCL's own cache is divided among processes")
    path = os.pathsep.join([str(ROOT), *filter(None, sys.path)])
    environment = {**os.environ, "PYTHONPATH": path, "XDG_CACHE_HOME": str(tmp_path), "CLSHADE_DEVICE": opened.index}
    with subprocess.Popen(
        [sys.executable, "-c", RENDER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    ) as first:
        assert first.stdout is not None
        assert set(first.stdout.readline().split()) == {"True"}  # the test of the device has compiled them
        compiled = {path.name for path in tmp_path.glob("clshade/slot-0/pocl/**/*.so")}
        second = python(RENDER, tmp_path, CLSHADE_DEVICE=opened.index)
        first.communicate("\n")
    assert set(second.stdout.split()) == {"True"}, second.stderr
    assert {path.name for path in tmp_path.glob("clshade/slot-1/pocl/**/*.so")} == compiled - {"fused_lanes.so"}
