// Instances of meshes, without a copy of their vertices and faces: those in the view are projected and set up block by block,
// and what may be seen of them is appended to the triangles.
#include "placements.clh"
#include "setup.cl"

#if INSTANCES
// Of instances from `first` to the one before `last`, of which number j begins at starts[j], the one that holds `at`.
INLINE int instance_at(global const long *starts, int first, int last, long at)
{
    while (last - first > 1) {
        int middle = first + (last - first) / 2;
        if (starts[middle] <= at)
            first = middle;
        else
            last = middle;
    }
    return first;
}

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

// As setup, for the faces of a block of instances. The counters count all; what finds no room is not written.
ITEM_BY_ITEM
kernel void setup_instances(global const int *faces,             // F x 3, vertices of the meshes
                            global const Vertex *vertices,       // of the block, from place
                            global const int *face_materials,    // F, with SIDES
                            global const Material *materials,    // with SIDES
                            global const Instance *instances,    // K
                            global const uint *listed,           // L
                            global const long *vertex_starts,    // L + 1
                            global const long *face_starts,      // L + 1
                            global const Image *image,           // 1
                            global Triangle *triangles,          // room
                            global Bounds *bounds,               // room
                            global ulong *keys,                  // room
                            global int *triangle_instances,      // room: the instance of each
                            global double *mean_depths,          // room; without DEPTH_TEST
                            global int *to_clip,                 // room: instance and face by turns
                            global Counters *counters,           // 1
                            int first, int last,                 // of the listed
                            int run, int room,
                            int index_bits)                          // of the keys
{
    long at = face_starts[first] + (long)get_global_id(0) * run, end = min(at + run, face_starts[last]);
    if (at >= end)
        return;
    Culled culled = {(fixeds)(0)};
    int j = instance_at(face_starts, first, last, at);
    for (; at < end; at += LANES) {
        int face[LANES], number[LANES], vertex[3][LANES];
        for (int lane = 0; lane < LANES; ++lane) {
            long own = min(at + lane, end - 1);
            while (face_starts[j + 1] <= own)
                ++j;
            number[lane] = listed[j];
            global const Instance *instance = instances + number[lane];
            face[lane] = instance->first_face + (int)(own - face_starts[j]);
            int from = (int)(vertex_starts[j] - vertex_starts[first]) - instance->first_vertex;
            for (int k = 0; k < 3; ++k)
                vertex[k][lane] = from + faces[3 * face[lane] + k];
        }
        fixeds behind[3], cut, asked = LANE_INDEX < (int)(end - at);
        Corners t = corners_at(vertices, vertex, behind);
        fixeds seen = see_faces(&t, asked, behind, face, face_materials, materials, image, &culled, &cut);
        if (any_lane(TO_INTS(cut))) {
            int crossing[LANES];
            STORE_LANES(cut, crossing);
            for (int lane = 0; lane < LANES; ++lane) {
                int slot = crossing[lane] ? 2 * atomic_inc(&counters->to_clip) : room;
                if (slot + 1 < room) {
                    to_clip[slot] = number[lane];
                    to_clip[slot + 1] = face[lane];
                }
            }
        }
        if (!any_lane(TO_INTS(seen)))
            continue;
        int visible[LANES], index[LANES], count = 0;
        STORE_LANES(seen, visible);
        for (int lane = 0; lane < LANES; ++lane)
            count += visible[lane] != 0;
        int slot = count ? atomic_add(&counters->visible, count) : room;
        for (int lane = 0; lane < LANES; ++lane) {
            index[lane] = visible[lane] ? slot++ : room;
            visible[lane] = index[lane] < room ? -1 : 0;
        }
        write_triangles(&t, LOAD_LANES(visible), index, face, WHOLE_FACE, triangles, bounds);
        for (int lane = 0; lane < LANES; ++lane) {
            if (!visible[lane])
                continue;
            double depth = depth_of_face(vertices + vertex[0][lane], vertices + vertex[1][lane], vertices + vertex[2][lane]);
#if !DEPTH_TEST
            mean_depths[index[lane]] = depth;
#endif
            keys[index[lane]] = sort_key(ORDER_OF(depth), index[lane], index_bits);
            triangle_instances[index[lane]] = number[lane];
        }
    }
    add_culled(counters, &culled);
}

// Number of the instance that each pixel shows; 0 for the background.
kernel void layer_instance_id(global const int *owners,                // M x N, from the pixel stage
                              global const int *triangle_instances,    // room, from setup_instances
                              global const Instance *instances,        // K
                              global uint *shown,                      // M x N
                              int count)                               // M * N
{
    int i = get_global_id(0);
    if (i < count)
        shown[i] = owners[i] < 0 ? 0u : (uint)instances[triangle_instances[owners[i]]].number;
}
#endif
