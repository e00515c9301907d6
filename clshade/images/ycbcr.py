"""Y'CbCr planes of video, by ITU-R BT.709-6: its luma coefficients, its limited range, chroma at half the resolution.

Written out, because the conversions of video libraries take BT.601's matrix unless told otherwise, round to 8 bits
before they subsample, and differ between versions.
"""

from __future__ import annotations

import numpy as np

from ..base.arrays import Array, Floats
from ..errors import InputError

KR, KB = 0.2126, 0.0722  # weights of red and blue in luma: BT.709-6, item 3.2
KG = 1.0 - KR - KB
# Rows: Y', Cb and Cr of (R', G', B') in 0 to 1, items 3.2 and 3.3. Cb and Cr lie within -0.5 to 0.5.
MATRIX = np.array(
    [
        [KR, KG, KB],
        [-0.5 * KR / (1.0 - KB), -0.5 * KG / (1.0 - KB), 0.5],
        [0.5, -0.5 * KG / (1.0 - KR), -0.5 * KB / (1.0 - KR)],
    ]
)
_SCALES, _OFFSETS = (219.0, 224.0, 224.0), (16.0, 128.0, 128.0)  # of 8-bit codes, item 3.4


def even(image: Array) -> Array:
    """Return the image (M, N, ...) with its last row or column repeated where their number is odd."""
    rows = np.concatenate([image, image[-1:]]) if image.shape[0] % 2 else image
    return np.concatenate([rows, rows[:, -1:]], axis=1) if image.shape[1] % 2 else rows


def planes_420(rgb: Array, bits: int = 8) -> tuple[Array, Array, Array]:
    """Convert a display image to Y'CbCr planes with 4:2:0 subsampling.

    rgb: (M, N, 3), M and N even, row 0 at the top: uint8 codes, or floats in 0 to 1.
    bits: 8 to 16, of the codes.

    Returns Y' (M, N), Cb and Cr (M/2, N/2), uint8 for 8 bits, else uint16, rounded to nearest once. A chroma sample lies
    on the left column of its 2 x 2 pixels, halfway between their rows, where decoders of H.264, HEVC and VP9 assume it
    (ITU-T H.264, figure 6-1); its weights are 1/4, 1/2, 1/4 across and 1/2, 1/2 down.
    """
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.shape[0] % 2 or rgb.shape[1] % 2 or 0 in rgb.shape:
        raise InputError(f"ycbcr: rgb: expected shape (M, N, 3), M and N even, found {rgb.shape}")
    values = rgb.astype(np.float32) / np.float32(255.0) if rgb.dtype == np.uint8 else rgb.astype(np.float32)
    rows = (values[0::2] + values[1::2]) * np.float32(0.5)
    left = np.concatenate([rows[:, :1], rows[:, 1:-1:2]], axis=1)
    small = (left + rows[:, 1::2]) * np.float32(0.25) + rows[:, 0::2] * np.float32(0.5)
    y, cb, cr = (_codes(image, k, bits) for k, image in enumerate((values, small, small)))
    return y, cb, cr


def _codes(rgb: Floats, plane: int, bits: int) -> Array:
    scale = 2.0 ** (bits - 8)
    weights = (MATRIX[plane] * _SCALES[plane] * scale).astype(np.float32)
    codes: Array = rgb @ weights + np.float32(_OFFSETS[plane] * scale + 0.5)
    return codes.astype(np.uint8 if bits == 8 else np.uint16)
