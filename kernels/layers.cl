// Further layers, from the triangle that owns each pixel's sample nearest the center.
#include "attributes.clh"
#include "layer_blocks.clh"
#include "samples.clh"

// A number for each pixel, 0 for the background: that of its instance, of its face in a table, or the face's own, from 1.
kernel void layer_number(global const int *owners,                // M x N, from the pixel stage
                         global const Triangle *triangles,        // F + C, from setup
                         global const int *triangle_instances,    // F + C, from setup_instances; with INSTANCES
                         global const Instance *instances,        // K; with INSTANCES
                         global const uint *numbers,              // F; with in_table
                         global uint *shown,                      // M x N
                         int in_table, int of_instances,          // which of these numbers; neither: the face's own
                         int count)                               // M * N
{
    int i = get_global_id(0);
    if (i >= count)
        return;
    int owner = owners[i];
    uint number = 0;
    if (owner >= 0) {
        int face = triangles[owner].face;
        number = in_table ? numbers[face] : (uint)face + 1u;
#if INSTANCES
        global const Instance *instance = instances + triangle_instances[owner];
        if (of_instances)
            number = (uint)instance->number;
        else if (!in_table)
            number += (uint)instance->face_shift;
#endif
    }
    shown[i] = number;
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
        LayerBlock pixels = layer_block(image, column, row);
        ints owner = owners_in(owners, &pixels);
        reals3 depth = {(reals)(INFINITY)};
        for (ints todo = owner >= 0, mine; any_lane(todo); todo = todo & !mine) {
            int index = lane_of(owner, todo);
            mine = todo & (owner == index);
            reals w = depths_at(triangles + index, sample_at(image, 0, column, row));
            depth.x = mine ? (NEEDS(image, ORTHOGRAPHIC) ? -w : 1.0f / w) * image->unscale : depth.x;
        }
        write_components(depths, 1, depth, &pixels);
    }
}
