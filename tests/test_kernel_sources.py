"""Kernel sources: constants shared with the host, and macros that would be 0 if misspelled."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from clshade.pipeline import struct_layout

ROOT = Path(__file__).resolve().parent.parent
KERNELS = sorted((ROOT / "kernels").glob("*.cl*"))


def code_of(text: str) -> str:
    """Return OpenCL C without comments and strings."""
    return re.sub(r'//[^\n]*|/\*.*?\*/|"[^"\n]*"', " ", text, flags=re.DOTALL)


def literals(text: str) -> set[float]:
    """Return the values of all numeric literals in OpenCL C."""
    hexadecimal = r"0[xX][0-9a-fA-F]+(?:\.[0-9a-fA-F]*)?(?:[pP][+-]?\d+)?"
    decimal = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
    found = re.findall(rf"(?<![\w.])({hexadecimal}|{decimal})[fFuUlL]*(?![\w.])", code_of(text))
    return {float.fromhex(t) if t.lower().startswith("0x") else float(t) for t in found}


def test_literals_are_found():
    text = "int a = 0x7f + 16; // 99\nfloat b = 1.5f, c = 0x1p-100f, d = 2.5e-3f, e = v.s16 + float16_8(3UL); /* 98 */"
    assert literals(text) == {127.0, 16.0, 1.5, 2.0**-100, 2.5e-3, 3.0}


# Constants of struct_layout.py with distinctive values. 16 (TILE_SIZE) and 8 (SUBPIXEL_BITS) may have other uses in a
# kernel; tests/pipeline/test_frames.py changes the tile size instead.
SHARED = [value for value in struct_layout.CONSTANTS.values() if value > 255]


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.name)
def test_no_kernel_holds_a_literal_that_the_host_also_knows(path):
    assert len(SHARED) >= 4
    found = literals(path.read_text())
    assert not found & {float(value) for value in SHARED}
    assert 1 << struct_layout.SUBPIXEL_BITS not in found


def guards_of(name: str) -> set[str]:
    """Return the macros that a kernel file requires to be defined."""
    guards = re.findall(r"^#if (!defined.*)\n#error", (ROOT / "kernels" / name).read_text(), re.MULTILINE)
    return set(re.findall(r"defined\((\w+)\)", " ".join(guards)))


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.name)
def test_every_feature_that_a_kernel_tests_is_guarded(path):
    """A macro in #if that neither features.clh nor the file itself requires would silently be 0 if misspelled."""
    guarded = guards_of("features.clh") | guards_of(path.name)
    own = {"FP64", "LANES"} | set(
        re.findall(r"^\s*#\s*define\s+(\w+)", "\n".join(each.read_text() for each in KERNELS), re.MULTILINE)
    )
    text = code_of(path.read_text())
    tested = set()
    for line in re.findall(r"^\s*#\s*(?:el)?if\s(.*)$", text, re.MULTILINE):
        tested |= set(re.findall(r"[A-Z_][A-Z0-9_]+", re.sub(r"defined\s*\(\w+\)|__has_builtin\(\w+\)", "", line)))
    assert tested <= guarded | own, tested - guarded - own


def test_every_feature_is_guarded():
    from clshade.pipeline.features import CHOICES, OPTIONAL
    from clshade.pipeline.layer_buffers import MACROS

    assert guards_of("features.clh") == {*CHOICES, *OPTIONAL}
    assert guards_of("surface_layers.cl") == {*MACROS.values(), "MIRRORED"}
