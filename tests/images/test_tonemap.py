"""Tone maps: equal to the float64 oracle at every code's threshold, at the extremes and in between."""

import numpy as np
import pytest
from tonemap_reference import tonemap as oracle

from clshade.errors import InputError
from clshade.images import tonemap as tm
from clshade.images.tonemap import JOINT, OPERATORS, agx, display_values, neutral, radiance, tonemap

SEPARATE = [operator for operator in OPERATORS if operator not in JOINT]
EXPOSURES = (0.0, 1.0, 0.5, -3.7, 21.3)
TINY, HUGE = np.float32(1e-45), np.finfo(np.float32).max


def image(values, dtype=np.float32):
    """Return values of any shape as a gray image one pixel high."""
    return np.repeat(np.asarray(values, dtype).reshape(1, -1, 1), 3, axis=2)


def steps(operator, exposure):
    """Return the 255 smallest float32 values of each code, (255, 5), with the two nearest floats on either side."""
    bits = tm._thresholds(operator, exposure, np.float32)
    return (bits[:, None] + np.arange(-2, 3)).astype(np.int32).view(np.float32)


def assert_equals_oracle(pixels, operator, exposure):
    with np.errstate(invalid="ignore"):  # signaling NaNs
        expected = oracle(pixels, operator, exposure)
    np.testing.assert_array_equal(tonemap(pixels, operator, exposure), expected, strict=True)


@pytest.mark.parametrize("operator", SEPARATE)
@pytest.mark.parametrize("exposure", EXPOSURES)
def test_every_threshold(operator, exposure):
    """Both sides of all 255 steps, exactly in float32; the oracle itself must step there. In float64, within 1e-13 of a
    step the formula's own rounding decides: its slope is below 255 * 4 there, each of some ten operations rounds by
    1e-16, so it crosses 1/2 within a relative distance of 1e-15 / (slope * value) of the step."""
    values = steps(operator, exposure)
    assert oracle(values[:, 2], operator, exposure).tolist() == list(range(1, 256))
    assert oracle(values[:, 1], operator, exposure).tolist() == list(range(255))
    assert_equals_oracle(image(values), operator, exposure)
    values64 = tm._thresholds64(operator, exposure)
    assert ((values[:, 1] < values64) & (values64 <= values[:, 2])).all()
    for factor in (1 - 1e-12, 1 + 1e-12, 1 - 1e-9, 1 + 1e-9):
        assert_equals_oracle(image(values64 * factor, np.float64), operator, exposure)


@pytest.mark.parametrize("operator", SEPARATE)
def test_everything_between(operator):
    random = np.random.default_rng(7)
    for exposure in EXPOSURES[::2]:
        values = np.exp(random.uniform(-14, 9, 90_000)) * 2.0**-exposure * np.where(random.random(90_000) < 0.1, -1, 1)
        assert_equals_oracle(values.astype(np.float32).reshape(300, 100, 3), operator, exposure)
        assert_equals_oracle(values[:9000].reshape(30, 100, 3), operator, exposure)
    halves = np.resize(np.arange(65536, dtype=np.uint16), 65538).view(np.float16).reshape(-1, 1, 3)
    assert_equals_oracle(halves, operator, 0.25)
    bits = random.integers(0, 2**32, 90_000, np.uint32)
    assert_equals_oracle(bits.view(np.float32).reshape(300, 100, 3), operator, 0.0)


@pytest.mark.parametrize("operator", SEPARATE)
@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_extremes(operator, dtype):
    nans = np.array([0x7FC00000, 0x7F800001, 0x7F807FFF, 0x7F808000, 0x7FFFFFFF, 0xFF800001, 0xFFFFFFFF], np.uint32)
    with np.errstate(over="ignore", invalid="ignore"):
        unknown = nans.view(np.float32) if dtype is np.float32 else np.full(7, np.nan, dtype)
        blank = np.append(unknown, np.array([0.0, -0.0, -TINY, -1.0, -HUGE, -np.inf, TINY]).astype(dtype))
        full = np.array([np.inf, HUGE, 3e4 if dtype is np.float16 else 1e38]).astype(dtype)
    for exposure in (0.0, 5.0, -5.0) if dtype is np.float16 else (0.0, 5.0, -5.0, 100.0, -100.0):
        assert not tonemap(image(blank, dtype), operator, exposure).any()
        assert (tonemap(image(full, dtype), operator, exposure) == 255).all()
    if dtype is not np.float16:
        assert (tonemap(image([np.inf, HUGE], dtype), operator, 300.0) == 255).all()
        assert (tonemap(image([np.inf, 1.0], dtype), operator, -300.0)[0, :, 0] == [255, 0]).all()


@pytest.mark.parametrize(
    ("operator", "codes"),
    # By hand: 127.5 and its neighbor; sRGB(0.5) = 0.73536, sRGB(0.18) = 0.46136, 12.92 * 0.002 = 0.02584;
    # 1/(1+1) = 0.5; 2 * 5.6 = 11.2, the white of the formula; (2.51+0.03)/(2.43+0.59+0.14) = 0.80380, sRGB 0.90823.
    [
        ("none", {0.5: 128, 0.49999997: 127, 0.18: 46, 1.0: 255, 0.001: 0}),
        ("srgb", {0.5: 188, 0.18: 118, 0.002: 7, 1.0: 255}),
        ("reinhard", {1.0: 188, 1e6: 255}),
        ("hable", {5.6: 255}),
        ("aces", {1.0: 232}),
    ],
)
def test_values_by_hand(operator, codes):
    for convert in (tonemap, oracle):
        assert convert(image(list(codes)), operator)[0, :, 0].tolist() == list(codes.values())


@pytest.mark.parametrize("shape", [(1, 1, 3), (331, 99, 3), (0, 4, 3), (104, 105, 3)])
def test_sizes_and_layouts(shape):
    pixels = np.random.default_rng(1).exponential(0.5, shape).astype(np.float32)
    assert_equals_oracle(pixels, "srgb", 0.0)
    pixels.flags.writeable = False
    wide = np.concatenate([pixels, pixels[..., :1]], axis=2)
    for view in (pixels[::-1], pixels[:, ::-1], pixels[..., ::-1], pixels.transpose(1, 0, 2), wide[..., :3]):
        assert_equals_oracle(view, "srgb", 0.0)
    assert_equals_oracle(pixels.astype(np.float64)[::-1], "aces", 0.0)


COLORS = np.exp(np.random.default_rng(3).uniform(-9, 5, (40, 30, 3)))


@pytest.mark.sampled
@pytest.mark.parametrize("operator", JOINT)
@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_colors_of_joint_operators(operator, dtype):
    """Also the ends: the least number, the largest, both infinities, NaN and zero, in one channel and in all."""
    largest, least = np.finfo(dtype).max, np.finfo(dtype).tiny
    special = np.array([0.0, -0.0, -1.0, -np.inf, np.nan, np.inf, largest, least, 0.4], dtype)
    ends = np.stack(np.meshgrid(special, special, special), axis=-1).reshape(27, 27, 3)
    for exposure in (0.0, -3.7, 21.3, 300.0, -300.0):
        assert_equals_oracle(COLORS.astype(dtype)[::-1], operator, exposure)
        assert_equals_oracle(ends, operator, exposure)


def test_neutral_keeps_base_colors_and_hues():
    """Khronos's specification: inputs within 0.08 to 0.8 less 0.04, and no turn about the axis of greys."""
    inside = np.random.default_rng(4).uniform(0.08, 0.8, (100, 3))
    assert neutral(inside) == pytest.approx(inside - 0.04, abs=1e-15)
    mapped = neutral(COLORS)
    assert ((mapped >= 0.0) & (mapped < 1.0)).all()
    chroma, mapped_chroma = (colors - colors.mean(axis=-1, keepdims=True) for colors in (COLORS, mapped))
    assert np.cross(chroma, mapped_chroma) == pytest.approx(0.0, abs=1e-12 * COLORS.max())
    assert ((chroma * mapped_chroma).sum(axis=-1) >= 0.0).all()


@pytest.mark.parametrize(
    ("entry", "value"),
    # Of the 4096 entries of LUTs/AgX_Default_Contrast.spi1d, github.com/sobotka/AgX, commit 1ba3230.
    [(3085, 0.7830822), (3086, 0.7834943), (4093, 0.9998583), (4094, 0.9999292), (4095, 1.0)],
)
def test_agx_is_the_published_curve(entry, value):
    grey = 0.18 * 2.0 ** (16.5 * entry / 4095 - 10.0)
    assert agx(np.full(3, grey)) == pytest.approx(value, abs=1e-7)


def test_agx_insets_primaries_as_published():
    """Within 1.4e-4 of the matrix of B. Wrensch's "Minimal AgX Implementation", whose rows do not sum to 1."""
    published = [[0.84248, 0.07843, 0.07922], [0.04233, 0.87847, 0.07917], [0.04238, 0.07843, 0.87914]]
    assert pytest.approx(np.array(published), abs=1.4e-4) == tm._INSET
    assert tm._INSET.sum(axis=1) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("operator", JOINT)
def test_joint_operators_are_inverted(operator):
    forward, inverse = JOINT[operator]
    colors = np.random.default_rng(5).uniform(0.01, 4.0, (500, 3))
    assert inverse(forward(colors)) == pytest.approx(colors, rel=1e-6)
    codes = tonemap(colors[None], operator, -2.0)
    again = tonemap(radiance(codes, operator, -2.0), operator, -2.0)
    assert np.abs(again.astype(int) - codes).max() <= 1  # nearer to white, a step of a code is a stop


@pytest.mark.parametrize("operator", OPERATORS)
def test_display_values_are_what_is_rounded_to_codes(operator):
    values = np.random.default_rng(3).lognormal(0, 3, (40, 50, 3)).astype(np.float32)
    values[0, 0] = [-1.0, np.nan, np.inf]
    displayed = display_values(values, operator, 1.5)
    assert displayed.dtype == np.float64
    assert (np.floor(255.0 * displayed + 0.5) == tonemap(values, operator, 1.5)).all()
    assert (operator in JOINT and displayed[0, 0, 1] == 0.0) or displayed[0, 0].tolist() == [0.0, 0.0, displayed.max()]
    with pytest.raises(InputError, match="exposure"):
        display_values(values, operator, np.nan)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        *(((np.zeros(shape),), "rgb") for shape in ((2, 2), (2, 2, 4))),
        ((np.zeros((2, 2, 3), np.uint8),), "rgb"),
        ((np.zeros((2, 2, 3)), "filmic"), "operator"),
        *(((np.zeros((2, 2, 3)), "srgb", exposure), "exposure") for exposure in (np.nan, 301, "bright")),
    ],
)
def test_refused_arguments(arguments, name):
    with pytest.raises(InputError, match=f"^tonemap: {name}: expected .*found"):
        tonemap(*arguments)
