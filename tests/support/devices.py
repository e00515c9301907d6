"""The OpenCL devices that tests run on: all that work, or those whose platform's name contains
CLSHADE_TEST_PLATFORM."""

import os
from collections.abc import Mapping
from functools import cache
from typing import Any

import pytest

from clshade.errors import DeviceError
from clshade.pipeline.frame import Frame
from clshade.pipeline.opencl.device import Device, found_devices
from clshade.pipeline.opencl.probe import recall, tried_out
from clshade.pipeline.renderer import Renderer
from clshade.scene.model import Scene


def needs_float64(device: Device) -> None:
    """Skip the test on a device without float64."""
    if not device.has_fp64:
        pytest.skip(f"{device.platform} has no float64")


def skip_unsupported(device: Device, options: Mapping[str, Any]) -> None:
    """Skip the test on a device without float64 if these options of a renderer need it."""
    if options.get("precision") == "float64" or "edges" in options:
        needs_float64(device)


def is_tested(platform: str) -> bool:
    """Return whether tests run on a platform of this name."""
    return os.environ.get("CLSHADE_TEST_PLATFORM", "").lower() in platform.lower()


@cache
def working_devices() -> tuple[str, ...]:
    """Return the indices "P:D" of the devices that work, as remembered, or else tried out; empty if there is none."""
    try:
        infos = [info for info in found_devices("") if is_tested(info.platform)]
    except DeviceError:
        return ()
    return tuple(info.index for info in infos if recall(info).works or tried_out(info).works)


def rendered(scene: Scene, **options: Any) -> Frame:
    """Return the frame of a renderer with these options."""
    with Renderer(scene, **options) as renderer:
        return renderer.render()
