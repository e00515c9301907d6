// Phong shading: the normal is interpolated and each owned pixel lit once.
#include "fill.clh"
#include "gather.clh"

#if PHONG
// The inputs of shading at the pixels of a block.
typedef struct {
    reals3 point, normal;
    colors3 color;
    Surface surface;
    Texels texels;
} ShadingInput;

// Sets the lanes in `mine`, which triangle t owns.
INLINE void see_owner(ShadingInput *seen, ints mine, const Inputs *in, global const Triangle *t, int2 at)
{
    int face = t->face;
    Weights m = weights_at(t, in->pieces, at, PERSPECTIVE);
#if DIFFUSE || SPECULAR
    real side = side_of(in, t);
    put_vector(&seen->normal, mine,
               mix_vectors(m, side * in->normals[normal_index(in, face, 0)], side * in->normals[normal_index(in, face, 1)],
                           side * in->normals[normal_index(in, face, 2)]));
    global const int *v = in->faces + 3 * face;
#if CENTROID
    real4 centroid = centroid_of(in, face);
    put_vector(&seen->point, mine, mix_vectors(m, centroid, centroid, centroid));
#else
    put_vector(&seen->point, mine, mix_vectors(m, in->relative[v[0]], in->relative[v[1]], in->relative[v[2]]));
#endif
#endif
#if VERTEX_COLORS || CORNER_COLORS
    put_color(&seen->color, mine,
              mix_colors(m, in->colors[color_index(in, face, 0)], in->colors[color_index(in, face, 1)],
                         in->colors[color_index(in, face, 2)]));
#endif
#if MATERIALS
    put_surface(&seen->surface, mine, material_of(in, face));
#endif
    put_texels(&seen->texels, mine, in, t, at);
}

#if GATHERS
// Sets as many of the lanes in `todo` as it can; returns those.
INLINE ints see_lanes(ShadingInput *seen, ints todo, const Inputs *in, ints owner, int2 at)
{
    Gathered t = gather_triangles(in, todo ? owner : (ints)(lane_of(owner, todo)), at);
    ints mine = todo & t.fits;
    Weights m = gathered_weights(&t);
    CornerRows vertex = rows_in(in->faces, t.face);
#if DIFFUSE || SPECULAR
#if NORMAL_INDICES
    CornerRows normal = rows_in(in->normal_faces, t.face);
#else
    CornerRows normal = vertex;
#endif
    put_vector(&seen->normal, mine, mix_gathered(m, in->normals, &normal, gathered_side(in, &t)));
#if CENTROID
    reals4 c0 = gather(in->relative, vertex.row[0]), c1 = gather(in->relative, vertex.row[1]);
    reals4 c2 = gather(in->relative, vertex.row[2]);
    reals3 centroid = {((c0.x + c1.x) + c2.x) / 3.0f, ((c0.y + c1.y) + c2.y) / 3.0f, ((c0.z + c1.z) + c2.z) / 3.0f};
    put_vector(&seen->point, mine, centroid);
#else
    put_vector(&seen->point, mine, mix_gathered(m, in->relative, &vertex, (reals)(1.0f)));
#endif
#endif
#if CORNER_COLORS
    CornerRows color = rows_of(t.face);
    put_color(&seen->color, mine, mix_gathered_colors(m, in->colors, &color));
#elif VERTEX_COLORS
    put_color(&seen->color, mine, mix_gathered_colors(m, in->colors, &vertex));
#endif
    put_surfaces(&seen->surface, mine, in, t.face);
    return mine;
}
#endif

colors3 light_block(const Inputs *in, ints owner, int2 at)
{
    ShadingInput seen;
    seen.point.x = seen.point.y = seen.point.z = (reals)(0.0f);
    seen.normal = seen.point;
    seen.color.r = seen.color.g = seen.color.b = (reals)(1.0f);
    seen.surface = surface_of(in->materials);
    seen.texels = no_texels();
    ints todo = (owner != NOBODY) & (OWNERS_DIFFER ? -1 : 0);
    FOR_OWNERS(owner, todo, see_owner(&seen, mine, in, in->triangles + index, at),
               see_lanes(&seen, todo, in, owner, at));
    colors3 color = times_texel(seen.color, &seen.texels, in);
#if LIT
    colors3 lit = shade(seen.point, normalize_or_zero(seen.normal), color, seen.surface, in->lights, in->image->lights,
                        in->image->to_eye);
    lit = radiance_of(lit, &seen.surface, in->image->light_unit);
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
