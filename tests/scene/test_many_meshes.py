"""Files of thousands of meshes, materials or nodes: the work grows with their number, in steps of the interpreter."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from mesh_writers import CORNERS, INDICES, Gltf

from clshade.pipeline.scene_tables import pack
from clshade.scene.contents import format_contents, scene_contents
from clshade.scene.description import part_digests
from clshade.scene.formats.load import load
from clshade.scene.ground import with_ground
from clshade.scene.model import Settings


def obj(path: Path, count: int, lines: Callable[[int], str]) -> Path:
    path.with_suffix(".mtl").write_text("".join(f"newmtl m{k}\nKd 0.{k + 1} 0 0\n" for k in range(count)))
    faces = (f"v {k} 0 0\nv {k} 1 0\nv {k} 0 1\n{lines(k)}\nf -3 -2 -1\n" for k in range(count))
    path.write_text(f"mtllib {path.stem}.mtl\n" + "".join(faces))
    return path


def glb(path: Path, count: int, kind: str) -> Path:
    document, nodes = Gltf(), kind == "nodes"
    for k in range(1 if nodes else count):
        document.mesh({"POSITION": CORNERS}, INDICES, material=document.add("materials", {"name": f"m{k}"}))
    document.json["meshes"] = [{"primitives": [mesh["primitives"][0] for mesh in document.json["meshes"]]}]
    for k in range(count if nodes else 1):
        document.add("nodes", {"mesh": 0, "name": f"n{k}", "translation": [k, 0, 0]})
    return document.glb(path)


FILES: dict[str, tuple[int, Callable[[Path, int], Path]]] = {  # and steps for a mesh, with its material, at most
    "runs.obj": (6000, lambda path, count: obj(path, count, lambda k: f"usemtl m{k % 2}")),
    "materials.obj": (12000, lambda path, count: obj(path, count, "usemtl m{}".format)),
    "nodes.glb": (2500, lambda path, count: glb(path, count, "nodes")),
    "primitives.glb": (19000, lambda path, count: glb(path, count, "primitives")),
}


def steps(work: Callable[[], object]) -> int:
    """Return how many instructions the interpreter takes: those of loops in one line too."""
    count = 0

    def seen(frame, event, argument):
        nonlocal count
        frame.f_trace_lines, frame.f_trace_opcodes = False, True
        count += event == "opcode"
        return seen

    before = sys.gettrace()
    sys.settrace(seen)
    try:
        work()
    finally:
        sys.settrace(before)
    return count


def host_work(path: Path) -> None:
    """Do what `inspect` and `render` do besides drawing."""
    scene = load(path)
    format_contents(scene_contents(scene))
    scene = with_ground(scene)
    part_digests(scene)
    pack(scene, Settings.from_preset("standard", layers=("object_id", "instance_id")))


@pytest.mark.sampled
@pytest.mark.parametrize("name", FILES)
def test_all_meshes_cost_alike_and_little(name, tmp_path):
    limit, write = FILES[name]

    def measured(count: int) -> int:
        path = write(tmp_path / name, count)
        return steps(lambda: host_work(path))

    measured(2)  # what is done once
    first, second, third = map(measured, (20, 40, 60))
    assert third - second <= 1.01 * (second - first)
    assert second - first <= 20 * limit
