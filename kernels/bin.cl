// Lists of triangles per tile, in the given order, without fixed-capacity bins: the sorted list is split into chunks;
// each chunk counts its entries per tile, a prefix sum is taken, then each chunk writes after the chunks before it.
#include "tile_walk.clh"

#define ENTRIES_PER_LINE 4  // of a cache

#if HAS_NEAR_TILES
#define GROUP LANES
#else
#define GROUP 1
#endif

// Some triangles, at most GROUP of them.
typedef struct {
    int index[GROUP], count;
    global const Bounds *bounds;  // of the first; the others' follow
} Group;

#if HAS_NEAR_TILES
// In lanes: the boxes of a group, pixels.
typedef struct {
    fixeds left, bottom, right, top;
} Boxes;

INLINE Boxes boxes_of(const Group *group)
{
    int first[LANES], last[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        ulong box = group->bounds[min(lane, group->count - 1)].box;
        first[lane] = (int)box;
        last[lane] = (int)(box >> 32);
    }
    fixeds low = LOAD_LANES(first), high = LOAD_LANES(last);
    return (Boxes){low & 0xffff, low >> 16 & 0xffff, high & 0xffff, high >> 16 & 0xffff};
}

INLINE NearTiles near_tiles_of(const Group *group, const Boxes *b, global const Image *image)
{
    return near_tiles(b->left, b->bottom, b->right, b->top, LANE_INDEX < group->count, image);
}
#endif

// Adds the triangles of a group to the counts of their tiles.
INLINE void count_group(global uint *counts, const Group *group, global const Triangle *triangles, global const Image *image)
{
#if HAS_NEAR_TILES
    Boxes boxes = boxes_of(group);
    NearTiles near = near_tiles_of(group, &boxes, image);
    for (ulong todo = near.touched; todo; todo &= todo - 1) {
        int i = LOWEST_BIT(todo), lane = i >> 2;
        if (near.wide >> lane & 1)
            count_tiles(counts, group->bounds[lane], triangles + group->index[lane], image);
        else
            counts[near.tile[i & 3][lane]] += 1;
    }
#else
    count_tiles(counts, group->bounds[0], triangles + group->index[0], image);
#endif
}

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
    for (int i = chunk * chunk_size; i < end; i += GROUP) {
        Group group;
        group.count = min(GROUP, end - i);
        group.bounds = sorted + i;
        for (int k = 0; k < group.count; ++k) {
            PREFETCH(bounds + order[min(i + k + 16, end - 1)]);
            group.index[k] = order[i + k];
            sorted[i + k] = bounds[group.index[k]];
        }
        count_group(own, &group, triangles, image);
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
    TileWalk walk = walk_of(b, triangle, image);
    while (next_tile(&walk)) {
        int x = walk.x * TILE_SIZE, y = walk.y * TILE_SIZE;
        int box = max(walk.left - x, 0) | max(walk.bottom - y, 0) << 8 | min(walk.right - x, TILE_SIZE - 1) << 16 |
                  min(walk.top - y, TILE_SIZE - 1) << 24;
        Entry e = {b.nearest, index, box, b.only};
        put_entry(lists, cursors + tile_at(&walk, image), e);
    }
}

// Appends the triangles of a group, one after the other, to the lists of their tiles.
INLINE void put_group(global Entry *lists, global uint *cursors, const Group *group, global const Triangle *triangles,
                      global const Image *image)
{
#if HAS_NEAR_TILES
    const fixeds last = (fixeds)(TILE_SIZE - 1);
    Boxes b = boxes_of(group);
    NearTiles near = near_tiles_of(group, &b, image);
    // In a box's first tile it begins within, and in those to the right and above at the tile's edge.
    fixeds left = b.left & last, bottom = (b.bottom & last) << 8, right = b.right & last, top = (b.top & last) << 24;
    fixeds x_end = min(b.right - (b.left - left), last) << 16, y_end = min(b.top - (b.bottom & ~last), last) << 24;
    int box[4][LANES];
    STORE_LANES(left | bottom | x_end | y_end, box[0]);
    STORE_LANES(bottom | right << 16 | y_end, box[1]);
    STORE_LANES(left | x_end | top, box[2]);
    STORE_LANES(right << 16 | top, box[3]);
    for (ulong todo = near.touched; todo; todo &= todo - 1) {
        int i = LOWEST_BIT(todo), lane = i >> 2, index = group->index[lane];
        global const Bounds *bounds = group->bounds + lane;
        if (near.wide >> lane & 1) {
            put_entries(lists, cursors, *bounds, triangles + index, index, image);
            continue;
        }
        Entry e = {bounds->nearest, index, box[i & 3][lane], bounds->only};
        put_entry(lists, cursors + near.tile[i & 3][lane], e);
    }
#else
    put_entries(lists, cursors, group->bounds[0], triangles + group->index[0], group->index[0], image);
#endif
}

// Appends triangles, a group at a time: numbers `first` to `end` of the order, or of all if there is none, and of their bounds.
INLINE void put_run(global Entry *lists, global uint *cursors, global const uint *order, int first, int end,
                    global const Bounds *bounds, global const Triangle *triangles, global const Image *image)
{
    for (int i = first; i < end; i += GROUP) {
        Group group;
        group.count = min(GROUP, end - i);
        group.bounds = bounds + i;
        for (int k = 0; k < group.count; ++k)
            group.index[k] = order ? (int)order[i + k] : i + k;
        put_group(lists, cursors, &group, triangles, image);
    }
}

// A chunk's triangles in the given order, or without one (count 0) in that of set-up.
ITEM_BY_ITEM
kernel void bin_fill(global const uint *order,           // T, triangles, nearest first
                     global const Triangle *triangles,   // F + C
                     global const Image *image,          // 1
                     global const Bounds *sorted,        // T, from bin_count; without an order F + C, from setup_count
                     global const uint *made,            // chunks, from setup_count; without an order
                     global uint *cursors,               // chunks x (tiles + 1): where each chunk's entries of a tile begin
                     global Entry *lists,                // entries of tile 0, of tile 1, ...
                     global const Counters *counters,    // 1
                     int chunk_size, int count)          // T
{
    if (!lists_hold_all(image, counters))
        return;
    int chunk = get_global_id(0), first = chunk * chunk_size;
    global uint *own = cursors + (long)chunk * TILE_COUNTS(image);
    if (count > 0)
        put_run(lists, own, order, first, min(first + chunk_size, count), sorted, triangles, image);
    else
        put_run(lists, own, 0, first, first + (int)made[chunk], sorted, triangles, image);
}
