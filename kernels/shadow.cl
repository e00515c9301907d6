// Shadow rays by themselves: receivers against one light.
#include "shadow_traversal.clh"

void meet_veil(BlockRays *block, int face, fixeds hit)
{
    // Only opaque triangles are asked about.
}

// Those of some lanes, from number `first` on.
ShadowReceiver receivers_of(global const float *points, global const int *receivers, int stride, int first)
{
    ShadowReceiver at;
#define POINTS(k) TO_REALS(LOAD_LANES(points + (size_t)(k) * stride + first))
    at.point.x.high = POINTS(0), at.point.y.high = POINTS(1), at.point.z.high = POINTS(2);
    at.point.x.low = POINTS(3), at.point.y.low = POINTS(4), at.point.z.low = POINTS(5);
#undef POINTS
    at.face = TO_INTS(LOAD_LANES(receivers + first));
    return at;
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
    begin_rays(&block, &at, &in, &light, at.face >= 0);
    ints hit = hidden_from(&block, at.face >= 0);
    STORE_LANES(TO_FIXEDS(hit ? (ints)(1) : (ints)(0)), dark + first);
}
