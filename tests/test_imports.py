"""Public names, and the cost of importing them."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import clshade

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "clshade"


def test_every_public_name_can_be_had():
    for name in clshade.__all__:
        assert getattr(clshade, name) is not None
    with pytest.raises(AttributeError, match="no_such_name"):
        clshade.no_such_name  # noqa: B018


HEAVY = ("numpy", "pyopencl", "OpenEXR", "matplotlib", "PIL", "trimesh", "scipy", "dask", "distributed")
MODULES = ("course", "errors", "exr", "farm", "view")
DOCUMENTED = {
    "course": (
        *("arguments", "bilerp", "calculate_normals", "gouraud_shading", "light", "release", "render_object"),
        *("render_object_map", "save", "shade_gouraud", "shade_phong"),
    ),
    "errors": ("ClshadeError", "DeviceError", "InputError", "OutputError", "WorkerError"),
    "exr": ("read", "write", "encode", "flatten"),
    "farm": ("draw_frames", "orbit", "parse_frames", "read_cameras", "Run"),
    "view": ("Film", "Sheet", "draw_film", "draw_sheet"),
}


def python(code: str) -> str:
    """Return the output of a new interpreter; fail the test if it ends with an error."""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.sampled
@pytest.mark.parametrize("module", MODULES)
def test_a_module_is_an_attribute_after_the_plain_import(module):
    """In a new interpreter, where nothing else has imported it; no heavy module is imported with it."""
    names = DOCUMENTED[module]
    shown = f"import sys, clshade; print(*(callable(getattr(clshade.{module}, n)) for n in {names}))"
    assert set(python(shown).split()) == {"True"}
    heavy = f"import sys, clshade; clshade.{module}; print(*(n for n in {HEAVY} if n in sys.modules))"
    drawing = {"pyopencl"} if module in ("course", "farm") else set()
    assert set(python(heavy).split()) <= {"numpy"} | drawing


def test_public_names_are_listed_and_seen_by_type_checkers():
    assert dir(clshade) == sorted(clshade.__all__)
    assert set(MODULES) == {name for name, home in clshade._HOMES.items() if home == f"clshade.{name}"}
    tree = ast.parse((PACKAGE / "__init__.py").read_text())
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    relative = [(alias.asname, node.module) for node in block.body for alias in node.names if node.level]
    assert {name: f"clshade.{module or name}" for name, module in relative} == clshade._HOMES
    assert (PACKAGE / "py.typed").is_file()
    assert "py.typed" in (ROOT / "pyproject.toml").read_text()


def test_every_path_of_the_documents_can_be_had():
    """Except in the list of changes, which names former ones."""
    documents = [ROOT / "README.md", *PACKAGE.rglob("README.md")]
    text = "\n".join(path.read_text() for path in documents)
    paths = set(re.findall(r"\bclshade((?:\.[A-Za-z_]\w*)+)", re.sub(r"-m clshade\S*|github\S*", "", text)))
    assert {".farm.draw_frames", ".exr.read", ".load"} <= paths
    for path in sorted(paths):
        target: object = clshade
        for name in path[1:].split("."):
            target = getattr(target, name)


def test_a_misspelt_name_is_answered_with_the_nearest():
    with pytest.raises(AttributeError) as caught:
        clshade.rendr  # noqa: B018
    assert (caught.value.name, caught.value.obj) == ("rendr", clshade)  # used for the hint of a traceback


DRAWING = (
    "render",
    "turntable",
    "animate",
    "poster",
    "grade",
    "report",
    "stability",
    "bench",
    "view",
)  # whose settings have the choices of scene.py


@pytest.mark.parametrize(
    ("code", "allowed"),
    [
        ("import clshade", ()),
        ("import clshade; clshade.Scene, clshade.load, clshade.builtin", ("numpy",)),
        ("import clshade.cli.main", ()),
        (
            f"from clshade.cli import main; [main._parser([name]) for name in main.COMMANDS if name not in {DRAWING}]",
            (),
        ),
        (f"from clshade.cli import main; [main._parser([name]) for name in {DRAWING}]", ("numpy",)),
    ],
)
def test_importing_costs_nothing_that_is_not_used(code, allowed):
    shown = f"{code}; import sys; print(*(n for n in {HEAVY} if n in sys.modules))"
    done = subprocess.run([sys.executable, "-c", shown], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert set(done.stdout.split()) <= set(allowed)
