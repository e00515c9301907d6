"""Which OpenCL devices the tests run on: every one that works."""

from __future__ import annotations

from functools import cache

from clshade.device import list_devices
from clshade.errors import DeviceError


@cache
def working_devices() -> tuple[str, ...]:
    """Indices "P:D" of the devices that work; empty where there is none."""
    try:
        return tuple(info.index for info in list_devices() if info.works)
    except DeviceError:
        return ()
