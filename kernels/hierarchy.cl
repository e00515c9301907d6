// The build of the hierarchy of casters: keys, which the host sorts; a better order of each run of them; leaves of
// LEAF_TRIANGLES in that order, and their boxes; then the boxes of each level above. A node has NODE_CHILDREN children, whose
// numbers follow from its own.
#include "hierarchy.clh"
#include "shadow_predicate.clh"

#define AXIS_BITS (CURVE_BITS / 3)
#define KEYS 16  // that a work-item makes: the compiler takes them together

// Spreads 12 bits to every third.
ulong spread(ulong v)
{
    v = (v | v << 16) & 0xff0000ffUL;
    v = (v | v << 8) & 0xf00f00f00fUL;
    v = (v | v << 4) & 0xc30c30c30c3UL;
    return (v | v << 2) & 0x249249249249UL;
}

// Turns cells, of AXIS_BITS along each axis, into their places along Hilbert's curve, whose bits are those of the three numbers
// in turn (J. Skilling, Programming the Hilbert curve, AIP Conference Proceedings 707, 2004): from the highest bit on, each
// octant turns and mirrors the curve within it, that is, the lower bits; what results is a Gray code.
void follow_curve(uint place[3][KEYS])
{
    for (uint bit = 1u << (AXIS_BITS - 1); bit > 1; bit >>= 1)
        for (int k = 0; k < 3; ++k)
            for (int s = 0; s < KEYS; ++s) {
                uint first = place[0][s], other = place[k][s], swapped = other & bit ? 0 : (first ^ other) & (bit - 1);
                place[0][s] = first ^ (other & bit ? bit - 1 : swapped);
                place[k][s] ^= k == 0 ? 0 : swapped;
            }
    for (int s = 0; s < KEYS; ++s) {
        uint y = place[0][s] ^ place[1][s], z = y ^ place[2][s];
        uint above = z >> 1;  // of each bit the parity of those above
        for (int shift = 1; shift < AXIS_BITS; shift *= 2)
            above ^= above >> shift;
        place[0][s] ^= above, place[1][s] = y ^ above, place[2][s] = z ^ above;
    }
}

// A face's key: its class of size, so that large triangles do not widen the boxes of small ones; its place along
// Hilbert's curve, AXIS_BITS an axis, less the lowest where the index needs them; its index. NO_CASTER if two of its corners are
// one vertex or one is not finite; others without area lie in every plane through them, so the predicate finds the light on
// neither side.
kernel void hierarchy_keys(global const float *vertices,  // V x VERTEX_ROW
                           global const int *faces,       // F x 3
                           global ulong *keys,            // F
                           int index_bits,                // of the keys
                           int face_count)                // F
{
    int base = get_global_id(0) * KEYS;
    if (base >= face_count)
        return;
    const float cell = (float)(SHADOW_REACH) / (1 << (AXIS_BITS - 1));
    uint place[3][KEYS];
    int size[KEYS];
    for (int s = 0; s < KEYS; ++s) {
        global const int *v = faces + 3 * (size_t)min(base + s, face_count - 1);
        global const float *a = vertices + VERTEX_ROW * (size_t)v[0], *b = vertices + VERTEX_ROW * (size_t)v[1];
        global const float *c = vertices + VERTEX_ROW * (size_t)v[2];
        float largest = 0.0f, sum = 0.0f;
        for (int k = 0; k < 3; ++k) {
            float low = MIN(a[k], MIN(b[k], c[k])), high = MAX(a[k], MAX(b[k], c[k]));
            float along = (0.5f * (low + high) + (float)(SHADOW_REACH)) / cell;
            // NaN, of faces to be dropped, becomes 0.
            place[k][s] = (uint)MIN(MAX(along, 0.0f), (float)((1 << AXIS_BITS) - 1));
            largest = MAX(largest, high - low);
            sum += (a[k] + b[k]) + c[k];
        }
        int drop = v[0] == v[1] || v[1] == v[2] || v[2] == v[0] || !(fabs(sum) <= FLT_MAX);
        size[s] = drop ? -1 : (largest > (float)(SHADOW_REACH) / 8.0f) + (largest > (float)(SHADOW_REACH) / 2.0f);
    }
    follow_curve(place);
    for (int s = 0; s < min(KEYS, face_count - base); ++s) {
        ulong code = spread(place[0][s]) << 2 | spread(place[1][s]) << 1 | spread(place[2][s]);
        ulong key = ((ulong)size[s] << CURVE_BITS | code) << (64 - SIZE_BITS - CURVE_BITS);
        keys[base + s] = size[s] < 0 ? NO_CASTER : (key >> index_bits) << index_bits | (ulong)(base + s);
    }
}

// A run of keys is reordered so that each half, quarter and so on, down to the leaves, is one along the axis along which it
// extends farthest; for each triangle a row: three times its centroid, its face.
#define BINS 64  // along an axis: what is in the middle one is halved as it comes

typedef struct {
    int first, count, side;  // of the rows; in which half of the room they are
} Part;

// Copies the `below` lowest rows of a part along its longest axis before the others. What is computed of the faces in their
// fourth column is not used.
void halve(global const float *from, global float *to, int count, int below)
{
    float16 lows = (float16)(FLT_MAX), highs = -lows;
    for (int i = 0; i < count / 4; ++i) {
        float16 four = load16(from + 16 * i);
        lows = MIN(four, lows), highs = MAX(four, highs);
    }
    float8 low8 = MIN(lows.lo, lows.hi), high8 = MAX(highs.lo, highs.hi);
    float4 low = MIN(low8.lo, low8.hi), high = MAX(high8.lo, high8.hi);
    for (int i = count / 4 * 4; i < count; ++i) {
        float4 row = load4(from + 4 * i);
        low = MIN(row, low), high = MAX(row, high);
    }
    float4 size = high - low;
    int axis = size.x > size.y ? (size.x > size.z ? 0 : 2) : size.y > size.z ? 1 : 2;
    float start = axis == 0 ? low.x : axis == 1 ? low.y : low.z, extent = axis == 0 ? size.x : axis == 1 ? size.y : size.z;
    float scale = extent > (float)(SHADOW_GRID) ? BINS / extent : 0.0f;
    int many[4][BINS];  // neighbors are often in one bin: their counts do not wait for each other
    for (int i = 0; i < BINS; ++i)
        many[0][i] = many[1][i] = many[2][i] = many[3][i] = 0;
    for (int i = 0; i < count; ++i)
        ++many[i % 4][min((int)((from[4 * i + axis] - start) * scale), BINS - 1)];
    for (int i = 0; i < BINS; ++i)
        many[0][i] += (many[1][i] + many[2][i]) + many[3][i];
    int middle = 0, rest = below;
    while (many[0][middle] < rest)
        rest -= many[0][middle++];
    int next = 0, other = below;
    for (int i = 0; i < count; ++i) {
        int bin = min((int)((from[4 * i + axis] - start) * scale), BINS - 1), equal = bin == middle;
        int before = (bin < middle) | (equal & (rest > 0));
        rest -= equal;
        store4(load4(from + 4 * i), to + 4 * (before ? next : other));
        next += before, other += !before;
    }
}

// A work-item does a run of HIERARCHY_RUN keys.
kernel void hierarchy_runs(global const float *vertices, global const int *faces,
                           global ulong *keys,   // sorted; of what is reordered only the faces stay
                           global float *rows,   // room: two rows of four for each key of the launch
                           int first, int index_bits,
                           int count)            // of keys, from number `first` on
{
    int begin = get_global_id(0) * HIERARCHY_RUN, many = min(HIERARCHY_RUN, count - begin);
    if (many <= LEAF_TRIANGLES)
        return;
    keys += first + begin;
    rows += 8 * (size_t)begin;
    for (int i = 0; i < many; ++i) {
        int face = (int)(keys[i] & ((1UL << index_bits) - 1));
        global const float4 *corners = (global const float4 *)vertices;
        global const int *v = faces + 3 * (size_t)face;
        float4 sum = (corners[2 * (size_t)v[0]] + corners[2 * (size_t)v[1]]) + corners[2 * (size_t)v[2]];
        store4((float4)(sum.xyz, as_float(face)), rows + 4 * i);
    }
    Part left[16] = {{0, many, 0}};  // parts that wait: at most one for each halving of a run, and one more
    int parts = 1;
    while (parts > 0) {
        Part part = left[--parts];
        global float *from = rows + 4 * (part.side * many + part.first), *to = rows + 4 * ((1 - part.side) * many + part.first);
        if (part.count <= LEAF_TRIANGLES) {
            for (int i = 0; i < part.count; ++i)
                keys[part.first + i] = (ulong)as_int(from[4 * i + 3]);
            continue;
        }
        int whole = part.count > LEAF_TRIANGLES * NODE_CHILDREN ? LEAF_TRIANGLES * NODE_CHILDREN : LEAF_TRIANGLES;
        int below = (part.count + 2 * whole - 1) / (2 * whole) * whole;  // full nodes, full leaves
        halve(from, to, part.count, below);
        left[parts++] = (Part){part.first, below, 1 - part.side};
        left[parts++] = (Part){part.first + below, part.count - below, 1 - part.side};
    }
}

void store_box(global float *node, int child, const float *low, const float *high)
{
    UNROLL for (int k = 0; k < 3; ++k) {
        node[k * NODE_CHILDREN + child] = low[k];
        node[(3 + k) * NODE_CHILDREN + child] = high[k];
    }
}

// A work-item makes a leaf and its box in the lowest level, or an empty box where there are no more leaves.
kernel void hierarchy_leaves(global const float *vertices, global const int *faces,
                             global const ulong *keys,  // of count casters, sorted
                             global float *leaves,      // structs of LEAF_SIZE
                             global float *nodes,       // structs of NODE_SIZE
                             int first_leaf, int leaf_count, int first_node, int index_bits, int count)
{
    int i = get_global_id(0);
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
                    low[k] = MIN(low[k], v[k]);
                    high[k] = MAX(high[k], v[k]);
                }
            }
            leaf[9 * LEAF_TRIANGLES + s] = as_float(face);
        }
    }
    store_box(nodes + (size_t)(first_node + i / NODE_CHILDREN) * NODE_SIZE, i % NODE_CHILDREN, low, high);
}

// A work-item likewise makes the box of a node in the level above, which begins at node `above` where its own does at `first`.
kernel void hierarchy_level(global float *nodes, int first, int above, int below_count)
{
    int i = get_global_id(0);
    float low[3] = {FLT_MAX, FLT_MAX, FLT_MAX}, high[3] = {-FLT_MAX, -FLT_MAX, -FLT_MAX};
    if (i < below_count) {
        global const float *node = nodes + (size_t)(first + i) * NODE_SIZE;
        for (int k = 0; k < 3; ++k)
            for (int child = 0; child < NODE_CHILDREN; ++child) {
                low[k] = MIN(low[k], node[k * NODE_CHILDREN + child]);
                high[k] = MAX(high[k], node[(3 + k) * NODE_CHILDREN + child]);
            }
    }
    store_box(nodes + (size_t)(above + i / NODE_CHILDREN) * NODE_SIZE, i % NODE_CHILDREN, low, high);
}
