// Lists of triangles per tile, in the given order, without fixed-capacity bins: the sorted list is split into chunks;
// each chunk counts its entries per tile, a prefix sum is taken, then each chunk writes after the chunks before it.
#include "samples.clh"

// A triangle's edge tests, as edge_test without its limits, at their maximum within a tile: if one is negative, the
// triangle misses the tile.
typedef struct {
    long most[3];          // in the first tile of its box
    long right[3], up[3];  // change from tile to tile
} TileTests;

INLINE TileTests tile_tests(global const Triangle *t, global const Image *image, int tile_x, int tile_y)
{
    int2 least = ((int2)(tile_x, tile_y) * TILE_SIZE << SUBPIXEL_BITS) + (int2)(LEAST_X(image), LEAST_Y(image));
    TileTests tests;
    for (int k = 0; k < 3; ++k) {
        Edge e = edge_at(t, k, least);
        long right = max(e.a, 0), up = max(e.b, 0);
        e.value += (MOST_X(image) - LEAST_X(image)) * right + (MOST_Y(image) - LEAST_Y(image)) * up;
        tests.most[k] = ((e.value - e.bias) >> SUBPIXEL_BITS) + (TILE_SIZE - 1) * (right + up);
        tests.right[k] = (long)e.a * TILE_SIZE;
        tests.up[k] = (long)e.b * TILE_SIZE;
    }
    return tests;
}

INLINE int misses_tile(const TileTests *tests, int right, int up)
{
    long signs = 0;
    for (int k = 0; k < 3; ++k)
        signs |= tests->most[k] + right * tests->right[k] + up * tests->up[k];
    return signs < 0;
}

// Loops over the tiles (tile_x, tile_y), with index `tile`, of which a triangle may cover a sample. Its box is (left,
// bottom) to (right, top), in pixels.
#define FOR_TILES_OF(b, index, tile)                                                                  \
    uint left = (b).box & 0xffff, bottom = (b).box >> 16 & 0xffff, right = (b).box >> 32 & 0xffff, top = (b).box >> 48; \
    int first_x = left / TILE_SIZE, first_y = bottom / TILE_SIZE;                                        \
    int last_x = right / TILE_SIZE, last_y = top / TILE_SIZE;                                        \
    TileTests tests;                                                                                  \
    int whole = last_x - first_x < 2 && last_y - first_y < 2;                                         \
    if (!whole)                                                                                       \
        tests = tile_tests(triangles + (index), image, first_x, first_y);                           \
    for (int tile_y = first_y; tile_y <= last_y; ++tile_y)                                            \
        for (int tile_x = first_x, tile = tile_y * image->tiles_x + tile_x; tile_x <= last_x; ++tile_x, ++tile) \
            if (whole || !misses_tile(&tests, tile_x - first_x, tile_y - first_y))

ITEM_BY_ITEM
kernel void bin_count(global const uint *order,           // T, triangles, nearest first
                      global const Triangle *triangles,   // F + C, from setup
                      global const Bounds *bounds,        // F + C, from setup
                      global const Image *image,          // 1
                      global Bounds *sorted,              // T: the bounds in this order, for bin_fill
                      global uint *counts,                // chunks x tiles
                      int chunk_size, int count)          // T
{
    int chunk = get_global_id(0);
    global uint *own = counts + (long)chunk * image->tiles;
    for (int tile = 0; tile < image->tiles; ++tile)
        own[tile] = 0;
    int end = min((chunk + 1) * chunk_size, count);
    for (int i = chunk * chunk_size; i < end; ++i) {
        PREFETCH(bounds + order[min(i + 16, end - 1)]);
        uint index = order[i];
        Bounds b = bounds[index];
        sorted[i] = b;
        FOR_TILES_OF(b, index, tile)
            own[tile] += 1;
    }
}

// The prefix sum works on parts of the tiles: first each part's total, then each part's tiles from the totals before it.
// A single part needs no totals.
int part_begin(int part, int tiles)
{
    return (int)((long)tiles * part / (int)get_global_size(0));
}

ITEM_BY_ITEM
kernel void bin_sums(global const Image *image,   // 1
                     global const uint *counts,   // chunks x tiles, from bin_count
                     global ulong *sums,          // entries of each part
                     int chunks)
{
    int part = get_global_id(0), end = part_begin(part + 1, image->tiles);
    ulong sum = 0;
    for (int chunk = 0; chunk < chunks; ++chunk) {
        global const uint *own = counts + (long)chunk * image->tiles;
        for (int tile = part_begin(part, image->tiles); tile < end; ++tile)
            sum += own[tile];
    }
    sums[part] = sum;
}

ITEM_BY_ITEM
kernel void bin_scan(global const Image *image,   // 1
                     global const ulong *sums,    // from bin_sums, with as many work-items
                     global uint *counts,         // chunks x tiles: in: counts; out: where each chunk's entries begin
                     global uint *starts,         // tiles + 1: where each tile's list begins
                     global Counters *counters,   // 1: entries, empty tiles
                     int chunks)
{
    int part = get_global_id(0), end = part_begin(part + 1, image->tiles), empty = 0;
    ulong at = 0;
    for (int before = 0; before < part; ++before)
        at += sums[before];
    for (int tile = part_begin(part, image->tiles); tile < end; ++tile) {
        ulong begin = at;
        starts[tile] = (uint)at;
        for (int chunk = 0; chunk < chunks; ++chunk) {
            global uint *own = counts + (long)chunk * image->tiles + tile;
            uint count = *own;
            *own = (uint)at;
            at += count;
        }
        empty += at == begin;
    }
    if (empty)
        atomic_add(&counters->empty_tiles, empty);
    if (end == image->tiles && part + 1 == get_global_size(0)) {
        starts[end] = (uint)at;
        counters->entries = at;
    }
}

ITEM_BY_ITEM
kernel void bin_fill(global const uint *order,           // T, triangles, nearest first
                     global const Triangle *triangles,   // F + C
                     global const Image *image,          // 1
                     global const Bounds *sorted,        // T, from bin_count
                     global uint *cursors,               // chunks x tiles: where each chunk's entries of a tile begin
                     global Entry *lists,                // entries of tile 0, of tile 1, ...
                     global const Counters *counters,    // 1
                     int chunk_size, int count)          // T
{
    if (!lists_hold_all(image, counters))
        return;
    int chunk = get_global_id(0);
    global uint *own = cursors + (long)chunk * image->tiles;
    int end = min((chunk + 1) * chunk_size, count);
    for (int i = chunk * chunk_size; i < end; ++i) {
        uint index = order[i];
        Bounds b = sorted[i];
        FOR_TILES_OF(b, index, tile) {
            int x = tile_x * TILE_SIZE, y = tile_y * TILE_SIZE;
            int box = max((int)left - x, 0) | max((int)bottom - y, 0) << 8 | min((int)right - x, TILE_SIZE - 1) << 16 |
                      min((int)top - y, TILE_SIZE - 1) << 24;
            Entry e = {b.nearest, index, box, b.only};
            lists[own[tile]++] = e;
        }
    }
}
