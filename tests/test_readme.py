"""Every example of README.md and of the rooms' READMEs runs as printed."""

import ast
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from processes import ROOT

from clshade.cli.main import COMMANDS
from clshade.view.regression import plugin

FILES = [ROOT / "README.md", ROOT / ".github" / "CONTRIBUTING.md", ROOT / "kernels" / "README.md"]
FILES += sorted((ROOT / "clshade").rglob("*.md"))
TEXTS = {path.relative_to(ROOT).as_posix(): path.read_text() for path in FILES}
README = TEXTS["README.md"]
PROSE = {name: re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL) for name, text in TEXTS.items()}


class Block(NamedTuple):
    """A fenced block of a document. name: the file with this text, given after the language, or ""."""

    document: str
    language: str
    name: str
    text: str
    line: int


BLOCKS = [
    Block(document, match[1], match[2], match[3], text[: match.start()].count("\n") + 1)
    for document, text in TEXTS.items()
    for match in re.finditer(r"^```(\w+)[ ]*([^\n]*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
]
PYTHON = [block for block in BLOCKS if block.language == "python"]
# Of our pytest plugin, pytest-xdist, dask.
OTHERS_OPTIONS = {plugin.UPDATE, plugin.OUT, "--dist", "--port", "--nworkers", "--nthreads"}


def at_line(block: Block) -> str:
    return f"{block.document}, line {block.line}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Return the folder in which the examples run, with the files that documents contain."""
    folder = tmp_path_factory.mktemp("readme")
    for block in BLOCKS:
        if block.name:
            (folder / block.name).write_text(block.text)
    return folder


@pytest.fixture(scope="module")
def namespaces() -> dict[str, dict[str, Any]]:
    """Return the namespace of each document: a Python block continues the one before it."""
    return {document: {"blocks run": 0} for document in TEXTS}


def run_python(block: Block, namespace: dict[str, Any]) -> None:
    """Run a block, and check the arrays whose shape and type comments begin with, such as "(600, 800, 3) float32"."""
    lines = block.text.splitlines()
    for statement in ast.parse(block.text).body:
        exec(compile(ast.Module([statement], []), at_line(block), "exec"), namespace)
        comment = lines[statement.end_lineno - 1][statement.end_col_offset :].strip()
        described = re.match(r"# (\([\d, ]+\)) (\w+)", comment)
        if described and isinstance(statement, ast.Expr):
            value = eval(ast.unparse(statement), namespace)
            shape, dtype = value if isinstance(value, tuple) else (value.shape, value.dtype)
            assert (shape, str(dtype)) == (ast.literal_eval(described[1]), described[2]), ast.unparse(statement)


@pytest.mark.long
@pytest.mark.parametrize("block", PYTHON, ids=at_line)
def test_python(opened, folder, namespaces, monkeypatch, block):
    monkeypatch.chdir(folder)
    namespace = namespaces[block.document]
    examples = [example for example in PYTHON if example.document == block.document]
    for example in examples[namespace["blocks run"] : examples.index(block) + 1]:
        run_python(example, namespace)
        namespace["blocks run"] += 1


NOT_RUN = {"venv", "install", "--scheduler"}  # words of commands; test_farm_cluster.py starts servers
OTHERS = {"pytest", "dask", "ruff", "mypy", "lint-imports"}


def commands(block: Block) -> list[list[str]]:
    # shlex would take the # of `out.####.exr` for the start of a comment.
    code = [re.sub(r"(^|\s)#\s.*", "", line) for line in block.text.splitlines()]
    lines = [shlex.split(part) for line in code for part in line.split("&&")]
    return [words for words in lines if words and not NOT_RUN & {*words} and Path(words[0]).name not in OTHERS]


SHELL = [words for block in BLOCKS if block.language == "sh" for words in commands(block)]


@pytest.mark.long
@pytest.mark.parametrize("words", SHELL, ids=[" ".join(words[1:]) for words in SHELL])
def test_command(opened, folder, words):
    assert Path(words[0]).name == "python"
    words = [str(ROOT / word) if (ROOT / word).is_file() else word for word in words[1:]]
    options = {"cwd": folder, "env": {**os.environ, "PYTHONPATH": str(ROOT)}, "timeout": 280}
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stderr


def test_the_commands_of_the_quick_start_are_those_that_a_clean_machine_runs():
    shell = "".join(block.text for block in BLOCKS if (block.document, block.language) == ("README.md", "sh"))
    tested = next(line for line in shell.splitlines() if "pytest" in line)
    assert tested.split("&&")[1].strip().removeprefix(".venv/bin/") in (ROOT / ".ci" / "run").read_text()


def options_of(command: str) -> set[str]:
    command_line = [sys.executable, *command.split()]
    done = subprocess.run(command_line, cwd=ROOT, capture_output=True, text=True, timeout=60, check=True)
    return set(re.findall(r"--[a-z][a-z-]*", done.stdout))


@pytest.mark.long
def test_every_option_exists():
    scripts = *(ROOT / "demos").glob("demo*.py"), ROOT / "tests" / "fuzz" / "run.py"
    commands = *(f"{path} --help" for path in scripts), *(f"-m clshade {name} --help all" for name in COMMANDS)
    options = set().union(*map(options_of, commands))
    for document, text in TEXTS.items():
        assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", text)) <= options | OTHERS_OPTIONS, document


def headings(document: str) -> set[str]:
    titles = re.findall(r"^#+ (.*)$", PROSE[document], re.M)
    return {re.sub(r"[^\w -]", "", title.lower()).strip().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("document", TEXTS)
def test_every_link_leads_somewhere_and_every_file_that_is_named_is_there(document):
    """Paths in backquotes, relative to the repository's root or the document's folder; or it contains the file."""
    for link in re.findall(r"\]\(([^)]+)\)", TEXTS[document]):
        if "://" not in link:
            path, _, title = link.partition("#")
            target = (ROOT / document).parent / path if path else ROOT / document
            assert target.is_file(), link
            assert not title or title in headings(target.resolve().relative_to(ROOT).as_posix()), link
    if document.startswith(("clshade/", "kernels/")):
        named = re.findall(r"`((?:[\w.-]+/)*[\w-]+\.(?:py|cl|clh))`", PROSE[document])
        places = [ROOT, (ROOT / document).parent, ROOT / "kernels"]
        lacking = {name for name in named if not any((place / name).is_file() for place in places)}
        assert lacking <= {block.name for block in BLOCKS if block.document == document}


def test_readme_is_a_newcomers_page_that_leads_to_all_others_and_lists_every_command():
    linked = {link.partition("#")[0] for link in re.findall(r"\]\(([^)]+)\)", README)}
    assert set(TEXTS) - {"README.md"} <= linked
    assert set(re.findall(r"python -m clshade (\w+)", PROSE["README.md"])) >= set(COMMANDS)


def test_the_kernels_drawing_names_every_kernel_and_every_include_says_what_it_holds():
    text = TEXTS["kernels/README.md"]
    for path in sorted((ROOT / "kernels").glob("*.cl*")):
        if path.suffix == ".clh":
            assert path.read_text().startswith("// "), path.name
        for name in re.findall(r"kernel void (\w+)\(", path.read_text()):
            assert re.search(rf"\b{name}\b", text), name
