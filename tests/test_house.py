"""Imports by name, which import-linter does not see, and their cost; public names; folders and packages."""

import ast
import re
from fnmatch import fnmatch
from operator import attrgetter

import pytest
from processes import ROOT, python

import clshade
from clshade.cli import main

PACKAGE = ROOT / "clshade"
SOURCES = {str(path.relative_to(PACKAGE)): path.read_text() for path in PACKAGE.rglob("*.py")}
ROOMS = {"base", "images", "scene", "oracle", "pipeline", "course", "farm", "view", "measure", "cli"}

# Modules that import by names from tables: of lazy attributes, of commands, of readers; and one that imports early.
BY_NAME = {
    "__init__.py": "_HOMES[name]",
    "view/__init__.py": "_HOMES[name]",
    "cli/main.py": "_MODULES[name]",
    "scene/formats/table.py": "_MODULES[self.name]",
    "course/demo.py": "matplotlib.ft2font",
}


def test_few_modules_import_by_name_and_their_tables_name_what_their_rooms_may_import():
    calls = re.compile(r"\b(import_module|__import__|run_module|run_path|spec_from_file_location|exec|eval)\b\(?")
    plain = {name: re.sub(r"literal_eval|import import_module", "", source) for name, source in SOURCES.items()}
    assert {name for name, source in plain.items() if calls.search(source)} == set(BY_NAME)
    assert all(argument in SOURCES[name] for name, argument in BY_NAME.items())
    assert {home.split(".")[1] for home in clshade.view._HOMES.values()} == {"view"}
    assert {home.split(".")[1] for home in main._MODULES.values()} == {"cli"}
    assert main._MODULES.keys() == main.COMMANDS.keys()


def test_every_package_is_installed_and_has_a_sentence():
    packages = {".".join(path.parent.relative_to(ROOT).parts) for path in PACKAGE.rglob("__init__.py")}
    (block,) = re.findall(r"^packages = \[(.*?)\]", (ROOT / "pyproject.toml").read_text(), re.MULTILINE | re.DOTALL)
    assert set(re.findall(r'"([\w.]+)"', block)) == packages | {"clshade.kernels"}
    assert {name.split(".")[1] for name in packages if "." in name} == ROOMS
    assert all(ast.get_docstring(ast.parse(source)) for name, source in SOURCES.items() if name.endswith("__init__.py"))


def test_the_top_level_is_as_small_as_it_can_be():
    """Beside what .gitignore names, such as pictures that somebody rendered here."""
    ignored = [line.strip("/") for line in (ROOT / ".gitignore").read_text().split()]
    names = {path.name for path in ROOT.iterdir() if not any(fnmatch(path.name, pattern) for pattern in ignored)}
    visible = {name for name in names if not name.startswith(".")}
    assert visible == {"pyproject.toml", "README.md", "clshade", "kernels", "demos", "tests"}


def test_the_oracle_never_reads_the_kernels():
    """It imports nothing that reads files; without `open` it shares no text with them."""
    for name, source in SOURCES.items():
        if name.startswith("oracle/"):
            assert not re.search(r"\b(open|read_text|read_bytes|fromfile|loadtxt)\(", source), name


def test_every_public_name_can_be_had_and_is_seen_by_type_checkers():
    assert all(getattr(clshade, name) is not None for name in clshade.__all__)
    assert dir(clshade) == sorted(clshade.__all__)
    (block,) = (node for node in ast.parse(SOURCES["__init__.py"]).body if isinstance(node, ast.If))
    relative = [(alias.asname, node.module) for node in block.body for alias in node.names if node.level]
    assert {name: f"clshade.{module or name}" for name, module in relative} == clshade._HOMES
    assert (PACKAGE / "py.typed").is_file()
    assert "py.typed" in (ROOT / "pyproject.toml").read_text()
    with pytest.raises(AttributeError) as caught:
        clshade.rendr  # noqa: B018
    assert (caught.value.name, caught.value.obj) == ("rendr", clshade)  # used for the hint of a traceback


def test_no_module_has_the_name_of_a_public_function():
    """`import clshade.load` would otherwise replace the function by the module."""
    functions = {name for name, home in clshade._HOMES.items() if home != f"clshade.{name}"}
    assert {"load", "render", "builtin"} <= functions
    assert not functions & {name.split("/")[0].removesuffix(".py") for name in SOURCES}


def test_every_path_of_the_documents_can_be_had():
    text = "\n".join(path.read_text() for path in [ROOT / "README.md", *PACKAGE.rglob("README.md")])
    paths = set(re.findall(r"\bclshade((?:\.[A-Za-z_]\w*)+)", re.sub(r"-m clshade\S*|github\S*", "", text)))
    assert {".farm.draw_frames", ".exr.read", ".load"} <= paths
    attrgetter(*(path[1:] for path in sorted(paths)))(clshade)


HEAVY = ("numpy", "pyopencl", "OpenEXR", "matplotlib", "PIL", "trimesh", "scipy", "dask", "distributed")
# Commands whose settings have the choices of scene.py.
DRAWING = ("render", "turntable", "animate", "poster", "grade", "report", "stability", "bench", "view")
PARSERS = "from clshade.cli import main; [main._parser([name]) for name in main.COMMANDS if name {} {}]"


@pytest.mark.parametrize(
    ("code", "allowed"),
    [
        ("import clshade", ()),
        ("import clshade; clshade.Scene, clshade.load, clshade.builtin, clshade.exr.read, clshade.view", ("numpy",)),
        ("import clshade; clshade.course.light, clshade.farm.draw_frames", ("numpy", "pyopencl")),
        (PARSERS.format("not in", DRAWING), ()),
        (PARSERS.format("in", DRAWING), ("numpy",)),
    ],
)
def test_importing_costs_nothing_that_is_not_used(code, allowed):
    shown = f"{code}; import sys; print(*(n for n in {HEAVY} if n in sys.modules))"
    done = python(shown, "")
    assert done.returncode == 0, done.stderr
    assert set(done.stdout.split()) <= set(allowed)
