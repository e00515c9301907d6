"""Textures from an image file's path, an array, or a Texture."""

from __future__ import annotations

import os

from numpy.typing import ArrayLike

from ...base.atomic_files import Path
from ...images.decode import read_image
from ..model import Lookup, Texture


def as_texture(source: Path | ArrayLike | Texture, *, srgb: bool, lookup: Lookup = "standard") -> Texture:
    """Return a Texture from an image file's path, an array (see `Texture`: taken as linear) or a Texture (as it is)."""
    if isinstance(source, Texture):
        return source
    if isinstance(source, (str, os.PathLike)):
        return Texture(read_image(source, srgb=srgb), lookup=lookup, name=os.path.basename(os.fspath(source)))
    return Texture(source, lookup=lookup)
