"""Frames that the oracle draws."""

import numpy as np

from clshade import oracle
from clshade.pipeline.frame import Frame
from clshade.scene.model import Scene, Settings


def frame_of(scene: Scene, settings: Settings) -> Frame:
    """Return the frame of a renderer with no error but rounding; needs no device."""
    expected = oracle.render(scene, settings)
    rgba = np.concatenate([expected.rgb, expected.alpha[..., None]], axis=-1).astype(np.float32)
    layers = {"Z": expected.Z.astype(np.float32), "id": expected.id}
    stats = {"times_ms": {"frame": 1.0}, "device": "none", "covered": int((expected.alpha > 0.0).sum())}
    return Frame(rgba, {name: layers[name] for name in settings.layers}, scene, settings, lambda: stats)
