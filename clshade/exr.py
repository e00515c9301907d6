"""OpenEXR images with layers, see `clshade.images.exr`."""

from .images.exr import COMPRESSIONS, FULL_PRECISION, LOSSY, SUFFIXES, drawn_window, encode, flatten, read, write

__all__ = ["COMPRESSIONS", "FULL_PRECISION", "LOSSY", "SUFFIXES", "drawn_window", "encode", "flatten", "read", "write"]
