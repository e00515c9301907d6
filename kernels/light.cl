// The reflection model at single points.
#include "surface.clh"

// A work-item does LANES points.
ITEM_BY_ITEM
kernel void light(global const real4 *points,        // K, relative to the eye, world axes, scaled
                  global const real4 *normals,       // K, unit or 0, world axes
                  global const real4 *colors,        // K, linear RGB
                  global const Material *materials,   // 1
                  global const Light *lights,
                  ulong needs,                       // as of Image
                  global real4 *lit,                 // K, linear RGB
                  real unit,                         // of the lights' intensities
                  int light_count, int count)         // K
{
    int first = get_global_id(0) * LANES;
    int index[LANES];
    real c[3][LANES];
    for (int lane = 0; lane < LANES; ++lane)
        index[lane] = min(first + lane, count - 1);
    ShadingInput at;
    at.point = vector_of_rows(gather(points, index));
    at.normal = vector_of_rows(gather(normals, index));
    at.color = vector_of_rows(gather(colors, index));
    at.lit = (ints)(-1);
    at.shift = NO_SHIFT;
    Lighting lighting = {needs, lights, light_count, surface_of(materials), 0, unit};
    at.surface = lighting.surface;
    shade(&at, &lighting, 1);
    reals3 color = at.color;
    if (NEEDS(&lighting, AMBIENT) && !NEEDS(&lighting, TINTED))
        color = with_plain_ambient(color, &lighting.surface);
    STORE_LANES(color.x, c[0]);
    STORE_LANES(color.y, c[1]);
    STORE_LANES(color.z, c[2]);
    for (int lane = 0; lane < LANES && first + lane < count; ++lane)
        lit[first + lane] = (real4)(c[0][lane], c[1][lane], c[2][lane], 0.0f);
}
