"""Shadow rays through the hierarchy of casters, and against all triangles one by one: from receivers to a light, and to
points of their own, which are a fan of rays."""

import math

import numpy as np
from kernel_stages import mask

from clshade.pipeline.buffers import Buffer
from clshade.pipeline.hierarchy import Hierarchy
from clshade.pipeline.launches import Stages
from clshade.pipeline.opencl.device import Device
from clshade.pipeline.programs import build
from clshade.pipeline.shading_tables import split
from clshade.pipeline.struct_layout import SHADOW_REACH

Array = np.ndarray
TEXT = """
#include "shadow.cl"

kernel void one_by_one(global const float *points, global const int *receivers, global const float *vertices,
                       global const int *faces, global const ShadowLight *lights, global int *dark, int face_count,
                       int stride)
{
    int first = get_global_id(0) * LANES;
    Shadows in = {vertices, faces};
    ShadowReceiver at = receivers_of(points, receivers, stride, first);
    ShadowLight light = lights[0];
    BlockRays block;
    fixeds hit = (fixeds)(0);
    begin_rays(&block, &at, &in, &light, (ints)(-1));
    find_planes(&block);
    for (int triangle = 0; triangle < face_count; ++triangle)
        hit |= casts_shadow(&block.ray, light.w, vertices, faces, triangle, (fixeds)(-1));
    STORE_LANES(hit, dark + first);
}

kernel void fans(global const float *points, global const int *receivers, global const float *ends,
                 global const float *vertices, global const int *faces, global const float *nodes,
                 global const float *leaves, global const Casters *casters, global int *dark, float w, int many,
                 int face_count)
{
    int row = get_global_id(0);
    Shadows in = {vertices, faces, nodes, leaves, 0, casters};
    global const float *p = points + row * 6;
    ShadowReceiver apex = {PAIRS_IN_ALL(p, p + 3), (fixeds)(receivers[row])};
    for (int j = 0; j < many; j += LANES) {
#define END(k) LOAD_LANES(ends + (row * 6 + k) * many + j)
        float_pair3 end = {{END(0), END(3)}, {END(1), END(4)}, {END(2), END(5)}};
        BlockRays block;
        begin_fan(&block, &in, &apex, &end, w);
        fixeds hit = (fixeds)(0);
        if (face_count)
            find_planes(&block);
        else {
            trace_block(&block, casters, (ints)(-1));
            hit = TO_FIXEDS(TO_INTS(block.dark));
        }
        for (int triangle = 0; triangle < face_count; ++triangle)
            hit |= casts_shadow(&block.ray, w, vertices, faces, triangle, (fixeds)(-1));
        STORE_LANES(hit, dark + row * many + j);
    }
}
"""


def one_by_one(device: Device, hierarchy: Hierarchy, points: Array, receivers: Array, light: Array) -> Array:
    """Return whether rays to a light meet any triangle, by the predicate alone; a multiple of 16 of them."""
    count, frame = len(points), hierarchy.frame
    rays = np.ascontiguousarray(frame.pairs(points).T), receivers.astype(np.int32), frame.light(light)
    values = dict(zip(("points", "receivers", "lights"), (Buffer(device, ray) for ray in rays), strict=True))
    dark = Buffer.empty(device, count, np.int32)
    stages = Stages(device, build(device, mask(), TEXT, lanes=16))
    more = {"dark": dark, "face_count": len(hierarchy.faces.array), "stride": count}
    stages.run("one_by_one", (count // 16, 1), {**vars(hierarchy), **values}, **more)
    return dark.to_host() != 0


def hidden(
    device: Device,
    hierarchy: Hierarchy,
    points: Array,
    receivers: Array,
    ends: Array,
    directional: bool = False,
    *,
    lanes: int = 16,
    predicate: bool = False,
) -> Array:
    """Return whether triangles hide points from receivers, (K, N).

    points, receivers: as of `Hierarchy.shadowed`. ends: (K, N, 3), N points for each receiver, or directions toward them.
    predicate: by what shadow_predicate.clh says of every triangle.
    """
    frame, (count, many, _) = hierarchy.frame, ends.shape
    moved = ends * frame.unit if directional else (ends - frame.origin) * frame.unit
    size = float(np.abs(moved).max(initial=0.0))
    w = 1.0 if size <= SHADOW_REACH else SHADOW_REACH * 2.0 ** -math.frexp(size)[1]
    parts = np.zeros((count, 6, -(-many // 16) * 16), np.float32)
    parts[:, :, :many] = split(moved * w).swapaxes(1, 2)
    dark = Buffer(device, np.zeros((count, parts.shape[2]), np.int32))
    arrays = {"points": frame.pairs(points), "receivers": receivers.astype(np.int32), "ends": parts}
    values = {**vars(hierarchy), **{name: Buffer(device, array) for name, array in arrays.items()}, "dark": dark}
    values |= {"w": 0.0 if directional else w, "many": parts.shape[2]}
    face_count = len(hierarchy.faces.array) if predicate else 0
    Stages(device, build(device, mask(), TEXT, lanes=lanes)).run("fans", (count, 1), values, face_count=face_count)
    return dark.to_host()[:, :many] != 0
