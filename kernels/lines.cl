// Lines along edges: at which samples of each pixel one shows. A sample belongs to a line if it is at most half the width
// away from it, in exact integers. The line shows there if no triangle hides it at the point of it that is nearest to the
// sample, in float64: a triangle, not of the edge, that covers the point and is nearer, by more than snapping its corners
// can account for.
//
// Triangles and lines are listed by tile, of the image and of a margin around it as wide as a line reaches. A list's order
// depends on the run, but whether any line shows, and any triangle hides, does not.
#include "samples.clh"

#if FP64
#define TILE_UNITS (TILE_SIZE << SUBPIXEL_BITS)
#define COVER_SLACK 0x1p-12   // 1/256 px by which triangles reach further: points on a common side belong to one at least
#define EQUAL_DEPTH 0x1p-40  // relative difference of 1/depths up to which they count as equal

// A triangle that hides lines.
typedef struct {
    int x[3], y[3];
    double w[3];  // 1/depth
    int face, turn;
} HidingTriangle;

#define HIDING_PARAMETERS                                                                                   \
    global const int *faces,                /* F x 3, vertices */                                           \
        global const Vertex *vertices,      /* V, from project */                                           \
        global const Piece *pieces,         /* C, from the host */                                          \
        global const int *face_materials,   /* F, with SIDES */                                             \
        global const Material *materials,   /* with SIDES */                                                \
        global const int *ranks,            /* F, in painter's order; without DEPTH_TEST */                 \
        global const View *view,            /* 1 */                                                         \
        int face_count                      /* F */
#define HIDING_ARGUMENTS faces, vertices, pieces, face_materials, materials, ranks, view, face_count

// The 1/depth of a vertex, scaled, as project has it.
INLINE double vertex_w(global const Vertex *v, global const View *view)
{
    double depth = v->depth * view->scale;
    depth = depth < MOST_DEPTH ? depth : MOST_DEPTH;
    return ORTHOGRAPHIC ? -depth : 1.0 / depth;
}

// Face `index`, or a clipped piece. Returns 0 for faces that are drawn as pieces, or not at all.
INLINE int hiding_triangle(HidingTriangle *t, int index, HIDING_PARAMETERS)
{
    if (index < face_count) {
        t->face = index;
        for (int k = 0; k < 3; ++k) {
            global const Vertex *v = vertices + faces[3 * index + k];
            if (v->w == 0.0f || abs(v->x) == SNAP_LIMIT || abs(v->y) == SNAP_LIMIT)
                return 0;
            t->x[k] = v->x;
            t->y[k] = v->y;
            t->w[k] = vertex_w(v, view);
        }
    } else {
        global const Piece *piece = pieces + (index - face_count);
        t->face = piece->face;
        for (int k = 0; k < 3; ++k) {
            t->x[k] = piece->x[k];
            t->y[k] = piece->y[k];
            t->w[k] = (double)piece->w[k] + (double)piece->w_low[k];
        }
    }
    long area = (long)(t->x[1] - t->x[0]) * (t->y[2] - t->y[0]) - (long)(t->x[2] - t->x[0]) * (t->y[1] - t->y[0]);
    t->turn = area < 0 ? -1 : 1;
#if SIDES && !CULL
    int front_only = materials[face_materials[t->face]].front_only;
#else
    int front_only = CULL;
#endif
    return area != 0 && !(front_only && area < 0);
}

// Change of the triangle's edge function k with x and y.
INLINE int2 edge_change(const HidingTriangle *t, int k)
{
    int i = NEXT_CORNER(k), j = LAST_CORNER(k);
    return (int2)((t->y[i] - t->y[j]) * t->turn, (t->x[j] - t->x[i]) * t->turn);
}

INLINE int grid_tile(int units, int margin, int tiles)
{
    return clamp((units >> (SUBPIXEL_BITS + TILE_BITS)) + margin, 0, tiles - 1);
}

// Whether the triangle may cover points of the tile whose lower left corner is at `at`.
INLINE int reaches_tile(const HidingTriangle *t, int2 at)
{
    for (int k = 0; k < 3; ++k) {
        int2 change = edge_change(t, k);
        int i = NEXT_CORNER(k);
        long most = (long)change.x * (at.x + (change.x > 0 ? TILE_UNITS + 1 : -1) - t->x[i]) +
                    (long)change.y * (at.y + (change.y > 0 ? TILE_UNITS + 1 : -1) - t->y[i]);
        if (most < 0)
            return 0;
    }
    return 1;
}

// Counts triangles into the tiles that they may cover; with `writes` puts them into the tiles' lists.
ITEM_BY_ITEM
kernel void list_hiders(HIDING_PARAMETERS,
                        global const LineGrid *grid,  // 1
                        global uint *cursors,         // tiles of the grid: counts, or where the next entry goes
                        global Hider *hiders,         // the lists
                        int writes, int count)        // F + C
{
    int index = get_global_id(0);
    HidingTriangle t;
    if (index >= count || !hiding_triangle(&t, index, HIDING_ARGUMENTS))
        return;
    Hider hider;
    hider.index = index;
    hider.low[0] = min(min(t.x[0], t.x[1]), t.x[2]) - 1;
    hider.low[1] = min(min(t.y[0], t.y[1]), t.y[2]) - 1;
    hider.high[0] = max(max(t.x[0], t.x[1]), t.x[2]) + 1;
    hider.high[1] = max(max(t.y[0], t.y[1]), t.y[2]) + 1;
#if DEPTH_TEST
    hider.nearest = fmax(fmax(t.w[0], t.w[1]), t.w[2]);
#else
    hider.nearest = -(double)ranks[t.face];
#endif
    int margin = grid->margin << (SUBPIXEL_BITS + TILE_BITS);
    int right = (grid->across << (SUBPIXEL_BITS + TILE_BITS)) - margin, top = (grid->up << (SUBPIXEL_BITS + TILE_BITS)) - margin;
    if (hider.high[0] < -margin || hider.high[1] < -margin || hider.low[0] > right || hider.low[1] > top)
        return;
    int first_x = grid_tile(hider.low[0], grid->margin, grid->across), last_x = grid_tile(hider.high[0], grid->margin, grid->across);
    int first_y = grid_tile(hider.low[1], grid->margin, grid->up), last_y = grid_tile(hider.high[1], grid->margin, grid->up);
    int few = first_x == last_x || first_y == last_y;
    for (int y = first_y; y <= last_y; ++y)
        for (int x = first_x; x <= last_x; ++x) {
            int2 at = ((int2)(x, y) - grid->margin) * TILE_UNITS;
            if (!few && !reaches_tile(&t, at))
                continue;
            uint slot = atomic_inc(cursors + y * grid->across + x);
            if (writes)
                hiders[slot] = hider;
        }
}

// The same for lines and the tiles of the image that they may reach.
ITEM_BY_ITEM
kernel void list_lines(global const Line *lines,     // L
                       global const Image *image,    // 1
                       global const LineGrid *grid,  // 1
                       global uint *cursors,         // tiles of the image
                       global uint *listed,          // the lists
                       int writes, int count)        // L
{
    int index = get_global_id(0);
    if (index >= count)
        return;
    Line l = lines[index];
    int reach = (grid->width + 1) / 2, rows = image->tiles / image->tiles_x;
    int right = image->columns << SUBPIXEL_BITS, top = image->rows << SUBPIXEL_BITS;
    int low_x = min(l.x[0], l.x[1]) - reach, high_x = max(l.x[0], l.x[1]) + reach;
    int low_y = min(l.y[0], l.y[1]) - reach, high_y = max(l.y[0], l.y[1]) + reach;
    if (high_x < 0 || high_y < 0 || low_x > right || low_y > top)
        return;
    int first_x = grid_tile(low_x, 0, image->tiles_x), last_x = grid_tile(high_x, 0, image->tiles_x);
    int first_y = grid_tile(low_y, 0, rows), last_y = grid_tile(high_y, 0, rows);
    long dx = l.x[1] - l.x[0], dy = l.y[1] - l.y[0];
    long most = (abs(l.x[1] - l.x[0]) + (long)abs(l.y[1] - l.y[0])) * (TILE_UNITS / 2 + reach + 1);
    for (int y = first_y; y <= last_y; ++y)
        for (int x = first_x; x <= last_x; ++x) {
            long across = dx * (y * TILE_UNITS + TILE_UNITS / 2 - l.y[0]) - dy * (x * TILE_UNITS + TILE_UNITS / 2 - l.x[0]);
            if (across > most || across < -most)
                continue;
            uint slot = atomic_inc(cursors + y * image->tiles_x + x);
            if (writes)
                listed[slot] = index;
        }
}

// Whether a line of this width, 1/256 px, covers point p: 4 * distance^2 <= width^2.
INLINE int covers(const Line *l, int2 p, int width)
{
    long dx = l->x[1] - l->x[0], dy = l->y[1] - l->y[0], px = p.x - l->x[0], py = p.y - l->y[0];
    long along = px * dx + py * dy, length2 = dx * dx + dy * dy, width2 = (long)width * width;
    if (along >= length2) {
        px -= dx;
        py -= dy;
    }
    if (along <= 0 || along >= length2)
        return 4 * (px * px + py * py) <= width2;
    // In between the distance is |across| / length. Both sides of the comparison have up to 102 bits.
    long cross_product = px * dy - py * dx;
    ulong across = 2 * (ulong)(cross_product < 0 ? -cross_product : cross_product);
    if (across >> 40)
        return 0;
    ulong ours = across * across, ours_high = mul_hi(across, across);
    ulong most = (ulong)width2 * (ulong)length2, most_high = mul_hi((ulong)width2, (ulong)length2);
    return ours_high < most_high || (ours_high == most_high && ours <= most);
}

// A point of a line.
typedef struct {
    double x, y;  // 1/256 px
    double w;     // 1/depth
} LinePoint;

// The point of the line, less the inset at either end, that is nearest to p.
INLINE LinePoint nearest_point(const Line *l, int2 p)
{
    long dx = l->x[1] - l->x[0], dy = l->y[1] - l->y[0];
    long along = (p.x - l->x[0]) * dx + (p.y - l->y[0]) * dy, length2 = dx * dx + dy * dy;
    LinePoint q = {l->x[0], l->y[0], fmax(l->w[0], l->w[1])};
    if (length2 == 0)
        return q;
    double t = (double)along / (double)length2, last = 1.0 - l->inset;
    t = t < l->inset ? l->inset : t;
    t = t > last ? last : t;
    q.x = l->x[0] + t * (double)dx;
    q.y = l->y[0] + t * (double)dy;
    q.w = l->w[0] + t * (l->w[1] - l->w[0]);
    return q;
}

// Whether the triangle covers point q and is nearer there, wherever within 1/512 px its corners and the line's ends were
// before they were snapped.
INLINE int hides(const HidingTriangle *t, LinePoint q)
{
    double ahead = 0.0, slope_x = 0.0, slope_y = 0.0;
    for (int k = 0; k < 3; ++k) {
        int2 change = edge_change(t, k);
        int i = NEXT_CORNER(k);
        double a = change.x, b = change.y;
        double e = a * (q.x - t->x[i]) + b * (q.y - t->y[i]);
        if (e < -(fabs(a) + fabs(b)) * COVER_SLACK)
            return 0;
        double nearer = t->w[k] - q.w;
        ahead += e * nearer;
        slope_x += a * nearer;
        slope_y += b * nearer;
    }
#if DEPTH_TEST
    long area = (long)(t->x[1] - t->x[0]) * (t->y[2] - t->y[0]) - (long)(t->x[2] - t->x[0]) * (t->y[1] - t->y[0]);
    return ahead > (fabs(slope_x) + fabs(slope_y)) + (EQUAL_DEPTH * fabs(q.w)) * fabs((double)area);
#else
    return 1;  // its rank was compared
#endif
}

INLINE int is_hidden(const Line *l, LinePoint q, global const int *edge_faces, global const LineGrid *grid,
                     global const uint *starts, global const Hider *hiders, HIDING_PARAMETERS)
{
    int x = grid_tile((int)floor(q.x), grid->margin, grid->across), y = grid_tile((int)floor(q.y), grid->margin, grid->up);
    int tile = y * grid->across + x;
    for (uint i = starts[tile]; i < starts[tile + 1]; ++i) {
        global const Hider *h = hiders + i;
        if (h->nearest <= q.w || q.x < h->low[0] || q.x > h->high[0] || q.y < h->low[1] || q.y > h->high[1])
            continue;
        HidingTriangle t;
        hiding_triangle(&t, h->index, HIDING_ARGUMENTS);
        if (!hides(&t, q))
            continue;
        int own = 0;
        for (int k = 0; k < l->faces; ++k)
            own |= edge_faces[l->first_face + k] == t.face;
        if (!own)
            return 1;
    }
    return 0;
}

// A work-group does a tile, a work-item a pixel.
kernel void line_samples(HIDING_PARAMETERS,
                         global const Image *image,       // 1
                         global const LineGrid *grid,     // 1
                         global const Line *lines,        // L
                         global const int *edge_faces,    // the faces of all edges
                         global const uint *line_starts,  // tiles of the image + 1: where their lists begin
                         global const uint *listed,       // lines
                         global const uint *starts,       // tiles of the grid + 1
                         global const Hider *hiders,
                         global ulong2 *shown)            // M x N, row 0 at the top: bit s is set where a line shows at
                                                          // sample s; likewise of lines along edges of more than two faces
{
    int tile = get_group_id(0), item = get_local_id(0);
    int column = tile % image->tiles_x * TILE_SIZE + item % TILE_SIZE;
    int row = tile / image->tiles_x * TILE_SIZE + item / TILE_SIZE;
    if (column >= image->columns || row >= image->rows)
        return;
    ulong found[2] = {0, 0};
    int reach = (grid->width + 1) / 2 + SUBPIXELS;
    int2 center = center_of(column, row);
    for (uint i = line_starts[tile]; i < line_starts[tile + 1]; ++i) {
        Line l = lines[listed[i]];
        if (center.x < min(l.x[0], l.x[1]) - reach || center.x > max(l.x[0], l.x[1]) + reach ||
            center.y < min(l.y[0], l.y[1]) - reach || center.y > max(l.y[0], l.y[1]) + reach)
            continue;
        for (int s = 0; s < SAMPLE_COUNT(image); ++s) {
            int2 p = sample_at(image, s, column, row);
            if ((found[l.marked] >> s & 1) || !covers(&l, p, grid->width))
                continue;
            if (!is_hidden(&l, nearest_point(&l, p), edge_faces, grid, starts, hiders, HIDING_ARGUMENTS))
                found[l.marked] |= 1UL << s;
        }
    }
    shown[(long)(image->rows - 1 - row) * image->columns + column] = (ulong2)(found[0], found[1]);
}
#endif
