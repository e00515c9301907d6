// Phong shading: the normal is interpolated and each owned pixel lit once.
#include "tile.clh"

#if PHONG
ITEM_BY_ITEM
kernel void phong(SURFACE_PARAMETERS, TILE_PARAMETERS)
{
    Inputs in = SURFACE_ARGUMENTS;
    draw_tiles(&in, TILE_ARGUMENTS);
}
#endif
