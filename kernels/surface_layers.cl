// The layers of LAYER_BITS (clshade/pipeline/struct_layout.py) at each pixel's sample nearest the center, never a mean.
#include "surface.clh"
#include "samples.clh"
#include "layer_blocks.clh"
#if CASTERS
#include "ambient_occlusion.clh"
#endif

// The layers at the pixels of a block, by name, of which those of fewer components use the first; their background where
// there is no triangle. Besides, what N and albedo are made of.
typedef struct {
    LAYER_VALUES
    reals3 tangent;
    reals across, factor;
    Texels turned, texels;
    int shows_turned, shows_texels;  // whether normals are turned by maps, and albedo has a texture
} Shown;

// Weights in the mesh's order of corners: if a placement mirrors, the renderer has swapped the last two. Rounding may
// leave one of them below 0.
void put_weights(reals3 *target, ints mine, Weights m, int turned)
{
    reals zero = (reals)(0.0f), last = fmax(m.b2, zero), middle = fmax(m.b1, zero);
    reals3 all = {fmax((1.0f - m.b1) - m.b2, zero), turned ? last : middle, turned ? middle : last};
    put_vector(target, mine, all);
}

// Sets the lanes in `mine`, which triangle t owns. requested: the layers, a bit each.
INLINE void show_owner(Shown *shown, ints mine, const Inputs *in, global const Triangle *t, Places at, int requested,
                       global const int *mirrored, global const real *scalars)
{
    int face = t->face, triangle = (int)(t - in->triangles);
    Weights m = weights_at(t, in->pieces, at, NEEDS(in, PERSPECTIVE), 0);
    if (requested & LAYER_N) {
        real side = side_of(in, t);
        put_vector(&shown->N, mine,
                   mix_vectors(m, side * corner_normal(in, triangle, face, 0), side * corner_normal(in, triangle, face, 1),
                               side * corner_normal(in, triangle, face, 2)));
        if (shown->shows_turned) {
            real4 t0 = corner_tangent(in, triangle, face, 0), t1 = corner_tangent(in, triangle, face, 1);
            real4 t2 = corner_tangent(in, triangle, face, 2);
            put_vector(&shown->tangent, mine, mix_vectors(m, side * t0, side * t1, side * t2));
            shown->across = where(mine, side * bitangent_side((reals)(t0.w), (reals)(t1.w), (reals)(t2.w)), shown->across);
            shown->factor = where(mine, (reals)(material_of(in, face)->map_factors[MAP_NORMAL]), shown->factor);
            put_texels(&shown->turned, mine, in, t, at, MAP_NORMAL);
        }
    }
    if (requested & LAYER_P) {
        // In perspective, like depth, with any interpolation of attributes: the visible point.
        Weights p = weights_at(t, in->pieces, at, !NEEDS(in, ORTHOGRAPHIC), 0);
        put_vector(&shown->P, mine,
                   mix_vectors(p, corner_point(in, triangle, face, 0), corner_point(in, triangle, face, 1),
                               corner_point(in, triangle, face, 2)));
    }
    if (requested & LAYER_ALBEDO) {
        reals3 albedo = gray((reals)(1.0f));
        if (shows_colors(in)) {
            real4 c0 = in->colors[color_index(in, face, 0)], c1 = in->colors[color_index(in, face, 1)];
            real4 c2 = in->colors[color_index(in, face, 2)];
            albedo = mix_vectors(m, c0, c1, c2);
            if (shows_scalars(in))
                albedo = times_map_color(albedo, weigh(m, c0.w, c1.w, c2.w), in);
        }
        put_vector(&shown->albedo, mine, albedo);
        if (shown->shows_texels)
            put_texels(&shown->texels, mine, in, t, at, MAP_COLOR);
    }
    if (requested & LAYER_UV) {
        Mapped uv = uv_at(in, t, at, 0);
        shown->uv.x = where(mine, uv.u.high + uv.u.low, shown->uv.x);
        shown->uv.y = where(mine, uv.v.high + uv.v.low, shown->uv.y);
    }
    if (requested & LAYER_SCALAR) {
        global const real *s = scalars + 3 * face;
        shown->scalar.x = where(mine, weigh(m, s[0], s[1], s[2]), shown->scalar.x);
    }
    if (requested & LAYER_BARYCENTRICS)
        put_weights(&shown->barycentrics, mine, m, requested & MIRRORED ? mirrored[face] : 0);
}

// Completes the layers of a block: normals of unit length, colors with their texels.
INLINE void finish_shown(Shown *shown, const Inputs *in, int requested)
{
    if (requested & LAYER_N) {
        if (shown->shows_turned && any_lane(shown->turned.textured)) {
            reals3 texel = texel_colors(&shown->turned, in, NEEDS(in, MIPMAPS));
            reals across = shown->turned.textured ? shown->across : (reals)(0.0f);
            shown->N = turned_normal(shown->N, shown->tangent, across, texel, shown->factor);
        }
        shown->N = normalize_or_zero(shown->N);
    }
    if (requested & LAYER_ALBEDO) {
        if (shown->shows_texels && any_lane(shown->texels.textured))
            shown->albedo = times_texel(shown->albedo, shown->texels.textured,
                                        texel_colors(&shown->texels, in, NEEDS(in, MIPMAPS)));
        shown->albedo = saturate_color(shown->albedo);
    }
}

// The layers of a block that is sampled at these places.
Shown show_block(const Inputs *in, ints owner, Places at, int requested, global const int *mirrored, global const real *scalars)
{
    Shown shown;
#define START(name, bit, components, background) shown.name.x = shown.name.y = shown.name.z = (reals)((real)background);
    FOR_LAYERS(START)
#undef START
    shown.shows_turned = (requested & LAYER_N) && NEEDS(in, NORMAL_MAP);
    shown.shows_texels = (requested & LAYER_ALBEDO) && NEEDS(in, TEXTURED);
    if (shown.shows_texels)
        shown.texels = no_texels(NEEDS(in, MIPMAPS));
    if (shown.shows_turned) {
        shown.turned = no_texels(NEEDS(in, MIPMAPS));
        shown.tangent = shown.N;
        shown.across = shown.factor = (reals)(0.0f);
    }
    for (ints todo = owner >= 0, mine; any_lane(todo); todo = todo & !mine) {
        int index = next_owner(owner, todo, &mine);
        show_owner(&shown, mine, in, in->triangles + index, at, requested, mirrored, scalars);
    }
#if CASTERS
    if (requested & LAYER_AO) {
        ShadingInput input;
        see_receivers(&input, in, owner, at);
        input.shift = light_shift(at, in->image);
        reals open = unoccluded_share(&input, in, owner >= 0);
        shown.AO.x = owner >= 0 ? open : (reals)(0.0f);
    }
#endif
    finish_shown(&shown, in, requested);
    return shown;
}

#define WRITE(name, bit, components, background)                                                                         \
    if (requested & bit)                                                                                                     \
        write_components(to_##name, components, shown.name, &pixels);
#define CLEAR(name, bit, components, background)                                                                         \
    if (requested & bit)                                                                                                     \
        clear_layer(to_##name, components, (real)background, &whole);

// The output arrays are M x N x components; layers not requested are not written. N is of unit length or 0, P relative to the
// eye and scaled, both along the world's axes; the scalar is as in its table. A work-item does a tile, or with several
// ITEMS_PER_TILE a block of it.
ITEM_BY_ITEM
kernel void surface_layers(SURFACE_PARAMETERS,
                           global const int *owners,      // M x N, from the pixel stage
                           global const int *mirrored,    // F, whether the face's placement mirrors; with MIRRORED
                           global const real *scalars,    // F x 3, scaled, NAN_POSITION for none; with LAYER_SCALAR
                           LAYER_PARAMETERS,
                           int requested)                     // the layers, and whether placements mirror, a bit each
{
    Inputs inputs = SURFACE_ARGUMENTS;
    const Inputs *in = &inputs;
    int tile = get_global_id(0) / ITEMS_PER_TILE, item = get_global_id(0) % ITEMS_PER_TILE;
    int left = tile % image->tiles_x * TILE_SIZE, bottom = tile / image->tiles_x * TILE_SIZE;
#if HAS_EMPTY_TILES
    if (is_empty_tile(owners, image, left, bottom)) {
        LayerBlock whole = layer_block(image, left, bottom);
        FOR_LAYERS(CLEAR)
        return;
    }
#endif
    for (int i = 0; i < BLOCKS_PER_ITEM; ++i) {
        int block = item * BLOCKS_PER_ITEM + i;
        int column = left + block % BLOCKS_X * BLOCK_WIDTH, row = bottom + block / BLOCKS_X * BLOCK_HEIGHT;
        LayerBlock pixels = layer_block(image, column, row);
        ints owner = owners_in(owners, &pixels);
        Shown shown = show_block(in, owner, places_at(sample_at(image, 0, column, row)), requested, mirrored, scalars);
        FOR_LAYERS(WRITE)
    }
}
