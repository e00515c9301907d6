// Further layers, from the triangle that owns each pixel.
#include "attributes.clh"

// Face of each pixel, counted from 1; 0 for the background.
kernel void layer_id(global const int *owners,            // M x N, from the pixel stage
                     global const Triangle *triangles,    // F + C, from setup
                     global uint *ids,                    // M x N
                     int count)                           // M * N
{
    int i = get_global_id(0);
    if (i < count)
        ids[i] = owners[i] < 0 ? 0 : triangles[owners[i]].face + 1;
}

// Camera z of each pixel, scene units; infinity for the background. A work-item takes a block.
kernel void layer_z(global const int *owners,            // M x N, from the pixel stage
                    global const Triangle *triangles,    // F + C, from setup
                    global const Image *image,           // 1
                    global float *depths)                // M x N
{
    int column = get_global_id(0) * BLOCK_WIDTH, row = get_global_id(1) * BLOCK_HEIGHT;
    for (int lane = 0; lane < LANES; ++lane) {
        int x = column + lane % BLOCK_WIDTH, y = row + lane / BLOCK_WIDTH;
        if (x >= image->columns || y >= image->rows)
            continue;
        long at = (long)(image->rows - 1 - y) * image->columns + x;
        if (owners[at] < 0) {
            depths[at] = INFINITY;
            continue;
        }
        global const Triangle *t = triangles + owners[at];
        float w[LANES];
        STORE_LANES(inverse_depth_at(t, edge_reals(edge_at(t, 0, column, row)), edge_reals(edge_at(t, 1, column, row)),
                                     edge_reals(edge_at(t, 2, column, row))), w);
        depths[at] = image->unscale / w[lane];
    }
}
