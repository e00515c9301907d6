"""Kernel sources: constants shared with the host, and macros that would be 0 if misspelled."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

from clshade.pipeline import struct_layout
from clshade.pipeline.features import COMPILED, FEATURES, GROUPS
from clshade.pipeline.programs import flatten

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


def test_literals_are_found():
    text = "int a = 0x7f + 16; // 99\nfloat b = 1.5f, c = 0x1p-100f, d = 2.5e-3f, e = v.s16 + float16_8(3UL); /* 98 */"
    assert literals(text) == {127.0, 16.0, 1.5, 2.0**-100, 2.5e-3, 3.0}


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
    macros = {"FP64", "LANES", *COMPILED} | set(
        re.findall(r"^\s*#\s*define\s+(\w+)", "\n".join(kernel.read_text() for kernel in KERNELS), re.MULTILINE)
    )
    text = code_of(path.read_text())
    tested = set()
    for line in re.findall(r"^\s*#\s*(?:el)?if\s(.*)$", text, re.MULTILINE):
        tested |= set(re.findall(r"[A-Z_][A-Z0-9_]+", re.sub(r"defined\s*\(\w+\)|__has_builtin\(\w+\)", "", line)))
    assert tested <= macros, tested - macros


def test_programs_differ_by_few_features():
    """Each doubles the programs that a user may wait for."""
    assert len(COMPILED) <= 10
    assert len(set(FEATURES)) == len(FEATURES)


def test_every_feature_is_read():
    """But for those that follow from the tables that kernels read."""
    text = "\n".join(code_of(path.read_text()) for path in KERNELS if path.name != "features.clh")
    named = {*re.findall(r"NEEDS\([^,()]+, (\w+)\)", text), *COMPILED, *GROUPS["MAPS"]}  # by NEEDS_NTH
    by_data = {"SHADOW_ALPHA", "NORMAL_INDICES", "UV_INDICES", "UV_SETS", "NEAREST", "BACKGROUND", "EMISSION"}
    assert named == set(FEATURES) - by_data


FUNCTION = re.compile(
    r"^(INLINE |kernel |__attribute__\(\(noinline\)\) )?\w+ \**(\w+)\([^;{]*?\)\s*\n\{\n(.*?)^\}",
    re.MULTILINE | re.DOTALL,
)


def visits(source: str) -> dict[str, int]:
    """Return how many functions PoCL's linker visits for each kernel: for each function that is not INLINE, all that it
    reaches, whether it has visited them before or not (`copy_func_callgraph`)."""
    functions = FUNCTION.findall(code_of(source))
    bodies = {name: "".join(body for _, function, body in functions if function == name) for _, name, _ in functions}
    inlined = {name for how, name, _ in functions if how == "INLINE "}

    @cache
    def called(name: str) -> frozenset[str]:
        names = {word for word in re.findall(r"\b(\w+)\(", bodies[name]) if word in bodies} - {name}
        return frozenset().union(*(called(callee) if callee in inlined else {callee} for callee in names))

    @cache
    def reached(name: str) -> frozenset[str]:
        return called(name).union(*map(reached, called(name)))

    @cache
    def visited(name: str) -> int:
        return 1 + sum(map(visited, reached(name)))

    return {name: visited(name) for how, name, _ in functions if how == "kernel "}


def test_visits_are_counted():
    functions = "void d()\n{\n}\nvoid c()\n{\n    d();\n}\nINLINE int b(int x)\n{\n    c();\n}\n"
    assert visits(functions + "kernel void a(int k)\n{\n    b(1);\n    d();\n}\n") == {"a": 4}


@pytest.mark.parametrize("path", [path for path in KERNELS if path.suffix == ".cl"], ids=lambda path: path.name)
def test_chains_of_calls_are_short(path):
    """Each function between a kernel and others doubles the visits: 700,000 of a pixel stage took PoCL's linker a second."""
    assert max(visits(flatten((path.name,))).values()) < 120_000
