"""Other renderers of the same image, which `bench` draws in turns with clshade's.

Each draws a scene of one mesh, lit per pixel by the same Phong model, into its own float image in NumPy memory, which
it reuses for every frame.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

from ....scene.model import Scene
from .peer import MissingPeer, Peer

__all__ = ["PEERS", "MissingPeer", "Peer", "open_peer"]


# name -> its module, and what it draws with
PEERS = {
    "llvmpipe": ("clshade.measure.bench.peers.opengl", "Mesa's software rasterizer, by OpenGL"),
    "opengl": ("clshade.measure.bench.peers.opengl", "whatever OpenGL the machine has"),
    "numpy": ("clshade.measure.bench.peers.numpy_arrays", "whole arrays in NumPy"),
}


def open_peer(name: str, scene: Scene) -> Peer:
    """Return the peer, ready to draw the scene. Raises MissingPeer if it is not available."""
    opener: Callable[[str, Scene], Peer] = import_module(PEERS[name][0]).open_for
    return opener(name, scene)
