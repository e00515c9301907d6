// Projection of vertices from world space to snapped image positions.
#include "placements.clh"

#if FP64
kernel void project(global const float *positions,    // V x 3, world space; float64 with DOUBLE_POSITIONS
                    global const View *view,          // 1
                    global Vertex *vertices,          // V
                    global real4 *relative,           // V, eye-relative, world axes, scaled
                    int count)                        // V
{
    int i = get_global_id(0);
    if (i >= count)
        return;
    size_t first = 3 * (size_t)i;
    global const double *wide = (global const double *)positions;
    vector64 d = NEEDS(view, DOUBLE_POSITIONS) ? from_eye(wide[first], wide[first + 1], wide[first + 2], view)
                                               : from_eye(positions[first], positions[first + 1], positions[first + 2], view);
    vertices[i] = projected(&d, view);
    relative[i] = relative_position(&d, view);
}

#if INSTANCES
// Projects the vertices of a block of instances. A work-item does a run of them.
kernel void place(global const double *positions,       // V x 3, of the meshes
                  global const Instance *instances,     // K
                  global const uint *listed,            // L, instances in the view
                  global const long *vertex_starts,     // L + 1
                  global const View *view,              // 1
                  global Vertex *vertices,              // of the block
                  int first, int last,                  // of the listed
                  int run)
{
    long start = vertex_starts[first], at = start + (long)get_global_id(0) * run;
    long end = min(at + run, vertex_starts[last]);
    if (at >= end)
        return;
    for (int j = instance_at(vertex_starts, first, last, at); at < end; ++j) {
        global const Instance *instance = instances + listed[j];
        for (long stop = min(end, vertex_starts[j + 1]); at < stop; ++at) {
            int index = instance->first_vertex + (int)(at - vertex_starts[j]);
            vector64 d = placed_from_eye(instance, positions, index, view);
            vertices[at - start] = projected(&d, view);
        }
    }
}
#endif
#endif
