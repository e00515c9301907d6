// Texture lookups at given coordinates, such as those at the corners of the faces (texture_at vertex).
#include "texture.clh"

// A work-item does LANES lookups.
ITEM_BY_ITEM
kernel void bilerp(global const real4 *uvs,               // K, u, v and their low parts
                   global const int *texture_of,           // K, texture of each lookup
                   global const Texture *textures,
                   global const float4 *texels,            // of all textures, linear RGB
                   global real4 *colors,                  // K, linear RGB
                   int count)                              // K
{
    int first = get_global_id(0) * LANES;
    int last_taken = -1;
    reals3 color;
    int index[LANES];
    real r[LANES], g[LANES], b[LANES];
    for (int lane = 0; lane < LANES; ++lane)
        index[lane] = min(first + lane, count - 1);
    reals4 uv = gather(uvs, index);
    double_single u = {uv.x, uv.z}, v = {uv.y, uv.w};
    for (int lane = 0; lane < LANES && first + lane < count; ++lane) {
        int texture = texture_of[first + lane];
        if (texture != last_taken) {
            color = fetch(footprint_of(textures + texture, u, v), texels);
            STORE_LANES(color.x, r);
            STORE_LANES(color.y, g);
            STORE_LANES(color.z, b);
            last_taken = texture;
        }
        colors[first + lane] = (real4)(r[lane], g[lane], b[lane], 0.0f);
    }
}
