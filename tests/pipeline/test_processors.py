"""The kernels as PyPI's PoCL compiles them for other x86-64 processors: they draw the right images, without a warning, and
without a call into PoCL's library of functions."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest
from processes import ROOT, python

from clshade.pipeline.opencl import environment
from clshade.pipeline.programs import QUICK

# A child process that draws scenes which need all kernels between them, and prints a digest of each image.
DRAW = """
import json
from dataclasses import replace

import numpy as np

from clshade import Renderer, builtin
from clshade.measure.digest import digest
from clshade.pipeline import programs
from clshade.pipeline.opencl.device import found_devices, open_untested
from clshade.scene.builtin.studio import studio
from clshade.scene.settings import Edges
from clshade.scene.lights import RectangleLight
from clshade.scene.material import MetallicRoughness
from clshade.scene.model import Material
from clshade.scene.texture import Texture

teapot, knot, course, quads = (builtin(name) for name in ("teapot", "torus_knot", "course", "quads"))
values = np.random.default_rng(1).uniform(0.2, 0.9, (4, 7, 5, 3)).astype(np.float32)
normal, occlusion, emission, roughness = map(Texture, values)
maps = MetallicRoughness(
    0.6,
    0.5,
    emission=0.3,
    normal_texture=normal,
    occlusion_texture=occlusion,
    emission_texture=emission,
    metallic_roughness_texture=roughness,
)
mapped = replace(course, environment=studio(), meshes=[replace(m, material=Material(pbr=maps)) for m in course.meshes])
lamp = RectangleLight((2.0, 6.0, 4.0), (1.0, 0.0, 0.0), (0.0, 0.6, -0.8), (9.0, 9.0, 9.0))
(mesh,) = quads.meshes
alphas = np.linspace(0.2, 0.9, len(mesh.verts))
glass = replace(quads, meshes=[replace(mesh, alphas=alphas, material=replace(mesh.material, blend=True))])
height = [replace(m, scalars={"height": m.verts[:, 1]}) for m in knot.meshes]
lines = {"scalars": "height", "edges": Edges(("feature", "silhouette")), "samples": 4, "precision": "float64"}
cases = [
    (teapot, {"texture_filter": "trilinear", "layers": ("Z", "id", "N", "uv")}),
    (teapot, {"preset": "course", "shader": "gouraud"}),
    (mapped, {"preset": "pbr", "background": "environment", "shadows": False}),
    (replace(teapot, lights=(*teapot.lights, lamp)), {"shadows": True, "ambient_occlusion": 5, "light_samples": 4}),
    (glass, {"shadows": True}),
    (replace(knot, meshes=height), lines),
]
info, *_ = found_devices("pocl")
device, images = open_untested(info.index, info.name), []
for scene, options in cases:
    with Renderer(scene, device=device, **{"resolution": (161, 97), "layers": ("Z", "id"), **options}) as renderer:
        images.append(digest(renderer.render()))
"""
FACTS = """
import shutil

from clshade.pipeline.opencl import environment

shutil.copytree(environment.pocl_folder(), environment.cache_root() / "compiled")
warnings = [line for program in programs.built() for line in program.warnings]
target = device.version.rpartition("gnu-")[2]
print(json.dumps({"target": target, "images": images, "warnings": warnings}))
"""
# Another one, with a kernel that calls PoCL's library, and of which the compiler warns.
PLANTED = """
import json

from clshade.pipeline import programs
from clshade.pipeline.buffers import Buffer
from clshade.pipeline.features import Features
from clshade.pipeline.opencl.device import found_devices, open_untested

text = "kernel void planted(global float16 *x) { int i = 1.5f; x[i] = _cl_fma(x[0], x[1], x[2]); }"
info, *_ = found_devices("pocl")
device, images = open_untested(info.index, info.name), []
numbers = Buffer.empty(device, (3, 16), "f4")
programs.build(device, Features.of(), text)["planted"](device.queue, (1,), (1,), numbers.memory).wait()
"""
# Its name in LLVM 14, and the library of PoCL's functions, kernel-*-LIBRARY.bc. A processor with AVX2 runs them all.
MODELS = {
    "nehalem": ("nehalem", "sse41"),  # the oldest, without AVX and FMA
    "haswell": ("haswell", "avx2"),
    "zen4": ("znver3", "avx512"),  # what LLVM 14 and PoCL make of it
}
LIBRARY = re.compile(rb"_Z(\d+)(_cl_\w+)")  # mangled names
OF_C = re.compile(rb"\0((?:fma|fmin|fmax|sqrt|rint|floor|ceil|trunc|round|exp2?|log2?|pow|ldexp)f?)\0")
STEPS = ("clshade: trying out ", "clshade: compiling ")


@pytest.fixture(scope="module")
def packages() -> Path:
    """Return the folder of PyPI's packages."""
    spec = importlib.util.find_spec("pyopencl")
    folder = Path(spec.origin).parents[1]
    if environment.level_of(environment.processor_flags()) < 3 or not (folder / "pocl_binary_distribution").is_dir():
        pytest.skip("expected x86-64 with AVX2, and PyPI's PoCL, `pip install 'pyopencl[pocl]'`")
    return folder


def variables_of(target: str, library: str, source: Path, folder: Path) -> dict[str, str]:
    """Return the environment variables with which a process has the PoCL of another processor.

    The folder gets links to PyPI's packages, with the processor's library under every name: PoCL looks for it beside the
    path by which it was loaded.
    """
    for name in ("pyopencl", "pocl_binary_distribution"):
        shutil.copytree(source / name, folder / name, copy_function=os.symlink)
    libraries = sorted(folder.glob("pocl_binary_distribution/.libs/share/pocl/kernel-*.bc"))
    (chosen,) = (path.resolve() for path in libraries if path.stem.endswith(f"-{library}"))
    for path in libraries:
        path.unlink()
        path.symlink_to(chosen)
    (folder / "no-vendors").mkdir()
    search = os.pathsep.join(map(str, (folder, ROOT, *filter(None, sys.path))))
    return {"PYTHONPATH": search, "OCL_ICD_VENDORS": str(folder / "no-vendors"), environment.FORCED: target}


def drawn(code: str, cache: Path, **variables: str) -> dict[str, Any]:
    """Return what a child process prints, its further messages, and the functions that compiled kernels call: of PoCL's
    library, and of the C library."""
    done = python(code + FACTS, cache, timeout=1800.0, CLSHADE_DEVICE="pocl", **{QUICK: "", **variables})
    assert done.returncode == 0, done.stderr
    compiled = [path.read_bytes() for path in cache.rglob("*.so")]
    return {
        **json.loads(done.stdout),
        "messages": [line for line in done.stderr.splitlines() if line.strip() and not line.startswith(STEPS)],
        "calls": {name[: int(length)].decode() for data in compiled for length, name in LIBRARY.findall(data)},
        "of_c": {name.decode() for data in compiled for name in OF_C.findall(data)},
    }


def test_planted_faults_are_seen(packages, tmp_path):
    report = drawn(PLANTED, tmp_path / "cache", **variables_of("znver1", "avx2", packages, tmp_path / "packages"))
    assert (report["target"], report["calls"]) == ("znver1", {"_cl_fma"})
    assert any("implicit conversion from 'float'" in line for line in report["warnings"])


@pytest.fixture(scope="module")
def own_images(packages, tmp_path_factory) -> list[str]:
    """Return digests of the images as this processor's own kernels draw them, not optimized, which has the same bits."""
    images: list[str] = drawn(DRAW, tmp_path_factory.mktemp("own"), **{QUICK: "1"})["images"]
    return images


@pytest.mark.long
@pytest.mark.parametrize("model", MODELS)
def test_kernels_for_another_processor_draw_the_same_bits(model, own_images, packages, tmp_path):
    target, library = MODELS[model]
    report = drawn(DRAW, tmp_path / "cache", **variables_of(target, library, packages, tmp_path / "packages"))
    assert report["images"] == own_images
    assert (report["target"], report["warnings"], report["messages"], report["calls"]) == (target, [], [], set())
    assert report["of_c"] <= ({"fma"} if model == "nehalem" else set())  # of float64, without the instruction
