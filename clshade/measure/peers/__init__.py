"""Other renderers on the same scenes, each in a process of its own, against an exact answer."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from ...pipeline.opencl.environment import THREADS

if TYPE_CHECKING:
    from .drawing import Opener


class Renderer(NamedTuple):
    """A renderer that `report --peers` measures.

    module: has `open_for`, see `drawing.Opener`. about: what draws, and where the light is computed. samples: whether it
    samples a pixel several times itself; others draw a larger image. threads: the environment variables that set how many
    threads it has; (): it is told as an argument. single: whether it has one thread only. several: whether it is measured at
    several samples only. backs: why it cannot draw scenes that show triangles from behind; "": it can.
    """

    module: str
    about: str
    samples: bool = False
    threads: tuple[str, ...] = ()
    single: bool = False
    several: bool = False
    backs: str = ""


_MESA = ("LP_NUM_THREADS",)
OURS = ("clshade", "clshade-float64", "clshade-shaded")
PEERS = {
    "clshade": Renderer("clshade.measure.peers.ours", "clshade in float32", True, THREADS),
    "clshade-float64": Renderer("clshade.measure.peers.ours", "clshade with --precision float64", True, THREADS),
    "clshade-shaded": Renderer(
        "clshade.measure.peers.ours",
        "clshade in float32, each sample lit (--sample-shading)",
        True,
        THREADS,
        several=True,
    ),
    "llvmpipe": Renderer("clshade.measure.peers.of_bench", "Mesa's software rasterizer, by OpenGL", False, _MESA),
    "vtk": Renderer(
        "clshade.measure.peers.vtk_window",
        "VTK's own shaders on Mesa's software rasterizer",
        False,
        _MESA,
        backs="its shaders reverse the normals of triangles seen from behind",
    ),
    "embree": Renderer("clshade.measure.peers.embree_rays", "Intel Embree's rays; light by NumPy", single=True),
    "mitsuba": Renderer("clshade.measure.peers.mitsuba_rays", "Mitsuba 3's rays and normals; light by Dr.Jit"),
    "riley": Renderer(
        "clshade.measure.peers.riley_fields",
        "riley-raster's fields of normals; light by NumPy",
        backs="it leaves out triangles seen from behind",
    ),
    "numpy": Renderer("clshade.measure.peers.of_bench", "whole arrays in NumPy", single=True),
}


def opener_of(name: str) -> Opener:
    """Return what opens a scene with the renderer of this name."""
    opener: Opener = import_module(PEERS[name][0]).open_for
    return opener
