"""Fields that are declared once: what is kept, what is refused, and what docstrings say of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Literal

import pytest

from clshade.base import declare
from clshade.base.validation import items
from clshade.errors import InputError


@dataclass(frozen=True)
class Pen:
    """What writes."""

    tip: str = declare.choice("round", Literal["flat", "round"]).about("shape of the tip. Flat ones are for letters.")
    wet: bool = declare.flag(False).about("write with ink")
    lines: int = declare.integer(1, 1, 4).about("lines at once")
    width: float | None = declare.number(None, "MM", unit="mm", above=0.0).about("of a line", usual="the tip's")
    gray: float = declare.number(0.5, "0..1", least=0.0, most=1.0).about("how light the ink is")
    name: str | None = declare.value(None, "str", lambda owner, name, value: value.upper(), "NAME").about(
        "what it is called"
    )

    def __post_init__(self):
        declare.check_fields(self)


def test_what_checks_return_is_kept():
    assert Pen(width=2, lines=3.0, name="a") == Pen(width=2.0, lines=3, name="A")
    assert isinstance(Pen(width=2).width, float)
    assert (Pen().width, Pen().name) == (None, None)


@pytest.mark.parametrize(
    ("arguments", "message"),
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
def test_refusals(arguments, message):
    with pytest.raises(InputError) as caught:
        Pen(**arguments)
    assert str(caught.value) == message


def test_the_docstring():
    text, Pen.__doc__ = Pen.__doc__, declare.Docstring(Pen.__doc__)
    assert text == "What writes."
    assert Pen.__doc__ == "\n".join(
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


@dataclass(frozen=True)
class Paper:
    size: tuple[float, ...] = field(
        metadata={"check": partial(items, expected="two numbers", count=2, kinds=(int, float))}
    )
    marks: tuple[str, ...] = declare.checked(None, items)

    def __post_init__(self):
        declare.check_fields(self, "Sheet")


def test_a_field_without_a_default_is_checked_and_a_default_of_none_stays():
    assert Paper([1, 2.5]) == Paper(size=(1, 2.5), marks=None)
    assert Paper((1, 2), iter("ab")).marks == ("a", "b")
    for value, text in (((1,), "(1,)"), ("12", "'12'"), ((1, "2"), "'2'"), (5, "5")):
        with pytest.raises(InputError) as caught:
            Paper(value)
        assert str(caught.value) == f"Sheet: size: expected two numbers, found {text}"
    with pytest.raises(InputError, match=r"^Sheet: marks: expected a sequence, found 5$"):
        Paper((1, 2), 5)
    with pytest.raises(TypeError):
        Paper()
