"""Bit-identical results: one SHA-256 per scene and settings, on every device, with any lanes, threads and features."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from devices import needs_float64, rendered
from golden import GOLDEN, RESOLUTION, digest, draw
from layer_scenes import mixed
from mesh_writers import spheres
from processes import ROOT

import clshade
from clshade.pipeline import programs, struct_layout
from clshade.pipeline.features import OPTIONAL
from clshade.pipeline.opencl.program_store import StoredProgram
from clshade.scene.model import Scene, Texture

pytestmark = pytest.mark.optimized

SHADOWED_TEAPOT = "851d5468d84f2cf2"
# (scene, field of the settings, value); otherwise the preset `standard`.
VARIANTS = {
    ("torus_knot", "samples", 5): "ce5bdcdc2faf43a9",
    ("box_room", "precision", "float64"): "6633c1e76fde73f2",
    ("teapot", "texture_filter", "trilinear"): "9b7dcfea01db44eb",
    ("teapot", "shadows", True): SHADOWED_TEAPOT,
}
# The same for several fields together: (scene, the fields' names and values).
COMBINED = {
    ("torus_knot", ("samples", 5), ("resolve", "weighted")): "99e958479eb5dd95",
    ("torus_knot", ("samples", 7), ("sample_shading", True)): "87a147373822762e",
    ("box_room", ("samples", 3), ("precision", "float64")): "c068ffa725a2f9ca",
    ("teapot", ("samples", 4), ("texture_filter", "trilinear")): "3b7775801e324cab",
}
# A file of glTF by preset, without shadows; that of `standard` is older than shader pbr.
SPHERES = {"standard": "1e67308c7a5624b2", "pbr": "45d7817443088c9f"}
SHADOWED_SPHERES = "8e8cd8622d0a5074"  # of the preset pbr, as it is
# Other programs of golden images: every number of lanes, with and without light, in either order.
OTHERS = [
    *((key, {"forced": OPTIONAL}) for key in GOLDEN if key[0] in ("teapot", "course")),
    *((("teapot", "standard", "phong"), {"lanes": lanes}) for lanes in (1, 4, 8)),
    (("teapot", "course", "gouraud"), {"lanes": 4}),
    (("course", "course", "phong"), {"lanes": 8}),
    (("course", "standard", "nolight"), {"lanes": 1}),
]


@pytest.mark.long
@pytest.mark.parametrize("key", GOLDEN, ids="-".join)
def test_golden_images(device, key):
    frame = draw(device, *key)
    assert frame.alpha.any()
    assert digest(frame) == GOLDEN[key]


@pytest.mark.long
@pytest.mark.parametrize("key", VARIANTS, ids=str)
def test_golden_variants(device, key):
    name, field, value = key
    if value == "float64":
        needs_float64(device)
    frame = draw(device, name, "standard", "phong", **{field: value})
    assert frame.alpha.any()
    assert digest(frame) == VARIANTS[key]


@pytest.mark.long
@pytest.mark.parametrize("preset", SPHERES)
def test_golden_glb(device, tmp_path, preset):
    """The scene's own preset is pbr; an explicit one takes its place. Lit by lights: an environment's tables are made by
    NumPy, whose last bits depend on the machine."""
    scene = replace(clshade.load(spheres(tmp_path / "spheres.glb")), own_lights=True)
    arguments = {"shadows": False} if preset == scene.preset else {"preset": preset}
    frame = rendered(scene, device=device, layers=("Z", "id"), resolution=RESOLUTION, **arguments)
    assert digest(frame) == SPHERES[preset]


@pytest.mark.long
def test_golden_glb_with_shadows(device, tmp_path):
    scene = replace(clshade.load(spheres(tmp_path / "spheres.glb")), own_lights=True)
    frame = rendered(scene, device=device, layers=("Z", "id"), resolution=RESOLUTION)
    assert digest(frame) == SHADOWED_SPHERES


@pytest.mark.long
@pytest.mark.parametrize("lanes", [1, 4, 8])
def test_shadows_with_any_number_of_lanes(device, lanes):
    assert digest(draw(device, "teapot", "standard", "phong", shadows=True, lanes=lanes)) == SHADOWED_TEAPOT


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
@pytest.mark.parametrize(("key", "options"), OTHERS, ids=str)
def test_neither_lanes_nor_features_change_a_bit(device, key, options):
    assert digest(draw(device, *key, **options)) == GOLDEN[key]


# The result of a lane must not depend on the other lanes: on which of them a triangle covers, or which need more work.
# Each scene takes another path through the kernels: many owners per block, gathered; textures, clipped pieces,
# materials; an alpha test.
def knot() -> Scene:
    return clshade.builtin("torus_knot", triangles=3000, resolution=(97, 61))


def cut_out() -> Scene:
    rng = np.random.default_rng(2)
    meshes = []
    for mesh in mixed().meshes:
        if mesh.uvs is not None:
            material = replace(mesh.material, texture=Texture(rng.random((5, 7, 4)), "mirror"), alpha_cutoff=0.4)
            mesh = replace(mesh, material=material)
        meshes.append(mesh)
    return replace(mixed(), meshes=tuple(meshes))


SEVERAL = [
    {"samples": 2},
    {"samples": 16, "resolve": "weighted", "shader": "gouraud"},
    {"samples": 17, "sample_shading": True},
    {"samples": 19, "sample_shading": True, "resolve": "weighted", "texture_filter": "trilinear"},
    {"samples": 4, "resolve": "weighted", "preset": "course", "shader": "gouraud"},
    {"samples": 3, "resolve": "weighted"},
    {"samples": 3, "resolve": "weighted", "precision": "float64"},
    {"samples": 1, "shader": "gouraud"},
]
EVERY_DAY = (knot, {"samples": 5, "resolve": "weighted"})
# Multiplied and then divided by its weight in float32, none of its channels is restored.
BACKGROUND = (0.26161213, 0.29849114, 0.81422574)


# Each of the settings meets two or three numbers of lanes, each number most of the paths.
OTHER_LANES = [
    *zip([knot] * 8, SEVERAL, (1, 4, 8, 1, 4, 8, 1, 4), [BACKGROUND] * 8, strict=True),
    *zip([mixed] * 4, SEVERAL[::2], (4, 1, 8, 8), [BACKGROUND] * 4, strict=True),
    *zip([cut_out] * 4, SEVERAL[1::2], (8, 4, 1, 1), [BACKGROUND] * 4, strict=True),
    (knot, SEVERAL[2], 4, None),
    (mixed, SEVERAL[3], 8, None),
    (*EVERY_DAY, 8, BACKGROUND),
]


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "options", "lanes", "background"),
    [(*EVERY_DAY, 1, BACKGROUND)] + [(*case,) for case in ((*EVERY_DAY, 1, None), *OTHER_LANES)],
    ids=lambda value: getattr(value, "__name__", str(value)),
)
def test_lanes_do_not_change_a_bit_of_several_samples(device, scene, options, lanes, background):
    """Nor of the layers, all of them where surfaces have everything; pixels without a face show the background, in
    tiles with and without triangles."""
    if options.get("precision") == "float64":
        needs_float64(device)
    digests = {}
    for count in (None, lanes):
        arguments = {"resolution": (97, 61), "layers": "all" if scene is mixed else ("Z", "id"), **options}
        frame = rendered(replace(scene(), background=background), device=device, lanes=count, **arguments)
        digests[count] = digest(frame)
        empty = frame.alpha == 0.0
        assert (frame.rgb[empty] == np.asarray(background or (0, 0, 0), frame.rgb.dtype)).all()
    assert digests[None] == digests[lanes]
    assert 0.1 < empty.mean() < 0.9
    if scene is knot:
        assert empty[-struct_layout.TILE_SIZE :, : struct_layout.TILE_SIZE].all()
        edges = empty[:, 1:] != empty[:, :-1]
        assert edges.any()  # partly empty tiles


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
    environment = {**os.environ, "POCL_CPU_MAX_CU_COUNT": "1", "POCL_MAX_PTHREAD_COUNT": "1"}
    run = partial(subprocess.run, env=environment, capture_output=True, text=True, timeout=120)
    done = run([sys.executable, "-c", ONE_THREAD, str(ROOT / "tests" / "support"), device.index])
    assert done.returncode == 0, done.stderr


@pytest.mark.long
@pytest.mark.filterwarnings("error")
def test_programs_from_the_cache_give_the_same_bits(device, tmp_path, monkeypatch):
    """And neither building nor loading them prints anything."""
    device = replace(device, keeps_programs=False)
    monkeypatch.setattr(programs, "_built", {})
    monkeypatch.setattr(programs, "_stored_program", lambda _, source, __: StoredProgram(tmp_path / str(hash(source))))
    for stored in (False, True):
        programs._built.clear()
        assert digest(draw(device, "quads", "standard", "phong")) == GOLDEN["quads", "standard", "phong"]
        assert [program.loaded for program in programs.built()] == [stored] * 2


def test_a_changed_bit_is_noticed(device):
    frame = draw(device, "icosphere", "standard", "phong")
    before = digest(frame)
    frame["Z"].view("u4")[50, 50] ^= 1
    assert digest(frame) != before
