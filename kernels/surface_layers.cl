// Layers of the surface at each pixel's sample nearest the center: normal, position, color, texture coordinates,
// barycentric coordinates. Never averaged over samples.
#include "surface.clh"
#include "samples.clh"
#include "layer_blocks.clh"
#if LAYER_AO
#include "ambient_occlusion.clh"
#endif

// The layers asked for (clshade/pipeline/layer_buffers.py).
#if !defined(LAYER_N) || !defined(LAYER_P) || !defined(LAYER_ALBEDO) || !defined(LAYER_UV)
#error "a layer is not defined"
#endif
#if !defined(LAYER_BARYCENTRICS) || !defined(LAYER_SCALAR) || !defined(LAYER_AO) || !defined(MIRRORED)
#error "a layer, or whether placements mirror, is not defined"
#endif

// The layers at the pixels of a block, where there is no triangle NAN_POSITION for the scalar and 0 for the rest. The normal
// is not yet of unit length.
typedef struct {
    reals3 normal, point;
#if LAYER_N && HAS_TANGENTS
    reals3 tangent;
    reals across, factor;
    Texels turned;
#endif
    colors3 albedo;
    Texels texels;
    reals u, v;
    reals3 weights;
    reals scalar, open;
} Shown;

// Weights in the mesh's order of corners: if a placement mirrors, the renderer has swapped the last two. Rounding may
// leave one of them below 0.
void put_weights(reals3 *target, ints mine, Weights m, int turned)
{
    reals zero = (reals)(0.0f), last = fmax(m.b2, zero), middle = fmax(m.b1, zero);
    reals3 all = {fmax((1.0f - m.b1) - m.b2, zero), turned ? last : middle, turned ? middle : last};
    put_vector(target, mine, all);
}

// Sets the lanes in `mine`, which triangle t owns.
INLINE void show_owner(Shown *shown, ints mine, const Inputs *in, global const Triangle *t, int2 at,
                       global const int *mirrored, global const real *scalars)
{
    int face = t->face, triangle = (int)(t - in->triangles);
    Weights m = weights_at(t, in->pieces, at, PERSPECTIVE);
#if LAYER_N
    real side = side_of(in, t);
    put_vector(&shown->normal, mine,
               mix_vectors(m, side * corner_normal(in, triangle, face, 0), side * corner_normal(in, triangle, face, 1),
                           side * corner_normal(in, triangle, face, 2)));
#if HAS_TANGENTS
    real4 t0 = corner_tangent(in, triangle, face, 0), t1 = corner_tangent(in, triangle, face, 1);
    real4 t2 = corner_tangent(in, triangle, face, 2);
    put_vector(&shown->tangent, mine, mix_vectors(m, side * t0, side * t1, side * t2));
    shown->across = where(mine, side * bitangent_side((reals)(t0.w), (reals)(t1.w), (reals)(t2.w)), shown->across);
    shown->factor = where(mine, (reals)(material_of(in, face)->map_factors[MAP_NORMAL]), shown->factor);
    put_texels(&shown->turned, mine, in, t, at, MAP_NORMAL);
#endif
#endif
#if LAYER_P
    // In perspective, like depth, with any interpolation of attributes: the visible point.
    Weights p = weights_at(t, in->pieces, at, !ORTHOGRAPHIC);
    put_vector(&shown->point, mine, mix_vectors(p, corner_point(in, triangle, face, 0), corner_point(in, triangle, face, 1),
                                                corner_point(in, triangle, face, 2)));
#endif
#if LAYER_ALBEDO
#if VERTEX_COLORS || CORNER_COLORS
    real4 c0 = in->colors[color_index(in, face, 0)], c1 = in->colors[color_index(in, face, 1)];
    real4 c2 = in->colors[color_index(in, face, 2)];
    reals3 mixed = mix_vectors(m, c0, c1, c2);
    colors3 color = {mixed.x, mixed.y, mixed.z};
#if HAS_POSITIONS
    color = times_map_color(color, weigh(m, c0.w, c1.w, c2.w), in);
#endif
    put_color(&shown->albedo, mine, color);
#else
    colors3 white = {(reals)(1.0f), (reals)(1.0f), (reals)(1.0f)};
    put_color(&shown->albedo, mine, white);
#endif
    put_texels(&shown->texels, mine, in, t, at, MAP_COLOR);
#endif
#if LAYER_UV
    Mapped uv = uv_at(in, t, at, 0);
    shown->u = where(mine, uv.u.high + uv.u.low, shown->u);
    shown->v = where(mine, uv.v.high + uv.v.low, shown->v);
#endif
#if LAYER_SCALAR
    global const real *s = scalars + 3 * face;
    shown->scalar = where(mine, weigh(m, s[0], s[1], s[2]), shown->scalar);
#endif
#if LAYER_BARYCENTRICS
#if MIRRORED
    put_weights(&shown->weights, mine, m, mirrored[face]);
#else
    put_weights(&shown->weights, mine, m, 0);
#endif
#endif
}

// The layers of a block whose first pixel is sampled at `at`.
Shown show_block(const Inputs *in, ints owner, int2 at, global const int *mirrored, global const real *scalars)
{
    Shown shown;
    shown.u = shown.v = (reals)(0.0f);
    shown.normal.x = shown.normal.y = shown.normal.z = (reals)(0.0f);
    shown.point = shown.weights = shown.normal;
    shown.albedo.r = shown.albedo.g = shown.albedo.b = (reals)(0.0f);
    shown.scalar = (reals)((real)NAN_POSITION);
    shown.texels = no_texels();
#if LAYER_N && HAS_TANGENTS
    shown.tangent = shown.normal;
    shown.across = shown.factor = (reals)(0.0f);
    shown.turned = no_texels();
#endif
    for (ints todo = owner >= 0, mine; any_lane(todo); todo = todo & !mine) {
        int index = next_owner(owner, todo, &mine);
        show_owner(&shown, mine, in, in->triangles + index, at, mirrored, scalars);
    }
#if LAYER_AO
    ShadingInput input;
    see_receivers(&input, in, owner, at);
    reals open = unoccluded_share(&input.receiver, input.facing, in, light_shift(at, in->image), owner >= 0);
    shown.open = owner >= 0 ? open : (reals)(0.0f);
#endif
    return shown;
}

// The output arrays; layers not asked for are not written.
typedef struct {
    global real *normals;         // M x N x 3, unit or 0, world axes
    global real *points;          // M x N x 3, relative to the eye, world axes, scaled
    global real *albedos;         // M x N x 3, linear RGB
    global real *coordinates;     // M x N x 2, the mesh's u and v
    global real *weights;         // M x N x 3, of the face's corners
    global real *scalars;         // M x N, as the table of scalars
    global real *open;            // M x N, the share of the rays of ambient occlusion that meet nothing
} LayerOutputs;

#define LAYER_PARAMETERS                                                                                           \
    global real *to_normals, global real *to_points, global real *to_albedos, global real *to_coordinates,         \
        global real *to_weights, global real *to_scalars, global real *to_open
#define LAYER_ARGUMENTS {to_normals, to_points, to_albedos, to_coordinates, to_weights, to_scalars, to_open}

void write_shown(const LayerOutputs *to, const Shown *shown, const Inputs *in, const LayerBlock *block)
{
#if LAYER_N
    reals3 normal = shown->normal;
#if HAS_TANGENTS
    if (any_lane(shown->turned.textured)) {
        colors3 texel = texel_colors(&shown->turned, in);
        reals across = shown->turned.textured ? shown->across : (reals)(0.0f);
        normal = turned_normal(normal, shown->tangent, across, texel, shown->factor);
    }
#endif
    write_components(to->normals, 3, normalize_or_zero(normal), block);
#endif
#if LAYER_P
    write_components(to->points, 3, shown->point, block);
#endif
#if LAYER_ALBEDO
    colors3 albedo = saturate_color(times_texel(shown->albedo, &shown->texels, in));
    reals3 color = {albedo.r, albedo.g, albedo.b};
    write_components(to->albedos, 3, color, block);
#endif
#if LAYER_UV
    reals3 uv = {shown->u, shown->v, shown->v};
    write_components(to->coordinates, 2, uv, block);
#endif
#if LAYER_BARYCENTRICS
    write_components(to->weights, 3, shown->weights, block);
#endif
#if LAYER_SCALAR
    write_numbers(to->scalars, shown->scalar, block);
#endif
#if LAYER_AO
    write_numbers(to->open, shown->open, block);
#endif
}

#if HAS_EMPTY_TILES
// The layers of a tile without any triangle.
void clear_layers(const LayerOutputs *to, const LayerBlock *tile)
{
#if LAYER_N
    clear_layer(to->normals, 3, 0.0f, tile);
#endif
#if LAYER_P
    clear_layer(to->points, 3, 0.0f, tile);
#endif
#if LAYER_ALBEDO
    clear_layer(to->albedos, 3, 0.0f, tile);
#endif
#if LAYER_UV
    clear_layer(to->coordinates, 2, 0.0f, tile);
#endif
#if LAYER_BARYCENTRICS
    clear_layer(to->weights, 3, 0.0f, tile);
#endif
#if LAYER_SCALAR
    clear_layer(to->scalars, 1, (real)NAN_POSITION, tile);
#endif
#if LAYER_AO
    clear_layer(to->open, 1, 0.0f, tile);
#endif
}
#endif

// A work-item does a tile, or with several ITEMS_PER_TILE a block of it.
ITEM_BY_ITEM
kernel void surface_layers(SURFACE_PARAMETERS,
                           global const int *owners,      // M x N, from the pixel stage
                           global const int *mirrored,    // F, whether the face's placement mirrors; with MIRRORED
                           global const real *scalars,    // F x 3, scaled, NAN_POSITION for none; with LAYER_SCALAR
                           LAYER_PARAMETERS)
{
    Inputs inputs = SURFACE_ARGUMENTS;
    LayerOutputs outputs = LAYER_ARGUMENTS;
    const Inputs *in = &inputs;
    int tile = get_global_id(0) / ITEMS_PER_TILE, item = get_global_id(0) % ITEMS_PER_TILE;
    int left = tile % image->tiles_x * TILE_SIZE, bottom = tile / image->tiles_x * TILE_SIZE;
#if HAS_EMPTY_TILES
    if (is_empty_tile(owners, image, left, bottom)) {
        LayerBlock whole = layer_block(image, left, bottom);
        clear_layers(&outputs, &whole);
        return;
    }
#endif
    for (int i = 0; i < BLOCKS_PER_ITEM; ++i) {
        int block = item * BLOCKS_PER_ITEM + i;
        int column = left + block % BLOCKS_X * BLOCK_WIDTH, row = bottom + block / BLOCKS_X * BLOCK_HEIGHT;
        if (column >= image->columns || row >= image->rows)
            continue;
        LayerBlock pixels = layer_block(image, column, row);
        ints owner = owners_in(owners, &pixels);
        Shown shown = show_block(in, owner, sample_at(image, 0, column, row), mirrored, scalars);
        write_shown(&outputs, &shown, in, &pixels);
    }
}
