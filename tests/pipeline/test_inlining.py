"""No kernel calls a function of PoCL's library: each is inlined, on every CPU."""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import python

from clshade.pipeline.opencl import probe
from clshade.pipeline.opencl.device import Device, list_devices
from clshade.pipeline.opencl.inlining import called_builtins

EVERYDAY = """
draw("teapot")
draw("torus_knot", shader="gouraud")
"""
ALL = """
draw("teapot", samples=4, texture_filter="trilinear", layers="all")
draw("teapot", preset="course", shader="gouraud")
draw("box_room", precision="float64")
draw("box_room", precision="float64", shader="gouraud", visibility="painter")
draw("quads", precision="fast", lanes=4)
draw("icosphere", samples=5, resolve="weighted", lanes=8)
draw("torus_knot", visibility="painter")
forced = features.OPTIONAL
draw("teapot", forced=forced, inside=True)
"""
DRAWING = """
import clshade
from dataclasses import replace
from clshade.pipeline import features

def draw(name, inside=False, **options):
    scene = clshade.builtin(name, resolution=(64, 48))
    camera = scene.camera
    if inside:
        camera = replace(camera, eye=camera.lookat + 0.01)
    with clshade.Renderer(scene, device="pocl", **options) as renderer:
        renderer.render(camera)
"""
CALLING = """
import pyopencl as cl
from clshade.pipeline.opencl.device import open_device
device = open_device("pocl")
source = '''
__attribute__((target("no-fma"))) float f(float a, float b) { return fma(a, b, 1.0f); }
kernel void calling(global float *x) { x[0] = f(x[0], x[1]); }
'''
memory = cl.Buffer(device.context, cl.mem_flags.READ_WRITE, 8)
cl.Program(device.context, source).build().calling(device.queue, (1,), (1,), memory)
device.queue.finish()
"""


def compiled(code: str, folder: Path, opened: Device) -> dict[str, list[str]]:
    """Return the calls in the kernels that PoCL compiles while the code runs."""
    if not opened.keeps_programs:
        pytest.skip("needs PoCL")
    done = python(code, folder, timeout=240)
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stderr  # of the compiler's
    return called_builtins(folder)


@pytest.mark.long
def test_kernels_call_no_builtin_function(tmp_path: Path, opened: Device) -> None:
    calls = compiled(DRAWING + EVERYDAY, tmp_path, opened)
    assert {"project", "setup", "phong", "gouraud"} <= calls.keys()
    assert not any(calls.values()), calls


@pytest.mark.long
def test_no_kernel_of_any_kind_calls_a_builtin_function(tmp_path: Path, opened: Device) -> None:
    calls = compiled(DRAWING + ALL, tmp_path, opened)
    assert {"setup_pieces", "surface_layers", "gouraud_corners", "layer_z"} <= calls.keys()
    assert not any(calls.values()), calls


@pytest.mark.long
def test_calls_are_found(tmp_path: Path, opened: Device) -> None:
    """A function for a CPU without fma inlines none of the library's, which is compiled for this one."""
    assert any("_cl_fma" in name for name in compiled(CALLING, tmp_path, opened).get("calling", []))


def test_a_probe_finds_none(opened: Device) -> None:
    info = next(info for info in list_devices() if info.index == opened.index)
    tried = probe.Probe(info)
    assert tried.finish() == ""
    assert tried.called == []
