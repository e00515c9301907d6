// Gouraud shading: the corners are lit and their light is interpolated; without LIT (nolight) the colors themselves.
#include "tile.clh"

#if !AT_PIXELS
// The light at the three corners of each visible triangle, without the `plain` ambient term. A work-item does LANES of
// them.
ITEM_BY_ITEM
kernel void gouraud_corners(SURFACE_PARAMETERS,
                            global const uint *order,     // T, visible triangles
                            global real4 *to_light,       // (F + C) x 3, linear RGB and position, written for visible triangles
                            int count)                    // T
{
    Inputs inputs = SURFACE_ARGUMENTS;
    const Inputs *in = &inputs;
    Lighting lighting = lighting_of(in);
    lighting.unit = 1.0f;
    int first = get_global_id(0) * LANES;
    int taken[LANES], face[LANES];
    ShadingInput at;
    at.lit = (ints)(-1);
    at.shift = no_light_shift();  // faces that share a corner are as bright there
    at.surface = lighting.surface;
#if CASTERS
    integer shown[LANES];
    Shadows casters = casters_of(in);
    lighting.casters = &casters;
#endif
    for (int lane = 0; lane < LANES; ++lane) {
        taken[lane] = order[min(first + lane, count - 1)];
        face[lane] = in->triangles[taken[lane]].face;
#if CASTERS
        shown[lane] = taken[lane];
#endif
        if (NEEDS(in, MATERIALS))
            put_surface(&at.surface, TO_INTS(LANE_INDEX == lane), material_of(in, face[lane]));
    }
    for (int k = 0; k < 3; ++k) {
        real p[3][LANES], n[3][LANES], c[3][LANES], position[LANES], bend[LANES];
        for (int lane = 0; lane < LANES; ++lane) {
            real4 point = NEEDS(in, CENTROID) ? centroid_of(in, taken[lane], face[lane])
                                                     : corner_point(in, taken[lane], face[lane], k);
            real4 normal = (real4)(0.0f), color = (real4)(1.0f);
            if (reflects(in))
                normal = side_of(in, in->triangles + taken[lane]) * corner_normal(in, taken[lane], face[lane], k);
            if (shows_colors(in))
                color = in->colors[color_index(in, face[lane], k)];
            p[0][lane] = point.x, p[1][lane] = point.y, p[2][lane] = point.z;
            bend[lane] = fabs(normal.w);
            n[0][lane] = normal.x, n[1][lane] = normal.y, n[2][lane] = normal.z;
            c[0][lane] = color.x, c[1][lane] = color.y, c[2][lane] = color.z;
            position[lane] = shows_scalars(in) ? color.w : 0.0f;
        }
        at.point.x = LOAD_LANES(p[0]), at.point.y = LOAD_LANES(p[1]), at.point.z = LOAD_LANES(p[2]);
        at.normal.x = LOAD_LANES(n[0]), at.normal.y = LOAD_LANES(n[1]), at.normal.z = LOAD_LANES(n[2]);
        at.color.r = LOAD_LANES(c[0]), at.color.g = LOAD_LANES(c[1]), at.color.b = LOAD_LANES(c[2]);
        at.open = (reals)(1.0f);
#if CASTERS
        see_corner_receivers(&at, in, shown, k);
        if (NEEDS(in, AMBIENT_OCCLUSION) && NEEDS(in, TINTED))
            occlude(&at, in, &lighting, no_light_shift());  // as above
        at.smooth = at.normal;
        at.bend = LOAD_LANES(bend);
#endif
        shade(&at, &lighting, 1);
        STORE_LANES(at.color.r, c[0]);
        STORE_LANES(at.color.g, c[1]);
        STORE_LANES(at.color.b, c[2]);
        for (int lane = 0; lane < LANES && first + lane < count; ++lane)
            to_light[3 * taken[lane] + k] = (real4)(c[0][lane], c[1][lane], c[2][lane], position[lane]);
    }
}

ITEM_BY_ITEM
kernel void gouraud(SURFACE_PARAMETERS, TILE_PARAMETERS)
{
    Inputs in = SURFACE_ARGUMENTS;
    draw_tiles(&in, TILE_ARGUMENTS);
}
#endif
