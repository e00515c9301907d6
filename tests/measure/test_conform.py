"""`conform`: planted faults are found and written as scripts; a device that crashes or hangs costs a line."""

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


def test_golden_scenes_cover_all_pairs():
    rows = json.loads(scenes.GOLDEN.read_text())
    choices = [row["choice"] for row in rows]
    names = list(choices[0])
    assert all(list(choice) == names for choice in choices)
    levels = {level for choice in choices for level in choice.items()}
    every = {frozenset(pair) for pair in combinations(levels, 2) if pair[0][0] != pair[1][0]}
    missing = every - {frozenset(pair) for choice in choices for pair in combinations(choice.items(), 2)}
    assert missing == {frozenset([("texture_at", "vertex"), ("texture_filter", "trilinear")])}


def rewrite(monkeypatch, right: str, fault: str) -> None:
    compiled = programs.compiled
    monkeypatch.setattr(
        programs, "compiled", lambda device, text, options: compiled(device, text.replace(right, fault), options)
    )


@pytest.mark.sampled
@pytest.mark.parametrize(("group", "name", "right", "fault"), [
    ("constructs", "divergent_loop", "k < a[i]", "k < a[i - get_local_id(0)]"),
    ("constructs", "denormals", "a[i] * 0.5f", "(fabs(a[i]) < 0x1p-126f ? 0.0f : a[i] * 0.5f)"),
    ("constructs", "comparisons", "!(a[i] >= b[i])", "(a[i] < b[i])"),
    ("operations", "fused_float", "{fma(a, b, c)}", "{a * b + c}"),
    ("operations", "count", "atomic_add(out + 3, x[item]);", "if (item) atomic_add(out + 3, x[item]);"),
    ("structs", "View_float32", "} View;", "} __attribute__((aligned(64))) View;"),
])  # fmt: skip
def test_a_fault_in_a_kernel_is_found(opened, monkeypatch, group, name, right, fault):
    """Sources are rewritten as if a compiler had made the fault; without it the test passes."""
    case = check_of(opened, group, name, "float32-library" if group == "operations" else "").test
    case = replace(case, program="")
    assert Bench(opened).wrong(case) is None
    rewrite(monkeypatch, right, fault)
    assert Bench(opened).wrong(case)


@pytest.mark.long
def test_faults_of_memory_and_frames_are_found(opened, monkeypatch):
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


@pytest.mark.long
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


def test_wrong_rows_are_told_by_the_first_and_a_device_that_flushes_may_err_with_denormals(opened, monkeypatch):
    inputs = np.array([1.0, 0.5], np.float32), np.array([[1, 2], [3, 4]], np.int32)
    monkeypatch.setattr(Bench, "run", lambda *_: np.array([1, 9]))
    wrong = Bench(opened).wrong(Case("name", "", "", inputs, lambda *_: np.array([1, 4])))
    assert wrong == ("1 of 2 rows; of 0.5, [3, 4]: expected 4, found 9", 1)
    case = Case("same", "", "", (np.array([1e-40, -1e-40, 1.0, -2.0], np.float32),), lambda v: v)
    for outputs, right in (([-0.0, 0.0, 1.0, -2.0], True), ([0.0, -0.0, 1.0, 0.0], False)):
        monkeypatch.setattr(Bench, "run", lambda *_, outputs=outputs: np.array(outputs, np.float32))
        for flushing in (True, False):
            monkeypatch.setattr(case_module, "flushes", lambda device, flushing=flushing: flushing)
            assert (Bench(opened).wrong(case) is None) == (right and flushing)


IMPORTS = "from clshade.measure.conform import isolated; from clshade.pipeline import programs"


@pytest.fixture
def results_with(opened, tmp_path, monkeypatch):
    def run_with(code: str, group: str = "constructs", **fields):
        program = f"import ctypes, json, os; {IMPORTS}\n{code}"
        monkeypatch.setattr(Task, "command", lambda self: [sys.executable, "-c", program, json.dumps(asdict(self))])
        return run_part(Task(opened.index, opened.name, group, "", str(tmp_path), **fields))

    return run_with


@pytest.mark.long
def test_a_failure_has_a_script_and_the_others_have_none(opened, tmp_path, results_with):
    planted = "os.write(1, b'{') and text.replace('k < a[i]', 'k < 3')"
    wrong = f"programs.compiled = lambda device, text, options: compiled(device, {planted}, options)"
    (first, *rest), facts = results_with(f"compiled = programs.compiled\n{wrong}\nisolated.main()")
    assert first.name == "divergent_loop"
    assert "of 1024 rows" in first.problem
    assert [path.name for path in tmp_path.iterdir()] == [first.script] == ["constructs_divergent_loop.py"]
    assert not any(result.problem or result.script for result in rest)
    assert facts["lanes"] == opened.lanes


@pytest.mark.long
def test_after_three_crashes_a_part_is_given_up(tmp_path, results_with):
    (*crashed, rest), _ = results_with("programs.compiled = lambda *_: os.abort()\nisolated.main()")
    assert [result.problem for result in crashed] == ["ends the process: SIGABRT"] * 3
    assert len({result.name for result in crashed}) == 3
    assert all((tmp_path / result.script).is_file() for result in crashed)
    assert rest.problem == "not tried: processes end early"


@pytest.mark.long
def test_a_launch_that_does_not_end_is_one_line(opened, results_with):
    """Even if it holds the interpreter's lock; the other tests of structs are those of an earlier process."""
    hangs = "programs.compiled = lambda *_: ctypes.PyDLL(None).sleep(60)\nisolated.main()"
    done = [check.name for check in groups.tests_of("structs", "", opened)][1:]
    (result,), _ = results_with(hangs, "structs", done=done, limit=5.0)
    assert result.problem == "does not end within 5 s"


@pytest.mark.sampled
@pytest.mark.parametrize(("code", "problem"), [
    ("", "exit code 0"),
    ("1 / 0", "exit code 1: ZeroDivisionError: division by zero"),
    ("print(json.dumps({'group': 'g', 'name': 'one', 'problem': 'has not ended'}))", "exit code 0"),
])  # fmt: skip
def test_a_process_that_ends_too_early_is_a_failure(results_with, code, problem):
    results, _ = results_with(code)
    assert results[0].problem == f"ends the process: {problem}"


@pytest.mark.long
def test_every_group_has_tests_and_the_card_tells_of_all(opened):
    for group in GROUPS:
        for part in parts_of(group, opened.has_fp64):
            tests = groups.tests_of(group, part, opened)
            assert len({test.name for test in tests}) == len(tests) > 0
    info = chosen_devices(opened.index)[0]
    results, facts = [Result("constructs", "one", "what", seconds=1.0), Result("scenes", "two")], {"lanes": 16}
    assert "- verdict: conforms\n" in conform.card(info, results, facts).markdown()
    results.append(Result("scenes", "three", "what", "a | b", script="scenes_three.py"))
    document = json.loads(conform.card(info, results, facts).json())
    assert document["verdict"] == "does not conform: 1 of 3 tests failed"
    assert (document["device"]["index"], document["lanes"]) == (opened.index, 16)


@pytest.mark.long
def test_the_command(opened, capsys, tmp_path):
    code, out, _ = run(capsys, "conform", "--device", opened.index, "--only", "memory", "-o", tmp_path / "card")
    assert code == 0
    assert out.splitlines()[-1] == "conforms"
    assert {path.name for path in (tmp_path / "card").iterdir()} == {"conform.csv", "conform.json", "conform.md"}


@pytest.mark.long
def test_the_device_conforms(device, tmp_path):
    assert conform.run(device.index, out=tmp_path)
