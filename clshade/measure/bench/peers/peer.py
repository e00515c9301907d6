"""The interface of renderers that are measured beside clshade."""

from __future__ import annotations

from typing import Protocol

from ....base.arrays import Array
from ....errors import ClshadeError
from ....scene.camera import Camera
from ....scene.model import Scene


class MissingPeer(ClshadeError):
    """Error for a peer that is not installed or does not work; the message says what to install."""


class Peer(Protocol):
    """Another renderer.

    title: name and version. scene: the scene it draws, whose preset clshade uses for the comparison too.
    once: it is so slow that a single frame is drawn, without turns.
    """

    title: str
    scene: Scene
    once: bool

    def draw(self, camera: Camera) -> Array:
        """Render linear RGB, (M, N, 3 or more), row 0 at the top; the next frame overwrites it."""

    def close(self) -> None:
        """Release all resources."""
