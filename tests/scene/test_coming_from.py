"""The page for users of other libraries. tests/test_readme.py runs our parts."""

from __future__ import annotations

import ast
import re
from functools import reduce

import trimesh
from processes import ROOT

TEXT = (ROOT / "clshade" / "scene" / "COMING_FROM.md").read_text()
TASKS = re.findall(r"^## \d+\. (.*?)\n(.*?)(?=^## )", TEXT, re.MULTILINE | re.DOTALL)
BLOCK = re.compile(r"^```py\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_what_is_named_of_trimesh_exists():
    trees = [ast.walk(ast.parse(block)) for _, task in TASKS for block in BLOCK.findall(task)]
    chains = {ast.unparse(node) for tree in trees for node in tree if isinstance(node, ast.Attribute)}
    named = {chain for chain in chains if re.fullmatch(r"trimesh(\.\w+)+", chain)}
    assert len(named) > 10
    for chain in named:
        reduce(getattr, chain.split(".")[1:], trimesh)
