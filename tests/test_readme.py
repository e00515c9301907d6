"""Everything that README shows is run as it stands there."""

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

README = (ROOT / "README.md").read_text()
PROSE = re.sub(r"^```.*?^```$", "", README, flags=re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A fenced block. name: the file that its text is, given after the language, or ""."""

    language: str
    name: str
    text: str
    line: int


BLOCKS = [
    Block(found[1], found[2], found[3], README[: found.start()].count("\n") + 1)
    for found in re.finditer(r"^```(\w+)[ ]*([^\n]*)\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
]
PYTHON = [block for block in BLOCKS if block.language == "python"]
OTHERS_OPTIONS = {"--dist", "--info", "--port", "--nworkers", "--nthreads"}  # of pytest-xdist, oiiotool, dask


def at_line(block: Block) -> str:
    return f"line {block.line}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Where all of it is run, with the files that README spells out."""
    folder = tmp_path_factory.mktemp("readme")
    for block in BLOCKS:
        if block.name:
            (folder / block.name).write_text(block.text)
    return folder


@pytest.fixture(scope="module")
def namespace() -> dict[str, Any]:
    """What the Python blocks run so far have defined: a block goes on where the one before it ends."""
    return {"blocks run": 0}


def described(comment: str) -> tuple[tuple[int, ...], str] | None:
    """Shape and type of an array that a comment begins with, such as "(600, 800, 3) float32"."""
    found = re.match(r"# (\([\d, ]+\)) (\w+)", comment)
    return found and (ast.literal_eval(found[1]), found[2])


def run_python(block: Block, namespace: dict[str, Any]) -> int:
    """Runs a block; returns how many arrays it describes, of which each is as described."""
    checked, lines = 0, block.text.splitlines()
    for statement in ast.parse(block.text).body:
        code = compile(ast.Module([statement], []), f"README.md, {at_line(block)}", "exec")
        exec(code, namespace)
        expected = described(lines[statement.end_lineno - 1][statement.end_col_offset :].strip())
        if expected and isinstance(statement, ast.Expr):
            value = eval(ast.unparse(statement), namespace)
            shape, dtype = value if isinstance(value, tuple) else (value.shape, value.dtype)
            assert (shape, str(dtype)) == expected, ast.unparse(statement)
            checked += 1
    return checked


@pytest.mark.parametrize("index", range(len(PYTHON)), ids=[at_line(block) for block in PYTHON])
def test_python(opened, folder, namespace, monkeypatch, index):
    monkeypatch.chdir(folder)
    for block in PYTHON[namespace["blocks run"] : index + 1]:
        run_python(block, namespace)
        namespace["blocks run"] += 1


def test_descriptions_of_arrays_are_found_and_checked():
    good, bad = (Block("python", "", f"x  # ({n}, 2) float64, more\n", 0) for n in (3, 4))
    assert run_python(good, {"x": np.zeros((3, 2))}) == 1
    with pytest.raises(AssertionError):
        run_python(bad, {"x": np.zeros((3, 2))})
    assert (
        sum(described(line[line.find("#") :]) is not None for block in PYTHON for line in block.text.splitlines()) >= 2
    )


def commands(block: Block) -> list[list[str]]:
    """The command lines of a shell block, without what installs something, runs the tests, or needs servers
    (tests/test_farm_cluster.py starts those)."""
    # Not shlex's comments: to it the # of `out.####.exr` begins one.
    code = [re.sub(r"(^|\s)#\s.*", "", line) for line in block.text.splitlines()]
    lines = [shlex.split(part) for line in code for part in line.split("&&")]
    return [
        words
        for words in lines
        if words
        and not {"venv", "install", "--scheduler"} & set(words)
        and Path(words[0]).name not in ("pytest", "dask")
    ]


def case(words: list[str]) -> Any:
    """The demos and a whole turn take long; tests/test_demos.py and tests/test_farm.py run them on small images."""
    slow = any(word.startswith("demos/") or word == "turntable" for word in words)
    return pytest.param(words, id=" ".join(words[1:]), marks=[pytest.mark.long] if slow else [])


SHELL = [case(words) for block in BLOCKS if block.language == "sh" for words in commands(block)]


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
        line for block in BLOCKS if block.language == "sh" for line in block.text.splitlines() if "pytest" in line
    )
    assert tested.split("&&")[1].strip().removeprefix(".venv/bin/") in (ROOT / ".ci" / "run").read_text()


@cache
def options_of(command: str) -> set[str]:
    done = subprocess.run(
        [sys.executable, *command.split(), "--help"], cwd=ROOT, capture_output=True, text=True, timeout=60, check=True
    )
    return set(re.findall(r"--[a-z][a-z-]*", done.stdout))


def test_every_option_exists():
    scripts = [str(path) for path in sorted((ROOT / "demos").glob("demo*.py"))]
    known = set().union(*(options_of(f"-m clshade {name}") for name in COMMANDS), *map(options_of, scripts))
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", README))
    assert len(named) > 40
    assert not named - known - OTHERS_OPTIONS


def test_every_command_is_listed():
    assert set(re.findall(r"python -m clshade (\w+)", PROSE)) >= set(COMMANDS)


def test_every_link_leads_somewhere():
    headings = {
        re.sub(r"[^\w -]", "", title.lower()).strip().replace(" ", "-")
        for title in re.findall(r"^#+ (.*)$", PROSE, re.M)
    }
    links = re.findall(r"\]\(([^)]+)\)", README)
    assert len(links) > 6
    for link in links:
        if link.startswith("#"):
            assert link[1:] in headings
        elif "://" not in link:
            assert (ROOT / link).is_file(), link
