"""`--ambient-occlusion` and `--ao-distance`: the image, its header, its layer, and what is refused."""

from __future__ import annotations

import pytest
from command_line import needs_device, run

from clshade import exr
from clshade.scene.builtin.scenes import builtin
from clshade.scene.geometry import bounding_box, half_diagonal

SMALL = ("render", "icosphere", "--resolution", "40,30", "--samples", "1")


@pytest.mark.long
@needs_device
def test_it_darkens_and_stands_in_the_header(capsys, tmp_path):
    found = {}
    for name, options in {"without": (), "with": ("--ambient-occlusion", "4", "--layers", "AO")}.items():
        code, _, err = run(capsys, *SMALL, *options, "-o", tmp_path / name)
        assert code == 0, err
        found[name] = exr.read(tmp_path / f"{name}.exr")
    channels, header = found["with"]
    assert "ambient_occlusion" not in found["without"][1]["settings"]
    assert "ambient_occlusion=4" in header["settings"]
    distance = 0.4 * half_diagonal(*bounding_box(builtin("icosphere")))
    assert f"ao_distance={distance!r}" in header["settings"]
    covered = channels["A"] == 1.0
    assert (channels["AO"][covered] == 1.0).all()  # it is convex
    assert not channels["AO"][~covered].any()
