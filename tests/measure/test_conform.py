"""`conform`: planted faults are found and written as scripts; a device that crashes or hangs costs a line."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import asdict, replace
from itertools import combinations

import numpy as np
import pytest
from command_line import run

from clshade.measure.conform import case as case_module
from clshade.measure.conform import conform, groups, operations, reproducer, scenes
from clshade.measure.conform.case import GROUP, Bench, Case, Check
from clshade.measure.conform.groups import GROUPS, parts_of
from clshade.measure.conform.isolated import Result, Task, run_part
from clshade.pipeline import programs
from clshade.pipeline.opencl.device import chosen_devices

pytestmark = pytest.mark.optimized


def check_of(device, group: str, name: str, part: str = "") -> Check:
    return next(check for check in groups.tests_of(group, part, device) if check.name.endswith(name))


# Choices


def test_golden_scenes_cover_all_pairs():
    """Of the levels of different choices, but one pair that Settings refuses."""
    rows = json.loads(scenes.GOLDEN.read_text())
    choices = [row["choice"] for row in rows]
    names = list(choices[0])
    assert all(list(choice) == names for choice in choices)
    levels = {level for choice in choices for level in choice.items()}
    every = {frozenset(pair) for pair in combinations(levels, 2) if pair[0][0] != pair[1][0]}
    missing = every - {frozenset(pair) for choice in choices for pair in combinations(choice.items(), 2)}
    assert missing == {frozenset([("texture_at", "vertex"), ("texture_filter", "trilinear")])}
    assert len(names) == 31
    assert len({row["digest"] for row in rows}) == len(rows) >= 88


@pytest.mark.long
@pytest.mark.parametrize("program", ["nolight", "float64"])
def test_a_device_without_float64_draws_every_scene(opened, program):
    """A few scenes of a program: those that need float64 are drawn in float32, without edges, and have digests too."""
    without = replace(opened, has_fp64=False)
    drawn = [scene for scene, _ in scenes.golden(True) if scene.choice["program"] == program]
    tests = scenes.tests(program, has_fp64=False)
    assert [check.name for check in tests] == [scene.name for scene in drawn]
    needing = [check.test for check, scene in zip(tests, drawn, strict=True) if scene.needs_float64]
    assert len(needing) > 3
    assert [test(Bench(without)) for test in needing[:3]] == ["", "", ""]


# Faults


def rewrite(monkeypatch, right: str, fault: str) -> None:
    compiled = programs.compiled
    monkeypatch.setattr(
        programs, "compiled", lambda device, text, options: compiled(device, text.replace(right, fault), options)
    )


@pytest.mark.parametrize(("group", "name", "right", "fault"), [
    ("operations", "fused_float", "{fma(a, b, c)}", "{a * b + c}"),
    ("operations", "count", "atomic_add(out + 3, x[item]);", "if (item) atomic_add(out + 3, x[item]);"),
    ("constructs", "divergent_loop", "k < a[i]", "k < a[i - get_local_id(0)]"),
    ("constructs", "denormals", "a[i] * 0.5f", "(fabs(a[i]) < 0x1p-126f ? 0.0f : a[i] * 0.5f)"),
    ("constructs", "comparisons", "!(a[i] >= b[i])", "(a[i] < b[i])"),
    ("structs", "View_float32", "} View;", "} __attribute__((aligned(64))) View;"),
])  # fmt: skip
def test_a_fault_in_a_kernel_is_found(opened, monkeypatch, group, name, right, fault):
    """Sources are rewritten as if a compiler had made the fault; without it the test passes."""
    case = check_of(opened, group, name, "float32-library" if group == "operations" else "").test
    case = replace(case, program="")
    assert Bench(opened).wrong(case) is None
    rewrite(monkeypatch, right, fault)
    assert Bench(opened).wrong(case)


def test_faults_of_memory_and_frames_are_found(opened, monkeypatch):
    """A lost byte, a buffer that is too large, a run with other bits, a color with another last bit."""
    monkeypatch.setattr(groups, "edge_bytes", lambda device, size: (5, 7 * (size < 1 << 20)))
    assert groups.sizes(Bench(opened)) == "1048576 bytes: expected (5, 7) at the ends, found (5, 0)"
    assert "expected an error" in groups.beyond(Bench(opened))
    outputs = iter([*[np.zeros(4)] * 49, *[np.ones(4)] * 51])
    monkeypatch.setattr(Bench, "run", lambda *_: next(outputs))
    assert groups.builds(Bench(opened)) == "run 50 of 100 gives other bits than the first"
    drawn, draw = check_of(opened, "scenes", "062-nolight", "nolight").test, scenes.draw

    def flipped(scene, device):
        frame = draw(scene, device)
        frame.rgba.reshape(-1).view(np.uint32)[4] ^= 1
        return frame

    assert not drawn(Bench(opened))
    monkeypatch.setattr(scenes, "draw", flipped)
    assert drawn(Bench(opened)).startswith("other bits, within the bounds of the oracle")


# Runs a script on a processor that PoCL's LLVM may not know, such as AMD Zen 5.
RUN = """
import runpy, sys
from clshade.pipeline.opencl.environment import set_target
set_target()
runpy.run_path(sys.argv.pop(1), run_name="__main__")
"""


@pytest.mark.parametrize(("name", "right", "fault"), [
    ("max_int", "{max(a, b)}", "{max(a, b + 1)}"),
    ("count", "atomic_add(out + 3, x[item]);", ""),
])  # fmt: skip
def test_a_script_shows_a_fault_where_it_is(opened, tmp_path, monkeypatch, name, right, fault):
    """It has the rows of a work-group, fails with the fault in its kernel, and does not without."""
    case = next(case for case in operations.cases(operations.Way(np.float32, True, 1)) if case.name == name)
    rewrite(monkeypatch, right, fault)
    _, row = Bench(opened).wrong(case)
    path = tmp_path / reproducer.write(case, row, opened, tmp_path, f"operations/{name}")
    text = path.read_text()
    assert path.name == f"operations_{name}.py"
    assert set(re.findall(r"reshape\(\((\d+),", text)) == {str(GROUP)}
    assert "clshade." not in text
    assert "#line" not in text
    assert opened.name in text
    for kernel, code in ((text, 0), (text.replace(right, fault), 1)):
        path.write_text(kernel)
        command = [sys.executable, "-c", RUN, path, *opened.index.split(":")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        assert (done.returncode, "as expected" in done.stdout) == (code, not code), done.stdout + done.stderr


def test_a_device_that_flushes_may_err_with_denormals(opened, monkeypatch):
    """In operands and results; no other device may, nor where there is none."""
    tiny = np.array([1e-40, -1e-40, 1.0, -2.0], np.float32)
    case = Case("same", "", "", (tiny,), lambda v: v)
    for outputs, right in (([-0.0, 0.0, 1.0, -2.0], True), ([0.0, -0.0, 1.0, 0.0], False)):
        monkeypatch.setattr(Bench, "run", lambda *_, outputs=outputs: np.array(outputs, np.float32))
        for flushing in (True, False):
            monkeypatch.setattr(case_module, "flushes", lambda device, flushing=flushing: flushing)
            assert (Bench(opened).wrong(case) is None) == (right and flushing)


def test_what_is_wrong_is_told_by_the_first_wrong_row(opened, monkeypatch):
    inputs = np.array([1.0, 0.5], np.float32), np.array([[1, 2], [3, 4]], np.int32)
    monkeypatch.setattr(Bench, "run", lambda *_: np.array([1, 9]))
    wrong = Bench(opened).wrong(Case("name", "", "", inputs, lambda *_: np.array([1, 4])))
    assert wrong == ("1 of 2 rows; of 0.5, [3, 4]: expected 4, found 9", 1)


# Processes


def task(device, folder, group: str = "constructs", **fields) -> Task:
    return Task(device.index, device.name, group, "", str(folder), **fields)


def with_fault(monkeypatch, code: str) -> None:
    """Let processes run code before they run their tests."""

    def command(self) -> list[str]:
        imports = (
            "import ctypes, os; from clshade.measure.conform import isolated; from clshade.pipeline import programs"
        )
        return [sys.executable, "-c", f"{imports}\n{code}\nisolated.main()", json.dumps(asdict(self))]

    monkeypatch.setattr(Task, "command", command)


def test_a_failure_has_a_script_and_the_others_have_none(opened, tmp_path, monkeypatch):
    """What a runtime prints is no event."""
    planted = "os.write(1, b'{') and text.replace('k < a[i]', 'k < 3')"
    with_fault(
        monkeypatch,
        "compiled = programs.compiled\n"
        f"programs.compiled = lambda device, text, options: compiled(device, {planted}, options)",
    )
    (first, *rest), facts = run_part(task(opened, tmp_path))
    assert first.name == "divergent_loop"
    assert "of 1024 rows" in first.problem
    assert [path.name for path in tmp_path.iterdir()] == [first.script] == ["constructs_divergent_loop.py"]
    assert not any(result.problem or result.script for result in rest)
    assert facts["lanes"] == opened.lanes


def test_after_three_crashes_a_part_is_given_up(opened, tmp_path, monkeypatch):
    """Each costs a test, which has a script; the next process leaves it out."""
    with_fault(monkeypatch, "programs.compiled = lambda *_: os.abort()")
    (*crashed, rest), _ = run_part(task(opened, tmp_path))
    assert [result.problem for result in crashed] == ["ends the process: SIGABRT"] * 3
    assert len({result.name for result in crashed}) == 3
    assert all((tmp_path / result.script).is_file() for result in crashed)
    assert rest.problem == "not tried: processes end early"


def test_a_launch_that_does_not_end_is_one_line(opened, tmp_path, monkeypatch):
    """Even if it holds the interpreter's lock; the other tests of structs are those of an earlier process."""
    with_fault(monkeypatch, "programs.compiled = lambda *_: ctypes.PyDLL(None).sleep(60)")
    done = [check.name for check in groups.tests_of("structs", "", opened)][1:]
    (result,), _ = run_part(task(opened, tmp_path, "structs", done=done, limit=10.0))
    assert result.problem == "does not end within 10 s"


@pytest.mark.parametrize(("code", "problem"), [
    ("", "exit code 0"),
    ("1 / 0", "exit code 1: ZeroDivisionError: division by zero"),
    ("print(json.dumps({'group': 'g', 'name': 'one', 'problem': 'has not ended'}))", "exit code 0"),
])  # fmt: skip
def test_a_process_that_ends_too_early_is_a_failure(opened, tmp_path, monkeypatch, code, problem):
    """Between two tests too, and whatever its exit code."""
    monkeypatch.setattr(Task, "command", lambda self: [sys.executable, "-c", f"import json; {code}"])
    results, _ = run_part(task(opened, tmp_path))
    assert results[0].problem == f"ends the process: {problem}"


# Groups and card


def test_every_group_has_tests(opened):
    for group in GROUPS:
        for part in parts_of(group, opened.has_fp64):
            tests = groups.tests_of(group, part, opened)
            assert tests
            assert len({test.name for test in tests}) == len(tests)


def test_the_card(opened):
    info = chosen_devices(opened.index)[0]
    passed = Result("constructs", "one", "what", seconds=1.0)
    results, facts = [passed, Result("scenes", "two")], {"lanes": 16}
    text = conform.card(info, results, facts).markdown()
    assert "- verdict: conforms\n" in text
    assert "| constructs: what kernels are made of | 1 | 0 | 1 |" in text
    results.append(Result("scenes", "three", "what", "a | b", script="scenes_three.py"))
    card = conform.card(info, results, facts)
    assert "- scenes/three (what): a | b [scenes_three.py]\n" in card.markdown()
    document = json.loads(card.json())
    assert document["verdict"] == "does not conform: 1 of 3 tests failed"
    assert [test["name"] for test in document["tests"]] == ["one", "two", "three"]
    assert (document["device"]["index"], document["lanes"]) == (opened.index, 16)


def test_the_command(opened, capsys, tmp_path):
    code, out, _ = run(capsys, "conform", "--device", opened.index, "--only", "memory", "-o", tmp_path / "card")
    assert code == 0
    assert out.splitlines()[-1] == "conforms"
    assert {path.name for path in (tmp_path / "card").iterdir()} == {"conform.csv", "conform.json", "conform.md"}


@pytest.mark.long
def test_the_device_conforms(device, tmp_path):
    assert conform.run(device.index, out=tmp_path)
