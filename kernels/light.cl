// The reflection model at single points.
#include "surface.clh"

// A work-item does LANES points.
kernel void light(global const real4 *points,        // K, relative to the eye, world axes, scaled
                  global const real4 *normals,       // K, unit or 0, world axes
                  global const real4 *colors,        // K, linear RGB
                  global const Material *materials,   // 1
                  global const Light *lights,
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
    reals3 point = {LOAD_LANES(p[0]), LOAD_LANES(p[1]), LOAD_LANES(p[2])};
    reals3 normal = {LOAD_LANES(n[0]), LOAD_LANES(n[1]), LOAD_LANES(n[2])};
    colors3 color = {LOAD_LANES(c[0]), LOAD_LANES(c[1]), LOAD_LANES(c[2])};
    Surface surface = surface_of(materials);
    color = shade(point, normal, color, surface, lights, light_count, 0);
    color = radiance_of(color, &surface, unit);
    STORE_LANES(color.r, c[0]);
    STORE_LANES(color.g, c[1]);
    STORE_LANES(color.b, c[2]);
    for (int lane = 0; lane < LANES && first + lane < count; ++lane)
        lit[first + lane] = (real4)(c[0][lane], c[1][lane], c[2][lane], 0.0f);
}
