// Triangle setup for faces and for the pieces of clipped ones, with sort keys. Faces to clip are left to the host.
#include "corners.clh"

// A depth as an unsigned integer of the same order.
ulong depth_order(ulong bits)
{
    bits = bits << 1 ? bits : 0;  // -0.0 is 0.0
    return (bits >> 63) ? ~bits : bits | (1UL << 63);
}

// Depths in comparable form: a device without float64, where they are stored as its bits, compares their order.
#if FP64
typedef double depth_t;
#define DEPTH_OF(stored) (stored)
#define ORDER_OF(depth) depth_order(as_ulong(depth))
#else
typedef ulong depth_t;
#define DEPTH_OF(stored) depth_order(stored)
#define ORDER_OF(depth) (depth)
#endif

// A depth's order with the low KEY_INDEX_BITS replaced by the complement of the triangle's index: the smallest key is the
// nearest triangle and, of equal ones, the latest. The host resolves what the dropped bits decide.
ulong sort_key(ulong order, int index)
{
    ulong index_bits = (1UL << KEY_INDEX_BITS) - 1;
    return (order & ~index_bits) | (index_bits - (ulong)index);
}

// The mask of lanes whose back faces are culled.
fixeds front_only_lanes(const int *face, global const int *face_materials, global const Material *materials)
{
#if SIDES && !CULL
    int front_only[LANES];
    for (int lane = 0; lane < LANES; ++lane)
        front_only[lane] = materials[face_materials[face[lane]]].front_only;
    return LOAD_LANES(front_only) != 0;
#else
    return (fixeds)(CULL) != 0;
#endif
}

Culled nothing_culled()
{
    fixeds none = (fixeds)(0);
    Culled culled = {none, none, none, none, none};
    return culled;
}

#define ADD_LANES(counter, lanes)                   \
    do {                                            \
        int sum = lanes_sum(TO_INTS(lanes));        \
        if (sum)                                    \
            atomic_add(&counters->counter, sum);    \
    } while (0)

void add_culled(global Counters *counters, const Culled *culled)
{
    ADD_LANES(behind, culled->behind);
    ADD_LANES(off_screen, culled->off_screen);
    ADD_LANES(between_samples, culled->between_samples);
    ADD_LANES(zero_area, culled->zero_area);
    ADD_LANES(back_facing, culled->back_facing);
}

#define WHOLE_FACE (-1)

// The corners of LANES triangles, in arrays.
typedef struct {
    int x[3][LANES], y[3][LANES];
    real w[3][LANES];
} Rows;

Corners corners_of(const Rows *rows)
{
    Corners t;
    for (int k = 0; k < 3; ++k) {
        t.x[k] = LOAD_LANES(rows->x[k]);
        t.y[k] = LOAD_LANES(rows->y[k]);
        t.w[k] = LOAD_LANES(rows->w[k]);
    }
    return t;
}

// Writes the triangles of the lanes in `seen` at index[lane]. piece: of the first lane, WHOLE_FACE for faces.
void write_triangles(const Rows *rows, const Corners *t, fixeds seen, const int *index, const int *face, int piece,
                     global Triangle *triangles, global Bounds *bounds)
{
    int visible[LANES], left[LANES], bottom[LANES], right[LANES], top[LANES], turn[LANES];
    real inverse_area[LANES], nearest[LANES], only[LANES];
    STORE_LANES(seen, visible);
    STORE_LANES(t->left, left);
    STORE_LANES(t->bottom, bottom);
    STORE_LANES(t->right, right);
    STORE_LANES(t->top, top);
    STORE_LANES(t->turn, turn);
    STORE_LANES(t->inverse_area, inverse_area);
    STORE_LANES(MOST(t->w), nearest);
    STORE_LANES(t->only, only);
    for (int lane = 0; lane < LANES; ++lane) {
        if (!visible[lane])
            continue;
        Triangle triangle = {{rows->x[0][lane], rows->x[1][lane], rows->x[2][lane]},
                             {rows->y[0][lane], rows->y[1][lane], rows->y[2][lane]},
                             {rows->w[0][lane], rows->w[1][lane], rows->w[2][lane]},
                             piece < 0 ? piece : piece + lane, turn[lane], face[lane], inverse_area[lane]};
        ulong box = left[lane] | bottom[lane] << 16 | (ulong)(right[lane] | top[lane] << 16) << 32;
        Bounds reach = {box, nearest[lane], only[lane]};
        triangles[index[lane]] = triangle;
        bounds[index[lane]] = reach;
    }
}

// A work-item processes SETUP_RUN faces, LANES at a time, and appends their keys in one block; the sort makes the order of
// blocks irrelevant.
ITEM_BY_ITEM
kernel void setup(global const int *faces,         // F x 3, vertices
                  global const Vertex *vertices,   // V, from project
                  global const int *face_materials,    // F, with SIDES
                  global const Material *materials,    // with SIDES
                  global const ulong *mean_depths,     // F, from the host: float64 bits; without FP64 and DEPTH_TEST
                  global const View *view,         // 1
                  global const Image *image,       // 1
                  global Triangle *triangles,      // F, written for visible faces
                  global Bounds *bounds,           // F, likewise
                  global ulong *keys,              // at least F, the first counters->visible are written
                  global int *to_clip,             // F, the first counters->to_clip are written: faces
                  global Counters *counters,       // 1
                  int count)                       // F
{
    int first = get_global_id(0) * SETUP_RUN;
    int end = min(first + SETUP_RUN, count);
    ulong own_keys[SETUP_RUN];
    int own_count = 0;
    Culled culled = nothing_culled();
    depth_t near = DEPTH_OF(view->near);
    int right_end = image->columns << SUBPIXEL_BITS, top_end = image->rows << SUBPIXEL_BITS;
    for (int group = first; group < end; group += LANES) {
        Rows rows;
        depth_t nearest[LANES];
        int face[LANES], behind_count[LANES];
        for (int lane = 0; lane < LANES; ++lane) {
            face[lane] = min(group + lane, end - 1);
            global const int *corners = faces + 3 * face[lane];
            int behind = 0;
            for (int k = 0; k < 3; ++k) {
                global const Vertex *at = vertices + corners[k];
                rows.x[k][lane] = at->x;
                rows.y[k][lane] = at->y;
                rows.w[k][lane] = at->w;
                depth_t depth = DEPTH_OF(at->depth);
                behind += depth < near;
                nearest[lane] = (k == 0 || depth < nearest[lane]) ? depth : nearest[lane];
            }
            behind_count[lane] = behind;
        }
        Corners t = corners_of(&rows);
        fixeds left = MIN3(t.x), right = MAX3(t.x), bottom = MIN3(t.y), top = MAX3(t.y);
        fixeds asked = group + LANE_INDEX < end, behind = LOAD_LANES(behind_count);
        COUNT(culled.behind, asked & (behind == 3));
        asked = asked & (behind != 3);
        fixeds beside = (behind == 0) & (((right < 0) | (top < 0)) | ((left > right_end) | (bottom > top_end)));
        COUNT(culled.off_screen, asked & beside);
        asked = asked & !beside;
        fixeds far = ((left == -SNAP_LIMIT) | (right == SNAP_LIMIT)) | ((bottom == -SNAP_LIMIT) | (top == SNAP_LIMIT));
        fixeds cut = asked & ((behind != 0) | far);
        asked = asked & !cut;
        if (any_lane(TO_INTS(cut))) {
            int crossing[LANES];
            STORE_LANES(cut, crossing);
            for (int lane = 0; lane < LANES; ++lane)
                if (crossing[lane])
                    to_clip[atomic_inc(&counters->to_clip)] = face[lane];
        }
        if (!any_lane(TO_INTS(asked)))
            continue;
        fixeds seen = complete(&t, asked, front_only_lanes(face, face_materials, materials), image, &culled);
        write_triangles(&rows, &t, seen, face, face, WHOLE_FACE, triangles, bounds);
        int visible[LANES];
        STORE_LANES(seen, visible);
        for (int lane = 0; lane < LANES; ++lane) {
            if (!visible[lane])
                continue;
#if DEPTH_TEST
            ulong order = ORDER_OF(nearest[lane]);
#elif FP64
            global const int *v = faces + 3 * face[lane];
            ulong order = ORDER_OF(((vertices[v[0]].depth + vertices[v[1]].depth) + vertices[v[2]].depth) / 3.0);
#else
            ulong order = depth_order(mean_depths[face[lane]]);
#endif
            own_keys[own_count++] = sort_key(order, face[lane]);
        }
    }
    if (own_count) {
        int at = atomic_add(&counters->visible, own_count);
        for (int i = 0; i < own_count; ++i)
            keys[at + i] = own_keys[i];
    }
    add_culled(counters, &culled);
}

// The same for the pieces of clipped faces, which follow the faces in `triangles`.
ITEM_BY_ITEM
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
    int first = get_global_id(0) * LANES;
    if (first >= count)
        return;
    Rows rows;
    int face[LANES], index[LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        int i = min(first + lane, count - 1);
        global const Piece *piece = pieces + i;
        face[lane] = piece->face;
        index[lane] = face_count + i;
        for (int k = 0; k < 3; ++k) {
            rows.x[k][lane] = piece->x[k];
            rows.y[k][lane] = piece->y[k];
            rows.w[k][lane] = piece->w[k];
        }
    }
    Corners t = corners_of(&rows);
    Culled culled = nothing_culled();
    fixeds front_only = front_only_lanes(face, face_materials, materials);
    fixeds seen = complete(&t, first + LANE_INDEX < count, front_only, image, &culled);
    write_triangles(&rows, &t, seen, index, face, first, triangles, bounds);
    int visible[LANES];
    STORE_LANES(seen, visible);
    for (int lane = 0; lane < LANES; ++lane)
        if (visible[lane])
            keys[atomic_inc(&counters->visible)] =
                sort_key(ORDER_OF(DEPTH_OF(pieces[first + lane].key_depth)), index[lane]);
    add_culled(counters, &culled);
}
