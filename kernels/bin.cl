// Lists of triangles per tile, in the order given, without fixed-capacity bins: the sorted list is cut into chunks;
// each chunk counts its entries per tile, the counts are summed up, then each chunk writes behind those before it.
#include "samples.clh"

// Whether an edge function is negative all over the tile, so that the triangle misses it.
int misses_tile(global const Triangle *t, global const Image *image, int column, int row)
{
    int2 least = ((int2)(column, row) << SUBPIXEL_BITS) + (int2)(LEAST_X(image), LEAST_Y(image));
    for (int k = 0; k < 3; ++k) {
        Edge e = edge_at(t, k, least);
        e.value += (long)(MOST_X(image) - LEAST_X(image)) * max(e.a, 0) + (long)(MOST_Y(image) - LEAST_Y(image)) * max(e.b, 0);
        int most = edge_test(e) + (TILE_SIZE - 1) * (max(e.a, 0) + max(e.b, 0));
        if (most < 0)
            return 1;
    }
    return 0;
}

#define FOR_TILES_OF(b, tile)                                                                         \
    int4 box = convert_int4(vload4(0, (b).box));                                                      \
    int4 span = convert_int4(convert_uint4(box) / TILE_SIZE);                                         \
    int whole = span.z - span.x < 2 && span.w - span.y < 2;                                           \
    for (int tile_y = span.y; tile_y <= span.w; ++tile_y)                                             \
        for (int tile_x = span.x, tile = tile_y * image->tiles_x + tile_x; tile_x <= span.z; ++tile_x, ++tile) \
            if (whole || !misses_tile(triangles + (b).index, image, tile_x * TILE_SIZE, tile_y * TILE_SIZE))

kernel void bin_count(global const uint *order,           // T, triangles, nearest first
                      global const Triangle *triangles,   // F + C, from setup
                      global const Bounds *bounds,        // F + C, from setup
                      global const Image *image,          // 1
                      global Bounds *sorted,              // T: the bounds in that order, for bin_fill
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
        Bounds b = bounds[order[i]];
        sorted[i] = b;
        FOR_TILES_OF(b, tile)
            own[tile] += 1;
    }
}

// The sums go over parts of the tiles: first each part's total, then each part's tiles from the totals before it. A part
// alone needs no totals.
int part_begin(int part, int tiles)
{
    return (int)((long)tiles * part / (int)get_global_size(0));
}

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

kernel void bin_scan(global const Image *image,   // 1
                     global const ulong *sums,    // from bin_sums, with as many work-items
                     global uint *counts,         // chunks x tiles: counts in, where each chunk's entries begin out
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

kernel void bin_fill(global const Triangle *triangles,   // F + C
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
        Bounds b = sorted[i];
        FOR_TILES_OF(b, tile) {
            int4 corner = (int4)(tile_x, tile_y, tile_x, tile_y) * TILE_SIZE;
            int4 part = clamp(box - corner, 0, TILE_SIZE - 1);
            Entry e = {b.nearest, b.index, part.x | part.y << 8 | part.z << 16 | part.w << 24};
            lists[own[tile]++] = e;
        }
    }
}
