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
    colors3 color;
    real r[LANES], g[LANES], b[LANES], u[LANES], v[LANES], u_low[LANES], v_low[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        int i = min(first + lane, count - 1);
        u[lane] = uvs[i].x, v[lane] = uvs[i].y;
        u_low[lane] = uvs[i].z, v_low[lane] = uvs[i].w;
    }
    double_single across = {LOAD_LANES(u), LOAD_LANES(u_low)}, down = {LOAD_LANES(v), LOAD_LANES(v_low)};
    for (int lane = 0; lane < LANES && first + lane < count; ++lane) {
        int texture = texture_of[first + lane];
        if (texture != last_taken) {
            color = fetch(footprint_of(textures + texture, across, down), texels);
            STORE_LANES(color.r, r);
            STORE_LANES(color.g, g);
            STORE_LANES(color.b, b);
            last_taken = texture;
        }
        colors[first + lane] = (real4)(r[lane], g[lane], b[lane], 0.0f);
    }
}
