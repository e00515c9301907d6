// Phong shading: the normal is interpolated, each owned pixel lit once.
#include "fill.clh"

#if PHONG
colors3 light_block(const Inputs *in, ints owner, int2 at)
{
    reals3 point = {0.0f, 0.0f, 0.0f}, normal = {0.0f, 0.0f, 0.0f};
    colors3 color = {1.0f, 1.0f, 1.0f};
    Surface surface = surface_of(in->materials);
    Texels texels = no_texels();
    ints todo = (owner != NOBODY) & (OWNERS_DIFFER ? -1 : 0);
    while (any_lane(todo)) {
        ints mine;
        global const Triangle *t = in->triangles + next_owner(owner, todo, &mine);
        todo = todo & !mine;
        int face = t->face;
        Weights m = weights_at(t, in->pieces, at, PERSPECTIVE);
#if DIFFUSE || SPECULAR
        real side = side_of(in, t);
        put_vector(&normal, mine,
                   mix_vectors(m, side * in->normals[normal_index(in, face, 0)],
                               side * in->normals[normal_index(in, face, 1)],
                               side * in->normals[normal_index(in, face, 2)]));
        global const int *v = in->faces + 3 * face;
#if CENTROID
        real4 centroid = centroid_of(in, face);
        put_vector(&point, mine, mix_vectors(m, centroid, centroid, centroid));
#else
        put_vector(&point, mine, mix_vectors(m, in->relative[v[0]], in->relative[v[1]], in->relative[v[2]]));
#endif
#endif
#if VERTEX_COLORS || CORNER_COLORS
        put_color(&color, mine,
                  mix_vectors(m, in->colors[color_index(in, face, 0)], in->colors[color_index(in, face, 1)],
                              in->colors[color_index(in, face, 2)]));
#endif
#if MATERIALS
        put_surface(&surface, mine, material_of(in, face));
#endif
        put_texels(&texels, mine, in, t, at);
    }
    color = times_texel(color, &texels, in);
#if LIT
    colors3 lit = shade(point, normalize_or_zero(normal), color, surface, in->lights, in->image->lights,
                        in->image->to_eye);
    lit = radiance_of(lit, &surface, in->image->light_unit);
    ints unlit = (ints)(-in->image->unlit);
    WHERE(!unlit, color.r, lit.r);
    WHERE(!unlit, color.g, lit.g);
    WHERE(!unlit, color.b, lit.b);
#endif
    return color;
}

#define LIGHT_PARAMETERS
#define LIGHT_ARGUMENTS
#include "tile.clh"

ITEM_BY_ITEM kernel void phong(SURFACE_PARAMETERS, TILE_PARAMETERS)
{
    Inputs in = SURFACE_ARGUMENTS;
    draw_tiles(&in, TILE_ARGUMENTS);
}
#endif
