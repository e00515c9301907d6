"""Bit-identical results: one SHA-256 per scene and settings, on every device, with any lanes, threads and features."""

from dataclasses import replace

import numpy as np
import pytest
from devices import rendered, skip_unsupported
from golden import GOLDEN, RESOLUTION, digest, draw
from mesh_writers import spheres
from oracle_frames import frame_of
from processes import ROOT, python

import clshade
from clshade.pipeline import struct_layout
from clshade.pipeline.features import OPTIONAL
from clshade.pipeline.opencl import environment
from clshade.scene.model import Settings

pytestmark = pytest.mark.optimized

TEAPOT, KNOT, ROOM = ((name, "standard", "phong") for name in ("teapot", "torus_knot", "box_room"))
CASES = [
    *((key, {}, expected) for key, expected in GOLDEN.items()),
    *((key, {"forced": OPTIONAL}, expected) for key, expected in GOLDEN.items() if key[0] in ("teapot", "course")),
    (("course", "course", "phong"), {"lanes": 8}, GOLDEN["course", "course", "phong"]),
    (KNOT, {"samples": 5}, "ce5bdcdc2faf43a9"),
    (KNOT, {"samples": 5, "resolve": "weighted"}, "99e958479eb5dd95"),
    (KNOT, {"samples": 7, "sample_shading": True}, "87a147373822762e"),
    (ROOM, {"precision": "float64"}, "6633c1e76fde73f2"),
    (ROOM, {"precision": "float64", "samples": 3}, "c068ffa725a2f9ca"),
    (TEAPOT, {"texture_filter": "trilinear"}, "9b7dcfea01db44eb"),
    (TEAPOT, {"texture_filter": "trilinear", "samples": 4}, "3b7775801e324cab"),
    *((TEAPOT, {"shadows": True, "lanes": lanes}, "851d5468d84f2cf2") for lanes in (None, 8)),
]
# A file of glTF by what differs from its own preset, pbr; that of `standard` is older than shader pbr.
SPHERES = [
    ({"preset": "standard"}, "1e67308c7a5624b2"),
    ({"shadows": False}, "45d7817443088c9f"),
    ({}, "8e8cd8622d0a5074"),
]


@pytest.mark.long
@pytest.mark.parametrize(("key", "options", "expected"), CASES, ids=str)
def test_golden_images(device, key, options, expected):
    skip_unsupported(device, options)
    frame = draw(device, *key, **options)
    assert frame.alpha.any()
    assert digest(frame) == expected


@pytest.mark.long
@pytest.mark.parametrize(("options", "expected"), SPHERES, ids=str)
def test_a_golden_glb(device, tmp_path, options, expected):
    """Lit by lights: an environment's tables are made by NumPy, whose last bits depend on the machine."""
    scene = replace(clshade.load(spheres(tmp_path / "spheres.glb")), own_lights=True)
    frame = rendered(scene, device=device, layers=("Z", "id"), resolution=RESOLUTION, **options)
    assert digest(frame) == expected


# Multiplied and then divided by its weight in float32, none of its channels is restored.
BACKGROUND = (0.26161213, 0.29849114, 0.81422574)
SEVERAL = [
    ({"samples": 5, "resolve": "weighted"}, 1, BACKGROUND),
    ({"samples": 16, "resolve": "weighted", "shader": "gouraud"}, 4, None),
    ({"samples": 19, "sample_shading": True, "resolve": "weighted"}, 8, BACKGROUND),
    ({"samples": 3, "resolve": "weighted", "precision": "float64"}, 1, BACKGROUND),
]


@pytest.mark.long
@pytest.mark.parametrize(("options", "lanes", "background"), SEVERAL, ids=str)
def test_lanes_do_not_change_a_bit_of_several_samples(device, options, lanes, background):
    """Whatever the other lanes do; pixels without a face show the background, in tiles with and without triangles."""
    skip_unsupported(device, options)
    scene = replace(clshade.builtin("torus_knot", triangles=3000, resolution=(97, 61)), background=background)
    frames = [rendered(scene, device=device, lanes=count, layers=("Z", "id"), **options) for count in (None, lanes)]
    assert digest(frames[0]) == digest(frames[1])
    empty = frames[0].alpha == 0.0
    assert (frames[0].rgb[empty] == np.asarray(background or (0, 0, 0), frames[0].rgb.dtype)).all()
    assert empty[-struct_layout.TILE_SIZE :, : struct_layout.TILE_SIZE].all()
    assert 0.1 < empty.mean() < 0.9


ONE_THREAD = """
import sys
sys.path[:0] = sys.argv[1:2]
from clshade.pipeline.opencl.device import open_device
from golden import GOLDEN, digest, draw
device = open_device(sys.argv[2])
assert device.compute_units == 1, device.compute_units
key = ("torus_knot", "standard", "phong")
assert digest(draw(device, *key)) == GOLDEN[key]
"""


@pytest.mark.long
def test_one_thread_gives_the_same_bits(device):
    if "portable computing" not in device.platform.lower():
        pytest.skip("only PoCL lets its number of threads be chosen")
    variables = {"POCL_CPU_MAX_CU_COUNT": "1", "POCL_MAX_PTHREAD_COUNT": "1"}
    support = str(ROOT / "tests" / "support")
    done = python(ONE_THREAD, environment.cache_home(), support, device.index, timeout=120.0, **variables)
    assert done.returncode == 0, done.stderr


def test_a_changed_bit_is_noticed():
    frame = frame_of(clshade.builtin("icosphere", level=1, resolution=(16, 16)), Settings(layers=("Z", "id")))
    before = digest(frame)
    frame["Z"].view("u4")[5, 5] ^= 1
    assert digest(frame) != before
