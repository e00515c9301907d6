// Shading at the pixels, by Phong's model or the metallic-roughness model: the normal is interpolated and each owned pixel lit once.
#include "tile.clh"

#if PHONG
ITEM_BY_ITEM
kernel void phong(SURFACE_PARAMETERS, TILE_PARAMETERS)
{
    Inputs in = SURFACE_ARGUMENTS;
    draw_tiles(&in, TILE_ARGUMENTS);
}
#elif PBR
ITEM_BY_ITEM
kernel void pbr(SURFACE_PARAMETERS, TILE_PARAMETERS)
{
    Inputs in = SURFACE_ARGUMENTS;
    draw_tiles(&in, TILE_ARGUMENTS);
}
#endif
