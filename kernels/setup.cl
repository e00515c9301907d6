// Triangle setup for faces, those of instances too, and for the pieces of clipped ones, with sort keys. Faces to clip are left
// to the host.
#include "corners.clh"
#include "placements.clh"
#include "rows.clh"
#include "tile_walk.clh"

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

// A depth's order with its lowest bits replaced by the complement of the triangle's index: the smallest key is the nearest
// triangle and, of equal ones, the latest. The host resolves what the dropped bits decide.
ulong sort_key(ulong order, int index, int index_bits)
{
    ulong mask = (1UL << index_bits) - 1;
    return (order & ~mask) | (mask - (ulong)index);
}

#define SETUP_PARAMETERS                                                            \
    global const int *face_materials,     /* F, with SIDES */                       \
        global const Material *materials, /* with SIDES */                          \
        global const Image *image,        /* 1 */                                   \
        global Triangle *triangles,       /* room for all, written for visible ones */ \
        global Bounds *bounds,            /* likewise */                            \
        global Counters *counters         /* 1 */
#define SETUP_ARGUMENTS face_materials, materials, image, triangles, bounds, counters
#define FACE_PARAMETERS                                                             \
    global const int *faces,           /* F x 3, vertices */                        \
        global const Vertex *vertices, /* V, from project */                        \
        global int *to_clip,           /* room for all; the faces to clip, counters->to_clip of them */ \
        SETUP_PARAMETERS
#define FACE_ARGUMENTS faces, vertices, to_clip, SETUP_ARGUMENTS

// Faces and their vertices, one in each lane.
typedef struct {
    int face[LANES], vertex[3][LANES];
} Faces;

#if FP64 || DEPTH_TEST
// The depth by which a face is sorted: that of its nearest corner, or in painter's order the mean of all.
depth_t depth_of_face(const Faces *f, int lane, global const Vertex *vertices)
{
    depth_t a = DEPTH_OF(vertices[f->vertex[0][lane]].depth), b = DEPTH_OF(vertices[f->vertex[1][lane]].depth);
    depth_t c = DEPTH_OF(vertices[f->vertex[2][lane]].depth);
#if DEPTH_TEST
    return MIN(MIN(a, b), c);
#else
    return ((a + b) + c) / 3.0;
#endif
}
#endif

// Completes the `active` triangles, with corners by x, y and w. Returns which may be visible.
INLINE fixeds complete_sides(Corners *t, fixeds active, const int *face, Culled *culled, SETUP_PARAMETERS)
{
    fixeds front_only = NEEDS(image, CULL) ? (fixeds)(-1) : (fixeds)(0);
    if (!NEEDS(image, CULL) && NEEDS(image, SIDES)) {
        int own[LANES];
        for (int lane = 0; lane < LANES; ++lane)
            own[lane] = materials[face_materials[face[lane]]].front_only;
        front_only = LOAD_LANES(own) != 0;
    }
    return complete(t, active, front_only, image, culled);
}

void add_culled(global Counters *counters, const Culled *culled)
{
    const fixeds *lanes = &culled->behind;
    for (int i = 0; i < (int)(sizeof(Culled) / sizeof(fixeds)); ++i) {
        int sum = lanes_sum(TO_INTS(lanes[i]));
        if (sum)
            atomic_add(&counters->behind + i, sum);
    }
}

#define WHOLE_FACE (-1)

// Triangles as they lie in memory.
#if HAS_ROWS
typedef struct {
    StoredRows box, row[3];
} Stored;

INLINE Stored stored_triangles(const Corners *t, const int *face, fixeds piece)
{
    Stored s;
    store_rows(&s.box, AS_REALS(t->left | t->bottom << 16), AS_REALS(t->right | t->top << 16), MOST(t->w), (reals)(0.0f));
    store_rows(s.row, AS_REALS(t->x[0]), AS_REALS(t->x[1]), AS_REALS(t->x[2]), AS_REALS(t->y[0]));
    store_rows(s.row + 1, AS_REALS(t->y[1]), AS_REALS(t->y[2]), t->w[0], t->w[1]);
    fixeds piece_and_turn = 2 * piece + (t->turn < 0 ? (fixeds)(1) : (fixeds)(0));
    store_rows(s.row + 2, t->w[2], AS_REALS(piece_and_turn), AS_REALS(LOAD_LANES(face)), t->inverse_area);
    return s;
}

INLINE void write_triangle(const Stored *s, int lane, global Triangle *triangle, global Bounds *bounds)
{
    for (int i = 0; i < 3; ++i)
        ((global float4 *)triangle)[i] = stored_row(s->row + i, lane);
    *(global float4 *)bounds = stored_row(&s->box, lane);
}
#else
typedef struct {
    Triangle triangle[LANES];
    Bounds bounds[LANES];
} Stored;

INLINE Stored stored_triangles(const Corners *t, const int *face, fixeds piece)
{
    Stored s;
    for (int lane = 0; lane < LANES; ++lane) {
        Triangle *triangle = s.triangle + lane;
        for (int k = 0; k < 3; ++k) {
            triangle->x[k] = LANE(int, t->x[k], lane);
            triangle->y[k] = LANE(int, t->y[k], lane);
            triangle->w[k] = LANE(real, t->w[k], lane);
        }
        triangle->piece_and_turn = 2 * LANE(int, piece, lane) + (LANE(int, t->turn, lane) < 0);
        triangle->face = face[lane];
        triangle->inverse_area = LANE(real, t->inverse_area, lane);
        int first = LANE(int, t->left, lane) | LANE(int, t->bottom, lane) << 16;
        int last = LANE(int, t->right, lane) | LANE(int, t->top, lane) << 16;
        Bounds bounds = {first | (ulong)last << 32, MOST(triangle->w), 0.0f};
        s.bounds[lane] = bounds;
    }
    return s;
}

INLINE void write_triangle(const Stored *s, int lane, global Triangle *triangle, global Bounds *bounds)
{
    *triangle = s->triangle[lane];
    *bounds = s->bounds[lane];
}
#endif

// Completes the `active` faces that lie before the near plane and not beside the image. Returns which may be visible; those that
// cross that plane or the guard band are listed to be clipped. instance: of each lane if they are listed with it, else null.
INLINE fixeds cull_faces(Corners *t, const Faces *f, fixeds active, const int *instance, int room, Culled *culled, FACE_PARAMETERS)
{
    fixeds behind[3];  // which corners lie behind the near plane: project and place leave their w as 0
    for (int k = 0; k < 3; ++k) {
#if HAS_ROWS
#define ROW(lane) load4((global const float *)&vertices[f->vertex[k][lane]].x)
        reals4 corner = transposed(ROWS(ROW, 0), ROWS(ROW, 1), ROWS(ROW, 2), ROWS(ROW, 3));
#undef ROW
        t->x[k] = AS_INTS(corner.x);
        t->y[k] = AS_INTS(corner.y);
        t->w[k] = corner.z;
#else
        for (int lane = 0; lane < LANES; ++lane) {
            global const Vertex *corner = vertices + f->vertex[k][lane];
            LANE(int, t->x[k], lane) = corner->x;
            LANE(int, t->y[k], lane) = corner->y;
            LANE(real, t->w[k], lane) = corner->w;
        }
#endif
        behind[k] = TO_FIXEDS(t->w[k] == 0.0f);
    }
    int right_end = image->columns << SUBPIXEL_BITS, top_end = image->rows << SUBPIXEL_BITS;
    fixeds left = MIN3(t->x), right = MAX3(t->x), bottom = MIN3(t->y), top = MAX3(t->y);
    fixeds any_behind = (behind[0] | behind[1]) | behind[2], all_behind = (behind[0] & behind[1]) & behind[2];
    COUNT(culled->behind, active & all_behind);
    active = active & !all_behind;
    fixeds beside = !any_behind & (((right < 0) | (top < 0)) | ((left > right_end) | (bottom > top_end)));
    fixeds far = ((left == -SNAP_LIMIT) | (right == SNAP_LIMIT)) | ((bottom == -SNAP_LIMIT) | (top == SNAP_LIMIT));
    if (NEEDS(image, LINES))
        beside = beside & !far;  // its pieces may hide what is seen of a line, somewhat beside the image too
    COUNT(culled->off_screen, active & beside);
    active = active & !beside;
    fixeds cut = active & (any_behind | far);
    if (any_lane(TO_INTS(cut))) {
        int crossing[LANES];
        STORE_LANES(cut, crossing);
        for (int lane = 0; lane < LANES; ++lane) {
            if (!crossing[lane])
                continue;
            int slot = atomic_inc(&counters->to_clip);
            if (!instance)
                to_clip[slot] = f->face[lane];
            else if (2 * slot + 1 < room) {
                to_clip[2 * slot] = instance[lane];
                to_clip[2 * slot + 1] = f->face[lane];
            }
        }
    }
    active = active & !cut;
    return any_lane(TO_INTS(active)) ? complete_sides(t, active, f->face, culled, SETUP_ARGUMENTS) : active;
}

// Culls faces of a scene, from `first` on and before `end`.
INLINE fixeds cull_run(Corners *t, Faces *f, int first, int end, Culled *culled, FACE_PARAMETERS)
{
    for (int lane = 0; lane < LANES; ++lane) {
        f->face[lane] = min(first + lane, end - 1);
        for (int k = 0; k < 3; ++k)
            f->vertex[k][lane] = faces[3 * f->face[lane] + k];
    }
    return cull_faces(t, f, first + LANE_INDEX < end, 0, 0, culled, FACE_ARGUMENTS);
}

// A work-item processes SETUP_RUN faces, LANES at a time, and appends their keys in one block: the sort orders all keys.
ITEM_BY_ITEM
kernel void setup(FACE_PARAMETERS,
                  global const ulong *mean_depths,  // F, from the host: float64 bits; without FP64 and DEPTH_TEST
                  global ulong *keys,               // at least F, the first counters->visible are written
                  int index_bits,                   // of the keys
                  int count)                        // F
{
    int first = get_global_id(0) * SETUP_RUN, end = min(first + SETUP_RUN, count), own_count = 0;
    ulong own_keys[SETUP_RUN];
    Culled culled = {(fixeds)(0)};
    for (int group = first; group < end; group += LANES) {
        Faces f;
        Corners t;
        fixeds seen = cull_run(&t, &f, group, end, &culled, FACE_ARGUMENTS);
        if (!any_lane(TO_INTS(seen)))
            continue;
        Stored stored = stored_triangles(&t, f.face, (fixeds)(WHOLE_FACE));
        int visible[LANES];
        STORE_LANES(seen, visible);
        for (int lane = 0; lane < LANES; ++lane) {
            int face = f.face[lane];
            if (!visible[lane])
                continue;
            write_triangle(&stored, lane, triangles + face, bounds + face);
#if FP64 || DEPTH_TEST
            ulong order = ORDER_OF(depth_of_face(&f, lane, vertices));
#else
            ulong order = depth_order(mean_depths[face]);
#endif
            own_keys[own_count++] = sort_key(order, face, index_bits);
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
kernel void setup_pieces(SETUP_PARAMETERS,
                         global const Piece *pieces,  // C, from the host
                         global ulong *keys,          // F + C
                         int face_count,              // F
                         int index_bits,              // of the keys
                         int count)                   // C
{
    int first = get_global_id(0) * LANES, face[LANES];
    Corners t;
    for (int lane = 0; lane < LANES; ++lane) {
        global const Piece *piece = pieces + min(first + lane, count - 1);
        face[lane] = piece->face;
        for (int k = 0; k < 3; ++k) {
            LANE(int, t.x[k], lane) = piece->x[k];
            LANE(int, t.y[k], lane) = piece->y[k];
            LANE(real, t.w[k], lane) = piece->w[k];
        }
    }
    Culled culled = {(fixeds)(0)};
    fixeds seen = complete_sides(&t, first + LANE_INDEX < count, face, &culled, SETUP_ARGUMENTS);
    Stored stored = stored_triangles(&t, face, first + LANE_INDEX);
    int visible[LANES];
    STORE_LANES(seen, visible);
    for (int lane = 0; lane < LANES; ++lane) {
        int piece = first + lane, index = face_count + piece;
        if (!visible[lane])
            continue;
        write_triangle(&stored, lane, triangles + index, bounds + index);
        keys[atomic_inc(&counters->visible)] = sort_key(ORDER_OF(DEPTH_OF(pieces[piece].key_depth)), index, index_bits);
    }
    add_culled(counters, &culled);
}

#if HAS_ROWS
// As setup, for chunks of faces, a multiple of LANES each: a chunk's triangles lie one behind the other from its first face's
// slot on, in the order of faces, and are counted into the tiles. There are no keys: the depth test decides. Buffers of
// triangles have room for LANES more.
ITEM_BY_ITEM
kernel void setup_count(FACE_PARAMETERS,
                        global uint *made,           // chunks: the triangles of each
                        global uint *counts,         // chunks x tiles: the entries of each tile
                        int chunk_size, int count)   // F
{
    int chunk = get_global_id(0), first = chunk * chunk_size, end = min(first + chunk_size, count), own_count = 0;
    global uint *own = counts + (long)chunk * image->tiles;
    for (int tile = 0; tile < image->tiles; ++tile)
        own[tile] = 0;
    Culled culled = {(fixeds)(0)};
    for (int group = first; group < end; group += LANES) {
        Faces f;
        Corners t;
        fixeds seen = cull_run(&t, &f, group, end, &culled, FACE_ARGUMENTS);
        if (!any_lane(TO_INTS(seen)))
            continue;
        Stored stored = stored_triangles(&t, f.face, (fixeds)(WHOLE_FACE));
        int visible[LANES], slot[LANES];
        STORE_LANES(seen & 1, visible);
        for (int lane = 0; lane < LANES; ++lane) {
            slot[lane] = first + own_count;  // what a lane that is not seen writes, the next one overwrites, or nobody reads
            write_triangle(&stored, lane, triangles + slot[lane], bounds + slot[lane]);
            own_count += visible[lane];
        }
        NearTiles near = near_tiles(t.left, t.bottom, t.right, t.top, seen, image);
        count_near(own, &near, slot, bounds, triangles, image);
    }
    made[chunk] = own_count;
    if (own_count)
        atomic_add(&counters->visible, own_count);
    add_culled(counters, &culled);
}
#endif

#if INSTANCES
// As setup, for the faces of a block of instances, whose vertices are those from place. The counters count all; what finds no
// room is not written.
ITEM_BY_ITEM
kernel void setup_instances(FACE_PARAMETERS,                     // to_clip: instance and face by turns
                            global const Instance *instances,    // K
                            global const uint *listed,           // L
                            global const long *vertex_starts,    // L + 1
                            global const long *face_starts,      // L + 1
                            global ulong *keys,                  // room
                            global int *triangle_instances,      // room: the instance of each
                            global double *mean_depths,          // room; without DEPTH_TEST
                            int first, int last,                 // of the listed
                            int run, int room,
                            int index_bits)                      // of the keys
{
    long at = face_starts[first] + (long)get_global_id(0) * run, end = min(at + run, face_starts[last]);
    if (at >= end)
        return;
    Culled culled = {(fixeds)(0)};
    int j = instance_at(face_starts, first, last, at);
    for (; at < end; at += LANES) {
        Faces f;
        int number[LANES];
        for (int lane = 0; lane < LANES; ++lane) {
            long own = min(at + lane, end - 1);
            while (face_starts[j + 1] <= own)
                ++j;
            number[lane] = listed[j];
            global const Instance *instance = instances + number[lane];
            f.face[lane] = instance->first_face + (int)(own - face_starts[j]);
            int from = (int)(vertex_starts[j] - vertex_starts[first]) - instance->first_vertex;
            for (int k = 0; k < 3; ++k)
                f.vertex[k][lane] = from + faces[3 * f.face[lane] + k];
        }
        Corners t;
        fixeds seen = cull_faces(&t, &f, LANE_INDEX < (int)(end - at), number, room, &culled, FACE_ARGUMENTS);
        if (!any_lane(TO_INTS(seen)))
            continue;
        Stored stored = stored_triangles(&t, f.face, (fixeds)(WHOLE_FACE));
        int visible[LANES], slot = atomic_add(&counters->visible, lanes_count(TO_INTS(seen)));
        STORE_LANES(seen, visible);
        for (int lane = 0; lane < LANES && slot < room; ++lane) {
            if (!visible[lane])
                continue;
            write_triangle(&stored, lane, triangles + slot, bounds + slot);
            double depth = depth_of_face(&f, lane, vertices);
#if !DEPTH_TEST
            mean_depths[slot] = depth;
#endif
            keys[slot] = sort_key(ORDER_OF(depth), slot, index_bits);
            triangle_instances[slot] = number[lane];
            ++slot;
        }
    }
    add_culled(counters, &culled);
}
#endif
