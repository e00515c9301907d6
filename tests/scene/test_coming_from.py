"""The page for users of other libraries: each of ten tasks in all six. tests/test_readme.py runs our parts."""

from __future__ import annotations

import ast
import re
from functools import reduce

import pytest
import trimesh
from processes import ROOT

TEXT = (ROOT / "clshade" / "scene" / "COMING_FROM.md").read_text()
OTHERS = ["pyrender", "trimesh", "Open3D", "PyVista", "Mitsuba"]
TASKS = re.findall(r"^## \d+\. (.*?)\n(.*?)(?=^## )", TEXT, re.MULTILINE | re.DOTALL)


def parts(task: str) -> dict[str, str]:
    """Return the code of the other libraries for a task, by library."""
    (block,) = re.findall(r"^```py\n(.*?)^```$", task, re.MULTILINE | re.DOTALL)
    pieces = re.split(rf"^# ({'|'.join(OTHERS)})\b.*\n", block, flags=re.MULTILINE)
    assert pieces[1::2] == OTHERS
    return dict(zip(OTHERS, pieces[2::2], strict=True))


def test_there_are_ten_tasks():
    assert len(TASKS) == 10


@pytest.mark.parametrize(("title", "task"), TASKS, ids=[title for title, _ in TASKS])
def test_each_task_is_shown_in_all_six_libraries(title, task):
    assert len(re.findall(r"^```python\n", task, re.MULTILINE)) == 1
    for code in parts(task).values():
        ast.parse(code)


def test_what_is_named_of_trimesh_exists():
    trees = [ast.walk(ast.parse(code)) for _, task in TASKS for code in parts(task).values()]
    chains = {ast.unparse(node) for tree in trees for node in tree if isinstance(node, ast.Attribute)}
    named = {chain for chain in chains if re.fullmatch(r"trimesh(\.\w+)+", chain)}
    assert len(named) > 10
    for chain in named:
        reduce(getattr, chain.split(".")[1:], trimesh)
