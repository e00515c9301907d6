"""Frames and scenes as notebooks and desktops show them."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import numpy as np

from ..base.arrays import Array
from ..base.atomic_files import Path
from ..base.validation import path as checked_path
from ..errors import OutputError
from ..images import exr, png
from ..images.image_file import Picture
from ..images.tonemap import Operator, over_checkers
from ..pipeline.frame import Frame
from ..scene.model import Scene, default_tonemap
from .page import Page, view

# The most pixels on the longer side of a frame in a notebook, whose file holds every picture that it shows.
FRAME_SIDE = 1024
SCENE_SIDE = 256  # of a scene, which is drawn in order to show it


def encoded(pixels: Array, side: int = FRAME_SIDE) -> bytes:
    """Encode uint8 (M, N, 3 or 4) as PNG, reduced to means of k x k pixels if its longer side exceeds `side`."""
    from PIL import Image

    factor = -(-max(pixels.shape[:2]) // side)
    if factor > 1:
        pixels = np.asarray(Image.fromarray(pixels).reduce(factor))
    return png.to_bytes(pixels)


def scene_bundle(scene: Scene) -> dict[str, Any]:
    """Return MIME type -> content: a line of text, and a small render of the scene if there is a device. Never raises."""
    from ..pipeline.renderer import render

    text, longer = repr(scene), max(*scene.camera.resolution, SCENE_SIDE)
    columns, rows = (max(1, side * SCENE_SIDE // longer) for side in scene.camera.resolution)
    try:
        small = replace(scene, camera=replace(scene.camera, resolution=(columns, rows)))
        picture = encoded(render(small, samples=1).to_png8())
    except Exception as error:  # a notebook should not show the traceback of a failed preview
        return {"text/plain": f"{text}\nnot drawn: {' '.join(str(error).split()) or type(error).__name__}"}
    return {"text/plain": text, "image/png": picture}


def show_frame(frame: Frame, tonemap: Operator | None, exposure: float) -> None:
    """Show a frame: in a notebook below the cell, else in the desktop's image viewer. Raises OutputError if there is
    none."""
    pixels = frame.to_png8(tonemap, exposure)
    ipython = sys.modules.get("IPython")  # a running notebook has imported it
    shell = ipython.get_ipython() if ipython is not None else None
    if getattr(shell, "kernel", None) is not None:
        from IPython.display import display

        display({"text/plain": repr(frame), "image/png": encoded(pixels)}, raw=True)
        return
    from PIL import Image, ImageShow

    # Pillow's last resort, if IPython is installed, is to print the object, which shows nothing.
    viewers = [viewer for viewer in ImageShow._viewers if not isinstance(viewer, ImageShow.IPythonViewer)]
    image, title = Image.fromarray(pixels), frame.scene.name or "clshade"
    if not any(viewer.show(image, title=title) for viewer in viewers):
        raise OutputError("Frame.show: found no program that shows images; Frame.save writes files")


def view_frame(frame: Frame, path: Path | None, tonemap: Operator | None, exposure: float) -> Page:
    """Return the page of a frame, and write it if there is a path."""
    name = frame.scene.name or "frame"
    picture = Picture(exr.flatten(frame.channels()), frame.metadata(), name=name)
    page = view({name: picture}, name, tonemap=tonemap or default_tonemap(frame.scene), exposure=exposure)
    if path is not None:
        page.save(checked_path("Frame.view", "path", path))
    return page


def plot_layers(frame: Frame) -> Any:
    """Return a matplotlib figure of a frame's image, coverage and layers."""
    from ..images.figures import Thumbnail, plot_thumbnails, thin, thumbnails

    pictures = thumbnails(exr.flatten(frame.channels()))
    pictures["RGB"] = Thumbnail(over_checkers(thin(frame.to_png8())), f"tone map {default_tonemap(frame.scene)}")
    return plot_thumbnails(pictures)
