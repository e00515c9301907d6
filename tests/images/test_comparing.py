"""`compare`: metrics of planted differences, layer by layer, as an image regression test."""

from __future__ import annotations

import importlib.util
import json
import math
import os

import command_line
import numpy as np
import pytest
from command_line import assert_refused
from PIL import Image

from clshade.errors import InputError
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
    for name, layer in compared(reference, {n: plane.copy() for n, plane in reference.items()}, threshold=0.0).items():
        assert (layer.different, layer.over, layer.nonfinite, layer.worst) == (0, 0, 0, None), name
        if not layer.exact:
            assert (layer.maximum, layer.mean, layer.rmse, layer.relmse) == (0, 0, 0, 0), name
        assert layer.psnr == (math.inf if name == "RGB" else None)


def test_one_channel_of_one_pixel():
    reference = layers()
    changed = {name: plane.copy() for name, plane in reference.items()}
    changed["G"][3, 4] = reference["G"][3, 4] + 0.25
    layer = compared(changed, reference)["RGB"]
    error = float(changed["G"][3, 4]) - float(reference["G"][3, 4])
    assert (layer.different, layer.nonfinite, layer.pixels) == (1, 0, 24 * 32)
    assert layer.maximum == error
    assert layer.mean == pytest.approx(error / (24 * 32 * 3), rel=1e-12)
    assert layer.rmse == pytest.approx(error / math.sqrt(24 * 32 * 3), rel=1e-12)
    floor = metrics.RELATIVE_FLOOR**2
    assert layer.relmse == pytest.approx(
        error**2 / (float(reference["G"][3, 4]) ** 2 + floor) / (24 * 32 * 3), rel=1e-12
    )
    assert (layer.worst.x, layer.worst.y) == (4, 3)
    assert layer.worst.values["G"] == changed["G"][3, 4]
    assert layer.worst.reference == {name: reference[name][3, 4] for name in "RGB"}
    images = [np.stack([channels[name] for name in "RGB"], axis=-1) for channels in (changed, reference)]
    assert layer.psnr == pytest.approx(metrics.image_error(*images).psnr)


def test_over_counts_pixels_strictly_above_the_threshold():
    reference = {"Z": np.zeros((1, 4), np.float32)}
    changed = {"Z": np.float32([[0.0, 0.5, 0.75, -2.0]])}
    for threshold, over in ((None, 3), (0.0, 3), (0.5, 2), (0.75, 1), (2.0, 0)):
        layer = compared(changed, reference, threshold=threshold)["Z"]
        assert (layer.different, layer.over) == (3, over)
        assert compare.compare_layers(Picture(changed), Picture(reference), (), threshold).passed == (
            threshold in (None, 2.0)
        )


@pytest.mark.parametrize(
    ("value", "expected", "differ"),
    [
        (np.nan, 1.0, True),
        (1.0, np.nan, True),
        (np.inf, 1.0, True),
        (np.inf, -np.inf, True),
        (np.nan, np.inf, True),
        (np.nan, np.nan, False),
        (np.inf, np.inf, False),
        (-0.0, 0.0, False),
    ],
)
def test_nan_and_infinity(value, expected, differ):
    """They exceed any threshold; the metrics cover the pixels that are finite in both images."""
    changed, reference = ({"Z": np.float32([[depth, 2.0]])} for depth in (value, expected))
    layer = compared(changed, reference, threshold=1e30)["Z"]
    assert (layer.different, layer.over, layer.nonfinite) == (differ,) * 3
    assert (layer.maximum, layer.mean, layer.rmse) == (0.0, 0.0, 0.0)
    assert (layer.worst is not None) == differ


def test_whole_numbers_are_compared_exactly():
    """Adjacent values at 2^32 - 1, which float32 cannot distinguish, with any threshold; also against floats."""
    reference = {"id": np.uint32([[2**32 - 1, 7, 0]])}
    changed = {"id": np.uint32([[2**32 - 2, 7, 0]])}
    layer = compared(changed, reference, threshold=1e9)["id"]
    assert (layer.exact, layer.different, layer.over, layer.maximum) == (True, 1, 1, None)
    layer = compared({"id": np.float32([[0, 7, np.nan]])}, reference)["id"]
    assert (layer.different, layer.nonfinite, layer.worst[:2]) == (2, 0, (0, 0))  # all are equally bad


def test_large_images_are_compared_in_strips(monkeypatch):
    """Strips of one, two, three rows: the same figures, and the worst pixel in the last strip."""
    reference = layers()
    changed = {name: plane.copy() for name, plane in reference.items()}
    changed["G"] += np.float32(0.01)
    changed["R"][23, 31] = np.nan
    changed["id"][22, 3] += 1
    baseline = compared(changed, reference, threshold=0.005)
    assert baseline["RGB"].over == 24 * 32
    for rows in (1, 2, 3):
        monkeypatch.setattr(compare, "_STRIP", rows * 32)
        for name, layer in compared(changed, reference, threshold=0.005).items():
            expected = vars(baseline[name])
            for field, value in vars(layer).items():  # sums are in another order
                if isinstance(value, float):
                    assert value == pytest.approx(expected[field], rel=1e-12), field
                else:
                    assert str(value) == str(expected[field]), field  # the worst pixel's NaN equals no NaN
    assert (baseline["RGB"].worst[:2], baseline["id"].worst[:2]) == ((31, 23), (3, 22))


def test_half_floats_against_floats():
    reference = {"Z": np.float32([[0.1, 0.5]])}
    layer = compared({"Z": reference["Z"].astype(np.float16)}, reference)["Z"]
    assert layer.different == 1
    assert 0.0 < layer.maximum <= 0.1 * 2.0**-11


@pytest.mark.skipif(not metrics.has_ssim(), reason="scikit-image is not installed")
def test_structural_similarity():
    """For images that differ by a constant, only the term of the means remains: (2ab + C1)/(a^2 + b^2 + C1), C1 =
    0.01^2."""
    a, b = np.full((20, 20, 3), 0.4), np.full((20, 20, 3), 0.5)
    assert metrics.ssim_of_seen(a, b) == pytest.approx((0.4 + 1e-4) / (0.16 + 0.25 + 1e-4), rel=1e-9)
    assert metrics.ssim_of_seen(a, a) == 1.0
    assert metrics.ssim_of_seen(a[:10], b[:10]) is None


def test_without_the_packages(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    reference = layers()
    layer = compared(reference, reference)["RGB"]
    assert (layer.ssim, layer.flip) == (None, None)


# Error metrics of images with known errors, and the radiance that a PNG's codes stand for


def flat(value: float) -> np.ndarray:
    return np.full((12, 16, 3), value)


def test_a_constant_offset():
    reference = RNG.uniform(0.0, 2.0, (12, 16, 3))
    assert rmse(reference + 0.25, reference) == pytest.approx(0.25, rel=1e-12)
    assert rmse(reference.astype(np.float32), reference) == pytest.approx(2.0**-25, rel=0.9)  # compared in float64


def test_an_error_of_one_channel_of_one_pixel():
    image = flat(1.0)
    image[3, 4, 1] += 2.0
    assert rmse(image, flat(1.0)) == pytest.approx(2.0 / math.sqrt(12 * 16 * 3), rel=1e-12)


def test_relative_error_does_not_depend_on_brightness():
    assert relmse(flat(110.0), flat(100.0)) == pytest.approx(0.01, rel=1e-6)
    assert relmse(flat(1.1), flat(1.0)) == pytest.approx(0.01, rel=1e-3)
    assert relmse(flat(0.01), flat(0.0)) == pytest.approx(1.0)  # the floor


def test_decibels_are_of_what_is_seen():
    assert image_error(flat(0.3), flat(0.3)).psnr == math.inf
    assert image_error(flat(1.0), flat(0.0)).psnr == pytest.approx(0.0)
    assert image_error(flat(7.0), flat(2.0)).psnr == math.inf  # both are white
    # The sRGB curve is a straight line of slope 12.92 near black.
    assert image_error(flat(0.002), flat(0.001)).psnr == pytest.approx(-20.0 * math.log10(0.001 * 12.92))


def test_without_flip_evaluator(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert not metrics.has_flip()
    assert image_error(flat(0.2), flat(0.4)).flip is None


@pytest.mark.skipif(not metrics.has_flip(), reason="flip-evaluator is not installed")
def test_flip():
    assert image_error(flat(0.5), flat(0.5)).flip == 0.0
    assert image_error(flat(0.5), flat(0.5) + 1e-9).flip == pytest.approx(0.0, abs=1e-6)
    assert image_error(flat(1.0), flat(0.0)).flip > 0.9
    near, far = (image_error(flat(0.5 + d), flat(0.5)).flip for d in (0.01, 0.2))
    assert 0.0 < near < far < 1.0


def test_all_measures_as_json():
    stats = image_error(flat(0.3), flat(0.3)).stats()
    assert (stats["rmse"], stats["relmse"], stats["psnr"]) == (0.0, 0.0, None)


def test_images_of_different_sizes():
    with pytest.raises(InputError, match=r"image_error: image: expected the reference's shape \(12, 16, 3\)"):
        image_error(flat(1.0)[:4], flat(1.0))


@pytest.mark.parametrize("exposure", [0.0, -2.0, 3.5])
@pytest.mark.parametrize("operator", OPERATORS)
def test_radiance_has_the_code_that_it_is_read_from(operator, exposure):
    codes = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    values = radiance(codes, operator, exposure)
    assert (np.diff(values, axis=0) > 0.0).all()
    assert (tonemap(values[None], operator, exposure)[0] == codes).all()


def test_radiance_is_off_by_half_a_step():
    """`none` has steps of 1/255; values beyond white are lost."""
    image = RNG.uniform(0.0, 254.4 / 255.0, (20, 30, 3))
    assert np.abs(radiance(tonemap(image, "none"), "none") - image).max() <= 0.5 / 255.0 + 1e-12
    assert radiance(np.uint8(255), "none") == pytest.approx(254.5 / 255.0)


# The command


def run(capsys, *arguments):
    return command_line.run(capsys, "compare", *arguments)


@pytest.fixture
def files(folder):
    """Write a.exr, and b.exr, which differs by 0.125 in the color of one pixel, and in one id."""
    planes = layers()
    exr.write("a.exr", planes)
    planes["B"][5, 6] += np.float32(0.125)
    exr.write("b.exr", planes)
    planes["id"][7, 8] += 1
    exr.write("c.exr", planes)
    return folder


def test_identical_files(files, capsys):
    code, out, err = run(capsys, "a.exr", "a.exr", "--threshold", "0")
    assert (code, err) == (0, [])
    assert out.splitlines()[-1] == "identical"
    assert out.splitlines()[2].split()[:8] == ["RGB", "0", "0", "0", "0", "0", "0", "inf"]
    code, out, _ = run(capsys, "a.exr", "a.exr", "--json")
    report = json.loads(out, parse_constant=pytest.fail)
    assert (code, report["identical"], report["passed"], report["threshold"]) == (0, True, True, None)
    assert set(report["layers"]) == {"RGB", "A", "N", "Z", "id"}
    assert report["layers"]["RGB"]["psnr"] is None
    assert report["layers"]["RGB"]["maximum"] == 0.0


@pytest.mark.parametrize(
    ("options", "code"),
    [
        (("b.exr",), 0),
        (("b.exr", "--threshold", "0.2"), 0),
        (("b.exr", "--threshold", "0.1"), 1),
        (("b.exr", "--threshold", "0"), 1),
        (("b.exr", "--threshold", "0.1", "--layer", "Z"), 0),
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
    assert code == 1
    assert out.splitlines()[-1] == "FAILED: over 0.1: 1 pixels of RGB, 1 pixels of id"
    assert "RGB at 6,5 (column, row from the top): R " in out
    code, out, _ = run(capsys, "c.exr", "a.exr", "--threshold", "0.1", "--json")
    report = json.loads(out, parse_constant=pytest.fail)
    assert (code, report["passed"], report["identical"]) == (1, False, False)
    assert report["layers"]["RGB"]["worst"]["x"] == 6
    assert report["layers"]["id"]["worst"]["y"] == 7
    assert report["layers"]["Z"]["worst"] is None


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
        (("a.exr", "b.exr", "--threshold", "-1"), ("--threshold", "'-1'")),
        (("a.exr", "b.exr", "--threshold", "nan"), ("--threshold", "'nan'")),
        (("a.exr", "b.exr", "-o", "none/a.png"), ("none/a.png", "there is no folder")),
        (("a.exr", "b.exr", "-o", "a.exr"), ("--output", ".png", "a.exr")),
        (("a.png", "a.png", "-o", "./a.png"), ("--output", "is read: choose another file", "./a.png")),
    ):
        assert_refused(run(capsys, *arguments, *(() if "-o" in arguments else ("-o", "new.png"))), *parts)
    assert sorted(os.listdir()) == before


@pytest.fixture
def partial(files):
    """Write less.exr, a.exr without Z and N.Y, and more.exr, with a mask and a difference of 0.125 in one pixel."""
    planes = exr.read("a.exr")[0]
    exr.write("less.exr", {name: plane for name, plane in planes.items() if name not in ("Z", "N.Y")})
    planes = exr.read("b.exr")[0]
    exr.write("more.exr", {**planes, "mask": np.zeros(SHAPE, np.float32)})


@pytest.mark.usefixtures("partial")
def test_what_both_images_have_is_compared(capsys):
    code, out, err = run(capsys, "less.exr", "a.exr")
    assert (code, err) == (0, ["clshade: warning: not compared: N.Y, Z of the reference alone"])
    assert [line.split()[0] for line in out.splitlines()[2:-1]] == ["RGB", "A", "N", "id"]
    assert out.splitlines()[-1] == "different"  # although no compared layer differs
    code, out, err = run(capsys, "more.exr", "less.exr", "--json")
    report = json.loads(out, parse_constant=pytest.fail)
    assert (code, len(err), report["passed"], report["identical"]) == (0, 1, True, False)
    assert (report["only_image"], report["only_reference"]) == (["N.Y", "Z", "mask"], [])
    assert report["layers"]["RGB"]["different"] == 1
    assert report["layers"]["N"]["maximum"] == 0.0


@pytest.mark.long
@pytest.mark.usefixtures("partial")
def test_a_regression_test_never_passes_without_a_layer(capsys):
    """Whichever image lacks it, unless the layers are named or there is no threshold."""
    for pair, place in ((("less.exr", "a.exr"), "reference"), (("a.exr", "less.exr"), "image")):
        code, out, err = run(capsys, *pair, "--threshold", "1")
        assert (code, len(err)) == (1, 1)
        assert out.splitlines()[-1] == f"FAILED: N.Y, Z of the {place} alone"
        assert run(capsys, *pair, "--threshold", "1", "--quiet") == (1, "", [])
        assert run(capsys, *pair, "--threshold", "0", "--layer", "RGB", "--layer", "id")[::2] == (0, [])
    code, out, err = run(capsys, "more.exr", "a.exr", "--threshold", "0.1", "-o", "d.png")
    assert (code, len(err)) == (1, 2)
    assert out.splitlines()[-1] == "FAILED: over 0.1: 1 pixels of RGB; mask of the image alone"
    assert run(capsys, "more.exr", "b.exr", "--threshold", "0.1", "--json")[0] == 1


def test_alpha_of_a_png_that_the_other_lacks(folder, capsys):
    codes = RNG.integers(0, 200, (12, 12, 4), dtype=np.uint8)
    Image.fromarray(codes).save("a.png")
    png.write("b.png", np.ascontiguousarray(codes[..., :3]))
    code, out, err = run(capsys, "a.png", "b.png")
    assert (code, err) == (0, ["clshade: warning: not compared: A of the image alone"])
    assert out.splitlines()[2].split()[:2] == ["RGB", "0"]


def test_pngs(folder, capsys):
    """Units are fractions of the largest code."""
    codes = RNG.integers(0, 200, (12, 12, 3), dtype=np.uint8)
    png.write("a.png", codes)
    codes[2, 3, 1] += 51
    png.write("b.png", codes)
    code, out, _ = run(capsys, "b.png", "a.png", "--json", "--threshold", "0.19")
    layer = json.loads(out)["layers"]["RGB"]
    assert code == 1
    assert layer["maximum"] == pytest.approx(0.2, rel=1e-6)
    assert layer["psnr"] == pytest.approx(-10 * math.log10(0.2**2 / 432), rel=1e-6)
    assert run(capsys, "b.png", "a.png", "--threshold", "0.21")[0] == 0
    assert run(capsys, "a.png", "a.png", "--threshold", "0")[0] == 0


# The figure


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
    shown = [np.asarray(axes.images[0].get_array()).astype(int) for axes in figure.axes[:2]]
    assert (shown[0][0, 0] == shown[1][0, 0]).all()
    assert (shown[0][64, 64] == shown[1][128, 128]).all()
    assert np.abs(shown[0][128, 128] - shown[1][128, 128]).max() > 50


@pytest.mark.long
def test_of_many_layers_those_that_differ_are_shown(folder, monkeypatch, capsys):
    planes = {f"L{k:03}": np.zeros((4, 6), np.float32) for k in range(compare_figure.MAX_LAYERS + 10)}
    exr.write("a.exr", planes)
    planes["L049"] += 1
    exr.write("b.exr", planes)
    drawn, draw = [], compare_figure.draw
    monkeypatch.setattr(
        compare_figure, "draw", lambda layers, **options: drawn.append(list(layers)) or draw(layers, **options)
    )
    assert run(capsys, "b.exr", "a.exr", "-o", "d.png")[0] == 0
    assert drawn == [["L049", *(f"L{k:03}" for k in range(compare_figure.MAX_LAYERS - 1))]]
