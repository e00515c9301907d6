// Triangles from snapped corners: area, box, culls, sort keys. Visible ones are listed, crossing ones left to the host.
#include "samples.clh"

// First and last pixel with a sample within snapped [low, high], of samples from `least` to `most`.
int2 samples_within(int low, int high, int least, int most)
{
    return (int2)((low - most + SUBPIXELS - 1) >> SUBPIXEL_BITS, (high - least) >> SUBPIXEL_BITS);
}

// A depth's order as unsigned bits; on a device without float64 the depths are bits already.
#if FP64
#define DEPTH_BITS(depth) as_ulong(depth)
#else
#define DEPTH_BITS(depth) (depth)
#endif

ulong depth_order(ulong bits)
{
    bits = bits << 1 ? bits : 0;  // -0.0 is 0.0
    return (bits >> 63) ? ~bits : bits | (1UL << 63);
}

// That order with the low KEY_INDEX_BITS replaced by the complement of the triangle's index: the smallest key is the
// nearest triangle and, of equal ones, the latest. The host settles what the dropped bits decide.
ulong sort_key(ulong order, int index)
{
    ulong low = (1UL << KEY_INDEX_BITS) - 1;
    return (order & ~low) | (low - (ulong)index);
}

typedef enum { VISIBLE, OFF_SCREEN, BETWEEN_SAMPLES, ZERO_AREA, BACK_FACING } Verdict;

// Whether a triangle that reaches over less than FEW_PIXELS + 1 pixels each way, so that its edge functions fit an int,
// covers a sample of a pixel: the one that lies `at` in the first pixel. Only looked into where its box holds few pixels.
INLINE int may_cover(const Triangle *t, const Bounds *bounds, int2 at)
{
    int columns = bounds->box[2] - bounds->box[0] + 1, rows = bounds->box[3] - bounds->box[1] + 1;
    if (columns * rows > FEW_PIXELS)
        return 1;
    int x0 = t->x[0] - at.x, x1 = t->x[1] - at.x, x2 = t->x[2] - at.x;
    int y0 = t->y[0] - at.y, y1 = t->y[1] - at.y, y2 = t->y[2] - at.y;
    int a0 = (y1 - y2) * t->orientation, a1 = (y2 - y0) * t->orientation, a2 = (y0 - y1) * t->orientation;
    int b0 = (x2 - x1) * t->orientation, b1 = (x0 - x2) * t->orientation, b2 = (x1 - x0) * t->orientation;
    int e0 = (x1 * y2 - x2 * y1) * t->orientation - edge_bias(a0, b0);
    int e1 = (x2 * y0 - x0 * y2) * t->orientation - edge_bias(a1, b1);
    int e2 = (x0 * y1 - x1 * y0) * t->orientation - edge_bias(a2, b2);
    for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column) {
            int dx = column << SUBPIXEL_BITS, dy = row << SUBPIXEL_BITS;
            if (((e0 + a0 * dx + b0 * dy) | (e1 + a1 * dx + b1 * dy) | (e2 + a2 * dx + b2 * dy)) >= 0)
                return 1;
        }
    return 0;
}

// Whether the face is drawn only where it is seen from the front.
int is_front_only(int face, global const int *face_materials, global const Material *materials)
{
#if SIDES
    return CULL || materials[face_materials[face]].front_only;
#else
    return CULL;
#endif
}

// Completes a triangle of which x, y and w are set, and its bounds.
INLINE Verdict complete(Triangle *t, Bounds *bounds, int face, int piece, int front_only, global const Image *image)
{
    long area = (long)(t->x[1] - t->x[0]) * (t->y[2] - t->y[0]) - (long)(t->x[2] - t->x[0]) * (t->y[1] - t->y[0]);
    if (area == 0)
        return ZERO_AREA;
    if (area < 0 && front_only)
        return BACK_FACING;
    int2 across = samples_within(min(min(t->x[0], t->x[1]), t->x[2]), max(max(t->x[0], t->x[1]), t->x[2]),
                                 LEAST_X(image), MOST_X(image));
    int2 up = samples_within(min(min(t->y[0], t->y[1]), t->y[2]), max(max(t->y[0], t->y[1]), t->y[2]),
                             LEAST_Y(image), MOST_Y(image));
    if (across.x > across.y || up.x > up.y)
        return BETWEEN_SAMPLES;
    int small = across.y - across.x < FEW_PIXELS && up.y - up.x < FEW_PIXELS;  // itself, not its part in the image
    across = (int2)(max(across.x, 0), min(across.y, image->columns - 1));
    up = (int2)(max(up.x, 0), min(up.y, image->rows - 1));
    if (across.x > across.y || up.x > up.y)
        return OFF_SCREEN;
    t->orientation = area > 0 ? 1 : -1;
    t->inverse_area = (real)(1 << SUBPIXEL_BITS) / (real)(area > 0 ? area : -area);
    bounds->box[0] = across.x;
    bounds->box[1] = up.x;
    bounds->box[2] = across.y;
    bounds->box[3] = up.y;
    for (int s = 0, seen = !small; !seen; ++s) {
        if (s == SAMPLE_COUNT(image))
            return BETWEEN_SAMPLES;
        seen = may_cover(t, bounds, sample_at(image, s, bounds->box[0], bounds->box[1]));
    }
    bounds->nearest = fmax(fmax(t->w[0], t->w[1]), t->w[2]);
    t->face = face;
    t->piece = piece;
    return VISIBLE;
}

void count_culled(Verdict verdict, Counters *counted)
{
    counted->off_screen += verdict == OFF_SCREEN;
    counted->between_samples += verdict == BETWEEN_SAMPLES;
    counted->zero_area += verdict == ZERO_AREA;
    counted->back_facing += verdict == BACK_FACING;
}

void add_culled(global Counters *counters, Counters counted)
{
    if (counted.behind)
        atomic_add(&counters->behind, counted.behind);
    if (counted.off_screen)
        atomic_add(&counters->off_screen, counted.off_screen);
    if (counted.between_samples)
        atomic_add(&counters->between_samples, counted.between_samples);
    if (counted.zero_area)
        atomic_add(&counters->zero_area, counted.zero_area);
    if (counted.back_facing)
        atomic_add(&counters->back_facing, counted.back_facing);
}

// A work-item takes SETUP_RUN faces and appends their keys in one piece; the sort makes the order of pieces irrelevant.
kernel void setup(global const int *faces,         // F x 3, vertices
                  global const Vertex *vertices,   // V, from project
                  global const int *face_materials,    // F, with SIDES
                  global const Material *materials,    // with SIDES
                  global const ulong *mean_depths,     // F, from the host: float64 bits; without FP64 and DEPTH_TEST
                  global const View *view,         // 1
                  global const Image *image,       // 1
                  global Triangle *triangles,      // F, written for visible faces
                  global Bounds *bounds,           // F, likewise
                  global ulong *keys,              // F and more, the first counters->visible are written
                  global int *to_clip,             // F, the first counters->to_clip are written: faces
                  global Counters *counters,       // 1
                  int count)                       // F
{
    int first = get_global_id(0) * SETUP_RUN;
    int end = min(first + SETUP_RUN, count);
    ulong own_keys[SETUP_RUN];
    Counters counted;
    counted.visible = counted.behind = counted.off_screen = 0;
    counted.between_samples = counted.zero_area = counted.back_facing = 0;
    ulong near = depth_order(DEPTH_BITS(view->near));
    for (int face = first; face < end; ++face) {
        Triangle t;
        Bounds b;
        ulong depth[3];
        int behind = 0;
        for (int k = 0; k < 3; ++k) {
            Vertex at = vertices[faces[3 * face + k]];
            depth[k] = depth_order(DEPTH_BITS(at.depth));
            t.x[k] = at.x;
            t.y[k] = at.y;
            t.w[k] = at.w;
            behind += depth[k] < near;
        }
        int left = min(min(t.x[0], t.x[1]), t.x[2]), right = max(max(t.x[0], t.x[1]), t.x[2]);
        int low = min(min(t.y[0], t.y[1]), t.y[2]), high = max(max(t.y[0], t.y[1]), t.y[2]);
        if (behind == 3) {
            counted.behind += 1;
            continue;
        }
        if (behind == 0 && (right < 0 || high < 0 || left > image->columns << SUBPIXEL_BITS ||
                            low > image->rows << SUBPIXEL_BITS)) {
            counted.off_screen += 1;
            continue;
        }
        if (behind || left == -SNAP_LIMIT || right == SNAP_LIMIT || low == -SNAP_LIMIT || high == SNAP_LIMIT) {
            to_clip[atomic_inc(&counters->to_clip)] = face;
            continue;
        }
        Verdict verdict = complete(&t, &b, face, -1, is_front_only(face, face_materials, materials), image);
        count_culled(verdict, &counted);
        if (verdict != VISIBLE)
            continue;
        b.index = face;
        triangles[face] = t;
        bounds[face] = b;
#if DEPTH_TEST
        ulong order = min(min(depth[0], depth[1]), depth[2]);
#elif FP64
        double z[3];
        for (int k = 0; k < 3; ++k)
            z[k] = vertices[faces[3 * face + k]].depth;
        ulong order = depth_order(DEPTH_BITS(((z[0] + z[1]) + z[2]) / 3.0));
#else
        ulong order = depth_order(mean_depths[face]);
#endif
        own_keys[counted.visible++] = sort_key(order, face);
    }
    if (counted.visible) {
        int at = atomic_add(&counters->visible, counted.visible);
        for (int i = 0; i < counted.visible; ++i)
            keys[at + i] = own_keys[i];
    }
    add_culled(counters, counted);
}

// The same for the pieces of clipped faces, which follow the faces in `triangles`.
kernel void setup_pieces(global const Piece *pieces,   // C, from the host
                         global const int *face_materials,    // F, with SIDES
                         global const Material *materials,    // with SIDES
                         global const Image *image,    // 1
                         global Triangle *triangles,   // F + C
                         global Bounds *bounds,        // F + C
                         global ulong *keys,           // F + C
                         global Counters *counters,    // 1
                         int face_count,               // F
                         int count)                    // C
{
    int i = get_global_id(0);
    if (i >= count)
        return;
    global const Piece *piece = pieces + i;
    Triangle t;
    Bounds b;
    for (int k = 0; k < 3; ++k) {
        t.x[k] = piece->x[k];
        t.y[k] = piece->y[k];
        t.w[k] = piece->w[k];
    }
    Verdict verdict = complete(&t, &b, piece->face, i, is_front_only(piece->face, face_materials, materials), image);
    if (verdict == VISIBLE) {
        b.index = face_count + i;
        triangles[face_count + i] = t;
        bounds[face_count + i] = b;
        keys[atomic_inc(&counters->visible)] = sort_key(depth_order(DEPTH_BITS(piece->key_depth)), face_count + i);
    }
    Counters counted;
    counted.behind = counted.off_screen = counted.between_samples = counted.zero_area = counted.back_facing = 0;
    count_culled(verdict, &counted);
    add_culled(counters, counted);
}
