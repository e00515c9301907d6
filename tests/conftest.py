"""Fixtures that several tests share: every OpenCL device that works, and the folder of real scenes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from devices import working_devices

from clshade.device import Device, open_device


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "device" in metafunc.fixturenames:
        metafunc.parametrize("device", working_devices() or [None], indirect=True, scope="session")


@pytest.fixture(scope="session")
def device(request: pytest.FixtureRequest) -> Iterator[Device]:
    """Each device that works, opened once."""
    if request.param is None:
        pytest.skip("no OpenCL device works here: see `python -m clshade devices`")
    return open_device(request.param, profiling=True)


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of real scenes that CLSHADE_DATA names."""
    name = os.environ.get("CLSHADE_DATA", "")
    if not name or not Path(name).is_dir():
        pytest.skip("CLSHADE_DATA names no folder with scenes")
    return Path(name)
