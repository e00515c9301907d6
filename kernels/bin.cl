// Lists of triangles per tile, in the given order, without fixed-capacity bins: the sorted list is split into chunks;
// each chunk counts its entries per tile, a prefix sum is taken, then each chunk writes after the chunks before it.
#include "tile_walk.clh"

#define ENTRIES_PER_LINE 4  // of a cache

ITEM_BY_ITEM
kernel void bin_count(global const uint *order,           // T, triangles, nearest first
                      global const Triangle *triangles,   // F + C, from setup
                      global const Bounds *bounds,        // F + C, from setup
                      global const Image *image,          // 1
                      global Bounds *sorted,              // T: the bounds in this order, for bin_fill
                      global uint *counts,                // chunks x (tiles + 1)
                      int chunk_size, int count)          // T
{
    int chunk = get_global_id(0);
    global uint *own = counts + (long)chunk * TILE_COUNTS(image);
    for (int tile = 0; tile < TILE_COUNTS(image); ++tile)
        own[tile] = 0;
    int end = min((chunk + 1) * chunk_size, count);
    for (int i = chunk * chunk_size; i < end; ++i) {
        PREFETCH(bounds + order[min(i + 16, end - 1)]);
        uint index = order[i];
        Bounds b = bounds[index];
        sorted[i] = b;
        TileWalk walk = walk_of(b, triangles + index, image);
        while (next_tile(&walk))
            own[tile_at(&walk, image)] += 1;
    }
}

#define NOTHING_FITS (1UL << 62)  // more entries than any list holds

// The prefix sum works on parts of the tiles: first each part's total, then each part's tiles from the totals before it.
// A single part needs no totals.
int part_begin(int part, int tiles)
{
    return (int)((long)tiles * part / (int)get_global_size(0));
}

ITEM_BY_ITEM
kernel void bin_sums(global const Image *image,   // 1
                     global const uint *counts,   // chunks x (tiles + 1), from bin_count
                     global ulong *sums,          // entries of each part
                     int chunks)
{
    int part = get_global_id(0), end = part_begin(part + 1, image->tiles);
    ulong sum = 0;
    for (int chunk = 0; chunk < chunks; ++chunk) {
        global const uint *own = counts + (long)chunk * TILE_COUNTS(image);
        for (int tile = part_begin(part, image->tiles); tile < end; ++tile)
            sum += own[tile];
    }
    sums[part] = sum;
}

ITEM_BY_ITEM
kernel void bin_scan(global const Image *image,   // 1
                     global const ulong *sums,    // from bin_sums, with as many work-items
                     global uint *counts,         // chunks x (tiles + 1): in: counts; out: where each chunk's entries begin
                     global uint *starts,         // tiles + 1: where each tile's list begins
                     global Counters *counters,   // 1: entries, empty tiles
                     int chunks,
                     int stops_to_clip)           // whether nothing is drawn if there are faces to clip
{
    int part = get_global_id(0), end = part_begin(part + 1, image->tiles), empty = 0;
    ulong at = 0;
    for (int before = 0; before < part; ++before)
        at += sums[before];
    for (int tile = part_begin(part, image->tiles); tile < end; ++tile) {
        ulong begin = at;
        starts[tile] = (uint)at;
        for (int chunk = 0; chunk < chunks; ++chunk) {
            global uint *own = counts + (long)chunk * TILE_COUNTS(image) + tile;
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
        counters->entries = stops_to_clip && counters->to_clip ? NOTHING_FITS : at;
    }
}

// Appends a triangle to the lists of its tiles.
INLINE void put_entries(global Entry *lists, global uint *cursors, Bounds b, global const Triangle *triangle, uint index,
                        global const Image *image)
{
    TileWalk walk = walk_of(b, triangle, image);
    while (next_tile(&walk)) {
        int x = walk.x * TILE_SIZE, y = walk.y * TILE_SIZE;
        int box = max(walk.left - x, 0) | max(walk.bottom - y, 0) << 8 | min(walk.right - x, TILE_SIZE - 1) << 16 |
                  min(walk.top - y, TILE_SIZE - 1) << 24;
        Entry e = {b.nearest, index, box, b.only};
        uint at = cursors[tile_at(&walk, image)]++;
        lists[at] = e;
        if (at % ENTRIES_PER_LINE == 0)
            PREFETCH_TO_WRITE(lists + at + ENTRIES_PER_LINE);
    }
}

ITEM_BY_ITEM
kernel void bin_fill(global const uint *order,           // T, triangles, nearest first
                     global const Triangle *triangles,   // F + C
                     global const Image *image,          // 1
                     global const Bounds *sorted,        // T, from bin_count
                     global uint *cursors,               // chunks x (tiles + 1): where each chunk's entries of a tile begin
                     global Entry *lists,                // entries of tile 0, of tile 1, ...
                     global const Counters *counters,    // 1
                     int chunk_size, int count)          // T
{
    if (!lists_hold_all(image, counters))
        return;
    int chunk = get_global_id(0);
    global uint *own = cursors + (long)chunk * TILE_COUNTS(image);
    int end = min((chunk + 1) * chunk_size, count);
    for (int i = chunk * chunk_size; i < end; ++i) {
        uint index = order[i];
        Bounds b = sorted[i];
        put_entries(lists, own, b, triangles + index, index, image);
    }
}

#if !SORTED && LANES > 1
// The same in the order of set-up, for the triangles of each chunk of faces.
ITEM_BY_ITEM
kernel void fill_lists(global const Triangle *triangles,   // F + C
                       global const Image *image,          // 1
                       global const Bounds *bounds,        // F + C, from setup_count
                       global const uint *made,            // chunks
                       global uint *cursors,               // chunks x (tiles + 1): where each chunk's entries of a tile begin
                       global Entry *lists,                // entries of tile 0, of tile 1, ...
                       global const Counters *counters,    // 1
                       int chunk_size)
{
    if (!lists_hold_all(image, counters))
        return;
    int chunk = get_global_id(0), first = chunk * chunk_size;
    global uint *own = cursors + (long)chunk * TILE_COUNTS(image);
    for (int i = first; i < first + (int)made[chunk]; ++i)
        put_entries(lists, own, bounds[i], triangles + i, i, image);
}
#endif
