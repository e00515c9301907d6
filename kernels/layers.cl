// Further layers, from the triangle that owns each pixel's sample nearest the center.
#include "attributes.clh"
#include "samples.clh"

// Face of each pixel, from 1; 0 for the background.
kernel void layer_id(global const int *owners,            // M x N, from the pixel stage
                     global const Triangle *triangles,    // F + C, from setup
                     global uint *ids,                    // M x N
                     int count)                           // M * N
{
    int i = get_global_id(0);
    if (i < count)
        ids[i] = owners[i] < 0 ? 0 : triangles[owners[i]].face + 1;
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

real depth_of(real w)
{
    return ORTHOGRAPHIC ? -w : 1.0f / w;
}

// Camera z of each pixel, scene units; infinity for the background.
kernel void layer_z(global const int *owners,            // M x N, from the pixel stage
                    global const Triangle *triangles,    // F + C, from setup
                    global const Image *image,           // 1
                    global real *depths,                // M x N
                    int count)                           // M * N
{
    int i = get_global_id(0);
    if (i >= count)
        return;
    int column = i % image->columns, row = image->rows - 1 - i / image->columns;
    global const Triangle *t = triangles + owners[i];
    int2 at = sample_at(image, 0, column, row);
    depths[i] = owners[i] < 0 ? INFINITY
                              : depth_of(inverse_depth(t, edge_at(t, 0, at), edge_at(t, 1, at), edge_at(t, 2, at))) *
                                    image->unscale;
}
