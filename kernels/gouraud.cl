// Gouraud shading: the corners are lit and their light is interpolated; without LIT (nolight) the colors themselves.
#include "fill.clh"
#include "gather.clh"

#if !PHONG
#if LIT

// The light at the three corners of each visible triangle, without the `plain` ambient term. A work-item does LANES of
// them.
kernel void gouraud_corners(SURFACE_PARAMETERS,
                            global const uint *order,       // T, visible triangles
                            global real4 *corner_light,    // (F + C) x 3, linear RGB, written for visible triangles
                            int count)                      // T
{
    Inputs inputs = SURFACE_ARGUMENTS;
    const Inputs *in = &inputs;
    int first = get_global_id(0) * LANES;
    Surface surface = surface_of(in->materials);
    int taken[LANES], face[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        taken[lane] = order[min(first + lane, count - 1)];
        face[lane] = in->triangles[taken[lane]].face;
#if MATERIALS
        put_surface(&surface, LANE_INDEX == lane, material_of(in, face[lane]));
#endif
    }
    for (int k = 0; k < 3; ++k) {
        real p[3][LANES], n[3][LANES], c[3][LANES];
        for (int lane = 0; lane < LANES; ++lane) {
#if CENTROID
            real4 at = centroid_of(in, face[lane]);
#else
            real4 at = in->relative[in->faces[3 * face[lane] + k]];
#endif
#if DIFFUSE || SPECULAR
            real4 normal = side_of(in, in->triangles + taken[lane]) * in->normals[normal_index(in, face[lane], k)];
#else
            real4 normal = (real4)(0.0f);  // there are no normals
#endif
#if VERTEX_COLORS || CORNER_COLORS
            real4 color = in->colors[color_index(in, face[lane], k)];
#else
            real4 color = (real4)(1.0f);
#endif
            p[0][lane] = at.x, p[1][lane] = at.y, p[2][lane] = at.z;
            n[0][lane] = normal.x, n[1][lane] = normal.y, n[2][lane] = normal.z;
            c[0][lane] = color.x, c[1][lane] = color.y, c[2][lane] = color.z;
        }
        reals3 point = {LOAD_LANES(p[0]), LOAD_LANES(p[1]), LOAD_LANES(p[2])};
        reals3 normal = {LOAD_LANES(n[0]), LOAD_LANES(n[1]), LOAD_LANES(n[2])};
        colors3 color = {LOAD_LANES(c[0]), LOAD_LANES(c[1]), LOAD_LANES(c[2])};
        color = shade(point, normal, color, surface, in->lights, in->image->lights, in->image->to_eye);
        STORE_LANES(color.r, c[0]);
        STORE_LANES(color.g, c[1]);
        STORE_LANES(color.b, c[2]);
        for (int lane = 0; lane < LANES && first + lane < count; ++lane)
            corner_light[3 * taken[lane] + k] = (real4)(c[0][lane], c[1][lane], c[2][lane], 0.0f);
    }
}
#endif

// The inputs of shading at a block's pixels.
typedef struct {
    colors3 color;
    Surface surface;
    Texels texels;
} ShadingInput;

// Sets the lanes in `mine`, which triangle `index` owns.
INLINE void see_owner(ShadingInput *seen, ints mine, const Inputs *in, int index, int2 at, global const real4 *corner_light)
{
    global const Triangle *t = in->triangles + index;
    int face = t->face;
#if LIT
    Weights m = weights_at(t, in->pieces, at, PERSPECTIVE);
    global const real4 *c = corner_light + 3 * index;
    put_color(&seen->color, mine, mix_vectors(m, c[0], c[1], c[2]));
#if MATERIALS
    put_surface(&seen->surface, mine, material_of(in, face));
#endif
#elif VERTEX_COLORS || CORNER_COLORS
    Weights m = weights_at(t, in->pieces, at, PERSPECTIVE);
    put_color(&seen->color, mine,
              mix_vectors(m, in->colors[color_index(in, face, 0)], in->colors[color_index(in, face, 1)],
                          in->colors[color_index(in, face, 2)]));
#endif
    put_texels(&seen->texels, mine, in, t, at);
}

#if GATHERS
// Sets as many of the lanes in `todo` as it can; returns those.
INLINE ints see_lanes(ShadingInput *seen, ints todo, const Inputs *in, ints owner, int2 at, global const real4 *corner_light)
{
    ints own = todo ? owner : (ints)(lane_of(owner, todo));
    Gathered t = gather_triangles(in, own, at);
    ints mine = todo & t.fits;
#if LIT
    int number[LANES];
    STORE_LANES(own, number);
    CornerRows corner = rows_of(number);
    put_color(&seen->color, mine, mix_gathered(gathered_weights(&t), corner_light, &corner, (reals)(1.0f)));
    put_surfaces(&seen->surface, mine, in, t.face);
#elif CORNER_COLORS
    CornerRows corner = rows_of(t.face);
    put_color(&seen->color, mine, mix_gathered(gathered_weights(&t), in->colors, &corner, (reals)(1.0f)));
#elif VERTEX_COLORS
    CornerRows corner = rows_in(in->faces, t.face);
    put_color(&seen->color, mine, mix_gathered(gathered_weights(&t), in->colors, &corner, (reals)(1.0f)));
#endif
    return mine;
}
#endif

colors3 light_block(const Inputs *in, ints owner, int2 at, global const real4 *corner_light)
{
    ShadingInput seen;
    seen.color.r = seen.color.g = seen.color.b = (reals)(1.0f);
    seen.surface = surface_of(in->materials);
    seen.texels = no_texels();
    ints todo = (owner != NOBODY) & (OWNERS_DIFFER ? -1 : 0);
    FOR_OWNERS(owner, todo, see_owner(&seen, mine, in, index, at, corner_light),
               see_lanes(&seen, todo, in, owner, at, corner_light));
    colors3 color = times_texel(seen.color, &seen.texels, in);
#if LIT
    color = radiance_of(color, &seen.surface, in->image->light_unit);
#endif
    return color;
}

#define LIGHT_PARAMETERS , global const real4 *corner_light  // (F + C) x 3, from gouraud_corners
#define LIGHT_ARGUMENTS , corner_light
#include "tile.clh"

ITEM_BY_ITEM kernel void gouraud(SURFACE_PARAMETERS, TILE_PARAMETERS LIGHT_PARAMETERS)
{
    Inputs in = SURFACE_ARGUMENTS;
    draw_tiles(&in, TILE_ARGUMENTS LIGHT_ARGUMENTS);
}
#endif
