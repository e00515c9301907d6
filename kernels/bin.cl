// Lists of triangles per tile, in the given order, without fixed-capacity bins: the sorted list is split into chunks;
// each chunk counts its entries per tile, a prefix sum is taken, then each chunk writes after the chunks before it.
#include "tile_walk.clh"

#define ENTRIES_PER_LINE 4  // of a cache, at least

// Boxes of triangles, pixels.
typedef struct {
    fixeds left, bottom, right, top;
} Boxes;

INLINE Boxes boxes_of(global const Bounds *bounds, int count)
{
    int first[LANES], last[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        ulong box = bounds[min(lane, count - 1)].box;
        first[lane] = (int)box;
        last[lane] = (int)(box >> 32);
    }
    fixeds low = LOAD_LANES(first), high = LOAD_LANES(last);
    return (Boxes){low & 0xffff, low >> 16 & 0xffff, high & 0xffff, high >> 16 & 0xffff};
}

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
    for (int i = chunk * chunk_size; i < end; i += LANES) {
        int index[LANES], some = min(LANES, end - i);
        for (int k = 0; k < some; ++k) {
            PREFETCH(bounds + order[min(i + k + 16, end - 1)]);
            index[k] = order[i + k];
            sorted[i + k] = bounds[index[k]];
        }
        Boxes b = boxes_of(sorted + i, some);
        NearTiles near = near_tiles(b.left, b.bottom, b.right, b.top, LANE_INDEX < some, image);
        count_near(own, &near, index, bounds, triangles, image);
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
        counters->entries = stops_to_clip && counters->to_clip ? NOTHING_FITS : at;
    }
}

INLINE void put_entry(global Entry *lists, global uint *cursor, Entry e)
{
    uint at = (*cursor)++;
    lists[at] = e;
    if (at % ENTRIES_PER_LINE == 0)
        PREFETCH_TO_WRITE(lists + at + ENTRIES_PER_LINE);
}

// Appends a triangle to the lists of its tiles.
INLINE void put_entries(global Entry *lists, global uint *cursors, Bounds b, global const Triangle *triangle, uint index,
                        global const Image *image)
{
    for (TileWalk walk = walk_of(b, triangle, image); next_tile(&walk);) {
        int x = walk.x * TILE_SIZE, y = walk.y * TILE_SIZE;
        int box = max(walk.left - x, 0) | max(walk.bottom - y, 0) << 8 | min(walk.right - x, TILE_SIZE - 1) << 16 |
                  min(walk.top - y, TILE_SIZE - 1) << 24;
        Entry e = {b.nearest, index, box};
        put_entry(lists, cursors + walk.y * image->tiles_x + walk.x, e);
    }
}

// Appends some triangles, at most LANES, one after the other to the lists of their tiles. bounds: theirs.
INLINE void put_group(global Entry *lists, global uint *cursors, const int *index, int count, global const Bounds *bounds,
                      global const Triangle *triangles, global const Image *image)
{
    const fixeds last = (fixeds)(TILE_SIZE - 1);
    Boxes b = boxes_of(bounds, count);
    NearTiles near = near_tiles(b.left, b.bottom, b.right, b.top, LANE_INDEX < count, image);
    // In a box's first tile it begins within, and in those to the right and above at the tile's edge.
    fixeds left = b.left & last, bottom = (b.bottom & last) << 8, right = b.right & last, top = (b.top & last) << 24;
    fixeds x_end = min(b.right - (b.left - left), last) << 16, y_end = min(b.top - (b.bottom & ~last), last) << 24;
    int box[4][LANES];
    STORE_LANES(left | bottom | x_end | y_end, box[0]);
    STORE_LANES(bottom | right << 16 | y_end, box[1]);
    STORE_LANES(left | x_end | top, box[2]);
    STORE_LANES(right << 16 | top, box[3]);
    for (ulong todo = near.touched; todo; todo &= todo - 1) {
        int i = LOWEST_BIT(todo), lane = i >> 2;
        Entry e = {bounds[lane].nearest, index[lane], box[i & 3][lane]};
        if (near.wide >> lane & 1)
            put_entries(lists, cursors, bounds[lane], triangles + e.index, e.index, image);
        else
            put_entry(lists, cursors + near.tile[i & 3][lane], e);
    }
}

// A chunk's triangles in the given order, or without one (count 0) in that of set-up.
ITEM_BY_ITEM
kernel void bin_fill(global const uint *order,           // T, triangles, nearest first
                     global const Triangle *triangles,   // F + C
                     global const Image *image,          // 1
                     global const Bounds *sorted,        // T, from bin_count; without an order F + C, from setup_count
                     global const uint *made,            // chunks, from setup_count; without an order
                     global uint *cursors,               // chunks x tiles: where each chunk's entries of a tile begin
                     global Entry *lists,                // entries of tile 0, of tile 1, ...
                     global const Counters *counters,    // 1
                     int chunk_size, int count)          // T
{
    if (!lists_hold_all(image, counters))
        return;
    int chunk = get_global_id(0), first = chunk * chunk_size;
    int end = count > 0 ? min(first + chunk_size, count) : first + (int)made[chunk];
    global uint *own = cursors + (long)chunk * image->tiles;
    for (int i = first; i < end; i += LANES) {
        int index[LANES], some = min(LANES, end - i);
        for (int k = 0; k < some; ++k)
            index[k] = count > 0 ? (int)order[i + k] : i + k;
        put_group(lists, own, index, some, sorted + i, triangles, image);
    }
}
