"""Fields of dataclasses that are declared once: their checks, docstrings and options come from the declaration."""

from __future__ import annotations

import inspect
import math
import os
import textwrap
from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields
from functools import cache, partial
from typing import TYPE_CHECKING, Any, TypeAlias, get_args

from . import validation

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Check: TypeAlias = Callable[[str, str, Any], Any]  # owner, field and value -> the value that is kept


@dataclass(frozen=True)
class Declared:
    """What is known of a field besides its name, type and default.

    about: what it is, in the help of options without its default, in docstrings with `more` after it. kind: the values
    that it takes, for docstrings. check: returns the value that is kept, or raises InputError. usual: what happens by
    default, where the default does not say it. choices: all values, if they can be listed. read: makes a value of an
    option's text, whose form is `form`; None for choices and flags.
    """

    about: str
    more: str
    kind: str
    check: Check
    usual: str = ""
    choices: tuple[str, ...] = ()
    read: Callable[[str], Any] | None = None
    form: str | None = None


def choice(default: str, literal: Any, about: str, more: str = "", usual: str = "") -> Any:
    """Declare a field that is one of the texts of a Literal."""
    allowed = get_args(literal)
    kind = ", ".join(f'"{text}"' for text in allowed)
    check = partial(validation.choice, allowed=allowed)
    return _field(default, Declared(about, more, f"{{{kind}}}", check, usual, choices=allowed))


def flag(default: bool, about: str, more: str = "", usual: str = "") -> Any:
    """Declare a field that is True or False."""
    return _field(default, Declared(about, more, "bool", validation.flag, usual))


def whole(default: int, least: int, most: int, about: str, more: str = "", usual: str = "") -> Any:
    """Declare a field that is a whole number."""
    check = partial(validation.integer, least=least, most=most)
    form = f"{least}..{most}"
    return _field(default, Declared(about, more, f"int from {least} to {most}", check, usual, read=int, form=form))


def real(
    default: float | None,
    form: str,
    about: str,
    more: str = "",
    usual: str = "",
    *,
    unit: str = "",
    above: float = -math.inf,
    least: float = -math.inf,
    most: float = math.inf,
) -> Any:
    """Declare a field that is a number, see `validation.number`. unit: such as degrees."""
    limits = validation.limits_of(above, least, most)
    expected, kind = (unit + limits, f"float, {unit}{limits}") if unit else ("", f"float{limits}")
    check = partial(validation.number, above=above, least=least, most=most, expected=expected)
    return _field(default, Declared(about, more, kind, check, usual, read=float, form=form))


def other(default: Any, kind: str, check: Check, form: str, about: str, more: str = "", usual: str = "") -> Any:
    """Declare a field of another kind, whose option is a text that `check` takes, unless its command knows better."""
    return _field(default, Declared(about, more, kind, check, usual, read=str, form=form))


def _field(default: Any, declared: Declared) -> Any:
    return checked(default, declared.check, declared=declared)


def checked(default: Any, check: Check, **facts: Any) -> Any:
    """Declare a field whose docstring and options stand elsewhere. facts: by name, for `facts_of`."""
    return field(default=default, metadata={"check": check, **facts})


def facts_of(kind: type[DataclassInstance], fact: str) -> dict[str, Any]:
    """Return a fact about each field that has it, by the fields' names, in their order."""
    return {each.name: each.metadata[fact] for each in fields(kind) if fact in each.metadata}


def check_fields(instance: DataclassInstance) -> None:
    """Replace each declared field by what its check makes of it, unless it is None as by default. Raises InputError."""
    owner, values = type(instance).__name__, vars(instance)
    for name, check, default, checked_default in _checks(type(instance)):
        value = values[name]
        values[name] = checked_default if value is default else check(owner, name, value)


@cache
def _checks(kind: type[DataclassInstance]) -> list[tuple[str, Check, Any, Any]]:
    """Return name, check and default of each declared field, and what the check makes of the default, once for all."""
    declared = [(each.name, each.metadata["check"], each.default) for each in fields(kind) if "check" in each.metadata]
    return [
        (name, check, default, default if default in (None, MISSING) else check(kind.__name__, name, default))
        for name, check, default in declared
    ]


def documented(kind: type) -> str:
    """Return the docstring of a dataclass with a section that describes its fields."""
    lines = [inspect.cleandoc(kind.__doc__ or ""), "", "Attributes", "----------"]
    for each in fields(kind):
        known: Declared = each.metadata["declared"]
        default = (
            f", default {known.usual or repr(each.default)}"
            if known.usual or each.default is not None
            else ", optional"
        )
        lines.append(f"{each.name} : {known.kind}{default}")
        text = f"{known.about[0].upper()}{known.about[1:]}. {known.more}"
        lines += textwrap.wrap(text, 100, initial_indent="    ", subsequent_indent="    ")
    return "\n".join(lines)


def as_option(name: str, value: Any) -> str:
    """Return the option that gives a field this value, as one argument of a command."""
    option = name.replace("_", "-")
    if isinstance(value, bool):
        return f"--{option}" if value else f"--no-{option}"
    values = value if isinstance(value, tuple) else ("none" if value is None else value,)
    return f"--{option}=" + ",".join(repr(each) if isinstance(each, float) else str(each) for each in values)


def as_argument(path: str) -> str:
    """Return a path as an argument that no program takes for an option."""
    return os.path.join(os.curdir, path) if path.startswith("-") else path
