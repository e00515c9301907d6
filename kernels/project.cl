// Projection of vertices from world space to snapped image positions.
#include "projection.clh"

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
#endif
