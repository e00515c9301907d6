"""Fields that are declared once: what is kept, what is refused, and what docstrings say of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import pytest

from clshade.base import declare
from clshade.errors import InputError


@dataclass(frozen=True)
class Pen:
    """What writes."""

    tip: str = declare.choice("round", Literal["flat", "round"], "shape of the tip", "Flat ones are for letters.")
    wet: bool = declare.flag(False, "write with ink")
    lines: int = declare.whole(1, 1, 4, "lines at once")
    width: float | None = declare.real(None, "MM", "of a line", usual="the tip's", unit="mm", above=0.0)
    gray: float = declare.real(0.5, "0..1", "how light the ink is", least=0.0, most=1.0)
    name: str | None = declare.other(None, "str", lambda owner, name, value: value.upper(), "NAME", "what it is called")

    def __post_init__(self):
        declare.check_fields(self)


def test_what_checks_return_is_kept():
    assert Pen(width=2, lines=3.0, name="a") == Pen(width=2.0, lines=3, name="A")
    assert isinstance(Pen(width=2).width, float)
    assert (Pen().width, Pen().name) == (None, None)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"tip": "rund"}, "Pen: tip: expected one of flat, round, found 'rund': did you mean 'round'?"),
        ({"wet": 1}, "Pen: wet: expected True or False, found 1"),
        ({"lines": 5}, "Pen: lines: expected a whole number from 1 to 4, found 5"),
        ({"lines": None}, "Pen: lines: expected a whole number from 1 to 4, found None"),
        ({"width": 0}, "Pen: width: expected mm above 0, found 0"),
        ({"gray": -0.5}, "Pen: gray: expected a number from 0 to 1, found -0.5"),
        ({"gray": 1.5}, "Pen: gray: expected a number from 0 to 1, found 1.5"),
    ],
)
def test_refusals(given, message):
    with pytest.raises(InputError) as caught:
        Pen(**given)
    assert str(caught.value) == message


def test_the_docstring():
    assert declare.documented(Pen) == "\n".join(
        [
            "What writes.",
            "",
            "Attributes",
            "----------",
            'tip : {"flat", "round"}, default \'round\'',
            "    Shape of the tip. Flat ones are for letters.",
            "wet : bool, default False",
            "    Write with ink.",
            "lines : int from 1 to 4, default 1",
            "    Lines at once.",
            "width : float, mm above 0, default the tip's",
            "    Of a line.",
            "gray : float from 0 to 1, default 0.5",
            "    How light the ink is.",
            "name : str, optional",
            "    What it is called.",
        ]
    )
