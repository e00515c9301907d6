// The metallic-roughness model: the normal is interpolated and each owned pixel lit once.
#include "tile.clh"

#if PBR
ITEM_BY_ITEM
kernel void pbr(SURFACE_PARAMETERS, TILE_PARAMETERS)
{
    Inputs in = SURFACE_ARGUMENTS;
    draw_tiles(&in, TILE_ARGUMENTS);
}
#endif
