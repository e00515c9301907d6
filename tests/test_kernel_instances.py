"""Instances (project.cl, setup.cl, placements.clh): what is set up from one copy of each mesh, against copies; normals and
tangents."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from devices import needs_float64
from kernel_stages import Probe, bits, image_of, mask, view_of
from layer_scenes import crowd, matrices

from clshade.pipeline import placements, scene_tables, triangle_source
from clshade.pipeline.buffers import Buffer
from clshade.pipeline.camera_space import CameraSpace, Extent
from clshade.pipeline.launches import FrameInFlight, Stages
from clshade.pipeline.programs import build
from clshade.pipeline.struct_layout import SINGLE
from clshade.pipeline.triangle_source import TriangleSource
from clshade.scene.model import Scene, Settings

STAGES = """
#include "project.cl"
#include "setup.cl"

// Of one lane.
kernel void normals(global const Instance *given, global const double4 *own, global real4 *out)
{
    int i = get_global_id(0);
    out[i] = placed_normal(given + i, own[i]);
}

kernel void tangents(global const Instance *given, global const double4 *own, global real4 *out)
{
    int i = get_global_id(0);
    out[i] = placed_tangent(given + i, own[i]);
}
"""
# Corners by rows, and by scalars in painter's order.
WAYS = [(None, {"DEPTH_TEST": 1}), (1, {})]


@pytest.fixture(autouse=True)
def _device_with_float64(device, monkeypatch):
    needs_float64(device)
    for name, value in {"_LEAST_ROOM": 5, "_ROOM_A_PIXEL": 0, "_ROOM_A_PIXEL_OF_GPU": 0}.items():
        monkeypatch.setattr(triangle_source, name, value)
    for name in ("_BLOCK", "_BLOCK_OF_GPU"):
        monkeypatch.setattr(triangle_source, name, 100)


def set_up(device, stages: Stages, scene: Scene, *, copies: bool) -> SimpleNamespace:
    """Return the triangles of a scene in the order of its faces, as they are set up.

    rows: of structs.Triangle, with the scene's faces. bounds, order, depth: of each, the last in painter's order. to_clip:
    faces. source, index: where the triangles are, and their numbers. table, of_triangles: of instances.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(triangle_source, "LEAST_COPIES", 1 << 40 if copies else 0)
        packed = scene_tables.pack(scene, Settings())
    table, camera = packed.instances, scene.camera
    space = CameraSpace.of(camera, Extent(tuple(packed.low), tuple(packed.high), 10.0), None)
    view = view_of(
        device, camera, space.near, space.scale, DOUBLE_POSITIONS=packed.arrays["positions"].dtype == np.float64
    )
    image = image_of(device, camera.resolution, needs=mask(SIDES=1).needs)
    counted = Buffer(device, np.zeros(1, SINGLE.Counters))
    positions, faces = Buffer(device, packed.arrays["positions"]), Buffer(device, packed.arrays["faces"])
    values = {name: Buffer(device, packed.arrays[name]) for name in ("face_materials", "materials")}
    values |= {"image": image, "view": view, "counters": counted, "faces": faces}
    frame = FrameInFlight({**values, "pieces": Buffer.empty(device, 0, SINGLE.Piece)}, space=space, streams=False)
    painter = not stages.features["DEPTH_TEST"]
    if table is None:
        source = TriangleSource(stages, positions, faces)
    else:
        source = triangle_source.Instances(stages, table, positions, faces, 1)
    source.project(frame)
    source.set_up(frame)
    counters = counted.to_host()[0]
    setup = SimpleNamespace(source=source, table=table)
    setup.counters = {name: int(counters[name]) + source.culled.get(name, 0) for name in counters.dtype.names[:7]}
    made = source.made
    lowest = np.uint64((1 << made.index_bits) - 1)
    keys = made.keys.to_host()[: counters["visible"]]
    index = (lowest - (keys & lowest)).astype(np.int64)
    faces_of, clipped = made.triangles.to_host()["face"][index].astype(np.int64), source.to_clip(counters["to_clip"])
    setup.to_clip = clipped.numbers.astype(np.int64)
    if table is not None:
        setup.of_triangles = frame.values["triangle_instances"]
        faces_of += table.rows["face_shift"][setup.of_triangles.to_host()[index]]
        setup.to_clip += table.rows["face_shift"][clipped.instances]
    by_face = np.argsort(faces_of)
    setup.index = index[by_face]
    setup.order = keys[by_face] >> np.uint64(made.index_bits)
    setup.rows, setup.bounds = made.triangles.array[setup.index], made.bounds.to_host()[setup.index]
    setup.rows["face"] = faces_of[by_face]
    setup.depth = source.painter_depths(frame, setup.index)[0] if painter else None
    return setup


@pytest.mark.parametrize(("lanes", "features"), WAYS)
def test_the_same_triangles_as_of_copies(device, lanes, features):
    """In blocks of few vertices, with room for few triangles at first; faces behind, beside the image, seen from behind, and
    to be clipped."""
    stages = Stages(device, build(device, mask(INSTANCES=1, **features), STAGES, lanes=lanes))
    scene = crowd()
    meshes = [replace(mesh, material=replace(mesh.material, sides="front")) for mesh in scene.meshes[-2:]]
    scene = replace(scene, meshes=(*scene.meshes[:-2], *meshes))
    expected, setup = (set_up(device, stages, scene, copies=copies) for copies in (True, False))
    assert setup.counters == expected.counters
    assert all(count > 0 for name, count in setup.counters.items() if name != "zero_area")
    assert np.array_equal(np.sort(setup.to_clip), expected.to_clip)
    for name in expected.rows.dtype.names:
        assert np.array_equal(setup.rows[name], expected.rows[name]), name
    assert np.array_equal(setup.bounds, expected.bounds)
    assert np.array_equal(setup.order, expected.order)
    if not features:
        assert np.array_equal(setup.depth, expected.depth)


def test_normals_and_tangents(device):
    """The bits of those of copies; of any size, some 0; under placements that mirror, of any scale, and the identity."""
    rng = np.random.default_rng(2)
    placed = matrices(40, rng)
    placed[:-1, :3, :3] *= 10.0 ** rng.uniform(-3.0, 3.0, (39, 1, 1))
    mirrored = placements.mirroring(placed)
    rows = np.zeros(40, SINGLE.Instance)
    rows["rows"], rows["mirrored"], rows["plain"] = placed[:, :3].reshape(-1, 12), mirrored, placements.plain(placed)
    rows["scale"] = np.ldexp(1.0, -np.frexp(np.abs(placed[:, :3, :3]).max(axis=(1, 2)))[1])
    vectors = np.zeros((12, 4))
    vectors[:, :3] = placements.about_one(rng.normal(size=(12, 3)))
    vectors[3, :3], vectors[5, 0], vectors[6, 1:3] = 0.0, 0.0, 0.0
    probe = Probe(device, STAGES, lanes=1, INSTANCES=1)
    every, tiled = np.repeat(rows, 12), np.tile(vectors, (40, 1))
    for is_unit in (False, True):
        tiled[:, 3] = is_unit
        expected = placements.placed_normals(vectors[:, :3], placed, mirrored, np.float32, is_unit=is_unit)
        turned = probe("normals", every, tiled, width=4)
        assert np.array_equal(bits(turned), bits(np.column_stack([expected, np.zeros(480)])))
    vectors[:, 3] = rng.choice([1.0, -1.0], 12)
    turned = probe("tangents", every, np.tile(vectors, (40, 1)), width=4)
    assert np.array_equal(turned, placements.placed_tangents(vectors, placed, mirrored).astype(np.float32))
