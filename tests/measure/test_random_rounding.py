"""Random rounding: the rewriting of OpenCL C, and the spread of scenes beside their bounds."""

from __future__ import annotations

import io
import json
import re

import numpy as np
import pytest
from command_line import assert_refused, needs_device, run

import clshade
from clshade.errors import ClshadeError, DeviceError, InputError
from clshade.images import exr
from clshade.measure.check import oracle_bounds
from clshade.measure.check.check import compare
from clshade.measure.rounding import exempt, rewrite, spread
from clshade.measure.stability import rounding_cases, scene_figure, scene_study, scene_tables
from clshade.pipeline import kernel_files

needs_packages = pytest.mark.skipif(
    any(rewrite.find_spec(name) is None for name in rewrite.PACKAGES), reason="needs libclang and pcpp"
)
KERNELS = kernel_files.kernel_folder()


# The rewriting


def rewritten(text: str, *options: str) -> str:
    """Return rewritten OpenCL C in one line."""
    return " ".join(rewrite.rewritten(rewrite.preprocessed(text, options))[0].split())


@needs_packages
@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("a = a * b + c;", "a = random_sum(rounding_run, 1u, random_product(rounding_run, 2u, a, b), c);"),
        ("a = a - (b / c);", "a = random_difference(rounding_run, 1u, a, (random_quotient(rounding_run, 2u, b, c)));"),
        ("a += b;", "a = random_sum(rounding_run, 1u, a, b);"),
        ("p[i + 1] *= b;", "p[i + 1] = random_product(rounding_run, 1u, p[i + 1], b);"),
        ("a = fma(a, b, -fma(b, b, c));", "a = random_fma(rounding_run, 1u, a, b, -random_fma(rounding_run, 2u, b, b, c));"),
        ("a = sqrt(b + c);", "a = random_root(rounding_run, 1u, random_sum(rounding_run, 2u, b, c));"),
        ("a = i > 2 ? a + b : c;", "a = i > 2 ? random_sum(rounding_run, 1u, a, b) : c;"),
        ("a = (float)(i) + (float)3;", "a = random_sum(rounding_run, 1u, random_real(rounding_run, 2u, (i)), (float)3);"),
        ("v *= a; a *= i;", "v = random_product(rounding_run, 1u, v, a); a = random_product(rounding_run, 2u, a, i);"),
        ("v = v * a;", "v = random_product(rounding_run, 1u, v, a);"),
        ("a = half_of(a + b);", "a = half_of(rounding_run, random_sum(rounding_run, 1u, a, b));"),
        ("a = THREE(b);", "a = random_sum(rounding_run, 1u, random_sum(rounding_run, 2u, b, b), b);"),
    ],
)  # fmt: skip
def test_operations_become_calls(given, expected):
    text = f"""#define THREE(x) x + x + x
float half_of(float x) {{ return x; }}
void f(float a, float b, float c, float4 v, int i, float *p) {{ {given} }}"""
    assert rewritten(text).endswith(f"{{ {expected} }}")


@needs_packages
@pytest.mark.parametrize(
    "given",
    [
        "i = i * 3 + (i >> 1) / 2;",
        "p = p + i; p += 2; i -= 1;",
        "a = p[i * 2 + 1];",
        "a = -b; a = a < b ? fmax(a, b) : floor(c);",
        "a = 1.0f / 3.0f;",
        "d = d * 2.0 + sqrt(d);",
        "long l = (long)i * i; d = (double)l;",
    ],
)
def test_other_text_is_left_alone(given):
    text = f"void f(float a, float b, float c, int i, float *p, double d) {{ {given} }}"
    assert rewritten(text) == text.replace("f(float", "f(const uint rounding_run, float", 1)


@needs_packages
def test_functions_hand_on_the_run():
    text = "float none() { return 1.0f; }\nkernel void k(global float *out) { out[0] = none(); }"
    expected = (
        "float none(const uint rounding_run) { return 1.0f; } "
        "kernel void k(global float *out) { const uint rounding_run = RUN_OF_ITEM; out[0] = none(rounding_run); }"
    )
    assert rewritten(text) == expected


@needs_packages
def test_options_choose_the_text():
    text = "#if TWICE\nfloat f(float x) { return x + x; }\n#else\nfloat f(float x) { return x; }\n#endif"
    assert "random_sum" in rewritten(text, "-DTWICE=1", "-cl-std=CL1.2")
    assert "random_sum" not in rewritten(text, "-DTWICE=0")


@needs_packages
def test_exempt_functions_and_files_are_left_alone():
    name = next(iter(exempt.FUNCTIONS))
    assert "random" not in rewritten(f"float {name}(float x) {{ return x + x; }}")
    text = 'float f(float x) { return x + x; }\n#line 1 "other.clh"\nfloat g(float x) { return x * x; }'
    found = rewritten(f'#line 1 "{next(iter(exempt.FILES))}"\n{text}')
    assert "random_sum" not in found
    assert "random_product" in found


@needs_packages
@pytest.mark.parametrize("text", ["void f() { float a = b; }", "#error out of order"])
def test_text_that_is_no_opencl_is_refused(text):
    with pytest.raises(InputError, match="expected OpenCL C, found"):
        rewritten(text)


@needs_packages
def test_a_target_that_cannot_be_named_twice_is_refused():
    with pytest.raises(InputError, match="named twice"):
        rewritten("void f(float *p, int i) { p[i++] += 1.0f; }")


@needs_packages
@pytest.mark.parametrize(
    ("given", "match"),
    [
        ("a = mad(a, b, c);", "expected fma or sqrt, found mad"),
        ("a = exp2(b);", "expected fma or sqrt, found exp2"),
        ("a *= d;", "expected an operand of float32, found double"),
    ],
)
def test_what_would_round_to_nearest_unseen_is_refused(given, match):
    with pytest.raises(InputError, match=match):
        rewritten(f"void f(float a, float b, float c, double d) {{ {given} }}")


def test_exempt_names_exist():
    assert all((KERNELS / name).is_file() for name in exempt.FILES)
    text = "\n".join(path.read_text() for path in KERNELS.glob("*.cl*"))
    assert all(re.search(rf"\b{name}\(", text) for name in exempt.FUNCTIONS)


# The spread of a scene


@pytest.fixture(scope="module")
def found(device):
    """Return the comparison of a small image with the oracle."""
    if not device.has_fp64:
        pytest.skip("needs float64")
    scene = clshade.builtin("quads")
    frame = clshade.render(scene, device=device, resolution=(32, 24), layers=("Z", "id"))
    return compare(frame, np.arange(frame.alpha.size))


@needs_packages
def test_scenes_spread_within_their_bounds(found, device):
    result = spread.measure(found, device, 4)
    assert result.same  # nothing moves in a run to nearest
    assert result.passed
    counted = result.counted
    assert counted.sum() > 300
    assert (result.spread[counted] > 0.0).mean() > 0.9
    assert 0.0 < result.worst < 1.0
    assert result.worst > (found.found / found.expected)[counted].max()  # of the image itself
    quantiles = result.quantiles()
    assert quantiles["found"]["median"] > quantiles["promised"]["median"]
    again = spread.measure(found, device, 4)
    np.testing.assert_array_equal(again.spread, result.spread)
    assert json.loads(json.dumps(result.stats()))["too_small"] == 0


@needs_packages
def test_bounds_that_are_too_small_are_found(found, device, monkeypatch):
    monkeypatch.setitem(oracle_bounds.ALLOWED, "float32", 0.05)
    result = spread.measure(compare(found.frame, np.arange(found.frame.alpha.size)), device, 2)
    assert result.same
    assert result.too_small.any()
    assert not result.passed
    monkeypatch.setitem(oracle_bounds.ALLOWED, "float32", 1e6)
    large = spread.measure(compare(found.frame, np.arange(found.frame.alpha.size)), device, 2)
    assert large.passed
    assert (large.too_large | large.exact)[large.counted].all()


@needs_packages
def test_a_study_names_pixels_and_draws_the_digits(found, device, monkeypatch, tmp_path):
    frame = found.frame
    studied = scene_study.study(frame.scene, frame.settings, device, 2)
    assert studied.rounding is not None
    assert studied.passed
    text = "\n".join(scene_tables.lines(studied))
    assert "random rounding, 2 runs" in text
    assert "bounds too small: 0" in text
    assert "## Random rounding" in scene_tables.markdown(studied)
    channels = studied.channels()
    assert channels["digits"].shape == channels["promised"].shape == (24, 32)
    assert np.nanmax(channels["digits"]) > np.nanmax(channels["promised"]) > 4.0
    assert json.loads(json.dumps(studied.stats()))["rounding"]["runs"] == 2
    scene_figure.plot_digits(studied, tmp_path / "digits.png", rounding=studied.rounding)
    assert (tmp_path / "digits.png").stat().st_size > 10_000
    monkeypatch.setitem(oracle_bounds.ALLOWED, "float32", 0.05)
    studied = scene_study.study(frame.scene, frame.settings, device, 2)
    assert not studied.passed
    text = " ".join(" ".join(scene_tables.lines(studied)).split())
    assert re.search(r"FAILED: .*random rounding: \d+ pixels above their bounds", text)
    assert "bounds too small, the worst:" in text


@needs_packages
@pytest.mark.long
def test_each_built_in_scene_is_within_its_bounds(device):
    if not device.has_fp64:
        pytest.skip("needs float64")
    for name in ("teapot", "torus_knot", "icosphere", "quads", "box_room", "course"):
        frame = clshade.render(clshade.builtin(name), device=device, resolution=(96, 72), layers=("Z", "id"))
        result = spread.measure(compare(frame, np.arange(frame.alpha.size)), device, 8)
        assert result.passed, name


@needs_packages
@pytest.mark.long
def test_what_rounds_to_nearest_by_design_adds_errors_if_moved(device, monkeypatch):
    """Pairs of floats lose their second half, and powers their polynomial's range: the bounds hold them nevertheless."""
    if not device.has_fp64:
        pytest.skip("needs float64")
    frame = clshade.render(clshade.builtin("teapot"), device=device, resolution=(96, 72), layers=("Z", "id"))
    found = compare(frame, np.arange(frame.alpha.size))
    kept = spread.measure(found, device, 4)
    monkeypatch.setattr(exempt, "FUNCTIONS", {})
    rewrite.random_rounding.cache_clear()
    try:
        moved = spread.measure(found, device, 4)
    finally:
        rewrite.random_rounding.cache_clear()
    assert moved.same
    assert moved.worst > 1.5 * kept.worst


@needs_packages
@pytest.mark.long
def test_cases_are_drawn_under_random_rounding(device, tmp_path):
    out = io.StringIO()
    options = {"out": tmp_path, "names": ["exponents"], "stream": out}
    assert rounding_cases.run(device.index, 2, **options)
    assert "exponents" in out.getvalue()
    assert json.loads((tmp_path / "rounding.json").read_text())["exponents"][0]["too_small"] == 0


@needs_packages
@pytest.mark.long
def test_the_command_writes_all_files(capsys, tmp_path):
    code, out, _ = run(capsys, "stability", "quads", "--resolution", "32,24", "--random-rounding", 2, "-o", tmp_path)
    assert code == 0
    assert "random rounding, 2 runs" in out
    assert {"digits", "promised"} <= set(exr.read(tmp_path / "stability.exr")[0])
    assert (tmp_path / "digits.png").is_file()


# What is refused


@pytest.mark.parametrize("scene", [(), ("quads",)])
def test_fewer_than_two_runs_are_refused(capsys, tmp_path, scene):
    found = run(capsys, "stability", *scene, "--random-rounding", 1, "-o", tmp_path)
    assert_refused(found, "--random-rounding", "from 2 on", "1")


def test_a_missing_package_is_named(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(rewrite, "find_spec", lambda name: None if name == "pcpp" else name)
    with pytest.raises(ClshadeError, match="needs pcpp"):
        rewrite.check_packages()
    code, _, lines = run(capsys, "stability", "quads", "--random-rounding", 2, "-o", tmp_path)
    assert code == 2
    assert len(lines) == 1
    assert re.search(r"needs pcpp: `pip install .*\[rounding\]", lines[0])


@pytest.mark.parametrize("option", [("--axes",), ("--list",), ("--functions",), ("--device", "all")])
def test_options_that_do_not_go_together_are_refused(capsys, tmp_path, option):
    found = run(capsys, "stability", *option, "--random-rounding", 2, "-o", tmp_path)
    assert_refused(found, "--random-rounding", option[-1])


@needs_packages
def test_float64_and_devices_without_it_are_refused(found, device):
    frame = found.frame
    double = compare(clshade.render(frame.scene, device=device, precision="float64", layers=("Z", "id")), np.arange(4))
    with pytest.raises(InputError, match="expected precision float32 or fast, found float64"):
        spread.measure(double, device, 2)

    class Single:
        has_fp64, name = False, "a device"

    with pytest.raises(DeviceError, match="expected a device with float64"):
        spread.measure(found, Single(), 2)


@needs_device
def test_a_missing_scene_is_named(capsys, tmp_path):
    found = run(capsys, "stability", tmp_path / "none.obj", "--random-rounding", 2, "-o", tmp_path)
    assert_refused(found, "none.obj")
