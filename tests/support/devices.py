"""Which OpenCL devices the tests run on: every one that works, or those of CLSHADE_TEST_PLATFORM, part of a name."""

from __future__ import annotations

import os
from functools import cache

import pytest

from clshade.errors import DeviceError
from clshade.pipeline.opencl.device import Device, list_devices


def needs_float64(device: Device) -> None:
    """Skips the test on a device that has none."""
    if not device.has_fp64:
        pytest.skip(f"{device.platform} has no float64")


@cache
def working_devices() -> tuple[str, ...]:
    """Indices "P:D" of the devices that work; empty where there is none."""
    platform = os.environ.get("CLSHADE_TEST_PLATFORM", "").lower()
    try:
        return tuple(info.index for info in list_devices() if info.works and platform in info.platform.lower())
    except DeviceError:
        return ()
