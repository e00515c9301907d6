"""What `--tolerance` promises: what is chosen keeps the limit, measured anew. Budgets, which load disturbs, are tested with
made-up times in test_selecting.py."""

from __future__ import annotations

import numpy as np
import pytest

from clshade.errors import InputError
from clshade.images.metrics import rmse
from clshade.measure.report.auto_settings import select
from clshade.measure.report.reference_image import reference
from clshade.pipeline.effective_settings import effective_settings
from clshade.pipeline.renderer import render
from clshade.scene.builtin.scenes import builtin

RESOLUTION = (400, 300)  # above 65,536 pixels: errors are estimated from windows
TOLERANCES = (0.03, 0.02, 0.01, 0.005)


@pytest.mark.long
def test_nine_of_ten_tolerances_are_kept_to_a_tenth(device):
    """Errors are those of all pixels."""
    ratios = []
    for name in ("teapot", "icosphere", "quads"):
        scene = effective_settings(builtin(name), resolution=RESOLUTION)[0]
        converged = reference(scene, effective_settings(scene)[1], device).rgb
        for tolerance in TOLERANCES:
            try:
                settings = select(scene, device=device, tolerance=tolerance).settings
            except InputError:
                continue
            ratios.append(rmse(np.asarray(render(scene, settings=settings, device=device).rgb), converged) / tolerance)
    assert len(ratios) >= 9
    assert np.mean(np.array(ratios) <= 1.1) >= 0.9, ratios
