"""Every kernel on Oclgrind, a simulated device: no access out of bounds, data race or read of uninitialized memory."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from processes import ROOT

LIBRARIES = ("/usr/lib/oclgrind/liboclgrind-rt-icd.so", "/usr/lib/x86_64-linux-gnu/oclgrind/liboclgrind-rt-icd.so")
SOURCES = "\n".join(path.read_text() for path in (ROOT / "kernels").glob("*.cl"))
KERNELS = set(re.findall(r"\bkernel void (\w+)", SOURCES))
pytestmark = pytest.mark.long


def library() -> str:
    """Return Oclgrind's library for ICD loaders: pyopencl bundles its own loader, which the command `oclgrind`
    bypasses."""
    command = shutil.which("oclgrind")
    beside = Path(command or "/").resolve().parent.parent / "lib" / "oclgrind" / "liboclgrind-rt-icd.so"
    return next((str(path) for path in (beside, *LIBRARIES) if os.path.exists(path)), "")


def oclgrind(folder: Path, form: str, options: str = "-disable-llvm-passes") -> tuple[Any, str]:
    """Run tests/support/oclgrind_drawing.py for a form; return its output and Oclgrind's log.

    options: clang's, for kernels: Oclgrind 21.10 aborts at intrinsics that LLVM's optimizer inserts.
    """
    if not shutil.which("oclgrind") or not library():
        pytest.skip("oclgrind is not installed (apt install oclgrind)")
    vendors = folder / "vendors"
    vendors.mkdir()
    (vendors / "oclgrind.icd").write_text(library() + "\n")
    log = folder / "log"
    variables = {
        "OCL_ICD_VENDORS": str(vendors),
        "OCLGRIND_BUILD_OPTIONS": options,
        "OCLGRIND_DATA_RACES": "1",
        "OCLGRIND_UNIFORM_WRITES": "1",
        "OCLGRIND_UNINITIALIZED": "1",
        "OCLGRIND_COMPUTE_UNITS": "2",
        "OCLGRIND_NUM_THREADS": "1",
        "OCLGRIND_LOG": str(log),
        "XDG_CACHE_HOME": str(folder),
        "PYTHONPATH": str(ROOT),
    }
    command = [sys.executable, str(ROOT / "tests" / "support" / "oclgrind_drawing.py"), form]
    done = subprocess.run(command, env={**os.environ, **variables}, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr + log.read_text()[:5000]
    return json.loads(done.stdout), log.read_text() if log.exists() else ""


def test_planted_errors_are_found(tmp_path):
    _, log = oclgrind(tmp_path, "planted")
    for message in ("Invalid read of size 4 at global memory", "data race at global memory", "uninitialized value"):
        assert message in log, log


@pytest.mark.parametrize("form", ["groups", "vectors"])
def test_no_kernel_does_anything_undefined(tmp_path, form):
    """Every kernel, alpha tests, clipped pieces, both visibilities, textures at corners and at pixels, an
    empty frame, edges, shadows, instances; the images are correct too."""
    report, log = oclgrind(tmp_path, form)
    assert log.strip() == ""
    assert set(report["ran"]) == KERNELS - ({"setup_count"} if form == "groups" else set())
    assert report["error"] < 16.0


def test_padding_is_never_read():
    """tests/support/oclgrind_drawing.py initializes it, so that Oclgrind does not report copies of structs."""
    for path in (ROOT / "kernels").iterdir():
        assert not re.search(r"(->|\.)\s*pad", path.read_text()), path.name
