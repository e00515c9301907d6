"""The subpackages ("rooms"): every import of every module, of any kind, follows the dependency order, without
cycles."""

from __future__ import annotations

import ast
import re
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "clshade"
TOP = {"pyproject.toml", "README.md", "clshade", "kernels", "demos", "tests"}

# room -> the parts of clshade that it may import, besides itself and clshade.errors
CHAIN = {
    "base": "",
    "images": "base",
    "scene": "base images",
    "oracle": "base.arrays base.validation scene.camera scene.environment scene.geometry scene.image_light scene.lights"
    " scene.model scene.scalar_colors",
    "pipeline": "base images scene",
    "course": "base images scene pipeline",
    "farm": "base images scene pipeline",
    "view": "base images scene pipeline farm",
    "measure": "base images scene oracle pipeline course",
    "cli": "root base images scene oracle pipeline course farm view measure",
}
AT_THE_ROOT = {"__init__", "__main__", "errors", "exr"}  # they may import everything; errors imports nothing
MOST_ROOMS, MOST_FILES = 10, 6
OPENCL = {
    "measure.conform.bare_kernel",
    "pipeline.programs",
    "pipeline.buffers",
    "pipeline.launches",
    "pipeline.renderer",
    "pipeline.opencl.device",
    "pipeline.opencl.probe",
    "pipeline.opencl.environment",
}

Modules = dict[str, str]  # dotted name relative to clshade, "" for clshade itself -> source


def module_name(path: Path) -> str:
    """Return a path's module name: `oracle.shade` for clshade/oracle/shade.py, `oracle` for its package, "" for
    clshade."""
    parts = list(path.relative_to(PACKAGE).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


PATHS = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}
SOURCES: Modules = {name: path.read_text() for name, path in PATHS.items()}
PACKAGES = {name for name, path in PATHS.items() if path.name == "__init__.py"}


class ComputedImport(Exception):
    """An import whose module is only known at run time."""


def literal_tables(tree: ast.Module) -> dict[str, list[str]]:
    """Return the strings in the values of each dict assigned at module level, by the dict's name."""
    found = {}
    for node in tree.body:
        target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
        if isinstance(target, ast.Name) and isinstance(getattr(node, "value", None), ast.Dict):
            inner = [part for value in node.value.values for part in ast.walk(value)]
            found[target.id] = [p.value for p in inner if isinstance(p, ast.Constant) and isinstance(p.value, str)]
    return found


def package_in(text: ast.JoinedStr) -> str | None:
    """Return the package whose module an f-string such as f"clshade.cli.{name}" names, None for another one."""
    match = re.fullmatch(r"f'clshade((?:\.\w+)*)\.{\w+}'", ast.unparse(text))
    return match[1].lstrip(".") if match else None


def by_name(tree: ast.Module) -> set[str]:
    """Return modules imported by names in strings: a literal, any of a table of literals, or any of a package.

    Raises ComputedImport for a name that is computed or relative, and for code run from strings.
    """
    tables, found = literal_tables(tree), set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if called in ("__import__", "spec_from_file_location", "run_module", "run_path") and "clshade" not in "".join(
            part.value for part in ast.walk(node) if isinstance(part, ast.Constant) and isinstance(part.value, str)
        ):
            raise ComputedImport(ast.unparse(node))
        if isinstance(node.func, ast.Name) and called in ("exec", "eval"):
            raise ComputedImport(ast.unparse(node))
        if called not in ("import_module", "__import__"):
            continue
        named = node.args[0]
        flat = named
        while isinstance(flat, ast.Subscript) and isinstance(flat.value, ast.Subscript):
            flat = flat.value
        if isinstance(named, ast.Constant) and not named.value.startswith("."):
            found.add(named.value)
        elif isinstance(named, ast.JoinedStr) and package_in(named) in PACKAGES - {""}:
            found |= {f"clshade.{name}" for name in SOURCES if name.rpartition(".")[0] == package_in(named)}
        elif isinstance(flat, ast.Subscript) and isinstance(flat.value, ast.Name) and flat.value.id in tables:
            found |= {text for text in tables[flat.value.id] if re.fullmatch(r"clshade(\.\w+)*", text)}
        else:
            raise ComputedImport(ast.unparse(node))
    return found


@cache
def imports(module: str, source: str) -> frozenset[str]:
    """Return all imports of a module: at module level, in functions, for type checkers only and by names in strings.

    Own modules are given as `.name` ("." for clshade itself), others by their top-level name.
    """
    tree = ast.parse(source)
    full = by_name(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            full |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = ["clshade", *(module.split(".") if module else [])]
                above = node.level - (1 if module in PACKAGES or module == "" else 0)
                base = ".".join([*parts[: len(parts) - above], *([base] if base else [])])
            inner = {f"{base}.{alias.name}" for alias in node.names}
            known = {name for name in inner if name.removeprefix("clshade.") in SOURCES and name.startswith("clshade.")}
            full |= known | ({base} if inner - known else set())
    own = {name for name in full if name.split(".")[0] == "clshade"}
    others = {name.split(".")[0] for name in full - own} - {"__future__"}
    return frozenset({f".{name[8:]}" for name in own} | others)


def room_of(module: str) -> str:
    return module.split(".")[0] if module.split(".")[0] in CHAIN else "root"


def allowed(module: str) -> list[str]:
    """Return the rooms and modules of clshade that a module may import."""
    room = room_of(module)
    parts = module.split(".")
    inner = [".".join(parts[:k]) for k in range(1, len(parts) + 1)]
    return ["errors", room, *" ".join(CHAIN.get(name, "") for name in inner).split()]


def is_allowed(module: str, imported: str) -> bool:
    if room_of(module) == "root":
        return module != "errors"
    if room_of(imported) == "root" and imported != "errors":
        return "root" in allowed(module)
    return any(imported == name or imported.startswith(f"{name}.") for name in allowed(module))


def upwards(modules: Modules) -> list[str]:
    """Return the imports that violate the dependency order."""
    found = []
    for module, source in modules.items():
        for name in sorted(imports(module, source)):
            if name.startswith(".") and not is_allowed(module, name[1:]):
                found.append(f"{module or 'clshade'} -> {name}")
    return found


def circles(modules: Modules) -> list[set[str]]:
    """Return groups of modules that import each other in cycles (Tarjan's strongly connected components)."""
    edges = {m: {n[1:] for n in imports(m, s) if n.startswith(".") and n[1:] in modules} for m, s in modules.items()}
    number: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(module: str) -> None:
        number[module] = lowest[module] = len(number)
        stack.append(module)
        for other in sorted(edges[module]):
            if other not in number:
                visit(other)
            if other in stack:
                lowest[module] = min(lowest[module], lowest[other])
        if lowest[module] == number[module]:
            group = set()
            while module not in group:
                group.add(stack.pop())
            if len(group) > 1 or module in edges[module]:
                found.append(group)

    for module in modules:
        if module not in number:
            visit(module)
    return found


@pytest.mark.long
def test_every_import_runs_down_the_chain():
    assert upwards(SOURCES) == []


def test_no_imports_run_in_a_circle():
    assert circles(SOURCES) == []


# Each kind of import, planted into a copy of the sources: a check that misses them could never fail.
KINDS = {
    "at the top": "from ..{room} import {leaf}\n",
    "absolute": "import clshade.{room}.{leaf}\n",
    "absolute from": "from clshade.{room} import {leaf} as other\n",
    "of one name": "from ..{room}.{leaf} import anything\n",
    "in a function": "def f():\n    from ..{room} import {leaf}\n",
    "in a method": "class C:\n    async def f(self):\n        if self:\n            import clshade.{room}.{leaf} as other\n",
    "for type checkers": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from ..{room} import {leaf}\n",
    "by its name": "import importlib\ndef f():\n    importlib.import_module('clshade.{room}.{leaf}')\n",
    "by its name in a table": (
        "from importlib import import_module\nT = {{'x': ('clshade.{room}.{leaf}', 1)}}\n"
        "def f(k):\n    return import_module(T[k][0])\n"
    ),
    "by __import__": "x = __import__('clshade.{room}.{leaf}')\n",
}


FORBIDDEN = [
    ("base.validation", "scene", "model"),
    ("images.png", "scene", "camera"),
    ("scene.model", "view", "notebook"),
    ("oracle.shade", "pipeline", "features"),
    ("oracle.shade", "scene", "framing"),
    ("pipeline.frame", "measure.check", "check"),
    ("measure.check.check", "farm", "frames"),
    ("farm.frames", "cli", "main"),
]


@pytest.mark.sampled
@pytest.mark.parametrize("kind", KINDS)
def test_a_planted_import_is_seen(kind):
    for module, room, leaf in FORBIDDEN:
        planted = KINDS[kind].format(room=room, leaf=leaf)
        planted = planted.replace("from ..", "from " + "." * (module.count(".") + 1))
        found = upwards({**SOURCES, module: f"{SOURCES[module]}\n{planted}"})
        assert found == [f"{module} -> .{room}.{leaf}"]


def test_a_planted_import_of_any_module_of_a_package_is_seen():
    planted = "from importlib import import_module\ndef f(k):\n    import_module(f'clshade.farm.{k}')\n"
    found = upwards({"base.validation": planted})
    assert found == sorted(f"base.validation -> .{name}" for name in SOURCES if name.startswith("farm."))


@pytest.mark.parametrize(
    "planted",
    [
        "import_module(f'clshade.{x}')",
        "import_module(f'clshade.none.{x}')",
        "import_module(f'clshade.farm.{x}.{x}')",
        "import_module('.showing', __package__)",
        "importlib.import_module(name)",
        "import_module('clshade.' + name)",
        "__import__(name)",
        "exec('import ' + 'clshade.cli')",
        "eval(text)",
    ],
)
def test_a_computed_import_is_refused(planted):
    with pytest.raises(ComputedImport):
        upwards({**SOURCES, "base.validation": planted})


def test_planted_circles_are_seen():
    camera = SOURCES["scene.camera"] + "\ndef f():\n    from . import model\n"
    assert circles({**SOURCES, "scene.camera": camera}) == [{"scene.camera", "scene.model"}]
    (group,) = circles({**SOURCES, "base.validation": "from ..cli import main\n"})
    assert {"base.validation", "cli.main", "pipeline.renderer"} <= group


def test_what_the_chain_allows():
    assert is_allowed("cli.main", "")
    assert is_allowed("oracle.frame", "oracle.shade")
    assert not is_allowed("oracle.frame", "base.console")
    assert not is_allowed("scene.model", "")
    assert not is_allowed("errors", "base")


# Rooms and files


def test_rooms_are_few_and_each_has_a_sentence():
    rooms = {name for name in PACKAGES if name and "." not in name}
    assert rooms == {name for name in CHAIN if "." not in name}
    assert len(rooms) <= MOST_ROOMS
    files = [path for path in PACKAGE.iterdir() if path.is_file()]
    assert {path.stem for path in files if path.suffix == ".py"} == AT_THE_ROOT
    assert len(files) <= MOST_FILES
    for name in PACKAGES:
        assert ast.get_docstring(ast.parse(SOURCES[name])), name


def test_every_module_lies_in_a_package_that_is_installed():
    folders = {".".join(path.relative_to(ROOT).parent.parts) for path in PATHS.values()}
    (block,) = re.findall(r"^packages = \[(.*?)\]", (ROOT / "pyproject.toml").read_text(), re.MULTILINE | re.DOTALL)
    listed = set(re.findall(r'"([\w.]+)"', block))
    assert listed == folders | {"clshade.kernels"}
    assert folders == {f"clshade.{name}".rstrip(".") for name in PACKAGES}


def test_the_top_level_is_as_small_as_it_can_be():
    """Beside what .gitignore names, such as pictures that somebody rendered here."""
    ignored = [line.strip("/") for line in (ROOT / ".gitignore").read_text().split()]
    found = {path.name for path in ROOT.iterdir() if not any(fnmatch(path.name, pattern) for pattern in ignored)}
    assert {name for name in found if not name.startswith(".")} == TOP


# What other packages may be imported where


def test_the_oracle_imports_only_numpy_and_the_standard_library():
    others = {name for module in SOURCES if room_of(module) == "oracle" for name in imports(module, SOURCES[module])}
    standard = {"collections", "dataclasses", "fractions", "functools", "math", "typing", "weakref"}
    assert {name for name in others if not name.startswith(".")} <= {"numpy", *standard}


@pytest.mark.parametrize("module", [name for name in PATHS if name.split(".")[0] == "oracle"])
def test_the_oracle_never_reads_the_kernels(module):
    tree = ast.parse(SOURCES[module])
    calls = {node.func.id for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    assert not calls & {"open", "__import__", "exec", "eval", "compile"}
    strings = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    with_docs = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docs = {ast.get_docstring(node, clean=False) for node in ast.walk(tree) if isinstance(node, with_docs)}
    assert not [s for s in strings if s not in docs and re.search(r"kernels?\b|\.clh?\b", s)]


def test_pyopencl_is_imported_by_few_modules_only():
    users = {module for module, source in SOURCES.items() if "pyopencl" in imports(module, source)}
    assert users <= OPENCL
    assert users


def test_modules_of_commands_do_not_import_each_other():
    """Except `verify`, which reads commands of `render`."""
    from clshade.cli import main

    homes = {home.removeprefix("clshade.") for home in main._MODULES.values()}
    assert main._MODULES.keys() == main.COMMANDS.keys()
    for home in homes:
        assert not imports(home, SOURCES[home]) & {f".{other}" for other in homes - {home}} - (
            {".cli.render"} if home == "cli.checking" else set()
        )


def test_only_main_imports_the_command_line():
    users = {name for name, source in SOURCES.items() if ".cli.main" in imports(name, source)}
    assert users == {"__main__"}


def test_no_module_has_the_name_of_a_public_function():
    """`import clshade.load` would otherwise replace the function by the module."""
    import clshade

    functions = {name for name, home in clshade._HOMES.items() if home != f"clshade.{name}"}
    assert not functions & {name.split(".")[0] for name in PATHS}
    assert {"load", "render", "builtin"} <= functions


# Tests


def test_tests_mirror_the_rooms():
    """test_kernel_*.py and tests of the whole repository are beside the rooms' folders; no test imports a test."""
    tests = ROOT / "tests"
    folders = {path.name for path in tests.iterdir() if path.is_dir() and list(path.glob("test_*.py"))}
    assert folders <= {"fuzz", *(name for name in CHAIN if "." not in name)}
    whole = {"docstrings", "house", "imports", "kernel_sources", "mutants", "readme", "typing"}
    beside = {path.stem.removeprefix("test_") for path in tests.glob("test_*.py")}
    assert {name for name in beside if not name.startswith("kernel_")} <= whole
    for path in tests.rglob("*.py"):
        names = re.findall(r"^\s*(?:from|import) (test_\w+|conftest)", path.read_text(), re.MULTILINE)
        assert not [name for name in names if name != "test_typing"], path
    helpers = {path.stem for path in (tests / "support").glob("*.py")}
    assert not helpers & {path.name for path in ROOT.iterdir()}


def test_files_of_tests_have_names_of_their_own():
    """pytest imports them by these names, and collects nothing if two are the same."""
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))
