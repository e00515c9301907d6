"""The processor that PyPI's PoCL compiles for; and that the kernels as it compiles them for other x86-64 processors draw the
right images, without a warning, and without a call into PoCL's library of functions."""

import importlib.util
import json
import os
import re
import shutil
import sys
from pathlib import Path

import pytest
import test_every_feature
from processes import ROOT, python

from clshade.measure.digest import digest
from clshade.pipeline.opencl import environment
from clshade.pipeline.opencl.device import open_device
from clshade.pipeline.opencl.environment import level_of, target_for
from clshade.pipeline.programs import QUICK

SECOND = {"cx16", "lahf_lm", "popcnt", "sse4_1", "sse4_2", "ssse3"}
THIRD = SECOND | {"abm", "avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe", "xsave"}
FOURTH = THIRD | {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"}


@pytest.mark.parametrize(
    ("name", "flags", "target"),
    [
        ("generic", FOURTH, "x86-64-v4"),  # Zen 5
        ("generic", THIRD | {"avx512f"}, "x86-64-v3"),
        ("generic", THIRD - {"fma"}, "x86-64-v2"),
        ("znver3", FOURTH, "x86-64-v4"),  # Zen 4
        ("sapphirerapids", FOURTH, "sapphirerapids"),
        ("sapphirerapids", THIRD, "x86-64-v3"),  # in a virtual machine without AVX-512
        ("haswell", SECOND, "x86-64-v2"),  # Pentium and Celeron, without AVX
        ("knl", THIRD | {"avx512f", "avx512cd"}, "knl"),
    ],
)
def test_targets(name, flags, target):
    assert target_for(name, flags) == target


@pytest.fixture(scope="module")
def packages() -> Path:
    folder = Path(importlib.util.find_spec("pyopencl").origin).parents[1]
    if level_of(environment.processor_flags()) < 3 or not (folder / "pocl_binary_distribution").is_dir():
        pytest.skip("expected x86-64 with AVX2, and PyPI's PoCL, `pip install 'pyopencl[pocl]'`")
    return folder


def variables_of(target: str, library: str, source: Path, folder: Path) -> dict[str, str]:
    """Return the environment variables with which a process has the PoCL of another processor: links to
    PyPI's packages, with its library under every name, for which PoCL looks beside the path by which it was loaded."""
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


OPEN = """
from clshade.pipeline.opencl.device import found_devices, open_untested
info, *_ = found_devices("pocl")
device, images = open_untested(info.index, info.name), []
"""
# Scenes of the programs that are used most, and of further ones; and a digest of each image.
SCENES = "glass over nothing", "all maps"
MORE_SCENES = "shadows of a rectangle", "gouraud, course", "float64, scalars and lines"
DRAW = f"""{OPEN}
import sys
sys.path.append({str(Path(__file__).parent)!r})
from test_every_feature import draw
from clshade.measure.digest import digest
images = [digest(draw(device, name)) for name in sys.argv[1:]]
"""
# A kernel that calls PoCL's library, and of which the compiler warns.
PLANTED = f"""{OPEN}
from clshade.pipeline import programs
from clshade.pipeline.buffers import Buffer
from clshade.pipeline.features import Features
text = "kernel void planted(global float16 *x) {{ int i = 1.5f; x[i] = _cl_fma(x[0], x[1], x[2]); }}"
numbers = Buffer.empty(device, (3, 16), "f4")
programs.build(device, Features.of(), text)["planted"](device.queue, (1,), (1,), numbers.memory).wait()
"""
FACTS = """
import json, shutil
from clshade.pipeline import programs
from clshade.pipeline.opencl import environment
shutil.copytree(environment.pocl_folder(), environment.cache_root() / "compiled")
warnings = [line for program in programs.built() for line in program.warnings]
target = device.version.rpartition("gnu-")[2]
print(json.dumps({"target": target, "lanes": device.lanes, "images": images, "warnings": warnings}))
"""
LIBRARY = re.compile(rb"_Z(\d+)(_cl_\w+)")  # mangled names
OF_C = re.compile(rb"\0((?:fma|fmin|fmax|sqrt|rint|floor|ceil|trunc|round|exp2?|log2?|pow|ldexp)f?)\0")
STEPS = ("clshade: trying out ", "clshade: compiling ")


def drawn(code: str, cache: Path, *names: str, **variables: str) -> dict:
    """Return what a child process prints, its further messages, and the functions that compiled kernels call: of PoCL's
    library, and of the C library."""
    done = python(code + FACTS, cache, *names, timeout=1800.0, CLSHADE_DEVICE="pocl", **{QUICK: "", **variables})
    assert done.returncode == 0, done.stderr
    compiled = [path.read_bytes() for path in cache.rglob("*.so")]
    return {
        **json.loads(done.stdout),
        "messages": [line for line in done.stderr.splitlines() if line.strip() and not line.startswith(STEPS)],
        "calls": {name[: int(length)].decode() for data in compiled for length, name in LIBRARY.findall(data)},
        "of_c": {name.decode() for data in compiled for name in OF_C.findall(data)},
    }


@pytest.mark.long
def test_planted_faults_are_seen(packages, tmp_path):
    """With the PoCL of another processor, for which the kernel is compiled."""
    report = drawn(PLANTED, tmp_path / "cache", **variables_of("znver1", "avx2", packages, tmp_path / "packages"))
    assert (report["target"], report["lanes"], report["calls"]) == ("znver1", 8, {"_cl_fma"})
    assert any("implicit conversion from 'float'" in line for line in report["warnings"])


@pytest.fixture(scope="module")
def own_images(packages) -> list[str]:
    """Return digests of the images as the kernels for this processor draw them."""
    device = open_device("pocl")
    assert device.version.rpartition("gnu-")[2] not in ("", "generic")
    return [digest(test_every_feature.draw(device, name)) for name in SCENES + MORE_SCENES]


# Its name in LLVM 14, the library of PoCL's functions, kernel-*-LIBRARY.bc, and what is drawn. A processor with AVX2 runs
# them all.
MODELS = {
    "nehalem": ("nehalem", "sse41", SCENES + MORE_SCENES),  # the oldest, without AVX and FMA
    "haswell": ("haswell", "avx2", SCENES),
    "zen4": ("znver3", "avx512", SCENES),  # what LLVM 14 and PoCL make of it
}


@pytest.mark.long
@pytest.mark.parametrize("model", MODELS)
def test_kernels_for_another_processor_draw_the_same_bits(model, own_images, packages, tmp_path):
    target, library, names = MODELS[model]
    report = drawn(DRAW, tmp_path / "cache", *names, **variables_of(target, library, packages, tmp_path / "packages"))
    assert report["images"] == own_images[: len(names)]
    assert (report["target"], report["warnings"], report["messages"], report["calls"]) == (target, [], [], set())
    assert report["of_c"] <= ({"fma"} if model == "nehalem" else set())  # of float64, without the instruction
