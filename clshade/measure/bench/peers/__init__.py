"""Other renderers of the same picture, which `bench` draws in turns with clshade's.

Each draws a scene of one mesh, lit per pixel by the same Phong model, to a float image in NumPy memory of its own that it
uses again for every frame.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Protocol

from ....base.validation import Array
from ....errors import ClshadeError
from ....scene.camera import Camera
from ....scene.model import Scene


class MissingPeer(ClshadeError):
    """A peer is not installed, or does not work here; the message says what to install."""


class Peer(Protocol):
    """title: what draws, with its version. scene: that it draws, whose preset clshade uses for the comparison too.

    once: it takes so long that one frame has to do, without turns.
    """

    title: str
    scene: Scene
    once: bool

    def draw(self, camera: Camera) -> Array:
        """(M, N, 3 or more) linear RGB, row 0 at the top; the next frame overwrites it."""

    def close(self) -> None:
        """Gives back what it holds."""


# name -> module here, and what it draws with
PEERS = {
    "llvmpipe": ("gl", "Mesa's software rasterizer, by OpenGL"),
    "opengl": ("gl", "whatever OpenGL the machine has"),
    "numpy": ("vectorized", "whole arrays in NumPy"),
    "scanline": ("plain", "loops over triangles, scanlines and pixels in Python"),
    "write": ("write", "the image's background written by NumPy"),
}
DEFAULT = ("llvmpipe", "numpy", "scanline")
YARDSTICKS = ("write",)  # drawn with whatever others


def open_peer(name: str, scene: Scene) -> Peer:
    """The peer, ready to draw the scene. Raises MissingPeer where it cannot be had."""
    module, _ = PEERS[name]
    opener: Callable[[str, Scene], Peer] = import_module(f".{module}", __name__).open_for
    return opener(name, scene)
