"""A small scene, and a small study of it, shared by several tests."""

from functools import cache

from clshade.measure.report import study
from clshade.measure.report.variants import BASE, base_settings, named, variants_for
from clshade.pipeline.opencl.device import Device
from clshade.scene.builtin.scenes import builtin
from clshade.scene.model import Scene

SMALL = (64, 48)


def sphere(level: int = 2) -> Scene:
    return builtin("icosphere", level=level, resolution=SMALL)


@cache
def small_study(device: Device) -> study.Study:
    """Return a study of two variants."""
    scene = sphere()
    chosen = named(variants_for(scene, base_settings(scene), device), [BASE, "gouraud"])
    return study.study(scene, device, chosen, 3)
