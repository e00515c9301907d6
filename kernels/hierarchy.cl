// The build of the hierarchy of casters: keys, which the host sorts; leaves of LEAF_TRIANGLES in that order, and their
// boxes; then the boxes of each level above. A node has NODE_CHILDREN children, whose numbers follow from its own.
#include "hierarchy.clh"
#include "shadow_predicate.clh"

// Spreads 12 bits to every third.
ulong spread(ulong v)
{
    v = (v | v << 16) & 0xff0000ffUL;
    v = (v | v << 8) & 0xf00f00f00fUL;
    v = (v | v << 4) & 0xc30c30c30c3UL;
    return (v | v << 2) & 0x249249249249UL;
}

// A face's key: its class of size, so that large triangles do not widen the boxes of small ones; its place along
// Morton's curve, 12 bits an axis, less the lowest where the index needs them; its index. NO_CASTER if two of its corners are
// one vertex or one is not finite; others without area lie in every plane through them, so the predicate finds the light on
// neither side.
kernel void hierarchy_keys(global const float *vertices,  // V x VERTEX_ROW
                           global const int *faces,       // F x 3
                           global ulong *keys,            // F
                           int index_bits,                // of the keys
                           int face_count)                // F
{
    int i = get_global_id(0);
    if (i >= face_count)
        return;
    int v[3] = {faces[3 * (size_t)i], faces[3 * (size_t)i + 1], faces[3 * (size_t)i + 2]};
    global const float *a = vertices + VERTEX_ROW * (size_t)v[0], *b = vertices + VERTEX_ROW * (size_t)v[1];
    global const float *c = vertices + VERTEX_ROW * (size_t)v[2];
    const float cell = (float)(SHADOW_REACH) / 2048.0f;
    float largest = 0.0f, sum = 0.0f;
    ulong code = 0;
    for (int k = 0; k < 3; ++k) {
        float low = LEAST_OF_TWO(a[k], LEAST_OF_TWO(b[k], c[k])), high = MOST_OF_TWO(a[k], MOST_OF_TWO(b[k], c[k]));
        float place = (0.5f * (low + high) + (float)(SHADOW_REACH)) / cell;
        code |= spread((ulong)clamp((int)place, 0, 4095)) << k;
        largest = MOST_OF_TWO(largest, high - low);
        sum += (a[k] + b[k]) + c[k];
    }
    int drop = v[0] == v[1] || v[1] == v[2] || v[2] == v[0] || !(fabs(sum) <= FLT_MAX);
    ulong size = largest > (float)(SHADOW_REACH) / 2.0f ? 2 : largest > (float)(SHADOW_REACH) / 8.0f ? 1 : 0;
    ulong place_bits = (size << CURVE_BITS | code) << (64 - SIZE_BITS - CURVE_BITS);
    keys[i] = drop ? NO_CASTER : (place_bits >> index_bits) << index_bits | (ulong)i;
}

void store_box(global float *node, int child, const float *low, const float *high)
{
    UNROLL for (int k = 0; k < 3; ++k) {
        node[k * NODE_CHILDREN + child] = low[k];
        node[(3 + k) * NODE_CHILDREN + child] = high[k];
    }
}

// A work-item makes a leaf and its box in the lowest level.
kernel void hierarchy_leaves(global const float *vertices, global const int *faces,
                             global const ulong *keys,  // of count casters, sorted
                             global float *leaves,      // structs of LEAF_SIZE
                             global float *nodes,       // structs of NODE_SIZE
                             int first_leaf, int leaf_count, int first_node, int slots, int index_bits, int count)
{
    int i = get_global_id(0);
    if (i >= slots)
        return;
    float low[3] = {FLT_MAX, FLT_MAX, FLT_MAX}, high[3] = {-FLT_MAX, -FLT_MAX, -FLT_MAX};
    if (i < leaf_count) {
        global float *leaf = leaves + (size_t)(first_leaf + i) * LEAF_SIZE;
        for (int s = 0; s < LEAF_TRIANGLES; ++s) {
            // Room that is left repeats the last triangle.
            int face = (int)(keys[min(i * LEAF_TRIANGLES + s, count - 1)] & ((1UL << index_bits) - 1));
            UNROLL for (int corner = 0; corner < 3; ++corner) {
                global const float *v = vertices + VERTEX_ROW * (size_t)faces[3 * (size_t)face + corner];
                UNROLL for (int k = 0; k < 3; ++k) {
                    leaf[(3 * corner + k) * LEAF_TRIANGLES + s] = v[k];
                    low[k] = LEAST_OF_TWO(low[k], v[k]);
                    high[k] = MOST_OF_TWO(high[k], v[k]);
                }
            }
            leaf[9 * LEAF_TRIANGLES + s] = as_float(face);
        }
    }
    store_box(nodes + (size_t)(first_node + i / NODE_CHILDREN) * NODE_SIZE, i % NODE_CHILDREN, low, high);
}

// A work-item makes the box of a node in the level above, which begins at node `above` where its own does at `first`.
kernel void hierarchy_level(global float *nodes, int first, int above, int below_count, int slots)
{
    int i = get_global_id(0);
    if (i >= slots)
        return;
    float low[3] = {FLT_MAX, FLT_MAX, FLT_MAX}, high[3] = {-FLT_MAX, -FLT_MAX, -FLT_MAX};
    if (i < below_count) {
        global const float *node = nodes + (size_t)(first + i) * NODE_SIZE;
        for (int k = 0; k < 3; ++k)
            for (int child = 0; child < NODE_CHILDREN; ++child) {
                low[k] = LEAST_OF_TWO(low[k], node[k * NODE_CHILDREN + child]);
                high[k] = MOST_OF_TWO(high[k], node[(3 + k) * NODE_CHILDREN + child]);
            }
    }
    store_box(nodes + (size_t)(above + i / NODE_CHILDREN) * NODE_SIZE, i % NODE_CHILDREN, low, high);
}
