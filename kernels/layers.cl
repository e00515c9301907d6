// Further layers, from the triangle that owns each pixel's sample nearest the center.
#include "attributes.clh"
#include "layer_blocks.clh"
#include "samples.clh"

// Face of each pixel, from 1; 0 for the background.
kernel void layer_id(global const int *owners,                // M x N, from the pixel stage
                     global const Triangle *triangles,        // F + C, from setup
                     global const int *triangle_instances,    // F + C, from setup_instances; with INSTANCES
                     global const Instance *instances,        // K; with INSTANCES
                     global uint *ids,                        // M x N
                     int count)                               // M * N
{
    int i = get_global_id(0);
    if (i >= count)
        return;
    int owner = owners[i];
    uint id = owner < 0 ? 0u : (uint)triangles[owner].face + 1u;
    if (INSTANCES && owner >= 0)
        id += (uint)instances[triangle_instances[owner]].face_shift;
    ids[i] = id;
}

// Number assigned to each pixel's face; 0 for the background.
kernel void layer_number(global const int *owners,            // M x N, from the pixel stage
                         global const Triangle *triangles,    // F + C, from setup
                         global const uint *numbers,          // F, from the host
                         global uint *shown,                  // M x N
                         int count)                           // M * N
{
    int i = get_global_id(0);
    if (i < count)
        shown[i] = owners[i] < 0 ? 0 : numbers[triangles[owners[i]].face];
}

// Depths at the pixels of a block whose first pixel is at snapped position `at`; infinity without an owner.
INLINE reals depths_in(global const Triangle *triangles, ints owner, int2 at, global const Image *image)
{
    reals depths = (reals)(INFINITY);
    for (ints todo = owner >= 0, mine; any_lane(todo); todo = todo & !mine) {
        int index = lane_of(owner, todo);
        mine = todo & (owner == index);
        reals w = depths_at(triangles + index, at);
        depths = mine ? (NEEDS(image, ORTHOGRAPHIC) ? -w : 1.0f / w) : depths;
    }
    return depths;
}

// Camera z of each pixel, scene units; infinity for the background. A work-item does a tile, or with several
// ITEMS_PER_TILE a block of it.
ITEM_BY_ITEM
kernel void layer_z(global const int *owners,            // M x N, from the pixel stage
                    global const Triangle *triangles,    // F + C, from setup
                    global const Image *image,           // 1
                    global real *depths)                 // M x N
{
    int tile = get_global_id(0) / ITEMS_PER_TILE, item = get_global_id(0) % ITEMS_PER_TILE;
    int left = tile % image->tiles_x * TILE_SIZE, bottom = tile / image->tiles_x * TILE_SIZE;
#if HAS_EMPTY_TILES
    if (is_empty_tile(owners, image, left, bottom)) {
        LayerBlock whole = layer_block(image, left, bottom);
        clear_layer(depths, 1, INFINITY, &whole);
        return;
    }
#endif
    for (int i = 0; i < BLOCKS_PER_ITEM; ++i) {
        int block = item * BLOCKS_PER_ITEM + i;
        int column = left + block % BLOCKS_X * BLOCK_WIDTH, row = bottom + block / BLOCKS_X * BLOCK_HEIGHT;
        if (column >= image->columns || row >= image->rows)
            continue;
        LayerBlock pixels = layer_block(image, column, row);
        ints owner = owners_in(owners, &pixels);
        reals3 depth = {depths_in(triangles, owner, sample_at(image, 0, column, row), image) * image->unscale};
        write_components(depths, 1, depth, &pixels);
    }
}
