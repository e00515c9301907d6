"""Launches kernels, with arguments by the names of their parameters; those of a frame that is being drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any
from weakref import ref

import numpy as np
import pyopencl as cl

from ..errors import DeviceError
from . import struct_layout
from .buffers import Buffer
from .camera_space import CameraSpace
from .features import COMMON, Features
from .opencl.device import Device
from .programs import Program, build, first_use, this_thread

# Triangles and tile lists depend on few features, lighting on most: two programs, so that scenes share the first.
_GEOMETRY_FILES = ("project.cl", "setup.cl", "bin.cl", "layers.cl")
_GEOMETRY_FEATURES = ("DOUBLE", "SAMPLES", "DEPTH_TEST", "INSTANCES")
_LINE_FEATURES = ("DOUBLE", "SAMPLES", "DEPTH_TEST")
_LAYER_FEATURES = ("DOUBLE", "SAMPLES", "INSTANCES", "CASTERS")
_WIDE = (1 << 16) - 1  # work-items in one dimension from which on PoCL compiles a separate kernel

Size = tuple[int, int]  # work-items of a launch, in one dimension, and of a work-group


def scene_stages(
    device: Device, features: Features, lanes: int | None = None, layers: Features | None = None, *, first: bool = False
) -> Stages:
    """Return the stages that draw a scene; their programs are built unless they are cached. layers: features of the
    program of surface_layers.cl, None if it is not needed. first: whether they may be those of `first_picture`."""
    everything = -1 if first else None
    geometry = build(device, features.compiled(_GEOMETRY_FEATURES), _GEOMETRY_FILES, needs=everything)
    pixels = "phong.cl" if features["PBR"] or features["PHONG"] else "gouraud.cl"
    needs = features.needs | COMMON if first else None
    programs = [build(device, features.compiled(), (pixels,), lanes=lanes, needs=needs)]
    if layers is not None:
        compiled = layers.compiled(_LAYER_FEATURES)
        programs.append(build(device, compiled, ("surface_layers.cl",), lanes=lanes, needs=everything))
    if features["LINES"] and device.has_fp64:
        programs.append(build(device, features.compiled(_LINE_FEATURES), ("lines.cl",), lanes=1))
    return Stages(device, *programs, geometry)


def stages_of(device: Device, name: str, lanes: int | None = None, features: Features | None = None) -> Stages:
    """Return the stages of one kernel file alone: shadow.cl traces shadow rays, bilerp.cl looks up textures."""
    return Stages(device, build(device, features or Features.of(), (name,), lanes=lanes))


def items(count: int, each: int = 1) -> Size:
    """Return the size of a launch with a work-item for every `each` elements, in work-groups of 64."""
    return max(1, -(-count // (64 * each))) * 64, 64


class Stages:
    """The kernels of some programs on one device: the first is that of the pixel stage, the last that of the geometry."""

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
        """Return the size of a launch with a work-item per tile, or with one lane a work-group with one per pixel."""
        local = 1 if self.lanes_of(name) > 1 else struct_layout.TILE_SIZE**2
        return count * local, local

    def pixels(self, name: str, tiles: int) -> Size:
        """Return the size of a launch of the pixel stage, where work-items of several lanes take tile after tile."""
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
        parameters = program.parameters(name)
        arguments = list(map(values.__getitem__, parameters))
        # Setting thirty arguments takes longer than a small kernel runs.
        references = [ref(argument) if isinstance(argument, Buffer) else argument for argument in arguments]
        code = name, size[1], size[0] >= _WIDE
        try:
            with program.lock:  # a kernel has one set of arguments, shared by all threads
                if program.arguments.get(name) != (self._token, references):
                    program.arguments.pop(name, None)
                    types = zip(parameters.values(), arguments, strict=True)
                    raw = [kind(value) if kind else (value or self._dummy).memory for kind, value in types]
                    program[name].set_args(*raw)
                    program.arguments[name] = self._token, references
                # PoCL compiles at the first launch with a local size, and again for a wide grid.
                if code not in program.launched:
                    return self._run_first(program, code, size)
                return cl.enqueue_nd_range_kernel(self.device.queue, program[name], size[:1], size[1:])
        except cl.Error as error:
            raise DeviceError(f"{self.device.name}: {name} did not start: {error}") from error

    def _run_first(self, program: Program, code: tuple[Any, ...], size: Size) -> cl.Event:
        """Launch code that the runtime may have to compile or load first, and wait until it has run."""
        name = code[0]
        with first_use(self.device, program.stored if name in program.stored else None):
            event = cl.enqueue_nd_range_kernel(self.device.queue, program[name], size[:1], size[1:])
            event.wait()
            this_thread.waited -= (event.profile.end - event.profile.start) * 1e-9
            program.launched.add(code)
        program.keep()
        return event


@dataclass
class FrameInFlight:
    """A frame that is being drawn.

    values: arguments of kernels by the names of their parameters, kept until the kernels are done: `image`, `counters`,
    `rgba`, (M, N, 4), `owners`, (M, N) triangles or None, and what each stage makes for those that follow.
    """

    values: dict[str, Any]
    events: dict[str, Any] = field(default_factory=dict)  # of kernels, by name; lists of those launched several times
    host_ms: dict[str, float] = field(default_factory=dict)  # of the host's stages
    visible: int = 0  # triangles to list
    is_sorted: bool = False  # whether those were sorted by depth
    counters: np.void | None = None  # as the host has read them
    room: int = 0  # entries that fitted in the tile lists when it was enqueued
    space: CameraSpace = None  # type: ignore[assignment]  # of a scene's camera
    streams: bool = False  # whether the image is written past the caches, if it has rows of 64 bytes
    layers: dict[str, Buffer] = field(default_factory=dict)  # by name, where they are drawn

    @property
    def resolution(self) -> tuple[int, int]:
        """Columns and rows."""
        rows, columns = self.values["rgba"].array.shape[:2]
        return columns, rows

    @property
    def tiles(self) -> int:
        columns, rows = self.resolution
        return -(-columns // struct_layout.TILE_SIZE) * -(-rows // struct_layout.TILE_SIZE)

    def read_counters(self) -> np.void:
        """Wait for the kernels enqueued so far, and return the counters."""
        counters: np.void = self.values["counters"].to_host()[0].copy()
        return counters

    def clear_counters(self) -> None:
        """Set the counters to 0."""
        with self.values["counters"].writing() as rows:
            rows[:] = 0
