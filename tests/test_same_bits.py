"""The same bits everywhere: one SHA-256 per scene and settings, on every device, with any lanes, threads and features."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import replace
from functools import partial

import pytest
from devices import needs_float64

import clshade
from clshade import programs
from clshade.features import OPTIONAL
from clshade.frame import Frame
from clshade.renderer import Renderer

RESOLUTION = (161, 97)

# (scene, its options, preset, shader) -> the first 16 digits. They change only when an image is meant to change.
GOLDEN = {
    ("teapot", "standard", "phong"): "287f35a3b8fbaa53",
    ("teapot", "course", "gouraud"): "b0a149a0b1d58ba3",
    ("torus_knot", "standard", "phong"): "c492d5ef6e411981",
    ("icosphere", "standard", "phong"): "c08619f34c11b9e3",
    ("icosphere", "course", "phong"): "927e48b18e7856bc",
    ("quads", "standard", "phong"): "a40a46783dfc0f1b",
    ("box_room", "standard", "gouraud"): "7fb96803e80b1381",
    ("course", "course", "phong"): "11a7f9f28278f14e",
    ("course", "standard", "nolight"): "7f8f191b9fa851bc",
}
# (scene, a field of the settings, its value), of the preset `standard` otherwise.
VARIANTS = {
    ("torus_knot", "samples", 5): "cca50022d326a2d3",
    ("box_room", "precision", "float64"): "5b6582138bb71d2a",
    ("teapot", "texture_filter", "trilinear"): "c2e91fba441b2cab",
}
# The same of several fields together: (scene, the fields' names and values).
COMBINED = {
    ("torus_knot", ("samples", 5), ("resolve", "weighted")): "adda6330caeb4c96",
    ("torus_knot", ("samples", 7), ("sample_shading", True)): "259491f30b381eef",
    ("box_room", ("samples", 3), ("precision", "float64")): "b008318580b76089",
    ("teapot", ("samples", 4), ("texture_filter", "trilinear")): "b059ee709aced3d8",
}
LONG = [key for key in GOLDEN if key[0] in ("teapot", "course")]


def digest(frame: Frame) -> str:
    """Of image and layers, the first 16 digits of the SHA-256."""
    found = hashlib.sha256(frame.rgba.tobytes())
    for name in frame.layers:
        found.update(frame[name].tobytes())
    return found.hexdigest()[:16]


def draw(device, name: str, preset: str, shader: str, **options) -> Frame:
    scene = clshade.builtin(name, **({"triangles": 10_000} if name == "torus_knot" else {}))
    given = {"preset": preset, "shader": shader, "layers": ("Z", "id"), "resolution": RESOLUTION}
    with Renderer(scene, device=device, **given, **options) as renderer:
        return renderer.render()


@pytest.mark.parametrize("key", GOLDEN, ids="-".join)
def test_golden_images(device, key):
    frame = draw(device, *key)
    assert frame.alpha.any()
    assert digest(frame) == GOLDEN[key]


@pytest.mark.parametrize("key", VARIANTS, ids=str)
def test_golden_variants(device, key):
    name, field, value = key
    if value == "float64":
        needs_float64(device)
    frame = draw(device, name, "standard", "phong", **{field: value})
    assert frame.alpha.any()
    assert digest(frame) == VARIANTS[key]


@pytest.mark.long
@pytest.mark.parametrize("key", COMBINED, ids=str)
def test_golden_combinations(device, key):
    name, *fields = key
    options = dict(fields)
    if options.get("precision") == "float64":
        needs_float64(device)
    frame = draw(device, name, "standard", "phong", **options)
    assert frame.alpha.any()
    assert digest(frame) == COMBINED[key]


@pytest.mark.long
@pytest.mark.parametrize("key", LONG, ids="-".join)
@pytest.mark.parametrize("options", [{"forced": OPTIONAL}, *({"lanes": lanes} for lanes in (1, 4, 8))], ids=str)
def test_neither_lanes_nor_features_change_a_bit(device, key, options):
    assert digest(draw(device, *key, **options)) == GOLDEN[key]


ONE_THREAD = """
import sys
sys.path[:0] = sys.argv[1:2]
from clshade.device import open_device
from test_same_bits import GOLDEN, digest, draw
device = open_device(sys.argv[2], profiling=True)
assert device.compute_units == 1, device.compute_units
key = ("torus_knot", "standard", "phong")
assert digest(draw(device, *key)) == GOLDEN[key]
"""


def test_one_thread_gives_the_same_bits(device):
    if "portable computing" not in device.platform.lower():
        pytest.skip("only PoCL lets its number of threads be chosen")
    environment = {**os.environ, "POCL_CPU_MAX_CU_COUNT": "1", "POCL_MAX_PTHREAD_COUNT": "1"}
    run = partial(subprocess.run, env=environment, capture_output=True, text=True, timeout=120)
    done = run([sys.executable, "-c", ONE_THREAD, os.path.dirname(__file__), device.index])
    assert done.returncode == 0, done.stderr


@pytest.mark.filterwarnings("error")
def test_programs_from_the_cache_give_the_same_bits(device, tmp_path, monkeypatch):
    """And neither building nor loading them has anything to say."""
    device = replace(device, keeps_programs=False)
    monkeypatch.setattr(programs, "_built", {})
    monkeypatch.setattr(programs, "_stored_at", lambda device, source, _: tmp_path / str(hash(source)))
    for stored in (False, True):
        programs._built.clear()
        assert digest(draw(device, "quads", "standard", "phong")) == GOLDEN["quads", "standard", "phong"]
        assert [program.stored for program in programs.built()] == [stored] * 2


def test_a_changed_bit_is_noticed(device):
    frame = draw(device, "icosphere", "standard", "phong")
    before = digest(frame)
    frame["Z"].view("u4")[50, 50] ^= 1
    assert digest(frame) != before
