"""`compare`: metrics of planted differences, layer by layer, as an image regression test."""

import importlib.util
import json
import math
import os
from copy import deepcopy

import command_line
import numpy as np
import pytest
from command_line import assert_refused
from PIL import Image

from clshade.images import compare, compare_figure, exr, metrics, png
from clshade.images.image_file import Picture
from clshade.images.metrics import image_error, relmse, rmse
from clshade.images.tonemap import OPERATORS, radiance, tonemap

RNG = np.random.default_rng(11)
SHAPE = (24, 32)


def layers():
    """Return an image with color, coverage, depth with an infinite background, directions and owners."""
    ids = RNG.integers(0, 9, SHAPE).astype(np.uint32)
    return {
        **exr.flatten(RNG.uniform(0.1, 0.9, (*SHAPE, 4)).astype(np.float32)),
        "Z": np.where(ids == 0, np.inf, RNG.uniform(1, 9, SHAPE)).astype(np.float32),
        **exr.flatten({"N": RNG.normal(size=(*SHAPE, 3)).astype(np.float32)}),
        "id": ids,
    }


def compared(changed, reference, **options):
    return compare.compare_layers(Picture(changed), Picture(reference), **options).layers


def test_what_is_equal_is_equal():
    reference = layers()
    reference["R"][0, 0] = reference["Z"][0, 0] = np.nan
    reference["Z"][0, 1] = -np.inf
    for name, layer in compared(reference, deepcopy(reference), threshold=0.0).items():
        assert (layer.different, layer.over, layer.nonfinite, layer.worst) == (0, 0, 0, None), name
        if not layer.exact:
            assert (layer.maximum, layer.mean, layer.rmse, layer.relmse) == (0, 0, 0, 0), name
        assert layer.psnr == (math.inf if name == "RGB" else None)


def test_one_channel_of_one_pixel():
    reference = layers()
    changed = deepcopy(reference)
    changed["G"][3, 4] += 0.25
    layer = compared(changed, reference)["RGB"]
    green, count = float(reference["G"][3, 4]), 24 * 32 * 3
    error = float(changed["G"][3, 4]) - green
    assert (layer.different, layer.nonfinite, layer.pixels, layer.maximum) == (1, 0, 24 * 32, error)
    relmse = error**2 / (green**2 + metrics.RELATIVE_FLOOR**2) / count
    expected = pytest.approx((error / count, error / math.sqrt(count), relmse), rel=1e-12)
    assert (layer.mean, layer.rmse, layer.relmse) == expected
    assert (layer.worst[:2], layer.worst.values["G"]) == ((4, 3), changed["G"][3, 4])
    assert layer.worst.reference == {name: reference[name][3, 4] for name in "RGB"}
    images = [np.stack([channels[name] for name in "RGB"], axis=-1) for channels in (changed, reference)]
    assert layer.psnr == pytest.approx(metrics.image_error(*images).psnr)


DEPTHS, BLACK, HALF = np.float32([0.0, 0.5, 0.75, -2.0]), np.zeros(4, np.float32), np.float16([0.1, 0.5])
ONE, UNKNOWN, FAR = np.float32([1.0, 2.0]), np.float32([np.nan, 2.0]), np.float32([np.inf, 2.0])
IDS = np.uint32([2**32 - 1, 7, 0])


@pytest.mark.parametrize(
    ("values", "expected", "threshold", "different", "over", "nonfinite", "maximum"),
    [
        # Over is what is strictly above the limit.
        *((DEPTHS, BLACK, limit, 3, over, 0, 2.0) for limit, over in ((None, 3), (0.0, 3), (0.5, 2), (2.0, 0))),
        (HALF, np.float32([0.1, 0.5]), None, 1, 1, 0, abs(float(np.float16(0.1)) - float(np.float32(0.1)))),
        # NaN and infinity exceed any threshold; the metrics cover the pixels that are finite in both images.
        (ONE, UNKNOWN, 1e30, 1, 1, 1, 0.0),
        *((UNKNOWN, other, 1e30, 1, 1, 1, 0.0) for other in (ONE, FAR)),
        *((FAR, other, 1e30, 1, 1, 1, 0.0) for other in (ONE, np.float32([-np.inf, 2.0]))),
        *((same, same, 1e30, 0, 0, 0, 0.0) for same in (UNKNOWN, FAR)),
        (np.float32([-0.0]), np.float32([0.0]), 0.0, 0, 0, 0, 0.0),
        # Whole numbers are compared exactly, also where float32 cannot distinguish them, and against floats.
        (np.uint32([2**32 - 2, 7, 0]), IDS, 1e9, 1, 1, 0, None),
        (np.float32([0, 7, np.nan]), IDS, None, 2, 2, 0, None),
    ],
)
def test_what_counts_as_different(values, expected, threshold, different, over, nonfinite, maximum):
    layer = compared({"Z": values[None]}, {"Z": expected[None]}, threshold=threshold)["Z"]
    assert (layer.different, layer.over, layer.nonfinite, layer.maximum) == (different, over, nonfinite, maximum)
    assert layer.exact == (maximum is None)
    assert (layer.worst is not None) == (different > 0)
    if layer.exact:
        assert layer.worst[:2] == (0, 0)  # all are equally bad


def test_large_images_are_compared_in_strips(monkeypatch):
    reference = layers()
    changed = deepcopy(reference)
    changed["G"] += np.float32(0.01)
    changed["R"][23, 31] = np.nan
    changed["id"][22, 3] += 1
    baseline = compared(changed, reference, threshold=0.005)
    assert baseline["RGB"].over == 24 * 32
    for rows in (1, 2, 3):
        monkeypatch.setattr(compare, "_STRIP", rows * 32)
        for name, layer in compared(changed, reference, threshold=0.005).items():
            expected = vars(baseline[name])
            for field, value in vars(layer).items():
                if isinstance(value, float):  # a sum in another order
                    assert value == pytest.approx(expected[field], rel=1e-12), field
                else:
                    assert str(value) == str(expected[field]), field  # the worst pixel's NaN equals no NaN
    assert (baseline["RGB"].worst[:2], baseline["id"].worst[:2]) == ((31, 23), (3, 22))


@pytest.mark.skipif(not metrics.has_ssim(), reason="scikit-image is not installed")
def test_structural_similarity():
    """Where images differ by a constant, only the term of the means remains: (2ab + C1)/(a^2 + b^2 + C1), C1 = 0.01^2."""
    a, b = np.full((20, 20, 3), 0.4), np.full((20, 20, 3), 0.5)
    assert metrics.ssim_of_seen(a, b) == pytest.approx((0.4 + 1e-4) / (0.16 + 0.25 + 1e-4), rel=1e-9)
    assert (metrics.ssim_of_seen(a, a), metrics.ssim_of_seen(a[:10], b[:10])) == (1.0, None)


def test_without_the_packages(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    layer = compared(layers(), layers())["RGB"]
    assert (layer.ssim, layer.flip, image_error(flat(0.2), flat(0.4)).flip) == (None, None, None)


def flat(value: float) -> np.ndarray:
    return np.full((12, 16, 3), value)


def psnr(image, reference) -> float:
    return image_error(image, reference).psnr


ONE_OFF = flat(1.0)
ONE_OFF[3, 4, 1] += 2.0


@pytest.mark.parametrize(
    ("metric", "image", "reference", "error", "tolerance"),
    [
        (rmse, flat(0.6), flat(0.35), 0.25, 1e-12),
        (rmse, np.float32(flat(0.3)), flat(0.3), abs(float(np.float32(0.3)) - 0.3), 1e-12),  # in float64
        (rmse, ONE_OFF, flat(1.0), 2.0 / math.sqrt(12 * 16 * 3), 1e-12),
        (relmse, flat(110.0), flat(100.0), 0.01, 1e-6),  # at any brightness
        (relmse, flat(1.1), flat(1.0), 0.01, 1e-3),
        (relmse, flat(0.01), flat(0.0), 1.0, 1e-6),  # the floor
        (psnr, flat(0.3), flat(0.3), math.inf, 0.0),
        (psnr, flat(1.0), flat(0.0), 0.0, 0.0),
        (psnr, flat(7.0), flat(2.0), math.inf, 0.0),  # both are white
        # The sRGB curve is a straight line of slope 12.92 near black.
        (psnr, flat(0.002), flat(0.001), -20.0 * math.log10(0.001 * 12.92), 1e-6),
    ],
)
def test_known_errors(metric, image, reference, error, tolerance):
    assert metric(image, reference) == pytest.approx(error, rel=tolerance, abs=1e-12)


@pytest.mark.skipif(not metrics.has_flip(), reason="flip-evaluator is not installed")
def test_flip():
    assert image_error(flat(0.5), flat(0.5)).flip == 0.0
    assert image_error(flat(0.5), flat(0.5) + 1e-9).flip == pytest.approx(0.0, abs=1e-6)
    assert image_error(flat(1.0), flat(0.0)).flip > 0.9
    near, far = (image_error(flat(0.5 + d), flat(0.5)).flip for d in (0.01, 0.2))
    assert 0.0 < near < far < 1.0


@pytest.mark.parametrize("exposure", [0.0, -2.0, 3.5])
@pytest.mark.parametrize("operator", OPERATORS)
def test_radiance_has_the_code_that_it_is_read_from(operator, exposure):
    codes = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    values = radiance(codes, operator, exposure)
    assert (np.diff(values, axis=0) > 0.0).all()
    assert (tonemap(values[None], operator, exposure)[0] == codes).all()
    assert radiance(np.uint8(255), "none") == pytest.approx(254.5 / 255.0)  # values beyond white are lost


def run(capsys, *arguments):
    return command_line.run(capsys, "compare", *arguments)


def reported(capsys, *arguments):
    code, out, err = run(capsys, *arguments, "--json")
    return code, json.loads(out, parse_constant=pytest.fail), err


@pytest.fixture
def files(folder):
    """Write a.exr, and b.exr, which differs by 0.125 in the color of one pixel, and in one id."""
    planes = layers()
    planes["B"][5, 6] = 0.5
    exr.write("a.exr", planes)
    planes["B"][5, 6] = 0.625
    exr.write("b.exr", planes)
    planes["id"][7, 8] += 1
    exr.write("c.exr", planes)
    return folder


def test_identical_files(files, capsys):
    code, out, err = run(capsys, "a.exr", "a.exr", "--threshold", "0")
    assert (code, err, out.splitlines()[-1]) == (0, [], "identical")
    assert out.splitlines()[2].split()[:8] == ["RGB", "0", "0", "0", "0", "0", "0", "inf"]
    code, report, _ = reported(capsys, "a.exr", "a.exr")
    assert (code, report["identical"], report["passed"], report["threshold"]) == (0, True, True, None)
    assert set(report["layers"]) == {"RGB", "A", "N", "Z", "id"}
    assert (report["layers"]["RGB"]["psnr"], report["layers"]["RGB"]["maximum"]) == (None, 0.0)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (("b.exr",), 0),
        (("b.exr", "--threshold", "0.125"), 0),
        (("b.exr", "--threshold", "0.1"), 1),
        (("b.exr", "--threshold", "0"), 1),
        (("b.exr", "--threshold", "0.1", "--layer", "R"), 0),
        (("b.exr", "--threshold", "0.1", "--layer", "Z", "--layer", "B"), 1),
        (("c.exr", "--threshold", "0.2"), 1),
        (("c.exr", "--threshold", "0.2", "--layer", "RGB"), 0),
    ],
)
def test_exit_codes(files, capsys, options, code):
    assert run(capsys, options[0], "a.exr", *options[1:])[::2] == (code, [])
    assert run(capsys, options[0], "a.exr", *options[1:], "--quiet") == (code, "", [])


def test_what_failed_is_told(files, capsys):
    code, out, _ = run(capsys, "c.exr", "a.exr", "--threshold", "0.1")
    assert (code, out.splitlines()[-1]) == (1, "FAILED: over 0.1: 1 pixels of RGB, 1 pixels of id")
    assert "RGB at 6,5 (column, row from the top): R " in out
    _, report, _ = reported(capsys, "c.exr", "a.exr", "--threshold", "0.1")
    assert (report["passed"], report["identical"]) == (False, False)
    layers = report["layers"]
    assert (layers["RGB"]["worst"]["x"], layers["id"]["worst"]["y"], layers["Z"]["worst"]) == (6, 7, None)


def test_refused(files, capsys):
    exr.write("small.exr", np.zeros((4, 5, 3)))
    exr.write("fewer.exr", {name: plane for name, plane in layers().items() if name not in ("Z", "N.Y")})
    exr.write("other.exr", {name: np.zeros(SHAPE, np.float32) for name in ("Y", "depth")})
    png.write("a.png", np.zeros((*SHAPE, 3), np.uint8))
    (files / "text.exr").write_text("no image")
    before = sorted(os.listdir())
    for arguments, parts in (
        (("small.exr", "a.exr"), ("small.exr", "size", "32 x 24", "5 x 4")),
        (("other.exr", "a.exr"), ("other.exr", "layers", "some of RGB, A, N (", "the layers of a.exr, found Y, depth")),
        (("fewer.exr", "a.exr", "--layer", "Z"), ("fewer.exr", "--layer", "RGB, A", "'Z'")),
        (("a.exr", "b.exr", "--layer", "depth"), ("a.exr", "--layer", "'depth': did you mean 'Z'?")),
        (("a.exr", "fewer.exr", "--layer", "N"), ("N.X+N.Z", "N.X+N.Y+N.Z")),
        (("a.exr", "fewer.exr", "--layer", "Z"), ("fewer.exr", "--layer", "'Z'")),
        (("a.exr", "b.exr", "--layer", "none"), ("--layer", "RGB", "'none'")),
        (("a.png", "a.exr"), ("a.png", "an EXR", "a PNG")),
        (("text.exr", "a.exr"), ("text.exr",)),
        (("a.exr", "none.exr"), ("none.exr", "no such file")),
        *((("a.exr", "b.exr", "--threshold", text), ("--threshold", f"'{text}'")) for text in ("-1", "nan")),
        (("a.exr", "b.exr", "-o", "none/a.png"), ("none/a.png", "there is no folder")),
        (("a.exr", "b.exr", "-o", "a.exr"), ("--output", ".png", "a.exr")),
        (("a.png", "a.png", "-o", "./a.png"), ("--output", "is read: choose another file", "./a.png")),
    ):
        assert_refused(run(capsys, *arguments, *(() if "-o" in arguments else ("-o", "new.png"))), *parts)
    assert sorted(os.listdir()) == before


@pytest.mark.usefixtures("files")
def test_what_one_image_lacks_is_not_compared_and_fails_a_regression_test(capsys):
    """Unless the layers are named or there is no threshold."""
    exr.write("less.exr", {name: plane for name, plane in exr.read("a.exr")[0].items() if name not in ("Z", "N.Y")})
    exr.write("more.exr", {**exr.read("b.exr")[0], "mask": np.zeros(SHAPE, np.float32)})
    for pair, place in ((("less.exr", "a.exr"), "reference"), (("a.exr", "less.exr"), "image")):
        code, out, err = run(capsys, *pair)
        assert (code, err) == (0, [f"clshade: warning: not compared: N.Y, Z of the {place} alone"])
        assert [line.split()[0] for line in out.splitlines()[2:-1]] == ["RGB", "A", "N", "id"]
        assert out.splitlines()[-1] == "different"  # although no compared layer differs
        code, out, err = run(capsys, *pair, "--threshold", "1")
        assert (code, len(err), out.splitlines()[-1]) == (1, 1, f"FAILED: N.Y, Z of the {place} alone")
        assert run(capsys, *pair, "--threshold", "0", "--layer", "RGB", "--layer", "id")[::2] == (0, [])
    code, report, err = reported(capsys, "more.exr", "less.exr", "--threshold", "0.1")
    assert (code, len(err), report["passed"], report["identical"]) == (1, 1, False, False)
    assert (report["only_image"], report["only_reference"]) == (["N.Y", "Z", "mask"], [])
    assert (report["layers"]["RGB"]["different"], report["layers"]["N"]["maximum"]) == (1, 0.0)


def test_pngs(folder, capsys):
    """Units are fractions of the largest code."""
    codes = RNG.integers(0, 200, (12, 12, 4), dtype=np.uint8)
    png.write("a.png", codes[..., :3])
    codes[2, 3, 1] += 51
    Image.fromarray(codes).save("b.png")
    code, out, err = run(capsys, "b.png", "a.png", "--json", "--threshold", "0.19")
    assert (code, err) == (1, ["clshade: warning: not compared: A of the image alone"])
    layer = json.loads(out)["layers"]["RGB"]
    assert (layer["maximum"], layer["psnr"]) == pytest.approx((0.2, -10 * math.log10(0.2**2 / 432)), rel=1e-6)
    assert run(capsys, "b.png", "a.png", "--layer", "RGB", "--threshold", "0.21")[0] == 0


@pytest.mark.long
def test_the_picture_shows_every_layer_and_single_pixels(files, capsys):
    code, _, err = run(capsys, "c.exr", "a.exr", "-o", "d.png")
    assert (code, err) == (0, ["clshade: wrote d.png"])
    assert png.read("d.png").std() > 10
    changed, reference = ({"Z": np.zeros((1500, 2000), np.float32)} for _ in range(2))
    changed["Z"][1001, 1003] = 2.0
    changed["Z"][3, 7] = np.nan
    pairs = compare.chosen_layers(Picture(changed), Picture(reference))
    figure = compare_figure.draw(pairs, encoded=False, titles=("a", "b"))
    (errors,) = (axes.images[0].get_array() for axes in figure.axes if axes.get_title().startswith("difference"))
    shown = np.argwhere((np.asarray(errors) != errors[-1, -1]).any(axis=-1))
    assert shown.tolist() == [[0, 1], [250, 250]]  # of blocks of 4 x 4
    assert errors[0, 1].tolist() == list(compare_figure.UNEQUAL_COLOR)
    assert errors[250, 250].tolist() == [252, 255, 164]  # the end of `inferno`: the maximum, not the mean


def test_a_color_means_the_same_in_both_images():
    """Depths from 1 to 3 beside depths from 1 to 2, whose largest is in the middle of the other range."""
    wide, narrow = (np.linspace(1, maximum, 129 * 129).reshape(129, 129) for maximum in (3, 2))
    pairs = compare.chosen_layers(Picture({"Z": wide}), Picture({"Z": narrow}))
    figure = compare_figure.draw(pairs, encoded=False, titles=("a", "b"))
    one, other = (np.asarray(axes.images[0].get_array()).astype(int) for axes in figure.axes[:2])
    assert (one[[0, 64], [0, 64]] == other[[0, 128], [0, 128]]).all()
    assert np.abs(one[128, 128] - other[128, 128]).max() > 50
