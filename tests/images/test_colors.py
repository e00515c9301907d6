"""Colors as people write them: every form, as linear and as encoded numbers, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from clshade import Edges, Scalars, Settings
from clshade.errors import InputError
from clshade.images.colors import encoded_rgb, linear_rgb
from clshade.images.decode import srgb_to_linear

GRAY = float(srgb_to_linear(np.array([128 / 255]))[0])


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("#ff8000", (1.0, GRAY, 0.0)),
        ("#F00", (1.0, 0.0, 0.0)),
        ("gray", (GRAY, GRAY, GRAY)),
        ("White ", (1.0, 1.0, 1.0)),
        ("0.5,0, 3e3", (0.5, 0.0, 3000.0)),
        ((0.25, 0, 7), (0.25, 0.0, 7.0)),
        (np.array([1, 2, 3]), (1.0, 2.0, 3.0)),
    ],
)
def test_linear(given, expected):
    assert linear_rgb("", "", given) == pytest.approx(expected, abs=1e-12)
    assert Edges(color=given).color == pytest.approx(expected, abs=1e-12)
    assert Settings(background=given).background == pytest.approx(expected, abs=1e-12)


def test_encoded():
    assert encoded_rgb("", "", "#ff8000") == (1.0, 128 / 255, 0.0)
    assert encoded_rgb("", "", f"1,{GRAY},0") == pytest.approx((1.0, 128 / 255, 0.0), abs=1e-12)
    assert Scalars("a", nan_color=f"0,0,{GRAY}").nan_color == pytest.approx((0.0, 0.0, 128 / 255), abs=1e-12)
    assert encoded_rgb("", "", (0.5, 0.25, 1)) == (0.5, 0.25, 1.0)  # as Matplotlib takes it
    with pytest.raises(InputError, match="from 0 to 1"):
        encoded_rgb("", "", "0,0,1.5")


@pytest.mark.parametrize(
    "wrong",
    [
        "",
        "none",
        "0.5",
        "1,2",
        "1,2,x",
        "-1,0,0",
        "nan,0,0",
        "1e39,0,0",
        "#12345",
        "#11223344",
        "blau",
        (1, 2),
        3,
        True,
    ],
)
def test_what_is_no_color(wrong):
    for make in (lambda: linear_rgb("x", "y", wrong), lambda: Settings(background=wrong), lambda: Edges(color=wrong)):
        with pytest.raises(InputError, match="expected a name such as white, #rrggbb"):
            make()


def test_a_hint():
    with pytest.raises(InputError, match="did you mean 'white'"):
        linear_rgb("x", "y", "whit")
