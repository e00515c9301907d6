"""Launches kernels, with arguments by the names of their parameters."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any
from weakref import ref

import numpy as np
import pyopencl as cl

from ..errors import DeviceError
from . import struct_layout
from .buffers import Buffer
from .features import COMMON, Features
from .opencl.device import Device
from .programs import Program, build, first_use, own

# Triangles and tile lists depend on few features, lighting on most: two programs, so that scenes share the first.
_GEOMETRY_FILES = ("project.cl", "setup.cl", "bin.cl", "layers.cl")
_GEOMETRY_FEATURES = ("DOUBLE", "SAMPLES", "DEPTH_TEST", "INSTANCES")
_INSTANCES_FILE = "instances.cl"  # of the geometry too
_LINE_FEATURES = ("DOUBLE", "SAMPLES", "DEPTH_TEST")
_LAYER_FEATURES = ("DOUBLE", "SAMPLES", "INSTANCES", "CASTERS")
_WIDE = (1 << 16) - 1  # work-items in one dimension from which on PoCL compiles a separate kernel

Size = tuple[int, int]  # work-items of a launch, in one dimension, and of a work-group


def scene_stages(
    device: Device,
    features: Features,
    lanes: int | None = None,
    layers: Features | None = None,
    *,
    first: bool = False,
) -> Stages:
    """Return the stages that draw a scene; their programs are built unless they are cached. layers: features of the
    program of surface_layers.cl, None if it is not needed. first: whether they may be those of `first_picture`."""
    files = (*_GEOMETRY_FILES, _INSTANCES_FILE) if features["INSTANCES"] else _GEOMETRY_FILES
    geometry = build(device, features.compiled(_GEOMETRY_FEATURES), files, needs=-1 if first else None)
    pixels = "pbr.cl" if features["PBR"] else "phong.cl" if features["PHONG"] else "gouraud.cl"
    needs = features.needs | COMMON if first else None
    programs = [build(device, features.compiled(), (pixels,), lanes=lanes, needs=needs)]
    if layers is not None:
        own = layers.compiled(_LAYER_FEATURES)
        programs.append(build(device, own, ("surface_layers.cl",), lanes=lanes, needs=-1 if first else None))
    if features["LINES"] and device.has_fp64:
        programs.append(build(device, features.compiled(_LINE_FEATURES), ("lines.cl",), lanes=1))
    return Stages(device, *programs, geometry)


def lookup_stages(device: Device, features: Features, lanes: int | None = None) -> Stages:
    """Return the stages that look up textures at given coordinates."""
    return Stages(device, build(device, features.compiled(("DOUBLE",)), ("bilerp.cl",), lanes=lanes))


def stages_of(device: Device, name: str, lanes: int | None = None) -> Stages:
    """Return the stages of one kernel file alone, such as shadow.cl, which traces shadow rays by themselves."""
    return Stages(device, build(device, Features.of(), (name,), lanes=lanes))


def items(count: int, each: int = 1) -> Size:
    """Return the size of a launch with a work-item for every `each` elements, in work-groups of 64."""
    return max(1, -(-count // (64 * each))) * 64, 64


class Stages:
    """The kernels of some programs on one device.

    The first program is that of the pixel stage and determines the lanes, the last one that of the geometry.
    """

    def __init__(self, device: Device, *programs: Program) -> None:
        self.device, self.lanes, self.features = device, programs[0].lanes, programs[-1].features
        self.pixel_features = programs[0].features
        self.structs = struct_layout.DOUBLE if self.features["DOUBLE"] else struct_layout.SINGLE
        self._programs = {name: program for program in programs for name in program.kernels}
        self._token = object()  # marks the arguments that these stages set last, whose None is their own _dummy

    @cached_property
    def _dummy(self) -> Buffer:
        """Stand-in for an argument that is None; made at the first launch, for programs may be built while a device is
        still being tested, and making a buffer enqueues commands."""
        return Buffer(self.device, np.zeros(64, np.uint8))

    def runs(self, count: int, run: int) -> Size:
        """Return the size of a launch with a work-item for each run of elements, on a CPU in work-groups of its own."""
        local = 1 if self.device.is_cpu else 64
        return max(1, -(-count // (run * local))) * local, local

    def vectors(self, count: int) -> Size:
        """Return the size of a launch with a work-item for as many elements as there are lanes."""
        return -(-count // self.lanes), 1

    def tiles(self, name: str, count: int) -> Size:
        """Return the size of a launch of that kernel with a work-item for each tile, or where they have one lane, a
        work-group with one for each pixel."""
        local = 1 if self.lanes_of(name) > 1 else struct_layout.TILE_SIZE**2
        return count * local, local

    def pixels(self, name: str, tiles: int) -> Size:
        """Return the size of a launch of the pixel stage: as `tiles`, but where work-items have several lanes, each takes
        one tile after the other."""
        return (4 * self.device.compute_units, 1) if self.lanes > 1 else self.tiles(name, tiles)

    def lanes_of(self, name: str) -> int:
        """Return the lanes of the program with that kernel."""
        return self._programs[name].lanes

    def run(self, name: str, size: Size, values: Mapping[str, Any] | None = None, /, **more: Any) -> cl.Event:
        """Enqueue a kernel and return its event.

        values, more: its arguments by the names of its parameters, and others, which it does not take. Arrays are `Buffer`s,
        None where no feature reads them; their element types and sizes are documented beside the kernels' parameters.
        """
        program = self._programs[name]
        values = ({**values, **more} if more else values) if values else more
        arguments = list(map(values.__getitem__, program.parameters(name)))
        code = name, size[1], size[0] >= _WIDE
        try:
            # PoCL compiles at the first launch with a local size, and again for a wide grid.
            if code not in program.launched:
                return self._run_first(program, code, size, arguments)
            # Setting thirty arguments takes longer than a small kernel runs.
            kept = [ref(each) if isinstance(each, Buffer) else each for each in arguments]
            with program.lock:  # a kernel has one set of arguments, shared by all threads
                if program.arguments.get(name) != (self._token, kept):
                    program.arguments.pop(name, None)
                    self._set(program, name, arguments)
                    program.arguments[name] = self._token, kept
                return cl.enqueue_nd_range_kernel(self.device.queue, program[name], size[:1], size[1:])
        except cl.Error as error:
            raise DeviceError(f"{self.device.name}: {name} did not start: {error}") from error

    def _set(self, program: Program, name: str, arguments: list[Any]) -> None:
        raw = [
            (self._dummy if each is None else each).memory if kind is None else kind(each)
            for kind, each in zip(program.parameters(name).values(), arguments, strict=True)
        ]
        program[name].set_args(*raw)

    def _run_first(self, program: Program, code: tuple[Any, ...], size: Size, arguments: list[Any]) -> cl.Event:
        """Launch code that the runtime may have to compile or load first, and wait until it has run."""
        name = code[0]
        with program.lock:
            with first_use(self.device, program.stored if name in program.stored else None):
                program.arguments.pop(name, None)
                self._set(program, name, arguments)
                event = cl.enqueue_nd_range_kernel(self.device.queue, program[name], size[:1], size[1:])
                event.wait()
                if self.device.profiling:
                    own.waited -= (event.profile.end - event.profile.start) * 1e-9
                program.launched.add(code)
            program.keep()
        return event
