"""Compiling and loading at a first use: timed apart from the frame, announced if slow, marked in the cache."""

from __future__ import annotations

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

import clshade
from clshade import Renderer
from clshade.base import console
from clshade.pipeline import programs
from clshade.pipeline.buffers import Buffer
from clshade.pipeline.features import Features
from clshade.pipeline.launches import Stages, items
from clshade.pipeline.opencl.device import Device
from clshade.pipeline.opencl.program_store import StoredProgram

SCENE = clshade.builtin("quads")
SLOWLY = 0.06  # seconds


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Simulate a process without built programs, in which each build and each kernel's first launch is slow; yield the
    names of the calls."""
    names: list[str] = []
    program, launch = cl.Program, cl.enqueue_nd_range_kernel

    def build(*arguments: Any) -> Any:
        names.append(f"build {len(names)}")
        time.sleep(SLOWLY)
        return program(*arguments)

    def enqueue(queue: Any, kernel: Any, *arguments: Any) -> Any:
        if kernel.function_name not in names:
            time.sleep(SLOWLY)
        names.append(kernel.function_name)
        return launch(queue, kernel, *arguments)

    monkeypatch.setattr(cl, "Program", build)
    monkeypatch.setattr(cl, "enqueue_nd_range_kernel", enqueue)
    monkeypatch.setattr(programs, "_built", {})
    return names


# Time


@pytest.mark.long
def test_a_frame_does_not_hold_what_its_kernels_cost(calls: list[str], opened: Device) -> None:
    start = time.perf_counter()
    with Renderer(SCENE, device=opened, resolution=(32, 24)) as renderer:
        first = renderer.render().stats
        passed = (time.perf_counter() - start) * 1e3
        uses = len(set(calls))
        second = renderer.render().stats
    minimum_ms = uses * SLOWLY * 1e3
    assert uses >= 6, "two programs and their kernels"
    assert minimum_ms <= first["build_ms"] <= passed
    assert sum(first["times_ms"][name] for name in ("pack", "open", "upload", "frame")) <= passed - minimum_ms
    assert second["build_ms"] == 0.0
    assert "build" not in first["times_ms"]


@pytest.mark.long
def test_what_clipping_compiles_is_counted_too(calls: list[str], opened: Device) -> None:
    """A camera among the triangles needs a kernel that the previous frame did not."""
    scene = clshade.builtin("torus_knot")
    seen = scene.camera
    inside = clshade.Camera(seen.lookat, seen.eye, seen.up, seen.focal, seen.plane, (32, 24))
    with Renderer(scene, device=opened, resolution=(32, 24)) as renderer:
        outside = renderer.render().stats
        clipped, again = (renderer.render(camera=inside).stats for _ in range(2))
    assert "clip" not in outside["times_ms"]
    assert "setup_pieces" in calls
    assert clipped["build_ms"] >= SLOWLY * 1e3
    assert clipped["times_ms"]["clip"] <= clipped["times_ms"]["frame"]
    assert again["build_ms"] == 0.0


@pytest.mark.sampled
@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("stored", [False, True])
@pytest.mark.parametrize("level", [console.NORMAL, console.QUIET])
def test_what_takes_long_is_said_once(
    parts: int, stored: bool, level: int, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    """Even if no single part is slow; nothing for a stored program, which can be slow to load."""
    monkeypatch.setattr(programs, "_said", False)
    monkeypatch.setattr(programs, "this_thread", type(programs.this_thread)())
    monkeypatch.setattr(programs, "SLOW", 0.24)
    device: Any = SimpleNamespace(title="PoCL: CPU")
    line = "clshade: compiling kernels for PoCL: CPU ...\n" if level == console.NORMAL else ""
    with console.at_level(level):
        for _ in range(parts):
            with programs.first_use(device, StoredProgram(None) if stored else None):
                time.sleep(0.36 / parts)
        meanwhile = capfd.readouterr().err
        assert meanwhile == ("" if stored else line)
        assert 0.36 <= programs.this_thread.waited < 1.8
        with programs.first_use(device, None):
            time.sleep(0.2)
            assert capfd.readouterr().err == ("" if meanwhile else line), "while it is under way"


def test_workers_leave_it_to_the_process_that_started_them(monkeypatch: pytest.MonkeyPatch, capfd: Any) -> None:
    console.progress("one")
    monkeypatch.setattr("multiprocessing.process._parent_process", object())
    console.progress("two")
    console.warning("three")
    assert capfd.readouterr().err == "clshade: one\n"


def test_what_a_kernel_runs_is_no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    before = programs.this_thread.waited
    with programs.first_use(SimpleNamespace(title=""), StoredProgram(None)):  # type: ignore[arg-type]
        start = time.perf_counter()
        time.sleep(0.2)
        programs.this_thread.waited -= time.perf_counter() - start
    assert programs.this_thread.waited - before < 0.1


# Kernels


@pytest.mark.long
def test_a_kernel_for_wide_grids_is_another(calls: list[str], opened: Device) -> None:
    program = programs.build(opened, Features.of(), ("layers.cl",))
    stages, uses = Stages(opened, program), []
    for count in (64, 64, 70_000, 70_000):
        owners, numbers, shown = (Buffer(opened, np.zeros(count, np.int32)) for _ in range(3))
        inputs = {"owners": owners, "numbers": numbers, "triangle_instances": None, "instances": None}
        inputs |= {"shown": shown, "in_table": True, "of_instances": False}
        stages.run("layer_number", items(count), inputs, triangles=owners, count=count)
        opened.queue.finish()
        uses.append(len(program.launched))
    assert uses == [1, 1, 2, 2]


@pytest.mark.parametrize("feature", ["DEPTH_TEST", "CASTERS", "INSTANCES"])
def test_parameters_are_read_from_the_source(device: Device, feature: str) -> None:
    """As many as the runtime counts, those of macros included."""
    files = ("project.cl", "setup.cl", "bin.cl", "surface_layers.cl")
    program = programs.build(device, Features.of({feature}), files, lanes=1)
    for name, kernel in program.kernels.items():
        assert len(program.parameters(name)) == kernel.num_args, name
    assert program.parameters("bin_sums") == {"image": None, "counts": None, "sums": None, "chunks": np.int32}
    surface = program.parameters("surface_layers")
    assert ("shadow_nodes" in surface, "object_normals" in surface) == (feature == "CASTERS", feature == "INSTANCES")


def test_a_build_is_tried_again_without_options_that_are_refused(
    opened: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once, for the compiler's message about the source is that of the second."""
    tried: list[bool] = []

    def refuse(program: Any, options: list[str]) -> str:
        tried.append(programs._LESS_OPTIMIZED in options)
        if tried[-1]:
            raise cl.RuntimeError("invalid options")
        return "built"

    monkeypatch.setattr(programs, "_without_log", refuse)
    assert programs.compiled(opened, "", ["-DA", programs._LESS_OPTIMIZED]) == "built"
    assert tried == [True, False]


# Warnings


def test_a_warning_of_the_compiler_is_said_and_fails_a_test(
    opened: Device, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    """By `unwarned` in conftest.py. PoCL keeps the log with a program, which warns again when it is loaded."""
    monkeypatch.setattr(programs, "_stored_program", lambda *_: StoredProgram(tmp_path / "program"))
    features = Features.of()
    text = "#warning planted\nkernel void warned(global int *x) { x[0] = 1; }"
    for _ in range(2 if opened.keeps_programs else 1):
        with console.at_level(console.VERBOSE), pytest.raises(AssertionError, match=r"text:1:.*planted"):
            programs.build(opened, features, text)
        assert "clshade: the compiler warns: " in capfd.readouterr().err


def test_a_warning_about_nvidias_own_mark_is_none() -> None:
    mark = "(): Warning: Function fill is a kernel, so overriding noinline attribute. It may be inlined."
    program = SimpleNamespace(get_build_info=lambda *_: f"{mark}\n<kernel>:3:1: warning: unused variable 'x'\n")
    messages = programs._warnings(SimpleNamespace(device=None), program)
    assert messages == ("<kernel>:3:1: warning: unused variable 'x'",)
