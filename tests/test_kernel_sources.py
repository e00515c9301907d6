"""Kernel sources: constants shared with the host, and macros that would be 0 if misspelled."""

import re
from pathlib import Path

import pytest

from clshade.pipeline import struct_layout
from clshade.pipeline.features import COMPILED, FEATURES, GROUPS

ROOT = Path(__file__).resolve().parent.parent
KERNELS = sorted((ROOT / "kernels").glob("*.cl*"))


def code_of(text: str) -> str:
    """Return OpenCL C without comments and strings."""
    return re.sub(r'//[^\n]*|/\*.*?\*/|"[^"\n]*"', " ", text, flags=re.DOTALL)


def literals(text: str) -> set[float]:
    """Return the values of all numeric literals in OpenCL C."""
    hexadecimal = r"0[xX][0-9a-fA-F]+(?:\.[0-9a-fA-F]*)?(?:[pP][+-]?\d+)?"
    decimal = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
    numerals = re.findall(rf"(?<![\w.])({hexadecimal}|{decimal})[fFuUlL]*(?![\w.])", code_of(text))
    return {float.fromhex(t) if t.lower().startswith("0x") else float(t) for t in numerals}


# Constants of struct_layout.py with distinctive values. 16 (TILE_SIZE) and 8 (SUBPIXEL_BITS) may have other uses in a
# kernel; tests/pipeline/test_frames.py changes the tile size instead.
SHARED = [value for value in struct_layout.CONSTANTS.values() if value > 255]


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.name)
def test_no_kernel_holds_a_literal_that_the_host_also_knows(path):
    assert len(SHARED) >= 4
    numbers = literals(path.read_text())
    assert not numbers & {float(value) for value in SHARED}
    assert 1 << struct_layout.SUBPIXEL_BITS not in numbers


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.name)
def test_every_macro_that_a_kernel_tests_is_defined(path):
    """A macro in #if that nobody defines would silently be 0: a feature that is a condition at run time, or misspelled."""
    texts = "\n".join(kernel.read_text() for kernel in KERNELS)
    macros = {"FP64", "LANES", *COMPILED, *re.findall(r"^\s*#\s*define\s+(\w+)", texts, re.MULTILINE)}
    text = code_of(path.read_text())
    tested = set()
    for line in re.findall(r"^\s*#\s*(?:el)?if\s(.*)$", text, re.MULTILINE):
        tested |= set(re.findall(r"[A-Z_][A-Z0-9_]+", re.sub(r"defined\s*\(\w+\)|__has_builtin\(\w+\)", "", line)))
    assert tested <= macros, tested - macros


def test_every_feature_is_read():
    """But for those that follow from the tables that kernels read."""
    text = "\n".join(code_of(path.read_text()) for path in KERNELS if path.name != "features.clh")
    named = {*re.findall(r"NEEDS\([^,()]+, (\w+)\)", text), *COMPILED, *GROUPS["MAPS"]}  # by NEEDS_NTH
    by_data = {"SHADOW_ALPHA", "NORMAL_INDICES", "UV_INDICES", "UV_SETS", "NEAREST", "BACKGROUND", "EMISSION"}
    assert named == set(FEATURES) - by_data
