"""Public docstrings in numpydoc's layout: a one-line summary, and a section that names every parameter.

Numpydoc's own validation needs Sphinx, and neither it nor pydoclint reads `a, b : type` of several parameters.
"""

import dataclasses
import inspect
import re
import sys
from typing import Any

import clshade

MODULES = [clshade, clshade.course, clshade.errors, clshade.exr, clshade.farm, clshade.view]
RESULTS = [clshade.Frame, clshade.Views]  # users get these from functions: instead of parameters they have attributes
MARKS = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}


def names_in(doc: str, title: str) -> set[str] | None:
    """Return the names in a section of lines `a, b : type` or `a, b`; None without this section."""
    parts = re.split(r"^(\w[\w ]*)\n-+\n", doc + "\n", flags=re.MULTILINE)
    sections = dict(zip(parts[1::2], parts[2::2], strict=True))
    if title not in sections:
        return None
    heads = re.findall(r"^(\S.*?)(?: : .*)?$", sections[title], re.MULTILINE)
    return {name for head in heads for name in head.split(", ")}


def parameters(function: Any) -> dict[str, set[str]]:
    """Return the names of parameters, with `*` and `**`, and of `**` the keys of its TypedDict."""
    keys: dict[str, set[str]] = {}
    for parameter in inspect.signature(function).parameters.values():
        match = re.fullmatch(r"Unpack\[(\w+)\]", str(parameter.annotation))
        options = set(getattr(sys.modules[function.__module__], match[1]).__annotations__) if match else set()
        keys[MARKS.get(parameter.kind, "") + parameter.name] = options
    return {name: options for name, options in keys.items() if name != "self"}


def faults(subject: Any) -> list[str]:
    """Return what the docstring of a function, method, property or class lacks."""
    doc = inspect.cleandoc(subject.__doc__ or "")
    summary, *rest = doc.split("\n")
    lines = [] if summary.endswith(".") and not any(rest[:1]) else [f"no summary of one line: {summary}"]
    lines += [f"underline of {a}" for a, b in re.findall(r"^(\w.*)\n(-+)$", doc, re.MULTILINE) if len(a) != len(b)]
    if isinstance(subject, property):
        return lines
    if dataclasses.is_dataclass(subject) or subject in RESULTS:
        fields = {field.name for field in dataclasses.fields(subject)} if dataclasses.is_dataclass(subject) else set()
        names = names_in(doc, "Attributes")
        return [*lines, "no Attributes"] if names is None else lines + [f"{name} is missing" for name in fields - names]
    function = subject.__init__ if inspect.isclass(subject) else subject
    if not inspect.isroutine(function) or not hasattr(function, "__annotations__"):  # of an exception
        return lines
    names, taken = names_in(doc, "Parameters"), parameters(function)
    if names is None:
        return [*lines, "no Parameters"] if taken else lines
    for name, keys in taken.items():
        if name not in names and not (keys and keys <= names):
            lines.append(f"{name} is missing")
    return lines + [f"{name} is no parameter" for name in names - {*taken, *set().union(*taken.values())}]


def public() -> dict[str, Any]:
    """Return everything whose docstring users read, by its dotted name."""
    subjects: dict[str, Any] = {}
    for module in MODULES:
        for name in getattr(module, "__all__", vars(module)):
            value = getattr(module, name)
            if (inspect.isclass(value) or inspect.isfunction(value)) and value.__module__.startswith("clshade."):
                subjects[f"{module.__name__}.{name}"] = value
    for title, owner in [(title, value) for title, value in subjects.items() if inspect.isclass(value)]:
        for name, value in vars(owner).items():
            is_method = inspect.isfunction(value) or isinstance(value, (property, classmethod, staticmethod))
            if is_method and (not name.startswith("_") or name == "__getitem__"):
                subjects[f"{title}.{name}"] = value if isinstance(value, property) else getattr(owner, name)
    return subjects


def test_docstrings_say_what_their_subjects_take():
    names = "clshade.load", "clshade.Camera.from_fov", "clshade.Scene.face_count", "clshade.farm.Run.rate"
    subjects = public()
    assert set(names) <= set(subjects)
    assert {name: lines for name, subject in subjects.items() if (lines := faults(subject))} == {}
