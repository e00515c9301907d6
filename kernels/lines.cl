// Lines along edges: at which samples of each pixel one shows. A sample belongs to a line if it is at most half the width
// away from it, in exact integers. The line shows there if no triangle hides it at the point of it that is nearest to the
// sample, in float64: a triangle, not of the edge, that covers the point and is nearer, by more than snapping its corners
// can account for.
//
// Triangles and lines are listed by square cells of the image and of a margin around it as wide as a line reaches. A list's
// order depends on the run, but whether any line shows, and any triangle hides, does not.
#include "projection.clh"
#include "samples.clh"

#if FP64
#define ROUNDED_TWICE (1.0 + 0x1p-8)  // 1/256 px and 1/65536 px, in 1/256 px
#define COVER_SLACK 0x1p-12   // 1/256 px by which triangles reach further: points on a common side belong to one at least
#define MOST_HIDERS 24
#define EQUAL_DEPTH 0x1p-40  // relative difference of 1/depths up to which they count as equal

// Lines, and the triangles that hide them, lie on the samples' grid: a snapped position in 1/256 px, halves up.
#define ON_LINE_GRID(x) (((x) + (1 << (SUBPIXEL_BITS - SAMPLE_BITS - 1))) >> (SUBPIXEL_BITS - SAMPLE_BITS))

// A triangle that hides lines.
typedef struct {
    int x[3], y[3];
    double w[3];  // 1/depth
    int face, turn;
    long area;  // twice its area
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

// Face `index`, or a clipped piece, without w. Returns 0 for faces that are drawn as pieces, or not at all.
INLINE int hiding_triangle(HidingTriangle *t, int index, HIDING_PARAMETERS)
{
    global const Piece *piece = index < face_count ? 0 : pieces + (index - face_count);
    t->face = piece ? piece->face : index;
    for (int k = 0; k < 3; ++k) {
        global const Vertex *v = piece ? 0 : vertices + faces[3 * index + k];
        int x = v ? v->x : piece->x[k], y = v ? v->y : piece->y[k];
        if (v && (v->w == 0.0f || abs(x) == SNAP_LIMIT || abs(y) == SNAP_LIMIT))
            return 0;
        t->x[k] = ON_LINE_GRID(x);
        t->y[k] = ON_LINE_GRID(y);
    }
    long area = (long)(t->x[1] - t->x[0]) * (t->y[2] - t->y[0]) - (long)(t->x[2] - t->x[0]) * (t->y[1] - t->y[0]);
    t->area = area < 0 ? -area : area;
    t->turn = area < 0 ? -1 : 1;
    int front_only = NEEDS(view, CULL) || (NEEDS(view, SIDES) && materials[face_materials[t->face]].front_only);
    return area != 0 && !(front_only && area < 0);
}

INLINE void put_w(HidingTriangle *t, int index, HIDING_PARAMETERS)
{
    global const Piece *piece = index < face_count ? 0 : pieces + (index - face_count);
    for (int k = 0; k < 3; ++k)
        t->w[k] = piece ? (double)piece->w[k] + (double)piece->w_low[k]
                        : inverse_of_depth(vertices[faces[3 * index + k]].depth, view);
}

// Change of the triangle's edge function k with x and y.
INLINE int2 edge_change(const HidingTriangle *t, int k)
{
    int i = NEXT_CORNER(k), j = LAST_CORNER(k);
    return (int2)((t->y[i] - t->y[j]) * t->turn, (t->x[j] - t->x[i]) * t->turn);
}

// The column or row of cells of a position, 1/256 px.
INLINE int cell_at(int units, int cells, global const LineGrid *grid)
{
    return clamp((units >> grid->cell_bits) + grid->margin, 0, cells - 1);
}

// Whether the triangle may cover points of the cell whose lower left corner is at `at`.
INLINE int reaches_cell(const HidingTriangle *t, int2 at, int size)
{
    for (int k = 0; k < 3; ++k) {
        int2 change = edge_change(t, k);
        int i = NEXT_CORNER(k);
        long most = (long)change.x * (at.x + (change.x > 0 ? size + 1 : -1) - t->x[i]) +
                    (long)change.y * (at.y + (change.y > 0 ? size + 1 : -1) - t->y[i]);
        if (most < 0)
            return 0;
    }
    return 1;
}

// Counts triangles into the cells that they may cover; with `writes` puts them into the cells' lists.
ITEM_BY_ITEM
kernel void list_hiders(HIDING_PARAMETERS,
                        global const LineGrid *grid,  // 1
                        global uint *cursors,         // cells: counts, or where the next entry goes
                        global Hider *hiders,         // the lists
                        int writes, int count)        // F + C
{
    int index = get_global_id(0);
    HidingTriangle t;
    if (index >= count || !hiding_triangle(&t, index, HIDING_ARGUMENTS))
        return;
    Hider hider = {0};  // padding too: it is copied
    hider.index = index;
    hider.low[0] = min(min(t.x[0], t.x[1]), t.x[2]) - 1;
    hider.low[1] = min(min(t.y[0], t.y[1]), t.y[2]) - 1;
    hider.high[0] = max(max(t.x[0], t.x[1]), t.x[2]) + 1;
    hider.high[1] = max(max(t.y[0], t.y[1]), t.y[2]) + 1;
#if DEPTH_TEST
    put_w(&t, index, HIDING_ARGUMENTS);
    hider.nearest = fmax(fmax(t.w[0], t.w[1]), t.w[2]);
#else
    hider.nearest = -(double)ranks[t.face];
#endif
    int size = 1 << grid->cell_bits, margin = grid->margin * size;
    int right = grid->across * size - margin, top = grid->up * size - margin;
    if (hider.high[0] < -margin || hider.high[1] < -margin || hider.low[0] > right || hider.low[1] > top)
        return;
    int first_x = cell_at(hider.low[0], grid->across, grid), last_x = cell_at(hider.high[0], grid->across, grid);
    int first_y = cell_at(hider.low[1], grid->up, grid), last_y = cell_at(hider.high[1], grid->up, grid);
    int few = first_x == last_x || first_y == last_y;
    for (int y = first_y; y <= last_y; ++y)
        for (int x = first_x; x <= last_x; ++x) {
            int2 at = ((int2)(x, y) - grid->margin) * size;
            if (!few && !reaches_cell(&t, at, size))
                continue;
            uint slot = atomic_inc(cursors + y * grid->across + x);
            if (writes)
                hiders[slot] = hider;
        }
}

// The same for lines and the cells that they cross.
ITEM_BY_ITEM
kernel void list_lines(global const Line *lines,     // L
                       global const LineGrid *grid,  // 1
                       global uint *cursors,         // cells
                       global uint *listed,          // the lists
                       int writes, int count)        // L
{
    int index = get_global_id(0);
    if (index >= count)
        return;
    Line l = lines[index];
    int first_x = cell_at(min(l.x[0], l.x[1]) - 1, grid->across, grid);
    int last_x = cell_at(max(l.x[0], l.x[1]) + 1, grid->across, grid);
    int first_y = cell_at(min(l.y[0], l.y[1]) - 1, grid->up, grid);
    int last_y = cell_at(max(l.y[0], l.y[1]) + 1, grid->up, grid);
    int size = 1 << grid->cell_bits;
    int2 middle = (int2)(size / 2) - grid->margin * size - (int2)(l.x[0], l.y[0]);
    long dx = l.x[1] - l.x[0], dy = l.y[1] - l.y[0];
    long most = (long)(abs(l.x[1] - l.x[0]) + abs(l.y[1] - l.y[0])) * (size / 2 + 1);
    for (int y = first_y; y <= last_y; ++y)
        for (int x = first_x; x <= last_x; ++x) {
            long across = dx * (y * size + middle.y) - dy * (x * size + middle.x);
            if (across > most || across < -most)
                continue;
            uint slot = atomic_inc(cursors + y * grid->across + x);
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
    ulong ours = across * across, ours_high = mul_hi(across, across);
    ulong most = (ulong)width2 * (ulong)length2, most_high = mul_hi((ulong)width2, (ulong)length2);
    return ours_high < most_high || (ours_high == most_high && ours <= most);
}

// A point of a line.
typedef struct {
    double x, y;  // 1/256 px
    double w;     // 1/depth
} LinePoint;

// The point of a line with length at the fraction t of it.
INLINE LinePoint point_at(const Line *l, double t)
{
    return (LinePoint){l->x[0] + t * (double)(l->x[1] - l->x[0]), l->y[0] + t * (double)(l->y[1] - l->y[0]),
                       l->w[0] + t * (l->w[1] - l->w[0])};
}

INLINE int has_length(const Line *l)
{
    return l->x[0] != l->x[1] || l->y[0] != l->y[1];
}

// The point of the line, less the inset at either end, that is nearest to p; of a line seen end-on the nearer end.
INLINE LinePoint nearest_point(const Line *l, int2 p)
{
    if (!has_length(l))
        return (LinePoint){l->x[0], l->y[0], fmax(l->w[0], l->w[1])};
    long dx = l->x[1] - l->x[0], dy = l->y[1] - l->y[0];
    long along = (p.x - l->x[0]) * dx + (p.y - l->y[0]) * dy, length2 = dx * dx + dy * dy;
    double t = (double)along / (double)length2, last = 1.0 - l->inset;
    t = t < l->inset ? l->inset : t;
    t = t > last ? last : t;
    return point_at(l, t);
}

// The triangle's edge function k at point q, `slacks` times COVER_SLACK further out.
INLINE double edge_value(const HidingTriangle *t, int k, LinePoint q, double slacks)
{
    int2 change = edge_change(t, k);
    int i = NEXT_CORNER(k);
    double a = change.x, b = change.y;
    return (a * (q.x - t->x[i]) + b * (q.y - t->y[i])) + slacks * ((fabs(a) + fabs(b)) * COVER_SLACK);
}

// Above 0 where the triangle is nearer than point q wherever its corners, and the line's ends, were before they were rounded to
// 1/65536 px and then to 1/256 px: by more than it changes over the sum of both to the right and up.
INLINE double lead_at(const HidingTriangle *t, LinePoint q)
{
#if DEPTH_TEST
    double ahead = 0.0, slope_x = 0.0, slope_y = 0.0;
    for (int k = 0; k < 3; ++k) {
        int2 change = edge_change(t, k);
        double nearer = t->w[k] - q.w;
        ahead += edge_value(t, k, q, 0.0) * nearer;
        slope_x += (double)change.x * nearer;
        slope_y += (double)change.y * nearer;
    }
    return ahead - ((fabs(slope_x) + fabs(slope_y)) * ROUNDED_TWICE + (EQUAL_DEPTH * fabs(q.w)) * (double)t->area);
#else
    return 1.0;  // its rank was compared
#endif
}

INLINE int hides(const HidingTriangle *t, LinePoint q)
{
    for (int k = 0; k < 3; ++k)
        if (edge_value(t, k, q, 1.0) < 0.0)
            return 0;
    return lead_at(t, q) > 0.0;
}

// Part of the way between two points, in fractions of it; empty if `to` is less than `from`.
typedef struct {
    double from, to;
} Way;

// Cuts the way to where a linear function with these values at the two points is not negative.
INLINE void cut_way(Way *way, double first, double last)
{
    if (first < 0.0 && last < 0.0)
        way->to = -1.0;
    else if (first < 0.0)
        way->from = fmax(way->from, first / (first - last));
    else if (last < 0.0)
        way->to = fmin(way->to, first / (first - last));
}

// Where the triangle covers the way between two points, made wider by `slacks` times COVER_SLACK.
INLINE Way covered_way(const HidingTriangle *t, const LinePoint *end, double slacks)
{
    Way way = {0.0, 1.0};
    for (int k = 0; k < 3 && way.from <= way.to; ++k)
        cut_way(&way, edge_value(t, k, end[0], slacks), edge_value(t, k, end[1], slacks));
    return way;
}

// The part of a line within a cell, and the triangles that may hide it there.
typedef struct {
    LinePoint end[2];
    global const Hider *hiders;  // the cell's list
    int listed;                  // its length
    HidingTriangle hider[MOST_HIDERS + 1];
    Way hidden[MOST_HIDERS + 1];  // where each certainly hides the part
    int count;                    // of hiders; beyond MOST_HIDERS they are looked up again
} Part;

// Cuts the part from t[0] to t[1] to where position + t * change lies from `low` to `high`.
INLINE void cut_part(double *t, double position, double change, double low, double high)
{
    if (change == 0.0)
        return;
    double a = (low - position) / change, b = (high - position) / change;
    t[0] = fmax(t[0], fmin(a, b));
    t[1] = fmin(t[1], fmax(a, b));
}

// Sets the ends of the part within a cell, 1/256 px more on each side. Returns 0 if there is none.
INLINE int set_ends(Part *part, const Line *l, int2 cell, int size)
{
    if (!has_length(l)) {
        part->end[0] = part->end[1] = nearest_point(l, (int2)(0));
        return 1;
    }
    double t[2] = {l->inset, 1.0 - l->inset};
    cut_part(t, l->x[0], l->x[1] - l->x[0], cell.x - 1, cell.x + size + 1);
    cut_part(t, l->y[0], l->y[1] - l->y[0], cell.y - 1, cell.y + size + 1);
    if (t[0] > t[1])
        return 0;
    part->end[0] = point_at(l, t[0]);
    part->end[1] = point_at(l, t[1]);
    return 1;
}

INLINE int has_face(const Line *l, global const int *edge_faces, int face)
{
    int own = 0;
    for (int k = 0; k < l->faces; ++k)
        own |= edge_faces[l->first_face + k] == face;
    return own;
}

// Finds the triangles of the cell's list that may hide a part. Returns whether they hide all of it.
INLINE int find_hiders(Part *part, const Line *l, global const int *edge_faces, HIDING_PARAMETERS)
{
    double least = fmin(part->end[0].w, part->end[1].w);
    int left = (int)floor(fmin(part->end[0].x, part->end[1].x)), right = (int)floor(fmax(part->end[0].x, part->end[1].x));
    int bottom = (int)floor(fmin(part->end[0].y, part->end[1].y)), top = (int)floor(fmax(part->end[0].y, part->end[1].y));
    double known = 0.0;  // up to here the part is hidden
    part->count = 0;
    for (global const Hider *h = part->hiders; h < part->hiders + part->listed; ++h) {
        if (h->nearest <= least || right < h->low[0] || left > h->high[0] || top < h->low[1] || bottom > h->high[1])
            continue;
        HidingTriangle t;
        hiding_triangle(&t, h->index, HIDING_ARGUMENTS);
        if (has_face(l, edge_faces, t.face))
            continue;
        Way seen = covered_way(&t, part->end, 2.0);
        if (seen.from > seen.to)
            continue;
        put_w(&t, h->index, HIDING_ARGUMENTS);
        // Less than COVER_SLACK, more than rounding: adjacent triangles overlap, and point by point all of it is hidden too.
        Way hidden = covered_way(&t, part->end, 0.5);
        cut_way(&hidden, lead_at(&t, part->end[0]), lead_at(&t, part->end[1]));
#if !DEPTH_TEST
        hidden.to = h->nearest > part->end[0].w ? hidden.to : -1.0;
#endif
        int last = min(part->count++, MOST_HIDERS);
        part->hider[last] = t;
        part->hidden[last] = hidden;
        for (int again = hidden.from <= known && hidden.to > known; again;) {
            again = 0;
            for (int i = 0; i <= last; ++i)
                if (part->hidden[i].from <= known && part->hidden[i].to > known) {
                    known = part->hidden[i].to;
                    again = 1;
                }
        }
        if (known >= 1.0)
            return 1;
    }
    return 0;
}

INLINE int is_hidden(const Part *part, const Line *l, LinePoint q, global const int *edge_faces, HIDING_PARAMETERS)
{
    int kept = part->count <= MOST_HIDERS;
    for (int i = 0; i < (kept ? part->count : part->listed); ++i) {
        HidingTriangle looked_up;
        const HidingTriangle *t = kept ? part->hider + i : &looked_up;
        if (!kept) {
            if (!(part->hiders[i].nearest > q.w))
                continue;
            hiding_triangle(&looked_up, part->hiders[i].index, HIDING_ARGUMENTS);
            put_w(&looked_up, part->hiders[i].index, HIDING_ARGUMENTS);
        }
        if (hides(t, q) && (kept || !has_face(l, edge_faces, t->face)))
            return 1;
    }
    return 0;
}

// Sets the bits of the samples of a pixel that show a line's part in a cell.
INLINE void show_in_pixel(const Part *part, const Line *l, int2 pixel, int cell, global const Image *image,
                          global const LineGrid *grid, global const int *edge_faces, global uint *shown, HIDING_PARAMETERS)
{
    global volatile uint *own =
        shown + 4 * ((long)(image->rows - 1 - pixel.y) * image->columns + pixel.x) + 2 * l->marked;
    for (int from = 0; from < SAMPLE_COUNT(image); from += 32) {
        uint known = own[from / 32];  // others may set bits meanwhile: what they find is then found again
        uint found = 0;
        for (int s = from; s < min(SAMPLE_COUNT(image), from + 32); ++s) {
            int2 p = SAMPLE_STEPS(sample_at(image, s, pixel.x, pixel.y));
            if ((known >> s % 32 & 1) || !covers(l, p, grid->width))
                continue;
            LinePoint q = nearest_point(l, p);
            int x = cell_at((int)floor(q.x), grid->across, grid), y = cell_at((int)floor(q.y), grid->up, grid);
            if (y * grid->across + x == cell && !is_hidden(part, l, q, edge_faces, HIDING_ARGUMENTS))
                found |= 1u << s % 32;
        }
        if (found)
            atomic_or(own + from / 32, found);
    }
}

// A work-group does a cell: those samples whose nearest points of lines lie in it. Its work-items share the lines.
ITEM_BY_ITEM
kernel void line_samples(HIDING_PARAMETERS,
                         global const Image *image,       // 1
                         global const LineGrid *grid,     // 1
                         global const Line *lines,        // L
                         global const int *edge_faces,    // the faces of all edges
                         global const uint *line_starts,  // cells + 1: where their lists begin
                         global const uint *listed,       // lines
                         global const uint *starts,       // cells + 1
                         global const Hider *hiders,
                         global uint *shown)              // M x N x 4, 0 at first, row 0 at the top: the low and the high 32
                                                          // bits of the samples that show a line; and one along an edge of
                                                          // more than two faces
{
    int cell = get_group_id(0);
    int2 at = ((int2)(cell % grid->across, cell / grid->across) - grid->margin) << grid->cell_bits;
    int reach = (grid->width + 1) / 2 + 1;
    Part part;
    part.hiders = hiders + starts[cell];
    part.listed = (int)(starts[cell + 1] - starts[cell]);
    for (uint i = line_starts[cell] + get_local_id(0); i < line_starts[cell + 1]; i += get_local_size(0)) {
        Line l = lines[listed[i]];
        if (!set_ends(&part, &l, at, 1 << grid->cell_bits) || find_hiders(&part, &l, edge_faces, HIDING_ARGUMENTS))
            continue;
        // The pixels that a sample in reach of the part, or beyond the inset, may belong to.
        int2 low = (int2)((int)floor(fmin(part.end[0].x, part.end[1].x)), (int)floor(fmin(part.end[0].y, part.end[1].y)));
        int2 high = (int2)((int)ceil(fmax(part.end[0].x, part.end[1].x)), (int)ceil(fmax(part.end[0].y, part.end[1].y)));
        low = max((low - (reach + LINE_INSET)) >> SAMPLE_BITS, (int2)(0));
        high = min((high + (reach + LINE_INSET)) >> SAMPLE_BITS, (int2)(image->columns, image->rows) - 1);
        long dx = l.x[1] - l.x[0], dy = l.y[1] - l.y[0];
        long most = (long)(abs(l.x[1] - l.x[0]) + abs(l.y[1] - l.y[0])) * (reach + (1 << (SAMPLE_BITS - 1)));
        for (int y = low.y; y <= high.y; ++y)
            for (int x = low.x; x <= high.x; ++x) {
                int2 center = SAMPLE_STEPS(center_of(x, y));
                long across = dx * (center.y - l.y[0]) - dy * (center.x - l.x[0]);
                if (across <= most && across >= -most)
                    show_in_pixel(&part, &l, (int2)(x, y), cell, image, grid, edge_faces, shown, HIDING_ARGUMENTS);
            }
    }
}
#endif
