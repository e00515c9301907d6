"""What is given for a texture: an image file's path, an array, or a Texture."""

from __future__ import annotations

import os
from typing import Any

from ...images.decode import read_image
from ..model import Texture


def as_texture(source: Any, *, srgb: bool, lookup: str = "standard") -> Texture:
    """A Texture from an image file's path, an array (see `Texture`: taken as linear) or a Texture (as it is)."""
    if isinstance(source, Texture):
        return source
    if isinstance(source, (str, os.PathLike)):
        return Texture(read_image(source, srgb=srgb), lookup=lookup, name=os.path.basename(os.fspath(source)))
    return Texture(source, lookup=lookup)
