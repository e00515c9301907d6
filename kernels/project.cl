// Projection of vertices from world space to snapped image positions.
#include "projection.clh"

#if FP64

#if DOUBLE_POSITIONS
typedef double position_t;
#else
typedef float position_t;
#endif

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
    vector64 d = from_eye(position[0], position[1], position[2], view);
    vertices[i] = projected(&d, view);
    relative[i] = relative_position(&d, view);
}
#endif
