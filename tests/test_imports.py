"""Who may import whom (DESIGN section 1), read from the sources; and what `import clshade` costs."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import clshade
from clshade.cli import main
from clshade.pipeline import struct_layout

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "clshade"
KERNELS = sorted((ROOT / "kernels").glob("*.cl*"))


def module_name(path: Path) -> str:
    """`oracle.shade` of clshade/oracle/shade.py, `oracle` of its package; "" of clshade itself."""
    parts = list(path.relative_to(PACKAGE).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


PATHS = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def import_nodes(tree: ast.AST) -> list[ast.Import | ast.ImportFrom]:
    """All imports, in functions too, but not those for type checkers alone."""
    found: list[ast.Import | ast.ImportFrom] = []
    for child in ast.iter_child_nodes(tree):
        if is_type_checking(child):
            continue
        if isinstance(child, (ast.Import, ast.ImportFrom)):
            found.append(child)
        found += import_nodes(child)
    return found


def names_of(node: ast.Import | ast.ImportFrom, module: str, is_package: bool) -> set[str]:
    """What one statement imports: own modules as `.name`, others by their top-level name."""
    if isinstance(node, ast.Import):
        full = [alias.name for alias in node.names]
        own = {f".{name.removeprefix('clshade').lstrip('.')}" for name in full if name.split(".")[0] == "clshade"}
        return own | {name.split(".")[0] for name in full if name.split(".")[0] != "clshade"}
    base = node.module or ""
    if node.level:
        parts = module.split(".") if module else []
        parts = parts[: len(parts) - (node.level - (1 if is_package else 0))]
        base = ".".join([*parts, base] if base else parts)
    elif base.split(".")[0] != "clshade":
        return {base.split(".")[0]}
    else:
        base = base.removeprefix("clshade").lstrip(".")
    # `from . import name` and `from .package import name` may name modules.
    inner = {f"{base}.{alias.name}".lstrip(".") for alias in node.names}
    modules = {name for name in inner if name in PATHS}
    return {f".{name}" for name in modules} | ({f".{base}"} if not modules or (base in PATHS and base) else set())


@cache
def imports(module: str) -> frozenset[str]:
    """Everything a module imports itself."""
    path = PATHS[module]
    tree = ast.parse(path.read_text())
    is_package = path.name == "__init__.py"
    found = [names_of(node, module, is_package) for node in import_nodes(tree)]
    return frozenset(set().union(*found)) - {"__future__"}


def reaches(module: str) -> dict[str, str]:
    """All that a module imports, itself or through other modules of clshade -> the module that does it."""
    found: dict[str, str] = {}
    todo = [module]
    while todo:
        current = todo.pop()
        for name in imports(current):
            if name not in found:
                found[name] = current
                if name.startswith(".") and name[1:] in PATHS and name != ".":
                    todo.append(name[1:])
    return found


def test_the_reader_of_imports_sees_what_is_there():
    """It finds relative, absolute, late and nested imports; it would not notice anything below otherwise."""
    assert {".layout", ".device", "numpy"} <= imports("stages")
    assert {"pyopencl", ".device"} <= imports("programs")  # pyopencl inside a function
    assert ".oracle.frame" in imports("oracle")
    assert {".scene", ".oracle.shade", ".oracle.vectors"} <= imports("oracle.pixels")
    assert ".cli" in imports("__main__")
    assert "pyopencl" in reaches("renderer")
    assert ".memory" in reaches("commands.render")
    source = "def f():\n    from ..device import Device\nif TYPE_CHECKING:\n    import pyopencl\n"
    found = [names_of(node, "oracle.made_up", False) for node in import_nodes(ast.parse(source))]
    assert found == [{".device"}]


# The rules


ORACLE = [name for name in PATHS if name.split(".")[0] == "oracle"]
ON_THE_DEVICE = ("device", "programs", "stages", "renderer", "memory", "runtimes", "probing")
OPENCL = {"device", "runtimes", "probing", "programs", "stages", "renderer"}


@pytest.mark.parametrize("module", ORACLE)
def test_the_oracle_imports_only_numpy_the_scene_and_errors(module):
    allowed = {"numpy", ".scene", ".errors", *(f".{name}" for name in ORACLE)}
    standard = {name for name in imports(module) if name in sys.stdlib_module_names}
    assert imports(module) - standard <= allowed
    assert standard <= {"collections", "dataclasses", "functools", "math", "typing", "weakref"}


@pytest.mark.parametrize("module", ORACLE)
def test_the_oracle_never_reads_the_kernels(module):
    text = PATHS[module].read_text()
    tree = ast.parse(text)
    calls = {node.func.id for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    assert not calls & {"open", "__import__", "exec", "eval", "compile"}
    strings = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    docs = {
        ast.get_docstring(node, clean=False) for node in ast.walk(tree) if hasattr(node, "body") and _documented(node)
    }
    assert not [s for s in strings if s not in docs and re.search(r"kernels?\b|\.clh?\b", s)]


def _documented(node: ast.AST) -> bool:
    return isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef))


def test_pyopencl_is_imported_by_five_modules_only():
    assert {name for name in PATHS if "pyopencl" in imports(name)} <= OPENCL


@pytest.mark.parametrize("module", ["scene", "features", "loading", "exr", "png", "tonemap"])
def test_scene_and_files_never_see_a_device(module):
    found = reaches(module)
    for name in (f".{name}" for name in ON_THE_DEVICE):
        assert name not in found, f"{module} reaches {name} through {found[name]}"
    assert "pyopencl" not in found


def test_only_main_imports_the_command_line():
    assert {name for name in PATHS if ".cli" in imports(name)} == {"__main__"}


COMMANDS = [name for name in PATHS if name.split(".")[0] == "commands"]


def test_only_the_command_line_imports_commands():
    """`clshade.cli.commands` and its arguments by name, a command when it is the one that is run."""
    importers = {name for name in PATHS if any(f".{command}" in imports(name) for command in COMMANDS)}
    assert importers <= {"cli", *COMMANDS}
    assert imports("cli") & {f".{name}" for name in COMMANDS} == {
        ".commands",
        ".commands.arguments",
        ".commands.parser",
    }


def test_every_command_is_a_module_of_its_own():
    own = ("arguments", "parser", "farm_options", "scene_options", "scene_outputs")
    shared = {"commands", *(f"commands.{name}" for name in own)}
    assert {f"commands.{name}" for name in main.COMMANDS} == set(COMMANDS) - shared
    for name in main.COMMANDS:
        assert not imports(f"commands.{name}") & {f".commands.{other}" for other in main.COMMANDS}, name
        command = importlib.import_module(f"clshade.cli.commands.{name}")
        assert callable(command.add_options), name
        assert callable(command.run), name


def test_the_renderer_never_sees_the_oracle():
    found = reaches("renderer")
    assert not [name for name in found if name.startswith(".oracle")]


# errors <- scene <- {geometry, features, loading, oracle}; layout <- programs <- stages <- renderer <- ... <- cli
LEVELS = (
    ("errors",),
    ("scene",),
    ("layout", "geometry", "features"),
    ("device",),
    ("programs",),
    ("stages",),
    ("renderer",),
    ("commands.render",),
    ("cli",),
    ("__main__",),
)


@pytest.mark.parametrize("level", range(1, len(LEVELS)))
def test_imports_point_downwards(level):
    """None of the levels below is reached from above it."""
    for lower in (name for names in LEVELS[:level] for name in names):
        for upper in (name for names in LEVELS[level:] for name in names):
            assert f".{upper}" not in reaches(lower), f"{lower} reaches {upper}"


def test_no_module_has_the_name_of_a_public_function():
    """`import clshade.load` would otherwise put the module in the function's place."""
    modules = {name.split(".")[0] for name in PATHS}
    homes = clshade._HOMES
    shared = {name for name in homes if name in modules and homes[name]}
    assert not shared
    assert {"load", "render", "builtin"} <= set(homes)


def test_every_public_name_can_be_had():
    for name in clshade.__all__:
        assert getattr(clshade, name) is not None
    with pytest.raises(AttributeError, match="no_such_name"):
        clshade.no_such_name  # noqa: B018


HEAVY = ("numpy", "pyopencl", "OpenEXR", "matplotlib", "PIL", "trimesh", "scipy", "dask", "distributed")
MODULES = ("course", "errors", "exr", "farm")
DOCUMENTED = {
    "course": (
        *("arguments", "bilerp", "calculate_normals", "gouraud_shading", "light", "release", "render_object"),
        *("render_object_map", "save", "shade_gouraud", "shade_phong"),
    ),
    "errors": ("ClshadeError", "DeviceError", "InputError", "OutputError", "WorkerError"),
    "exr": ("read", "write", "encode", "flatten"),
    "farm": ("draw_frames", "orbit", "parse_frames", "read_cameras", "Run"),
}


def python(code: str) -> str:
    """What a new interpreter prints; it fails the test where that ends with an error."""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("module", MODULES)
def test_a_module_is_an_attribute_after_the_plain_import(module):
    """In an interpreter of its own, where nothing else has imported it; nothing heavy comes with it."""
    names = DOCUMENTED[module]
    shown = f"import sys, clshade; print(*(callable(getattr(clshade.{module}, n)) for n in {names}))"
    assert set(python(shown).split()) == {"True"}
    heavy = f"import sys, clshade; clshade.{module}; print(*(n for n in {HEAVY} if n in sys.modules))"
    drawing = {"pyopencl"} if module in ("course", "farm") else set()
    assert set(python(heavy).split()) <= {"numpy"} | drawing


def test_public_names_are_listed_and_seen_by_type_checkers():
    assert dir(clshade) == sorted(clshade.__all__)
    assert set(MODULES) == {name for name, home in clshade._HOMES.items() if not home}
    tree = ast.parse(PATHS[""].read_text())
    (block,) = (node for node in tree.body if is_type_checking(node))
    seen = {alias.asname: node.module for node in block.body for alias in node.names if node.level}
    assert seen == {name: home or None for name, home in clshade._HOMES.items()}
    assert (PACKAGE / "py.typed").is_file()
    assert "py.typed" in (ROOT / "pyproject.toml").read_text()


def test_every_path_of_the_readme_can_be_had():
    text = (ROOT / "README.md").read_text()
    paths = set(re.findall(r"\bclshade((?:\.[A-Za-z_]\w*)+)", re.sub(r"-m clshade\S*|github\S*", "", text)))
    assert {".farm.draw_frames", ".exr.read", ".load"} <= paths
    for path in sorted(paths):
        found: object = clshade
        for name in path[1:].split("."):
            found = getattr(found, name)


def test_a_misspelt_name_is_answered_with_the_nearest():
    with pytest.raises(AttributeError) as caught:
        clshade.rendr  # noqa: B018
    assert (caught.value.name, caught.value.obj) == ("rendr", clshade)  # from which a traceback takes its hint


DRAWING = ("render", "turntable", "animate")  # whose settings have the choices of scene.py


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


# Kernels


def code_of(text: str) -> str:
    """OpenCL C without comments and strings."""
    return re.sub(r'//[^\n]*|/\*.*?\*/|"[^"\n]*"', " ", text, flags=re.DOTALL)


def literals(text: str) -> set[float]:
    """The values of all numbers in OpenCL C."""
    hexadecimal = r"0[xX][0-9a-fA-F]+(?:\.[0-9a-fA-F]*)?(?:[pP][+-]?\d+)?"
    decimal = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
    found = re.findall(rf"(?<![\w.])({hexadecimal}|{decimal})[fFuUlL]*(?![\w.])", code_of(text))
    return {float.fromhex(t) if t.lower().startswith("0x") else float(t) for t in found}


def test_literals_are_found():
    text = "int a = 0x7f + 16; // 99\nfloat b = 1.5f, c = 0x1p-100f, d = 2.5e-3f, e = v.s16 + float16_8(3UL); /* 98 */"
    assert literals(text) == {127.0, 16.0, 1.5, 2.0**-100, 2.5e-3, 3.0}


# Numbers of layout.py that stand for nothing else. Of TILE_SIZE (16) and SUBPIXEL_BITS (8) a kernel may well have other
# uses; tests/test_frames.py changes the tile's size instead.
SHARED = [value for value in struct_layout.CONSTANTS.values() if value > 255]


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.name)
def test_no_kernel_holds_a_literal_that_the_host_also_knows(path):
    assert len(SHARED) >= 4
    found = literals(path.read_text())
    assert not found & {float(value) for value in SHARED}
    assert 1 << struct_layout.SUBPIXEL_BITS not in found


def guards_of(name: str) -> set[str]:
    """The macros without which a kernel file does not build."""
    guards = re.findall(r"^#if (!defined.*)\n#error", (ROOT / "kernels" / name).read_text(), re.MULTILINE)
    return set(re.findall(r"defined\((\w+)\)", " ".join(guards)))


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.name)
def test_every_feature_that_a_kernel_tests_is_guarded(path):
    """A macro in #if that neither features.clh nor the file itself demands would pass as 0 when misspelled."""
    guarded = guards_of("features.clh") | guards_of(path.name)
    own = {"FP64", "LANES", "BLOCKS_X", "BLOCKS_Y", "ITEMS_PER_TILE", "PREFETCH", "GATHERS", "HAS_ROWS"}
    text = code_of(path.read_text())
    tested = set()
    for line in re.findall(r"^\s*#\s*(?:el)?if\s(.*)$", text, re.MULTILINE):
        tested |= set(re.findall(r"[A-Z_][A-Z0-9_]+", re.sub(r"defined\s*\(\w+\)|__has_builtin\(\w+\)", "", line)))
    assert tested <= guarded | own, tested - guarded - own


def test_every_feature_is_guarded():
    from clshade.pipeline.features import CHOICES, OPTIONAL
    from clshade.pipeline.layer_buffers import MACROS

    assert guards_of("features.clh") == {*CHOICES, *OPTIONAL}
    assert guards_of("surface_layers.cl") == {*MACROS.values(), "MIRRORED"}
