// Gouraud shading: the corners are lit and their light is interpolated; without LIT (nolight) the colors themselves.
#include "tile.clh"

#if !AT_PIXELS
// The light at the corners of each visible triangle, without the `plain` ambient term. A work-item does LANES of them.
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
    at.shift = NO_SHIFT;  // faces that share a corner are as bright there
    at.surface = lighting.surface;
#if CASTERS
    integer shown[LANES];
    Shadows casters = casters_of(in);
    PointShares known;
    lighting.casters = &casters, lighting.known = &known;
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
        real4 point[LANES], normal[LANES], color[LANES];
        real c[3][LANES], position[LANES];
        for (int lane = 0; lane < LANES; ++lane) {
            point[lane] = NEEDS(in, CENTROID) ? centroid_of(in, taken[lane], face[lane])
                                              : corner_point(in, taken[lane], face[lane], k);
            normal[lane] = (real4)(0.0f), color[lane] = (real4)(1.0f);
            if (NEEDS_ANY(in, TERMS))
                normal[lane] = side_of(in, in->triangles + taken[lane]) * corner_normal(in, taken[lane], face[lane], k);
            if (shows_colors(in))
                color[lane] = in->colors[color_index(in, face[lane], k)];
        }
        reals4 normals = transposed_rows(normal), colors = transposed_rows(color);
        at.point = vector_of_rows(transposed_rows(point));
        at.normal = vector_of_rows(normals);
        at.color = vector_of_rows(colors);
        at.open = (reals)(1.0f);
#if CASTERS
        see_corner_receivers(&at, in, LOAD_LANES(shown), k);
        if (NEEDS(in, AMBIENT_OCCLUSION) && NEEDS(in, TINTED))
            occlude(&at, in, &lighting);
        at.smooth = at.normal;
        at.bend = fabs(normals.w);
#endif
        shade(&at, &lighting, 1);
        STORE_LANES(shows_scalars(in) ? colors.w : (reals)(0.0f), position);
        STORE_LANES(at.color.x, c[0]);
        STORE_LANES(at.color.y, c[1]);
        STORE_LANES(at.color.z, c[2]);
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
