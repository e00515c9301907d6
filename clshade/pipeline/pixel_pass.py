"""The pixel stage of a frame, or of a single triangle."""

from __future__ import annotations

from typing import Any

from .buffers import Buffer
from .launches import Stages
from .surface_inputs import SurfaceInputs


def draw_pixels(
    stages: Stages,
    inputs: SurfaceInputs,
    order: Buffer,
    visible: int,
    tile: tuple[Any, ...],
    tiles: int,
    events: dict[str, Any],
) -> SurfaceInputs:
    """Run the pixel stage, with Gouraud's shading after that of the corners.

    order: (T,) the triangles whose corners are lit, of which there are `visible`. tile: the last arguments of the
    stage. Returns the inputs, with memory for the corners' light once that is needed; it has to be kept until the
    stage is done.
    """
    features = stages.pixel_features
    if features["PHONG"]:
        events["phong"] = stages.phong(inputs, tile, tiles)
        return inputs
    if features["PBR"]:
        events["pbr"] = stages.pbr(inputs, tile, tiles)
        return inputs
    if features["LIT"] and visible:
        light, count = inputs.corner_light, 3 * len(inputs.triangles.array)
        if light is None or len(light.array) < count:
            light = Buffer.empty(stages.device, (count, 4), stages.structs.real)
            inputs = inputs._replace(corner_light=light)
        events["gouraud_corners"] = stages.gouraud_corners(inputs, order, light, visible)
    events["gouraud"] = stages.gouraud(inputs, tile, tiles)
    return inputs
