"""What another renderer has to do to be measured beside clshade."""

from __future__ import annotations

from typing import Protocol

from ....base.arrays import Array
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
