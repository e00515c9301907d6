"""`bench --processors`: the table of models, their environment, what counts as a fault, and the images of each model."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command_line import run
from processes import python

from clshade.errors import InputError
from clshade.measure.bench import processors
from clshade.measure.bench.processors import MODELS, Measured
from clshade.pipeline.opencl import pocl_target

VERSIONS = (
    "from clshade.pipeline.opencl import device; print(*(h.version for _, h in device.found_devices('')), sep='\\n')"
)

# Run at the start of a process: of the scenes only the hierarchy's kernels are built, and one more in the same program.
PLANTED = """
from clshade.pipeline import launches, programs
launches.scene_stages = lambda *_: None
flatten = programs.flatten
programs.flatten = lambda names: flatten(names) + '''
kernel void planted(global float16 *x) { int i = 1.5f; x[i] = _cl_fma(x[0], x[1], x[2]); }
'''
"""


@pytest.fixture(scope="module")
def packages() -> Path:
    """Return the folder of PyPI's packages."""
    try:
        return processors._packages()
    except InputError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def own(packages) -> dict[str, str]:
    """Draw the six images on this processor's own device."""
    return processors.own_images()


def flags_of(level: int) -> set[str]:
    return {word for number, words in pocl_target._LEVELS if number <= level for word in words.split()}


@pytest.mark.parametrize("model", MODELS)
def test_a_model_is_known_and_its_library_installed(model, packages):
    target, library, level, flags, about = MODELS[model]
    assert pocl_target.target_for(target, flags_of(level) | set(flags)) == target
    assert len(list(packages.glob(f"pocl_binary_distribution/.libs/share/pocl/kernel-*-{library}.bc"))) == 1
    assert about.endswith(".")


@pytest.mark.parametrize(
    ("flags", "runs"),
    [
        (flags_of(1), 0),
        (flags_of(2), 1),
        (flags_of(2) | {"avx", "f16c"}, 2),
        (flags_of(3), 7),
        (flags_of(3) | {"gfni", "avx_vnni"}, 8),
        (flags_of(4), 8),
        (flags_of(4) | {*processors._ICELAKE}, 9),
        (flags_of(4) | {*processors._ICELAKE, "avx_vnni", "avx512_bf16"}, 11),
    ],
)
def test_what_a_processor_can_run(monkeypatch, flags, runs):
    monkeypatch.setattr(pocl_target, "processor_flags", lambda: flags)
    assert sum(map(processors.can_run, MODELS)) == runs


def test_pocl_compiles_for_the_model(packages, tmp_path):
    done = python(VERSIONS, "", **processors.environment_of("zen1", tmp_path))
    (version,) = done.stdout.split("\n")[:-1]  # of no other PoCL
    assert version.endswith("-znver1"), done.stderr


def test_planted_faults_are_found_without_running_kernels(packages, tmp_path, monkeypatch):
    monkeypatch.setattr(processors, "can_run", lambda model: False)
    processors.environment_of("zen1", tmp_path)
    (tmp_path / "packages" / "sitecustomize.py").write_text(PLANTED)
    found = processors.draw_scenes("zen1", tmp_path, {})
    assert (found.failed, found.ran, found.target, found.passed) == ("", False, "znver1", False)
    assert found.calls == ("_cl_fma",)
    assert any("implicit conversion from 'float'" in line for line in found.warnings), found.warnings


@pytest.mark.parametrize("fault", [{"wrong": ("pbr",)}, {"warnings": ("w",)}, {"calls": ("_cl_fma",)}, {"failed": "x"}])
def test_a_fault_of_one_model_fails_the_run(fault, packages, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(processors, "own_images", dict)
    good = {"ran": True, "target": "t", "frames": {"quads": (1.5, None)}}
    for bad, code in (({}, 0), (fault, 1)):
        each = {"zen1": good, "zen3": {**good, **bad}}
        monkeypatch.setattr(processors, "measure", lambda model, *_, each=each: Measured(model, **each[model]))
        prefix = str(tmp_path / "p")
        assert run(capsys, "bench", "--processors", "zen1,zen3", "-o", prefix)[0] == code
        models = json.loads(Path(f"{prefix}.json").read_text())["models"]
        assert [model["model"] for model in models] == ["zen1", "zen3"]
        assert Path(f"{prefix}.csv").read_text().count("\n") == 3


def test_what_is_refused(packages, capsys, monkeypatch):
    assert "did you mean 'zen4'" in run(capsys, "bench", "--processors", "zen")[2][0]
    assert "either --views or --processors" in run(capsys, "bench", "--processors", "zen1", "--views", "2")[2][0]
    assert "--device" in run(capsys, "bench", "--processors", "--device", "pocl")[2][0]
    monkeypatch.setattr(processors.platform, "machine", lambda: "aarch64")
    code, out, err = run(capsys, "bench", "--processors")
    assert (code, out, len(err)) == (2, "", 1)
    assert "Linux on x86-64" in err[0]


@pytest.mark.long
@pytest.mark.parametrize("model", MODELS)
def test_kernels_for_a_model_draw_the_same_bits_without_calls(model, own, tmp_path):
    found = processors.draw_scenes(model, tmp_path, own)
    assert found.passed, "\n".join(found.faults())
    assert found.target == MODELS[model].target
    assert found.lanes in (4, 8, 16)
    software = {"fma"} if MODELS[model].level == 2 else set()  # of float64, without the instruction
    assert set(found.of_c) <= software | {"memcpy", "memset"}
