"""Public docstrings in numpydoc's layout: a one-line summary, and a section that names every parameter."""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
from collections.abc import Iterator
from typing import Any

import pytest

import clshade

MODULES = [clshade.course, clshade.errors, clshade.exr, clshade.farm, clshade.view]
RESULTS = [clshade.Frame, clshade.Views]  # users get these from functions: instead of parameters they have attributes
MARKS = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}


def sections(doc: str) -> dict[str, str]:
    """Return the text below each underlined title."""
    parts = re.split(r"^(\w[\w ]*)\n-+\n", doc + "\n", flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def named_in(section: str) -> list[str]:
    """Return the names in a section: lines `a, b : type` or `a, b` at the left margin, with indented text below."""
    heads = re.findall(r"^(\S.*?)(?: : .*)?$", section, re.MULTILINE)
    return [name for head in heads for name in head.split(", ")]


def option_keys(function: Any, name: str) -> set[str]:
    """Return the keys of `**name`, if its annotation is Unpack of a TypedDict."""
    match = re.fullmatch(r"Unpack\[(\w+)\]", str(function.__annotations__.get(name)))
    return set(getattr(sys.modules[function.__module__], match[1]).__annotations__) if match else set()


def taken(function: Any) -> list[inspect.Parameter]:
    """Return the parameters of a function, or of a method without its first."""
    return [item for item in inspect.signature(function).parameters.values() if item.name != "self"]


def mismatches(function: Any, section: str) -> Iterator[str]:
    """Yield the parameters of a function that a section lacks, and the names in it that are no parameters."""
    rest = named_in(section)
    for item in taken(function):
        name = MARKS.get(item.kind, "") + item.name
        keys = option_keys(function, item.name) if name.startswith("**") else set()
        if name not in rest and not (keys and keys <= set(rest)):
            yield f"{name} is missing"
        rest = [other for other in rest if other != name and other not in keys]
    yield from (f"{name} is no parameter" for name in rest)


def faults(subject: Any) -> list[str]:
    """Return what the docstring of a function, method, property or class lacks."""
    if not subject.__doc__:
        return ["no docstring"]
    doc = inspect.cleandoc(subject.__doc__)
    summary, *rest = doc.split("\n")
    found = [f"no summary of one line: {summary}"] if not summary.endswith(".") or any(rest[:1]) else []
    found += [
        f"underline of {title}" for title, line in re.findall(r"^(\w.*)\n(-+)$", doc, re.M) if len(title) != len(line)
    ]
    if isinstance(subject, property):
        return found
    parts, title, function = sections(doc), "Parameters", subject
    if dataclasses.is_dataclass(subject) or subject in RESULTS:
        title = "Attributes"
        names = [field.name for field in dataclasses.fields(subject)] if dataclasses.is_dataclass(subject) else []
        lacking = [f"{name} is missing" for name in names if name not in named_in(parts.get(title, ""))]
        return found + lacking + ([] if title in parts else ["no Attributes"])
    if inspect.isclass(subject):
        function = subject.__init__
        if not inspect.isfunction(function):  # of an exception, which takes a message
            return found
    if title not in parts and taken(function):
        return [*found, "no Parameters"]
    return found + list(mismatches(function, parts.get(title, "")))


def public() -> dict[str, Any]:
    """Return everything whose docstring users read, by its dotted name."""
    found: dict[str, Any] = {}
    for module in [clshade, *MODULES]:
        for name in getattr(module, "__all__", vars(module)):
            value = getattr(module, name)
            if (inspect.isclass(value) or inspect.isfunction(value)) and value.__module__.startswith("clshade."):
                found[f"{module.__name__}.{name}"] = value
    for title, owner in [(title, value) for title, value in found.items() if inspect.isclass(value)]:
        for name, value in vars(owner).items():
            if name.startswith("_") and name != "__getitem__":
                continue
            if inspect.isfunction(value) or isinstance(value, (property, classmethod, staticmethod)):
                found[f"{title}.{name}"] = value if isinstance(value, property) else getattr(owner, name)
    return found


PUBLIC = public()


def test_all_that_is_public_is_looked_at():
    assert {
        "clshade.load",
        "clshade.Camera",
        "clshade.Camera.from_fov",
        "clshade.Scene.face_count",
        "clshade.Frame.__getitem__",
        "clshade.course.light",
        "clshade.errors.InputError",
        "clshade.exr.read",
        "clshade.farm.Run.rate",
    } <= set(PUBLIC)
    names = [name for name in clshade.__all__ if name != "__version__"]
    assert {name for name in names if f"clshade.{name}" not in PUBLIC} == {m.__name__.split(".")[1] for m in MODULES}


@pytest.mark.parametrize("name", PUBLIC)
def test_a_docstring_says_what_its_subject_takes(name):
    assert faults(PUBLIC[name]) == []


@pytest.mark.parametrize("module", [clshade, *MODULES], ids=lambda module: module.__name__)
def test_a_module_has_a_summary(module):
    summary, *rest = module.__doc__.split("\n")
    assert summary.endswith(".")
    assert not any(rest[:1])


# The checker itself: docstrings without a fault, and each fault planted into one of them.


def painted(scene, size=1, *others, lamp=False, **settings):
    """Paint a scene.

    Parameters
    ----------
    scene, size : Scene or int
        What to paint, and
        how large : a number.
    *others
        More.
    lamp : bool, default False
        Whether the light is on.
    **settings
        The rest.

    Returns
    -------
    Frame
    """


@dataclasses.dataclass
class Point:
    """A point.

    Attributes
    ----------
    x, y : float
        Where it lies.
    """

    x: float
    y: float = 0.0

    def moved(self, by):
        """Return the point moved.

        Parameters
        ----------
        by : float
            How far.
        """

    @classmethod
    def origin(cls, name):
        """Return the origin.

        Parameters
        ----------
        name : str
            Its name.
        """

    @property
    def length(self):
        """Distance from the origin."""


class Pen:
    """A pen.

    Parameters
    ----------
    width : float
        In pixels.
    """

    def __init__(self, width):
        self.width = width

    def lift(self):
        """Lift the pen."""


SOUND = [painted, Point, Point.moved, Point.origin, Point.length, Pen, Pen.lift]


def test_sound_docstrings_have_no_fault():
    assert [faults(subject) for subject in SOUND] == [[]] * len(SOUND)


@pytest.mark.parametrize(
    ("subject", "old", "new", "fault"),
    [
        (painted, "Paint a scene.", "Paint a scene", "no summary of one line: Paint a scene"),
        (painted, "Paint a scene.\n", "Paint a scene.\nOr two.\n", "no summary of one line: Paint a scene."),
        (painted, "scene, size :", "scene :", "size is missing"),
        (painted, "scene, size : Scene or int", "scene", "size is missing"),
        (painted, "lamp :", "lamps :", "lamp is missing"),
        (painted, "lamp :", "lamp, color :", "color is no parameter"),
        (painted, "*others\n", "others\n", "*others is missing"),
        (painted, "**settings", "settings", "**settings is missing"),
        (painted, "Parameters\n----------", "Arguments\n---------", "no Parameters"),
        (painted, "Parameters\n----------", "Parameters", "no Parameters"),
        (painted, "Parameters\n----------", "Parameters\n---------", "underline of Parameters"),
        (Point, "x, y :", "x :", "y is missing"),
        (Point, "Attributes\n----------", "Parameters\n----------", "no Attributes"),
        (Point.moved, "by :", "to :", "by is missing"),
        (Point.moved, "by :", "self, by :", "self is no parameter"),
        (Point.origin, "name :", "cls, name :", "cls is no parameter"),
        (Point.length, "origin.", "origin", "no summary of one line: Distance from the origin"),
        (Pen, "width :", "color :", "width is missing"),
        (Pen.lift, "Lift the pen.", "", "no docstring"),
    ],
)
def test_a_planted_fault_is_seen(subject, old, new, fault, monkeypatch):
    holder = getattr(subject, "__func__", subject)
    doc = inspect.cleandoc(holder.__doc__)
    assert doc.count(old) == 1
    monkeypatch.setattr(holder, "__doc__", doc.replace(old, new))
    assert fault in faults(subject)


def test_options_may_be_named_by_their_keys(monkeypatch):
    method = clshade.Settings.from_preset
    doc = inspect.cleandoc(method.__doc__)
    keys = list(clshade.Settings.__dataclass_fields__)
    monkeypatch.setattr(method.__func__, "__doc__", doc.replace("**fields", "\n".join(keys)))
    assert faults(method) == []
    monkeypatch.setattr(method.__func__, "__doc__", doc.replace("**fields", "\n".join(keys[1:])))
    assert faults(method) == ["**fields is missing"]
