"""What import-linter's contracts in pyproject.toml do not see: imports by name, packages that are installed, folders."""

from __future__ import annotations

import ast
import re
from fnmatch import fnmatch
from pathlib import Path

import clshade
from clshade.cli import main

ROOT = Path(__file__).resolve().parent.parent
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


def test_few_modules_import_by_name():
    calls = re.compile(r"\b(import_module|__import__|run_module|run_path|spec_from_file_location|exec|eval)\b\(?")
    users = {
        name
        for name, source in SOURCES.items()
        if calls.search(re.sub(r"literal_eval|import import_module", "", source))
    }
    assert users == set(BY_NAME)
    for name, argument in BY_NAME.items():
        assert argument in SOURCES[name], name


def test_tables_name_modules_that_their_rooms_may_import():
    homes = {*clshade._HOMES.values(), *main._MODULES.values(), *clshade.view._HOMES.values()}
    for home in homes:
        assert (PACKAGE / (home.removeprefix("clshade.").replace(".", "/") + ".py")).is_file() or home.count(".") == 1
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


def test_no_module_has_the_name_of_a_public_function():
    """`import clshade.load` would otherwise replace the function by the module."""
    functions = {name for name, home in clshade._HOMES.items() if home != f"clshade.{name}"}
    assert {"load", "render", "builtin"} <= functions
    assert not functions & {name.split("/")[0].removesuffix(".py") for name in SOURCES}


def test_the_oracle_never_reads_the_kernels():
    """It imports nothing that reads files; without `open` it shares no text with them."""
    for name, source in SOURCES.items():
        if name.startswith("oracle/"):
            assert not re.search(r"\b(open|read_text|read_bytes|fromfile|loadtxt)\(", source), name
