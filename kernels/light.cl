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
    real p[3][LANES], n[3][LANES], c[3][LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        int i = min(first + lane, count - 1);
        p[0][lane] = points[i].x, p[1][lane] = points[i].y, p[2][lane] = points[i].z;
        n[0][lane] = normals[i].x, n[1][lane] = normals[i].y, n[2][lane] = normals[i].z;
        c[0][lane] = colors[i].x, c[1][lane] = colors[i].y, c[2][lane] = colors[i].z;
    }
    ShadingInput at;
    at.point.x = LOAD_LANES(p[0]), at.point.y = LOAD_LANES(p[1]), at.point.z = LOAD_LANES(p[2]);
    at.normal.x = LOAD_LANES(n[0]), at.normal.y = LOAD_LANES(n[1]), at.normal.z = LOAD_LANES(n[2]);
    at.color.r = LOAD_LANES(c[0]), at.color.g = LOAD_LANES(c[1]), at.color.b = LOAD_LANES(c[2]);
    at.lit = (ints)(-1);
    at.shift = no_light_shift();
    Lighting lighting = {needs, lights, light_count, surface_of(materials), 0, unit};
    at.surface = lighting.surface;
    shade(&at, &lighting, 1);
    colors3 color = at.color;
    if (NEEDS(&lighting, AMBIENT) && !NEEDS(&lighting, TINTED))
        color = with_plain_ambient(color, &lighting.surface);
    STORE_LANES(color.r, c[0]);
    STORE_LANES(color.g, c[1]);
    STORE_LANES(color.b, c[2]);
    for (int lane = 0; lane < LANES && first + lane < count; ++lane)
        lit[first + lane] = (real4)(c[0][lane], c[1][lane], c[2][lane], 0.0f);
}
