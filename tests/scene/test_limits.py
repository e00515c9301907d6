"""Limits of files: values at a limit are accepted, those one beyond it refused; the work grows with the number of meshes."""

import os
import struct
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from mesh_writers import CORNERS, INDICES, Gltf, ply, properties, triangle
from scene_files import npy_of_pickle, refusal

from clshade import load
from clshade.base import input_files
from clshade.errors import InputError
from clshade.images.decode import read_image
from clshade.pipeline.scene_tables import pack
from clshade.scene.contents import format_contents, scene_contents
from clshade.scene.description import part_digests
from clshade.scene.formats import gltf_nodes, safe_pickle
from clshade.scene.formats.gltf_data import GltfData
from clshade.scene.ground import with_ground
from clshade.scene.model import Settings


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.stl", "a.gltf", "a.glb", "a.npy", "a.json", "a.mtl", "a.png"])
def test_sizes_of_files(tmp_path, monkeypatch, name):
    """Sparse files, which are not read: if the size is accepted, opening them fails."""
    obj_path = tmp_path / "of.obj"
    obj_path.write_bytes(b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")

    def opened(path, mode):
        if os.fspath(path) == str(obj_path):
            return open(path, mode)
        raise OSError(5, "opened")

    monkeypatch.setattr(input_files, "open", opened, raising=False)
    path = tmp_path / name
    readers = {"a.png": partial(read_image, path, srgb=True), "a.mtl": partial(load, obj_path)}
    read = readers.get(name, partial(load, path))
    cap = {"a.mtl": 1 << 24, "a.png": 1 << 29, "a.json": 1 << 28}.get(name, 1 << 31)
    for size, part in ((cap, "opened"), (cap + 1, f"file: expected at most {cap} bytes, found {cap + 1} bytes")):
        path.touch()
        os.truncate(path, size)
        with pytest.raises(InputError, match=part):
            read()


def test_rows_of_gltf_accessors():
    """2^26 with data, 2^24 without."""
    views = [{"buffer": 0, "byteLength": (1 << 26) + 1}]
    document = {"buffers": [{"byteLength": (1 << 26) + 1}], "bufferViews": views, "accessors": []}
    for count, fields in ((1 << 24, {}), (1 << 26, {"bufferView": 0})):
        fields |= {"componentType": 5121, "type": "SCALAR"}
        document["accessors"] += [{**fields, "count": count}, {**fields, "count": count + 1}]
    buffers = GltfData("a.glb", document, memoryview(bytes((1 << 26) + 1)))
    for index, count in ((0, 1 << 24), (2, 1 << 26)):
        assert buffers.array(index).shape == (count, 1)
        with pytest.raises(InputError, match=rf"accessors\[{index + 1}\]\.count"):
            buffers.array(index + 1)


def test_nodes_of_gltf_files(tmp_path, monkeypatch):
    monkeypatch.setattr(gltf_nodes, "MAX_NODES", 1 << 10)
    document = triangle()
    document.json["nodes"] = [{"mesh": 0}, *[{}] * ((1 << 10) - 1)]
    assert len(load(document.glb(tmp_path / "a.glb")).meshes) == 1
    document.json["nodes"].append({})
    refusal(document.glb(tmp_path / "a.glb"), "nodes: expected at most 1024, found 1025")


def test_headers_and_lists_of_ply_files(tmp_path):
    """end_header begins within the first 2^16 bytes; an element has at most 8 lists."""
    rows = [("3f", corner) for corner in ([0, 0, 0], [1, 0, 0], [0, 1, 0])]

    def written(lists: int, padding: int = 0) -> str:
        head = f"element vertex 3\n{properties('float', 'x y z')}"
        head += "element face 1\nproperty list uchar int vertex_indices\n"
        head += "".join(f"property list uchar uchar l{k}\n" for k in range(lists - 1)) + f"comment {padding * 'c'}\n"
        data = ply("binary_little_endian", head, [*rows, ("B3i" + "B" * (lists - 1), [3, 0, 1, 2, *[0] * (lists - 1)])])
        (tmp_path / "a.ply").write_bytes(data)
        return str(tmp_path / "a.ply")

    assert len(load(written(8)).meshes[0].faces) == 1
    refusal(written(9), "element face: expected at most 8 lists, found 9")
    with open(written(1), "rb") as file:
        room = (1 << 16) - (file.read().index(b"end_header") + len(b"end_header"))
    assert len(load(written(1, room)).meshes[0].faces) == 1
    refusal(written(1, room + 1), "header: expected end_header in the first 65536 bytes")


def test_headers_of_course_files(tmp_path):
    """At most 4096 bytes."""
    path = tmp_path / "a.npy"
    npy_of_pickle(path, b"")
    header = path.read_bytes()[10:].strip()
    for length, part in ((4096, "pickle: "), (4097, "header: expected format 1, 2 or 3 and at most 4096 bytes")):
        path.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", length) + header.ljust(length))
        refusal(path, part)


def test_numbers_in_lists_of_course_files(monkeypatch):
    monkeypatch.setattr(safe_pickle, "MAX_LISTED", 8)
    assert safe_pickle.Content({"n": [1.0] * 7}, "a.npy", 100).value("n").shape == (7,)  # the list itself counts as one
    with pytest.raises(InputError, match="too long"):
        safe_pickle.Content({"n": [1.0] * 8}, "a.npy", 100).value("n")


# Thousands of meshes, materials or nodes: steps of the interpreter


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
