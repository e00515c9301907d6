"""The cost of each file format: the error after reading back, the time to write, the size."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ...base.arrays import Array
from ...errors import OutputError
from ...images import exr, png
from ...images.metrics import rmse
from ...images.tonemap import Operator, radiance, tonemap
from ...pipeline.frame import Frame
from ...scene.model import default_tonemap
from ..timing import Spread, in_turns, spread

ROUNDS = 7  # files written per format
EXR: dict[str, dict[str, Any]] = {
    "EXR float": {"compression": "zip"},
    "EXR pxr24": {"compression": "pxr24"},
    "EXR half": {"compression": "zip", "half": True},
    "EXR half b44": {"compression": "b44", "half": True},
    "EXR half dwaa": {"compression": "dwaa", "half": True},
}


@dataclass(frozen=True)
class Kept:
    """One file format. rmse, largest: errors after reading back, against the image, in units of radiance."""

    name: str
    rmse: float
    largest: float
    write_ms: Spread
    bytes: int

    def stats(self) -> dict[str, Any]:
        return {**vars(self), "write_ms": self.write_ms._asdict()}


def formats(frame: Frame) -> list[Kept]:
    """Measure the formats, written in turns; times include tone mapping and the disk. Raises OutputError.

    A PNG's codes are read back as the middle of the radiances that they stand for; radiance above the brightest code is
    lost, and counts as error.
    """
    image = np.ascontiguousarray(frame.rgb, dtype=np.float32)
    operator = default_tonemap(frame.scene)

    def write_png(path: Path) -> None:
        png.write(path, tonemap(image, operator))

    writers: dict[str, Callable[[Path], Any]] = {
        **{name: partial(_write_exr, image, options) for name, options in EXR.items()},
        f"PNG 8 bit {operator}": write_png,
    }
    try:
        with TemporaryDirectory() as folder:
            paths = {name: Path(folder, f"{k}.exr" if name in EXR else f"{k}.png") for k, name in enumerate(writers)}
            draws = [partial(_milliseconds, writer, paths[name]) for name, writer in writers.items()]
            times = zip(*in_turns(draws, ROUNDS, seconds=5.0), strict=True)
            return [_kept(name, paths[name], image, operator, ms) for name, ms in zip(writers, times, strict=True)]
    except OSError as error:
        raise OutputError(f"report: temporary folder: expected one that can be written to, found: {error}") from None


def png_radiance(frame: Frame) -> Array:
    """Return the image as its PNG holds it, (M, N, 3) float64."""
    operator = default_tonemap(frame.scene)
    return radiance(tonemap(frame.rgb, operator), operator)


def _write_exr(image: Array, options: dict[str, Any], path: Path) -> None:
    exr.write(path, image, **options)


def _milliseconds(write: Callable[[Path], Any], path: Path, _: int) -> float:
    start = time.perf_counter()
    write(path)
    return (time.perf_counter() - start) * 1e3


def _kept(name: str, path: Path, image: Array, operator: Operator, ms: tuple[float, ...]) -> Kept:
    if path.suffix == ".png":
        back = radiance(png.read(path), operator)
    else:
        channels = exr.read(path)[0]
        back = np.stack([channels[channel] for channel in "RGB"], axis=-1).astype(np.float64)
    return Kept(name, rmse(back, image), float(np.abs(back - image).max()), spread(ms), path.stat().st_size)
