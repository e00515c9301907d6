"""Python code in child processes with a minimal environment."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from clshade.pipeline.programs import QUICK

ROOT = Path(__file__).resolve().parents[2]


def _command(code: str, arguments: tuple[str, ...], cache: Path | str, **variables: str) -> dict[str, Any]:
    """Return what `subprocess` runs Python code with; `cache` becomes XDG_CACHE_HOME."""
    path = os.pathsep.join([str(ROOT), *filter(None, sys.path)])
    base = {"PATH": os.environ.get("PATH", ""), "PYTHONPATH": path, "XDG_CACHE_HOME": str(cache)}
    base[QUICK] = os.environ.get(QUICK, "")  # an empty one is left out
    environment = {name: value for name, value in {**base, **variables}.items() if value}
    return {"args": [sys.executable, "-c", code, *arguments], "env": environment}


def python(
    code: str, cache: Path | str, *arguments: str, timeout: float = 300.0, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run Python code in a process with a minimal environment; `cache` becomes XDG_CACHE_HOME."""
    how = _command(code, arguments, cache, **variables)
    return subprocess.run(**how, capture_output=True, text=True, timeout=timeout)


def started(code: str, cache: Path | str, *arguments: str) -> subprocess.Popen[bytes]:
    """Start the same without waiting."""
    return subprocess.Popen(**_command(code, arguments, cache))


OPEN = """
from clshade.pipeline.opencl import device
from clshade.errors import DeviceError
try:
    opened = device.open_device()
    print("opened", opened.platform)
except DeviceError as error:
    print("refused", error)
"""


# Prefix of `python -c` programs. getrusage's peak would start at that of the parent process.
PEAK = """
import re
def peak():
    "The most memory that this program has taken, MiB."
    return int(re.search(r"VmHWM:\\s*(\\d+)", open("/proc/self/status").read())[1]) / 1024
"""
