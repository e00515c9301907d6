"""Animated images by Pillow: GIF, APNG and WebP, which loop for ever."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from ..base.arrays import Array, Bytes
from .film_format import FilmFormat, durations

if TYPE_CHECKING:
    from PIL import Image

NAMES = {".gif": "GIF", ".apng": "APNG", ".webp": "WebP"}
PIXELS = {".gif": "256 colors, dithered", ".apng": "lossless", ".webp": "lossless"}
_SAMPLED_FRAMES, _SAMPLED_PIXELS = 16, 1 << 16  # that the colors of a GIF are chosen from
_COLORS = 255  # Pillow needs one to say that a pixel stays
_OPTIONS: dict[str, dict[str, Any]] = {
    ".gif": {"format": "GIF", "optimize": False},
    ".apng": {"format": "PNG", "compress_level": 6},
    ".webp": {"format": "WEBP", "lossless": True, "quality": 20, "method": 1},  # effort: higher ones gain little
}


class _Lazy:
    """An image of a sequence, loaded when Pillow uses it: all of them at once may not fit in memory."""

    def __init__(self, load: Callable[[int], Image.Image], index: int) -> None:
        self._load, self._index = load, index

    def __getattr__(self, name: str) -> Any:
        return getattr(self._load(self._index), name)


def encode(file: BinaryIO, images: Sequence[Callable[[], Bytes]], rate: Fraction, kind: FilmFormat) -> None:
    """Encode an animation into an open file. images: load each image, uint8 (M, N, 3).

    Equal neighbors may become one frame that is shown for longer. A GIF has one palette for all frames, so that areas
    that stay do not flicker, and error diffusion (Floyd and Steinberg), without which gradients have bands.
    """
    from PIL import Image

    palette = _palette(images) if kind.ending == ".gif" else None

    @lru_cache(maxsize=1)
    def load(index: int) -> Image.Image:
        image = Image.fromarray(images[index]())
        return image if palette is None else image.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)

    shown: Any = durations(len(images), rate, kind.ticks)
    milliseconds = [duration * 1000 // kind.ticks for duration in shown]
    others: Any = [_Lazy(load, index) for index in range(1, len(images))]
    load(0).save(file, save_all=True, append_images=others, duration=milliseconds, loop=0, **_OPTIONS[kind.ending])


def _palette(images: Sequence[Callable[[], Bytes]]) -> Image.Image:
    """Return an image that has the colors of a GIF: by median cut and k-means, from some of the frames."""
    from PIL import Image

    chosen = images[:: -(-len(images) // _SAMPLED_FRAMES)]
    most = _SAMPLED_PIXELS // len(chosen)
    sampled = np.concatenate([_thinned(load(), most) for load in chosen])
    image = Image.fromarray(sampled[None])
    return image.quantize(_COLORS, method=Image.Quantize.MEDIANCUT, kmeans=1, dither=Image.Dither.NONE)


def _thinned(image: Bytes, most: int) -> Array:
    """Return pixels of an image on a grid, (K, 3), about `most` of them."""
    step = max(1, round((image.shape[0] * image.shape[1] / most) ** 0.5))
    return image[::step, ::step].reshape(-1, 3)
