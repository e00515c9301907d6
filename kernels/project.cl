// Projection of vertices from world space to snapped image positions, in float64. For devices without it,
// clshade/pipeline/host_projection.py does the same on the host.
#include "reals.clh"

#if FP64

#if DOUBLE_POSITIONS
typedef double position_t;
#else
typedef float position_t;
#endif

// Column or row in 1/256 px, ties to even; beyond the guard band +-SNAP_LIMIT.
int snap(double pixels)
{
    if (!(fabs(pixels) <= (double)GUARD_PIXELS))
        return pixels > 0.0 ? SNAP_LIMIT : -SNAP_LIMIT;
    return (int)((pixels * (1 << SUBPIXEL_BITS) + 0x1.8p52) - 0x1.8p52);  // 1.5 * 2^52 has no fraction bits
}

// A scaled coordinate, clamped to float32's range; only vertices far outside the view need it.
real held(double scaled)
{
    scaled = scaled < MOST_LENGTH ? scaled : MOST_LENGTH;
    return (real)(scaled > -MOST_LENGTH ? scaled : -MOST_LENGTH);
}

kernel void project(global const position_t *positions,  // V x 3, world space
                    global const View *view,             // 1
                    global Vertex *vertices,             // V
                    global real4 *relative,             // V, eye-relative, world axes, scaled
                    int count)                           // V
{
    int i = get_global_id(0);
    if (i >= count)
        return;
    global const position_t *position = positions + 3 * (size_t)i;
    double dx = (double)position[0] - view->eye[0];
    double dy = (double)position[1] - view->eye[1];
    double dz = (double)position[2] - view->eye[2];
    global const double *m = view->axes;
    double x = (dx * m[0] + dy * m[1]) + dz * m[2];
    double y = (dx * m[3] + dy * m[4]) + dz * m[5];
    double z = (dx * m[6] + dy * m[7]) + dz * m[8];
    Vertex v = {z, 0, 0, 0.0f, 0.0f};
    if (z >= view->near) {
        double depth = z * view->scale;
        depth = depth < MOST_DEPTH ? depth : MOST_DEPTH;
#if ORTHOGRAPHIC
        v.x = snap((x / view->plane_width + view->principal[0]) * view->columns);
        v.y = snap((y / view->plane_height + view->principal[1]) * view->rows);
        double w = -depth;
#else
        v.x = snap(((view->focal * x) / (z * view->plane_width) + view->principal[0]) * view->columns);
        v.y = snap(((view->focal * y) / (z * view->plane_height) + view->principal[1]) * view->rows);
        double w = 1.0 / depth;
#endif
        v.w = (real)w;
        v.w_low = (real)(w - (double)v.w);
    }
    vertices[i] = v;
    relative[i] = (real4)(held(dx * view->scale), held(dy * view->scale), held(dz * view->scale), 0.0f);
}
#endif
