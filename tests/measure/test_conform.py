"""`conform`: planted faults are found, made small and written as scripts; a device that crashes or hangs costs a line."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from command_line import assert_refused, run

from clshade.measure.conform import (
    card,
    child,
    conform,
    constructs,
    faults,
    operations,
    planted,
    reproducer,
    scenes,
    shrink,
    tests_of_device,
)
from clshade.measure.conform import case as case_module
from clshade.measure.conform.case import GROUP, Bench, Case, without_denormals
from clshade.measure.conform.child import Task
from clshade.measure.conform.content import FACTORS, golden_scene
from clshade.measure.conform.pairs import Draws, covering
from clshade.measure.conform.part import Part
from clshade.measure.conform.results import Judged, Result
from clshade.measure.conform.tests_of_device import GROUPS, Check, described, parts_of
from clshade.pipeline import programs
from clshade.pipeline.opencl.device import chosen_devices

pytestmark = pytest.mark.optimized


def case_of(name: str) -> Case:
    return next(case for case in constructs.all_cases() if case.name == name)


def with_fault(device, name: str):
    """Return the wrong case that a planted fault gives, and the smallest that was found from it."""
    with faults.planted(name, device) as bench:
        wrong = bench.wrong(case_of(faults.FAULTS[name].test))
        assert wrong is not None
        return wrong, shrink.smallest(bench, wrong)


def exit_code(script, device) -> int:
    """Run a script on the device; return its exit code, which fits to what it prints."""
    command = [sys.executable, script, *device.index.split(":")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert ("as expected" in done.stdout) == (done.returncode == 0), done.stdout + done.stderr
    return done.returncode


def task(device, folder, **fields) -> Task:
    return Task(device.index, device.name, "constructs", "", str(folder), only="divergent_loop", **fields)


# Choices


def uncovered(factors: dict, rows: list[dict]) -> set:
    """Return the pairs of levels of different factors that no row has."""
    every = {
        ((one, a), (other, b)) for one, other in combinations(factors, 2) for a in factors[one] for b in factors[other]
    }
    return every - {pair for row in rows for pair in combinations(row.items(), 2)}


def test_golden_scenes_cover_all_pairs():
    rows = [row["choice"] for row in json.loads(scenes.GOLDEN.read_text())]
    assert uncovered(FACTORS, rows) == {(("texture_at", "vertex"), ("texture_filter", "trilinear"))}
    assert len(rows) >= 100
    assert len({row["digest"] for row in json.loads(scenes.GOLDEN.read_text())}) == len(rows)


@pytest.mark.long
@pytest.mark.parametrize("program", ["nolight", "float64"])
def test_a_device_without_float64_draws_every_scene(opened, program):
    """A few scenes of a program: those that need float64 are drawn in float32, without edges, and have digests too."""
    without = replace(opened, has_fp64=False)
    given = [each for each, _ in scenes.golden(True) if each.choice["program"] == program]
    tests = scenes.tests(program, has_fp64=False)
    assert [name for name, *_ in tests] == [each.name for each in given]
    needing = [run for (_, _, run), each in zip(tests, given, strict=True) if each.needs_float64]
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


# Small cases


def test_a_fault_is_made_small_and_written_as_a_script(opened, tmp_path):
    """The script fails with the fault in its kernel, and does not without it."""
    wrong, small = with_fault(opened, "divergent-loop")
    assert wrong.rows.sum() > 500
    assert len(small.case.inputs[0]) == 64
    options = programs.compiler_options(opened)
    path = reproducer.write(small, opened, options, tmp_path, "constructs/divergent loop")
    assert path.name == "constructs_divergent_loop.py"
    text = path.read_text()
    assert len(text.splitlines()) < 100
    assert "clshade." not in text
    assert opened.name in text
    for kernel, code in ((text, 0), (text.replace("k < a[i]", "k < a[i - get_local_id(0)]"), 1)):
        path.write_text(kernel)
        assert exit_code(path, opened) == code


@pytest.mark.parametrize(("name", "right", "fault"), [
    ("count", "atomic_add(out + 3, x[item]);", ""),
    ("of_int", "clamp(a, b, c)", "min(max(a, b), c - 1)"),
])  # fmt: skip
def test_a_script_of_a_fault_asks_for_nothing_undefined(opened, tmp_path, name, right, fault):
    """Made small, it is still as a right device has it: scratch memory is 0, and limits are ordered."""
    way = operations.Way(np.float32, True, 1)
    case = next(case for case in operations.cases(way) if case.name == name)
    case = (case.alone(case.columns.index(right)) if case.alone else case).with_inputs([v[:1024] for v in case.inputs])
    with programs.rewriting(lambda source, options: source.replace(right, fault)):
        wrong = Bench(opened).wrong(case)
        small = shrink.smallest(Bench(opened), wrong, 2.0)
    assert len(small.case.inputs[0]) < 128
    assert small.case.allowed(*small.case.inputs).all()
    path = reproducer.write(small, opened, programs.compiler_options(opened), tmp_path, name)
    assert exit_code(path, opened) == 0


def test_values_of_a_failure_become_simple(opened):
    """Of 1024 rows one is left, with the simplest numbers that fail."""
    _, small = with_fault(opened, "long-shift")
    assert len(small.case.inputs[0]) == 1
    assert small.case.inputs[0].tolist() == [1]
    assert described(small).startswith("1 of 1 rows; of 1, ")


TEXT = """
// a comment
#line 3 "x"
#define TWICE(v) ((v) * 2) \\
    + 0
#if LANES == 1
typedef int lanes;
#else
typedef int4 lanes;
#endif
int unused(int v)
{
    return v;
}
lanes moved(lanes v)
{
    return TWICE(v);
}
"""


def test_a_text_is_cut_into_units():
    units = shrink.units(TEXT)
    assert units[0] == "#define TWICE(v) ((v) * 2) + 0"
    assert units[1:6] == ["#if LANES == 1", "typedef int lanes;", "#else", "typedef int4 lanes;", "#endif"]
    assert [unit.split("\n")[0] for unit in units[6:]] == ["int unused(int v)", "lanes moved(lanes v)"]
    used = shrink.reachable(units, "out[i] = moved(a[i]);")
    assert used == units[:6] + units[7:]


def test_the_fewest_units():
    """The first branch and the function are needed, and nothing else."""
    needed = {"typedef int lanes;", shrink.units(TEXT)[-1]}
    found = shrink.fewer(shrink.units(TEXT), lambda units: needed <= set(units))
    assert set(found) == needed


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


# Processes


def planning(*names: str) -> str:
    return f"import json; print(json.dumps({{'planned': {list(names)}}}), flush=True); "


@pytest.mark.parametrize("code", ["", "1 / 0", "print(json.dumps({'begin': 'one', 'title': ''}))"])
def test_a_process_that_ends_too_early_is_a_failure(opened, tmp_path, monkeypatch, code):
    """Between two tests too, and whatever its exit code."""
    monkeypatch.setattr(Task, "command", lambda self: [sys.executable, "-c", planning("one", "two") + code])
    found = Part(task(opened, tmp_path), Judged(None), 30.0).run()
    assert any(result.problem.startswith("ends the process: exit code") for result in found)


def test_a_compiler_that_aborts_is_one_line(opened, tmp_path):
    (found,) = Part(task(opened, tmp_path, fault="abort"), Judged(None), 60.0).run()
    assert found.problem.startswith("ends the process: SIGABRT")
    assert (tmp_path / found.script).is_file()
    assert found.title == "a loop of another length in each work-item"


def test_a_launch_that_does_not_end_is_one_line(opened, tmp_path, monkeypatch):
    code = 'import time; print(\'{"begin": "one", "title": ""}\', flush=True); time.sleep(60)'
    monkeypatch.setattr(
        Task, "command", lambda self: [sys.executable, "-c", planning() if self.done else planning("one") + code]
    )
    (found,) = Part(task(opened, tmp_path), Judged(None), 3.0).run()
    assert found.problem == "does not end within 3 s"


def test_after_a_crash_the_other_tests_go_on(opened, tmp_path, monkeypatch):
    """The first process ends in its first test; the next one leaves that out."""
    commands = []
    code = "import json; print(json.dumps({'begin': NAME, 'title': ''}), flush=True); END"
    first, second = (
        code.replace("NAME", repr(name)).replace("END", end)
        for name, end in (("one", "import os; os.abort()"), ("two", 'print(\'{"end": "two", "seconds": 1}\')'))
    )

    def command(self) -> list[str]:
        commands.append(self.done)
        return [sys.executable, "-c", planning("one", "two") + (second if self.done else first)]

    monkeypatch.setattr(Task, "command", command)
    found = Part(task(opened, tmp_path), Judged(None), 30.0).run()
    assert commands == [(), ("one",)]
    assert [(result.name, result.problem) for result in found] == [("one", "ends the process: SIGABRT"), ("two", "")]


def test_a_failure_is_told_with_its_script(opened, tmp_path, capsys):
    """A process with a fault: its events, and the script that it writes."""
    with faults.planted("divergent-loop", opened) as bench:
        child.run(task(opened, tmp_path, shrinks=False), opened, bench)
    _, begin, script, end = map(json.loads, capsys.readouterr().out.splitlines())
    assert begin["begin"] == end["end"] == "divergent_loop"
    assert "of 1024 rows" in end["problem"]
    assert (tmp_path / script["script"]).is_file()


def test_a_failure_that_is_not_made_small_has_few_rows(opened, tmp_path):
    """Of one column, and the script fails as the whole case does; a case that has not run has its first rows."""
    way = operations.Way(np.float32, True, 1)
    case = next(case for case in operations.cases(way) if case.name == "of_int")
    with programs.rewriting(lambda source, options: source.replace("{max(a, b)}", "{max(a, b + 1)}")):
        wrong = Bench(opened).wrong(case)
    assert wrong.case.columns[wrong.column] == "max(a, b)"
    small = reproducer.cut(wrong)
    assert len(small.inputs[0]) == len(reproducer.cut(case).inputs[0]) == GROUP
    assert small.columns == ("max(a, b)",)
    text = reproducer.write(wrong, opened, [], tmp_path, "of_int").read_text()
    assert "#line" not in text
    assert "clamp(a, b, c)" not in text.split("kernel void")[-1]


# Groups and card


def test_every_group_has_tests(opened):
    for group in GROUPS:
        for part in parts_of(group, opened.has_fp64):
            tests = tests_of_device.tests_of(group, part, opened)
            assert tests
            assert len({test.name for test in tests}) == len(tests)
            assert all((test.run is None) == (test.case is not None) for test in tests)


@pytest.mark.parametrize("name", faults.FAULTS)
def test_every_fault_names_a_test(opened, name):
    fault = faults.FAULTS[name]
    assert fault.test in {test.name for test in tests_of_device.tests_of(fault.group, fault.part, opened)}


def test_faults_are_of_many_kinds():
    assert len({fault.what for fault in faults.FAULTS.values()}) == len(faults.FAULTS) >= 20


def test_the_card(opened, tmp_path):
    info = chosen_devices(opened.index)[1][0]
    passed = Result("constructs", "one", "what", seconds=1.0)
    judged = Judged(info, [passed, Result("scenes", "two", skipped="no float64")], {"lanes": 16})
    text = card.markdown(judged)
    assert text.endswith("The device conforms.\n")
    assert "- Skipped: no float64." in text
    judged.results.append(replace(passed, group="scenes", name="three", problem="a | b"))
    text = card.markdown(judged)
    assert "No operation and no construct that was tested explains it." in text
    assert r"| scenes/three | what | a \| b | - |" in text
    assert text.endswith("does not conform: scenes/three.\n")
    card.write(judged, tmp_path)
    found = json.loads((tmp_path / "conform.json").read_text())
    assert found["verdict"] == "does not conform: scenes/three"
    assert [test["name"] for test in found["tests"]] == ["one", "two", "three"]


def test_the_command(opened, capsys, tmp_path):
    code, out, _ = run(capsys, "conform", "--device", opened.index, "--only", "memory", "-o", tmp_path / "card")
    assert code == 0
    assert out.splitlines()[-1] == "conforms"
    assert {path.name for path in (tmp_path / "card").iterdir()} == {"conform.json", "conform.md"}


def test_bad_input(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert_refused(run(capsys, "conform", "--only", "operation"), "--only", "did you mean 'operations'?")
    assert_refused(run(capsys, "conform", "--device", "none such"), "'none such'")


# All of it


@pytest.mark.long
def test_the_device_conforms(device, tmp_path):
    assert conform.run(device.index, out=tmp_path)


@pytest.mark.long
def test_all_faults_are_found(opened, tmp_path):
    assert planted.run(opened.index, out=tmp_path)


def test_a_test_without_a_kernel_has_no_wrong_case(opened):
    assert Check("name", "title", lambda bench: "").wrong(Bench(opened)) is None
