"""`conform`: planted faults are found and written as scripts; a device that crashes or hangs costs a line."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import asdict, replace
from itertools import combinations

import numpy as np
import pytest
from command_line import assert_refused, run

from clshade.measure.conform import case as case_module
from clshade.measure.conform import conform, groups, memory, operations, reproducer, scenes
from clshade.measure.conform.case import GROUP, Bench, Case, Wrong, without_denormals
from clshade.measure.conform.conform import Judged
from clshade.measure.conform.content import FACTORS, golden_scene
from clshade.measure.conform.groups import GROUPS, Check, parts_of
from clshade.measure.conform.isolated import Part, Result, Task
from clshade.measure.conform.pairs import Draws, covering
from clshade.pipeline import programs
from clshade.pipeline.opencl.device import chosen_devices

pytestmark = pytest.mark.optimized


def check_of(device, group: str, name: str, part: str = "") -> Check:
    return next(check for check in groups.tests_of(group, part, device) if check.name.endswith(name))


# Choices


def uncovered(factors: dict, rows: list[dict]) -> set:
    """Return the pairs of levels of different factors that no row has."""
    every = {
        ((one, a), (other, b)) for one, other in combinations(factors, 2) for a in factors[one] for b in factors[other]
    }
    return every - {pair for row in rows for pair in combinations(row.items(), 2)}


def test_golden_scenes_cover_all_pairs():
    rows = json.loads(scenes.GOLDEN.read_text())
    choices = [row["choice"] for row in rows]
    assert uncovered(FACTORS, choices) == {(("texture_at", "vertex"), ("texture_filter", "trilinear"))}
    assert len({row["digest"] for row in rows}) == len(rows) >= 100


@pytest.mark.long
@pytest.mark.parametrize("program", ["nolight", "float64"])
def test_a_device_without_float64_draws_every_scene(opened, program):
    """A few scenes of a program: those that need float64 are drawn in float32, without edges, and have digests too."""
    without = replace(opened, has_fp64=False)
    drawn = [scene for scene, _ in scenes.golden(True) if scene.choice["program"] == program]
    tests = scenes.tests(program, has_fp64=False)
    assert [name for name, *_ in tests] == [scene.name for scene in drawn]
    needing = [run for (_, _, run), scene in zip(tests, drawn, strict=True) if scene.needs_float64]
    assert len(needing) > 3
    assert [run(Bench(without)) for run in needing[:3]] == ["", "", ""]


def test_choices_cover_what_is_allowed():
    factors = {"a": (0, 1, 2), "b": "xyz", "c": (False, True)}
    found = covering(factors, lambda row: (row["a"], row["b"]) != (2, "z"), 12)
    assert uncovered(factors, found) == {(("a", 2), ("b", "z"))}
    assert len(found) == 12
    assert len(covering(factors, lambda row: True, 0)) <= 14


def test_draws_are_the_same_everywhere():
    draws = Draws(5)
    assert draws.below(1000, 6).tolist() == [805, 807, 515, 285, 53, 383]
    values = draws.parts(-1.5, 1.5, 500, 2)
    assert values.shape == (500, 2)
    assert (values * 4096 == np.rint(values * 4096)).all()
    assert -1.5 <= values.min() < -1.4
    assert 1.4 < values.max() <= 1.5


def test_a_scene_follows_from_its_choices():
    row = json.loads(scenes.GOLDEN.read_text())[0]["choice"]
    one, again, other = golden_scene(0, row), golden_scene(0, row), golden_scene(1, row)
    assert np.array_equal(one.scene.meshes[0].verts, again.scene.meshes[0].verts)
    assert not np.array_equal(one.scene.meshes[0].verts, other.scene.meshes[0].verts)
    assert one.settings.shader == "phong"


# Faults


@pytest.mark.parametrize(("group", "name", "right", "fault"), [
    ("operations", "fused_float", "{fma(a, b, c)}", "{a * b + c}"),
    ("operations", "count", "atomic_add(out + 3, x[item]);", "if (item) atomic_add(out + 3, x[item]);"),
    ("constructs", "divergent_loop", "k < a[i]", "k < a[i - get_local_id(0)]"),
    ("constructs", "denormals", "a[i] * 0.5f", "(fabs(a[i]) < 0x1p-126f ? 0.0f : a[i] * 0.5f)"),
    ("constructs", "comparisons", "!(x >= y)", "(x < y)"),
    ("constructs", "ids_in_2_dimensions", "(int)get_global_id(0)", "x"),
    ("structs", "View_float32", "} View;", "} __attribute__((aligned(64))) View;"),
])  # fmt: skip
def test_a_fault_in_a_kernel_is_found(opened, group, name, right, fault):
    """Sources are rewritten as if a compiler had made the fault; without it the test passes."""
    case = check_of(opened, group, name, "float32-library-1" if group == "operations" else "").case
    case = replace(case, program="")
    assert Bench(opened).wrong(case) is None
    with programs.rewriting(lambda source, options: source.replace(right, fault)):
        assert Bench(opened).wrong(case)


def test_faults_of_memory_and_frames_are_found(opened, monkeypatch):
    """A lost byte, a buffer that is too large, a run with other bits, a color with another last bit."""
    tests = {name: run for name, _, run in memory.TESTS}
    monkeypatch.setattr(memory, "edge_bytes", lambda device, size: (5, 0))
    assert "expected (5, 7)" in tests["largest_allocation"](Bench(opened))
    assert "the last byte" in tests["sizes_of_buffers"](Bench(opened))
    monkeypatch.setattr(memory, "edge_bytes", lambda device, size: (5, 7))
    assert "expected an error" in tests["beyond_the_limit"](Bench(opened))
    outputs = iter([*[np.zeros(4)] * 49, *[np.ones(4)] * 51])
    monkeypatch.setattr(Bench, "run", lambda *_: next(outputs))
    problem = check_of(opened, "repeatability", "builds").run(Bench(opened))
    assert problem == "run 50 of 100 gives other bits than the first"
    drawn, draw = check_of(opened, "scenes", "062-nolight", "nolight"), Bench.draw

    def other(self, scene, **options):
        frame = draw(self, scene, **options)
        frame.rgba.reshape(-1).view(np.uint32)[4] ^= 1
        return frame

    assert not drawn.run(Bench(opened))
    monkeypatch.setattr(Bench, "draw", other)
    assert drawn.run(Bench(opened)).startswith("other bits, within the bounds of the oracle")


@pytest.mark.parametrize(("name", "right", "fault"), [
    ("max_int", "{max(a, b)}", "{max(a, b + 1)}"),
    ("count", "atomic_add(out + 3, x[item]);", ""),
])  # fmt: skip
def test_a_script_shows_a_fault_where_it_is(opened, tmp_path, name, right, fault):
    """It has the rows of a work-group, fails with the fault in its kernel, and does not without; what has not run has a
    script too."""
    case = next(case for case in operations.cases(operations.Way(np.float32, True, 1)) if case.name == name)
    with programs.rewriting(lambda source, options: source.replace(right, fault)):
        wrong = Bench(opened).wrong(case)
    assert len(reproducer.cut(case).inputs[0]) == len(reproducer.cut(wrong).inputs[0]) == GROUP
    path = reproducer.write(wrong, opened, programs.compiler_options(opened), tmp_path, f"operations/{name}")
    text = path.read_text()
    assert path.name == f"operations_{name}.py"
    assert "clshade." not in text
    assert "#line" not in text
    assert opened.name in text
    for kernel, code in ((text, 0), (text.replace(right, fault), 1)):
        path.write_text(kernel)
        command = [sys.executable, path, *opened.index.split(":")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        assert (done.returncode, "as expected" in done.stdout) == (code, not code), done.stdout + done.stderr


def test_denormals_may_be_zeros():
    tiny = np.array([1e-40, -1e-40, 1.0, np.inf], np.float32)
    assert without_denormals(tiny).tolist() == [0.0, -0.0, 1.0, np.inf]
    assert np.signbit(without_denormals(tiny)[1])


def test_a_device_that_flushes_may_give_zeros_of_any_sign(opened, monkeypatch):
    """In place of denormals, in operands and results; no other device may, nor where there is none."""
    tiny = np.array([1e-40, -1e-40, 1.0, -2.0], np.float32)
    case = Case("same", "", "", (tiny,), lambda v: v)
    for found, right in (
        ([-0.0, 0.0, 1.0, -2.0], True),
        ([0.0, -0.0, 1.0, 0.0], False),
        ([1.0, 0.0, 1.0, -2.0], False),
    ):
        monkeypatch.setattr(Bench, "run", lambda *_, found=found: np.array(found, np.float32))
        for flushing in (True, False):
            monkeypatch.setattr(case_module, "flushes", lambda device, flushing=flushing: flushing)
            assert (Bench(opened).wrong(case) is None) == (right and flushing)


def test_what_is_wrong_is_told_by_the_first_wrong_row():
    case = Case("name", "", "", (np.array([1.0, 0.5], np.float32), np.array([[1, 2], [3, 4]], np.int32)), np.copy)
    wrong = Wrong(case, np.array([1, 9]), np.array([1, 4]), np.array([False, True]))
    assert str(wrong) == "1 of 2 rows; of 0x1.0000000000000p-1, (3, 4): expected 4, found 9"


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
    rewrite = "lambda source, options: os.write(1, b'{') and source.replace('k < a[i]', 'k < 3')"
    code = f"planted = programs.rewriting({rewrite}); planted.__enter__()"
    with_fault(monkeypatch, code)
    part = Part(task(opened, tmp_path))
    first, *others = part.run()
    assert (first.name, first.title) == ("divergent_loop", "a loop of another length in each work-item")
    assert "of 1024 rows" in first.problem
    assert [path.name for path in tmp_path.iterdir()] == [first.script] == ["constructs_divergent_loop.py"]
    assert not any(result.problem or result.script for result in others)
    assert part.device["lanes"] == opened.lanes


def test_after_three_crashes_a_part_is_given_up(opened, tmp_path, monkeypatch):
    """Each costs a test, which has a script; the next process leaves it out."""
    with_fault(monkeypatch, "programs.build_alone = lambda *_: os.abort()")
    *crashed, rest = Part(task(opened, tmp_path)).run()
    assert [result.problem for result in crashed] == ["ends the process: SIGABRT"] * 3
    assert len({result.name for result in crashed}) == 3
    assert all((tmp_path / result.script).is_file() for result in crashed)
    assert rest.skipped == "constructs is given up: its processes end early"


def test_a_launch_that_does_not_end_is_one_line(opened, tmp_path, monkeypatch):
    """Even if it holds the interpreter's lock; the other tests of structs are those of an earlier process."""
    with_fault(monkeypatch, "programs.build_alone = lambda *_: ctypes.PyDLL(None).sleep(60)")
    done = [check.name for check in groups.tests_of("structs", "", opened)][1:]
    (result,) = Part(task(opened, tmp_path, "structs", done=done, limit=10.0)).run()
    assert result.problem == "does not end within 10 s"


@pytest.mark.parametrize(("code", "problem"), [
    ("", "exit code 0"),
    ("1 / 0", "exit code 1: ZeroDivisionError: division by zero"),
    ("print(json.dumps({'begin': 'one', 'title': '', 'script': ''}))", "exit code 0"),
])  # fmt: skip
def test_a_process_that_ends_too_early_is_a_failure(opened, tmp_path, monkeypatch, code, problem):
    """Between two tests too, and whatever its exit code."""
    planned = "import json; print(json.dumps({'planned': ['one', 'two'], 'device': {}}), flush=True); "
    monkeypatch.setattr(Task, "command", lambda self: [sys.executable, "-c", planned + code])
    found = Part(task(opened, tmp_path)).run()
    assert found[0].problem == f"ends the process: {problem}"


# Groups and card


def test_every_group_has_tests(opened):
    for group in GROUPS:
        for part in parts_of(group, opened.has_fp64):
            tests = groups.tests_of(group, part, opened)
            assert tests
            assert len({test.name for test in tests}) == len(tests)


def test_the_card(opened):
    info = chosen_devices(opened.index)[1][0]
    passed = Result("constructs", "one", "what", seconds=1.0)
    judged = Judged(info, [passed, Result("scenes", "two", skipped="no float64")], {"lanes": 16})
    text = conform.card(judged).markdown()
    assert "- verdict: conforms\n" in text
    assert "- Skipped: no float64." in text
    assert "| constructs: what kernels are made of | 1 | 0 | 0 | 1 |" in text
    judged.results += [replace(passed, group="scenes", name=name, problem="a | b") for name in ("three", "four")]
    text = conform.card(judged, 1).markdown()
    assert "- scenes/three (what): a | b\n- 1 more failures\n- No operation and no construct" in text
    found = json.loads(conform.card(judged).json())
    assert found["verdict"] == "does not conform: scenes/three, scenes/four"
    assert [test["name"] for test in found["tests"]] == ["one", "two", "three", "four"]
    assert (found["device"]["index"], found["lanes"]) == (opened.index, 16)


def test_the_command(opened, capsys, tmp_path):
    code, out, _ = run(capsys, "conform", "--device", opened.index, "--only", "memory", "-o", tmp_path / "card")
    assert code == 0
    assert out.splitlines()[-1] == "conforms"
    assert {path.name for path in (tmp_path / "card").iterdir()} == {"conform.csv", "conform.json", "conform.md"}


def test_bad_input(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert_refused(run(capsys, "conform", "--only", "operation"), "--only", "did you mean 'operations'?")
    assert_refused(run(capsys, "conform", "--device", "none such"), "'none such'")


@pytest.mark.long
def test_the_device_conforms(device, tmp_path):
    assert conform.run(device.index, out=tmp_path)
