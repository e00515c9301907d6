"""What a device is tested with before it draws, in a process of its own (`opencl.probe`), so that a compiler that aborts
takes no other along: a kernel of a few lines, then a small frame of the scene, whose compiled programs the parent takes
over."""

from __future__ import annotations

import contextlib
import pickle
import sys

import numpy as np

from ..scene.camera import Camera
from ..scene.model import Mesh, Scene
from .buffers import Buffer
from .features import Features
from .launches import Stages
from .opencl.device import Device, open_untested
from .opencl.probe import LANES, RIGHT, WRONG
from .programs import build, first_picture
from .renderer import Renderer

# (1 + 2^-12)^2 - (1 + 2^-11) is 2^-24 if it is rounded once, and 0 if the product is rounded too.
FUSED = """
#include "lanes.clh"
ITEM_BY_ITEM
kernel void fused_lanes(global const float *x, global float *y)
{
    reals a = LOAD_LANES(x), b = LOAD_LANES(x + LANES);
    STORE_LANES(fma(a, a, -b), y);
}
"""
SIZE = (48, 32)  # columns, rows


def main(index: str, name: str, lanes: str) -> None:
    """Test the device with so many lanes, "0" for its own number, and print whether its results are right: a small kernel,
    then the frame that standard input describes, which may come later."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # an abort is expected: no core file
    device = open_untested(index, name, int(lanes))
    print(f"{LANES}{device.lanes}", flush=True)
    program = build(device, Features.of(), FUSED, stored=False)  # to see whether the compiler works
    x = np.repeat(np.array([1 + 2.0**-12, 1 + 2.0**-11], np.float32), device.lanes)
    y = Buffer(device, np.zeros(device.lanes, np.float32))
    Stages(device, program).run("fused_lanes", (1, 1), x=Buffer(device, x), y=y)
    right = (y.to_host() == np.float32(2.0**-24)).all() and _draws(device, sys.stdin.buffer.read())
    print(RIGHT if right else WRONG, flush=True)


def _draws(device: Device, trial: bytes) -> bool:
    """Return whether a frame is right: of the parent's scene, if it can be drawn small, its numbers are finite; else of
    a red rectangle and, before its left half in the image, a green one."""
    with contextlib.suppress(Exception):
        arguments, first = pickle.loads(trial)
        with first_picture() if first else contextlib.nullcontext(), Renderer(**arguments, device=device) as renderer:
            return bool(np.isfinite(renderer.render().rgba).all())
    camera = Camera(eye=(0, 0, 0), lookat=(0, 0, 1), up=(0, 1, 0), focal=1.0, plane=(2.0, 3.0), resolution=SIZE)
    meshes = _rectangle(-9.0, 3.0, (1.0, 0.0, 0.0)), _rectangle(0.0, 2.0, (0.0, 1.0, 0.0))
    with Renderer(Scene(meshes, camera), device=device, shader="nolight") as renderer:
        frame = renderer.render()
    half = SIZE[0] // 2
    expected = np.zeros((SIZE[1], SIZE[0], 3), np.float32)
    expected[:, :half, 1] = expected[:, half:, 0] = 1.0
    return bool((frame.alpha == 1.0).all()) and np.array_equal(frame.rgb, expected)


def _rectangle(left: float, depth: float, color: tuple[float, float, float]) -> Mesh:
    corners = np.array([[left, -9, depth], [9, -9, depth], [9, 9, depth], [left, 9, depth]], float)
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), colors=np.tile(color, (4, 1)))
