// Shadow rays by themselves: receivers against one light.
#include "shadow_traversal.clh"

void meet_veil(BlockRays *block, int face, fixeds hit)
{
    // Only opaque triangles are asked about.
}

// Those of some lanes, from number `first` on.
ShadowReceiver receivers_of(global const float *points, global const int *receivers, int stride, int first)
{
#define POINTS(k) LOAD_LANES(points + (size_t)(k) * stride + first)
    float_pair3 point = {{POINTS(0), POINTS(3)}, {POINTS(1), POINTS(4)}, {POINTS(2), POINTS(5)}};
#undef POINTS
    return (ShadowReceiver){fp3_on_grid(&point), LOAD_LANES(receivers + first)};
}

// A work-item does LANES receivers.
ITEM_BY_ITEM
kernel void shadow_rays(global const float *points,   // 6 x K, high then low parts of x, y, z
                        global const int *receivers,  // K, the face of each; negative: not asked
                        global const float *vertices, global const int *faces, global const float *nodes,
                        global const float *leaves, global const ShadowLight *lights,
                        global const Casters *casters,
                        global int *dark,             // K, 1 or 0
                        int stride)                   // K
{
    int first = get_global_id(0) * LANES;
    if (first >= stride)
        return;
    Shadows in = {vertices, faces, nodes, leaves, lights, casters};
    ShadowReceiver at = receivers_of(points, receivers, stride, first);
    ShadowLight light = lights[0];
    BlockRays block;
    ints active = TO_INTS(at.face >= 0);
    begin_rays(&block, &at, &in, &light, active);
    trace_block(&block, casters, active);
    STORE_LANES(TO_FIXEDS(TO_INTS(block.dark) ? (ints)(1) : (ints)(0)), dark + first);
}
