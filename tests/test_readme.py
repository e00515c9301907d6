"""Every example of README.md and of the rooms' READMEs runs as printed."""

from __future__ import annotations

import ast
import os
import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from processes import ROOT

from clshade.cli.main import COMMANDS
from clshade.view.regression import plugin

FILES = [ROOT / "README.md", ROOT / ".github" / "CONTRIBUTING.md", ROOT / "kernels" / "README.md"]
FILES += sorted((ROOT / "clshade").rglob("*.md"))
TEXTS = {path.relative_to(ROOT).as_posix(): path.read_text() for path in FILES}
README = TEXTS["README.md"]
PROSE = {name: re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL) for name, text in TEXTS.items()}
MOST_LINES = 160  # of README.md: a newcomer's page


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
# Of our pytest plugin, pytest-xdist, oiiotool, dask, Chromium.
EARLIER_OPTIONS = {  # of commit 1e1eb0f, by which figures were measured
    *("--family", "--sizes", "--peers", "--limits", "--features", "--instances", "--scaling", "--random-rounding"),
    "--functions",
}
OTHERS_OPTIONS = {
    plugin.UPDATE,
    plugin.OUT,
    "--dist",
    "--info",
    "--port",
    "--nworkers",
    "--nthreads",
    "--headless",
    "--window-size",
}


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


def described(comment: str) -> tuple[tuple[int, ...], str] | None:
    """Return the shape and type of an array that a comment begins with, such as "(600, 800, 3) float32"."""
    match = re.match(r"# (\([\d, ]+\)) (\w+)", comment)
    return match and (ast.literal_eval(match[1]), match[2])


def run_python(block: Block, namespace: dict[str, Any]) -> int:
    """Run a block, check the arrays that its comments describe, and return their number."""
    checked, lines = 0, block.text.splitlines()
    for statement in ast.parse(block.text).body:
        code = compile(ast.Module([statement], []), at_line(block), "exec")
        exec(code, namespace)
        expected = described(lines[statement.end_lineno - 1][statement.end_col_offset :].strip())
        if expected and isinstance(statement, ast.Expr):
            value = eval(ast.unparse(statement), namespace)
            shape, dtype = value if isinstance(value, tuple) else (value.shape, value.dtype)
            assert (shape, str(dtype)) == expected, ast.unparse(statement)
            checked += 1
    return checked


@pytest.mark.long
@pytest.mark.parametrize("block", PYTHON, ids=at_line)
def test_python(opened, folder, namespaces, monkeypatch, block):
    monkeypatch.chdir(folder)
    namespace = namespaces[block.document]
    examples = [example for example in PYTHON if example.document == block.document]
    for example in examples[namespace["blocks run"] : examples.index(block) + 1]:
        run_python(example, namespace)
        namespace["blocks run"] += 1


def test_descriptions_of_arrays_are_found_and_checked():
    good, bad = (Block("made up", "python", "", f"x  # ({n}, 2) float64, more\n", 0) for n in (3, 4))
    assert run_python(good, {"x": np.zeros((3, 2))}) == 1
    with pytest.raises(AssertionError):
        run_python(bad, {"x": np.zeros((3, 2))})
    assert (
        sum(described(line[line.find("#") :]) is not None for block in PYTHON for line in block.text.splitlines()) >= 2
    )


def commands(block: Block) -> list[list[str]]:
    """Return the command lines of a shell block, except those that install something, run the tests, or need servers
    (tests/farm/test_farm_cluster.py starts those)."""
    # shlex would take the # of `out.####.exr` for the start of a comment.
    code = [re.sub(r"(^|\s)#\s.*", "", line) for line in block.text.splitlines()]
    lines = [shlex.split(part) for line in code for part in line.split("&&")]
    return [
        words
        for words in lines
        if words
        and not {"venv", "install", "--scheduler"} & set(words)
        and Path(words[0]).name not in ("pytest", "dask", "ruff", "mypy", "lint-imports")
    ]


def case(words: list[str]) -> Any:
    """Mark slow commands: the demos, a full turn, sheets and drawings of lines alone; test_demos.py, test_farm.py,
    test_sheet.py and test_lines.py have small ones."""
    slow = any(word.startswith("demos/") or word in ("turntable", "--sheet", "--edges-only") for word in words)
    return pytest.param(words, id=" ".join(words[1:]), marks=[pytest.mark.long] if slow else [])


SHELL = [case(words) for block in BLOCKS if block.language == "sh" for words in commands(block)]


@pytest.mark.long
@pytest.mark.parametrize("words", SHELL)
def test_command(opened, folder, words):
    assert Path(words[0]).name == "python"
    words = [str(ROOT / word) if (ROOT / word).is_file() else word for word in words[1:]]
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert done.returncode == 0, done.stderr


def test_the_commands_of_the_quick_start_are_those_that_a_clean_machine_runs():
    tested = next(
        line
        for block in BLOCKS
        if (block.document, block.language) == ("README.md", "sh")
        for line in block.text.splitlines()
        if "pytest" in line
    )
    assert tested.split("&&")[1].strip().removeprefix(".venv/bin/") in (ROOT / ".ci" / "run").read_text()


@cache
def options_of(command: str) -> set[str]:
    done = subprocess.run(
        [sys.executable, *command.split()], cwd=ROOT, capture_output=True, text=True, timeout=60, check=True
    )
    return set(re.findall(r"--[a-z][a-z-]*", done.stdout))


@pytest.mark.long
def test_every_option_exists():
    paths = [*sorted((ROOT / "demos").glob("demo*.py")), ROOT / "tests" / "fuzz" / "run.py"]
    scripts = [f"{path} --help" for path in paths]
    commands = [f"-m clshade {name} --help all" for name in COMMANDS]
    options = set().union(*map(options_of, (*commands, *scripts)))
    for document, text in TEXTS.items():
        named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", text))
        assert named - options - OTHERS_OPTIONS <= (EARLIER_OPTIONS if "1e1eb0f" in text else set()), document


def test_every_command_is_listed():
    assert set(re.findall(r"python -m clshade (\w+)", PROSE["README.md"])) >= set(COMMANDS)


def headings(document: str) -> set[str]:
    titles = re.findall(r"^#+ (.*)$", PROSE[document], re.M)
    return {re.sub(r"[^\w -]", "", title.lower()).strip().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("document", TEXTS)
def test_every_link_leads_somewhere(document):
    for link in re.findall(r"\]\(([^)]+)\)", TEXTS[document]):
        if "://" in link:
            continue
        path, _, title = link.partition("#")
        target = (ROOT / document).parent / path if path else ROOT / document
        assert target.is_file(), link
        if title:
            assert title in headings(target.resolve().relative_to(ROOT).as_posix()), link


def test_readme_is_a_newcomers_page_that_leads_to_all_others():
    assert README.count("\n") <= MOST_LINES
    linked = {link.partition("#")[0] for link in re.findall(r"\]\(([^)]+)\)", README)}
    assert set(TEXTS) - {"README.md"} <= linked


@pytest.mark.parametrize(
    "document", [name for name in TEXTS if name.startswith("clshade/") or name == "kernels/README.md"]
)
def test_every_file_that_a_document_names_is_there(document):
    """Paths in backquotes, relative to the repository's root or the document's folder; or it contains the file."""
    named = re.findall(r"`((?:[\w.-]+/)*[\w-]+\.(?:py|cl|clh))`", PROSE[document])
    places = [ROOT, (ROOT / document).parent, ROOT / "kernels"]
    contained = {block.name for block in BLOCKS if block.document == document}
    lacking = [name for name in named if not any((place / name).is_file() for place in places)]
    assert set(lacking) <= contained


def test_the_kernels_drawing_names_every_file_and_kernel():
    text = TEXTS["kernels/README.md"]
    for path in sorted((ROOT / "kernels").glob("*.cl*")):
        included = re.findall(r'^#include "(\w+)\.clh"', path.read_text(), re.M)
        if path.suffix == ".clh":
            assert f"| `{path.name}` | {', '.join(included)} |".replace("|  |", "| |") in text, path.name
        for name in re.findall(r"kernel void (\w+)\(", path.read_text()):
            assert re.search(rf"\b{name}\b", text), name
