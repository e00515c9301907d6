// Shadow rays by themselves: receivers against one light, or against points of their own.
#include "shadow_traversal.clh"

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
    ints hit = shadowed(&at, &in, 0, at.face >= 0);
    STORE_LANES(TO_FIXEDS(hit ? (ints)(1) : (ints)(0)), dark + first);
}

// A work-item does LANES receivers.
ITEM_BY_ITEM
kernel void shadow_fans(global const float *points,   // 6 x K, high then low parts of x, y, z
                        global const int *receivers,  // K, the face of each; negative: not asked
                        global const float *ends,     // K x 6 x N, the same parts of the ends of each receiver's rays, times w
                        global const float *vertices, global const int *faces, global const float *nodes,
                        global const float *leaves, global const Casters *casters,
                        global int *dark,             // K x N, 1 or 0
                        float w,                      // a power of two, or 0 of directions
                        int many,                     // N, a multiple of LANES
                        int stride)                   // K
{
    int first = get_global_id(0) * LANES;
    if (first >= stride)
        return;
    Shadows in = {vertices, faces, nodes, leaves, 0, casters};
    ShadowReceiver at = receivers_of(points, receivers, stride, first);
    FanReceivers apexes;
    fan_receivers(&apexes, &at, at.face >= 0);
    for (int lane = 0; lane < LANES; ++lane) {
        size_t row = first + lane;
        for (int j = 0; j < many; j += LANES) {
            float_pair3 end;
            ints hit = (ints)(0);
#define ENDS(k) LOAD_LANES(ends + (row * 6 + (k)) * many + j)
            end.x.high = ENDS(0), end.y.high = ENDS(1), end.z.high = ENDS(2);
            end.x.low = ENDS(3), end.y.low = ENDS(4), end.z.low = ENDS(5);
#undef ENDS
            if (receivers[row] >= 0) {
                BlockRays block;
                begin_fan(&block, &in, &apexes, lane, &end, w);
                hit = hidden_from(&block, (ints)(-1));
            }
            STORE_LANES(TO_FIXEDS(hit ? (ints)(1) : (ints)(0)), dark + row * many + j);
        }
    }
}
