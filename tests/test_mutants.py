"""mutants.py, which is run by hand: it plants what it reports, and its tables name existing files."""

from __future__ import annotations

import json
import os

import mutants
import pytest
from mutants import EQUIVALENT, KERNELS, LOADERS, ROOT, TESTS
from mutation_sites import sites

KERNEL = """\
// a < b in a comment
#if LANES == 16
#define TWICE(v) ((v) * 2)
#endif
int f(int a, global const int *b)
{
    int c[3];
    if (a < 3 && !b[a])
        a += 1;
    c[0] = min(a, -b[1]);
    return fma(a, b, c).x;
}
"""
OF_KERNEL = {
    "#define TWICE(v) ((v) * 2)": {"((v) / 2)", "((v) * 3)", "((v) * 1)"},
    "int c[3];": {"c[4]", "c[2]"},
    "if (a < 3 && !b[a])": {
        "(a <= 3 &&",
        "(a < 4 &&",
        "(a < 2 &&",
        "3 || !b",
        "&& b[a])",
        "!b[a + 1])",
        "(!(a < 3 && !b[a]))",
    },
    "a += 1;": {"a -= 1;", "a += 2;", "a += 0;", ";"},
    "c[0] = min(a, -b[1]);": {"c[1] =", "max(a,", "(a, b[1]);", "-b[2]", "-b[0]", ";"},
    "return fma(a, b, c).x;": {"fma(a, b, -(c))", "fma(a, c, b)", ".y;"},
}
PYTHON = """\
def f(a: int = 3) -> str:
    '''a < b in a text'''
    if a < 1 and not g(a):
        raise ValueError(f"{a + 1}")
    h.x = -a // 2.0
    return a is None
"""
OF_PYTHON = {
    "def f(a: int = 3) -> str:": {"= 4)", "= 2)"},
    "if a < 1 and not g(a):": {"a <= 1", "a < 2", "a < 0", "1 or not", "and g(a)", "if (not (a < 1 and not g(a))):"},
    'raise ValueError(f"{a + 1}")': {"pass"},
    "h.x = -a // 2.0": {"= a //", "-a * 2.0", "(4.0)", "(-2.0)", "pass"},
    "return a is None": {"a is not None"},
}


@pytest.mark.parametrize(("name", "text", "expected"), [("a.cl", KERNEL, OF_KERNEL), ("a.py", PYTHON, OF_PYTHON)])
def test_what_is_planted(name, text, expected):
    changes = [site.lines(text)[1:] for site in sites(name, text)]
    assert {before for before, _ in changes} == set(expected)
    for line, parts in expected.items():
        after = [now for before, now in changes if before == line]
        assert len(after) == len(parts), after
        assert len(set(after)) == len(after)
        assert all(any(part in now for now in after) for part in parts), after
        assert line not in after


def test_the_tables_name_what_there_is():
    kernels = {f"kernels/{name}" for name in os.listdir(ROOT / "kernels") if ".cl" in name} - {"kernels/features.clh"}
    assert {file for file in TESTS if file.startswith("kernels/")} == kernels
    for file in TESTS:
        assert mutants.mutants_of(file), file
    for names in (*TESTS.values(), *KERNELS, *LOADERS):
        for name in names.split():
            assert (ROOT / mutants.test_file(name)).is_file(), name


def test_the_reasons_are_of_mutants_that_there_are():
    for entry in json.loads(EQUIVALENT.read_text()):
        assert entry["reason"]
        there = [
            {"file": m.file, "line": m.line, "from": m.before, "to": m.after} for m in mutants.mutants_of(entry["file"])
        ]
        assert any(mutants.reason(record, [entry]) for record in there), entry


def test_draws_are_even_and_repeatable():
    files = ["kernels/fill.clh", "kernels/samples.clh", "clshade/scene/formats/obj.py"]
    first, again, second = (mutants.draw(60, seed, files) for seed in (1, 1, 2))
    assert first == again
    assert first != second
    counts = {file: wanted for file, (wanted, _) in first.items()}
    assert sum(counts.values()) == 60
    assert 2 <= counts["kernels/samples.clh"] < min(counts[file] for file in files if file != "kernels/samples.clh")
    for file, (wanted, order) in first.items():
        assert len({mutant.line for mutant in order[:wanted]}) == wanted
        assert len(order) == len(mutants.mutants_of(file))


@pytest.mark.parametrize(
    ("code", "printed", "expected"),
    [
        (0, "3 passed", ("survived", "")),
        (1, "FAILED tests/test_a.py::test_b[1 - 2] - assert 1 == 2\n", ("found", "tests/test_a.py::test_b[1 - 2]")),
        (1, "ERROR tests/test_a.py - NameError\n", ("found", "tests/test_a.py")),
        (1, "the kernels did not build: no\nFAILED tests/test_a.py::test_b - x\n", ("broken", "")),
        (-11, "", ("found", "crash, signal 11")),
        (None, "", ("timeout", "beyond its time")),
    ],
)
def test_outcomes(code, printed, expected):
    assert mutants.judged(code, printed) == expected
