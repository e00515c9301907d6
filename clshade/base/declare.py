"""Fields of dataclasses, declared once: their checks, docstrings and options come from the declaration."""

from __future__ import annotations

import inspect
import os
import textwrap
from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, get_args

from . import validation

if TYPE_CHECKING:
    from _typeshed import DataclassInstance
    from typing_extensions import dataclass_transform

Kind = TypeVar("Kind", bound=type)

Check: TypeAlias = Callable[[str, str, Any], Any]  # owner, field and value -> the value that is kept


@dataclass(frozen=True)
class Declared:
    """What docstrings and options say of a field besides its name and type.

    kind: its values, for docstrings. choices: all values, if they can be listed. read: converts an option's text, whose
    form is `form`; None for choices and flags. text, usual: see `about`.
    """

    default: Any
    check: Check
    kind: str
    choices: tuple[str, ...] = ()
    read: Callable[[str], Any] | None = None
    form: str | None = None
    text: str = ""
    usual: str = ""

    def about(self, text: str, usual: str = "") -> Any:
        """Return the field. text: what it is; the first sentence is the help of its option. usual: what happens by default,
        where the default does not say it."""
        return checked(self.default, self.check, declared=replace(self, text=text, usual=usual))

    @property
    def help(self) -> str:
        return self.text.partition(". ")[0]


def choice(default: str, literal: Any) -> Declared:
    choices = get_args(literal)
    kind = "{" + ", ".join(f'"{text}"' for text in choices) + "}"
    return Declared(default, partial(validation.choice, allowed=choices), kind, choices)


def flag(default: bool) -> Declared:
    return Declared(default, validation.flag, "bool")


def integer(default: int, least: int, most: int) -> Declared:
    check = partial(validation.integer, least=least, most=most)
    return Declared(default, check, f"int from {least} to {most}", (), int, f"{least}..{most}")


def number(default: float | None, form: str, unit: str = "", **limits: Any) -> Declared:
    """Declare a field that is a number. unit: such as degrees. limits: see `validation.number`."""
    words = validation.limits_of(**limits)
    kind = f"float, {unit}{words}" if unit else f"float{words}"
    check = partial(validation.number, **limits, expected=unit and unit + words)
    return Declared(default, check, kind, (), float, form)


def value(default: Any, kind: str, check: Check, form: str) -> Declared:
    """Declare a field of another kind, whose option is a text that `check` takes, unless its command knows better."""
    return Declared(default, check, kind, (), str, form)


def checked(default: Any, check: Check, **facts: Any) -> Any:
    """Declare a field whose docstring and options stand elsewhere. facts: by name, for `facts_of`."""
    return field(default=default, metadata={"check": check, **facts})


def required(*, check: Check) -> Any:
    """Declare a field without a default."""
    return field(metadata={"check": check})


if TYPE_CHECKING:

    @dataclass_transform(eq_default=False, frozen_default=True, field_specifiers=(required,))
    def record(kind: Kind) -> Kind: ...

else:

    def record(kind: Kind) -> Kind:
        """Make a frozen dataclass that compares by identity, whose declared fields are checked. Type checkers know what the
        constructor accepts from fields of type `Converted`, which those of a dataclass may be only with a default."""
        if not hasattr(kind, "__post_init__"):
            kind.__post_init__ = check_fields
        return dataclass(frozen=True, eq=False, repr=kind.__repr__ is object.__repr__)(kind)


def facts_of(kind: type[DataclassInstance], fact: str) -> dict[str, Any]:
    """Return a fact about each field that has it, by the fields' names, in their order."""
    return {item.name: item.metadata[fact] for item in fields(kind) if fact in item.metadata}


def check_fields(instance: DataclassInstance, owner: str = "") -> None:
    """Replace each declared field by what its check returns; a default of None stays. owner: for errors, by default the
    class. Raises InputError."""
    kind, values = type(instance), vars(instance)
    for name, check, default, checked_default in _checks(kind):
        value = values[name]
        values[name] = checked_default if value is default else check(owner or kind.__name__, name, value)


@cache
def _checks(kind: type[DataclassInstance]) -> list[tuple[str, Check, Any, Any]]:
    """Return name, check, default and checked default of the declared fields of a class."""
    checks = []
    for name, check in facts_of(kind, "check").items():
        default = kind.__dataclass_fields__[name].default
        checked_default = default if default in (None, MISSING) else check(kind.__name__, name, default)
        checks.append((name, check, default, checked_default))
    return checks


class Docstring:
    """The docstring of a dataclass with a section that describes its fields, made when it is read: that takes a while."""

    def __init__(self, text: str | None) -> None:
        self._text = inspect.cleandoc(text or "")

    def __get__(self, _instance: object, kind: type[DataclassInstance]) -> str:
        lines = [self._text, "", "Attributes", "----------"]
        for item in fields(kind):
            declared: Declared = item.metadata["declared"]
            default = declared.usual or ("" if item.default is None else repr(item.default))
            lines.append(f"{item.name} : {declared.kind}, " + (f"default {default}" if default else "optional"))
            text = declared.text[0].upper() + declared.text[1:].removesuffix(".") + "."
            lines += textwrap.wrap(text, 100, initial_indent="    ", subsequent_indent="    ")
        return "\n".join(lines)


def as_option(name: str, value: Any) -> str:
    """Return the option that gives a field this value, as one argument of a command."""
    option = name.replace("_", "-")
    if isinstance(value, bool):
        return f"--{option}" if value else f"--no-{option}"
    values = value if isinstance(value, tuple) else ("none" if value is None else value,)
    return f"--{option}=" + ",".join(repr(item) if isinstance(item, float) else str(item) for item in values)


def as_argument(path: str) -> str:
    """Return a path as an argument that no program takes for an option."""
    return os.path.join(os.curdir, path) if path.startswith("-") else path
