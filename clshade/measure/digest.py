"""A hash of a frame's bits."""

from __future__ import annotations

import hashlib

from ..pipeline.frame import Frame


def digest(frame: Frame) -> str:
    """Return the first 16 digits of the SHA-256 of image and layers."""
    sha = hashlib.sha256(frame.rgba.tobytes())
    for name in frame.layers:
        sha.update(frame[name].tobytes())
    return sha.hexdigest()[:16]
