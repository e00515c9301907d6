// Triangle setup for faces and for the pieces of clipped ones, with sort keys. Faces to clip are left to the host.
#include "corners.clh"
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

#if FP64 || DEPTH_TEST
// The depth by which a face is sorted: that of its nearest corner, or in painter's order the mean of all.
depth_t depth_of_face(global const Vertex *a, global const Vertex *b, global const Vertex *c)
{
#if DEPTH_TEST
    return LEAST_OF_TWO(LEAST_OF_TWO(DEPTH_OF(a->depth), DEPTH_OF(b->depth)), DEPTH_OF(c->depth));
#else
    return ((a->depth + b->depth) + c->depth) / 3.0;
#endif
}
#endif

// The mask of lanes whose back faces are culled.
fixeds front_only_lanes(const int *face, global const int *face_materials, global const Material *materials,
                        global const Image *image)
{
    if (NEEDS(image, CULL))
        return (fixeds)(-1);
    if (!NEEDS(image, SIDES))
        return (fixeds)(0);
    int front_only[LANES];
    for (int lane = 0; lane < LANES; ++lane)
        front_only[lane] = materials[face_materials[face[lane]]].front_only;
    return LOAD_LANES(front_only) != 0;
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

// Writes the triangles of the lanes in `seen` at index[lane]. piece: of the first lane, WHOLE_FACE for faces.
void write_triangles(const Corners *t, fixeds seen, const int *index, const int *face, int piece,
                     global Triangle *triangles, global Bounds *bounds)
{
    int visible[LANES], left[LANES], bottom[LANES], right[LANES], top[LANES], turn[LANES], x[3][LANES], y[3][LANES];
    real inverse_area[LANES], nearest[LANES], only[LANES];
    real w[3][LANES];
    for (int k = 0; k < 3; ++k) {
        STORE_LANES(t->x[k], x[k]);
        STORE_LANES(t->y[k], y[k]);
        STORE_LANES(t->w[k], w[k]);
    }
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
        Triangle triangle = {{x[0][lane], x[1][lane], x[2][lane]},
                             {y[0][lane], y[1][lane], y[2][lane]},
                             {w[0][lane], w[1][lane], w[2][lane]},
                             2 * (piece < 0 ? piece : piece + lane) + (turn[lane] < 0), face[lane], inverse_area[lane]};
        ulong box = left[lane] | bottom[lane] << 16 | (ulong)(right[lane] | top[lane] << 16) << 32;
        Bounds reach = {box, nearest[lane], only[lane]};
        triangles[index[lane]] = triangle;
        bounds[index[lane]] = reach;
    }
}

// The corners of faces by the vertices of each lane, and which lie behind the near plane: project and place leave their w as 0.
INLINE Corners corners_at(global const Vertex *vertices, int vertex[3][LANES], fixeds *behind)
{
    Corners t;
    for (int k = 0; k < 3; ++k) {
#if HAS_ROWS
#define ROW(lane) load4((global const float *)&vertices[vertex[k][lane]].x)
        reals4 corner = transposed(ROWS(ROW, 0), ROWS(ROW, 1), ROWS(ROW, 2), ROWS(ROW, 3));
#undef ROW
        t.x[k] = AS_INTS(corner.x);
        t.y[k] = AS_INTS(corner.y);
        t.w[k] = corner.z;
#else
        int x[LANES], y[LANES];
        real w[LANES];
        for (int lane = 0; lane < LANES; ++lane) {
            global const Vertex *corner = vertices + vertex[k][lane];
            x[lane] = corner->x;
            y[lane] = corner->y;
            w[lane] = corner->w;
        }
        t.x[k] = LOAD_LANES(x);
        t.y[k] = LOAD_LANES(y);
        t.w[k] = LOAD_LANES(w);
#endif
        behind[k] = TO_FIXEDS(t.w[k] == 0.0f);
    }
    return t;
}

INLINE Corners corners_of_faces(global const int *faces, global const Vertex *vertices, const int *face, fixeds *behind)
{
    int vertex[3][LANES];
    for (int k = 0; k < 3; ++k)
        for (int lane = 0; lane < LANES; ++lane)
            vertex[k][lane] = faces[3 * face[lane] + k];
    return corners_at(vertices, vertex, behind);
}

// Completes the `asked` faces that lie before the near plane and not beside the image. Returns which may be visible; `cut`
// becomes those that cross that plane or the guard band. behind: of each corner, whether it lies behind the plane.
INLINE fixeds see_faces(Corners *t, fixeds asked, const fixeds *behind, const int *face, global const int *face_materials,
                        global const Material *materials, global const Image *image, Culled *culled, fixeds *cut)
{
    int right_end = image->columns << SUBPIXEL_BITS, top_end = image->rows << SUBPIXEL_BITS;
    fixeds left = MIN3(t->x), right = MAX3(t->x), bottom = MIN3(t->y), top = MAX3(t->y);
    fixeds any_behind = (behind[0] | behind[1]) | behind[2], all_behind = (behind[0] & behind[1]) & behind[2];
    COUNT(culled->behind, asked & all_behind);
    asked = asked & !all_behind;
    fixeds beside = !any_behind & (((right < 0) | (top < 0)) | ((left > right_end) | (bottom > top_end)));
    fixeds far = ((left == -SNAP_LIMIT) | (right == SNAP_LIMIT)) | ((bottom == -SNAP_LIMIT) | (top == SNAP_LIMIT));
    if (NEEDS(image, LINES))
        beside = beside & !far;  // its pieces may hide what is seen of a line, somewhat beside the image too
    COUNT(culled->off_screen, asked & beside);
    asked = asked & !beside;
    *cut = asked & (any_behind | far);
    asked = asked & !*cut;
    if (!any_lane(TO_INTS(asked)))
        return asked;
    return complete(t, asked, front_only_lanes(face, face_materials, materials, image), image, culled);
}

// Appends the faces of the lanes in `cut` to those that the host clips.
INLINE void list_to_clip(fixeds cut, const int *face, global int *to_clip, global Counters *counters)
{
    if (any_lane(TO_INTS(cut))) {
        int crossing[LANES];
        STORE_LANES(cut, crossing);
        for (int lane = 0; lane < LANES; ++lane)
            if (crossing[lane])
                to_clip[atomic_inc(&counters->to_clip)] = face[lane];
    }
}

// A work-item processes SETUP_RUN faces, LANES at a time, and appends their keys in one block: the sort orders all keys.
ITEM_BY_ITEM
kernel void setup(global const int *faces,         // F x 3, vertices
                  global const Vertex *vertices,   // V, from project
                  global const int *face_materials,    // F, with SIDES
                  global const Material *materials,    // with SIDES
                  global const ulong *mean_depths,     // F, from the host: float64 bits; without FP64 and DEPTH_TEST
                  global const Image *image,       // 1
                  global Triangle *triangles,      // F, written for visible faces
                  global Bounds *bounds,           // F, likewise
                  global ulong *keys,              // at least F, the first counters->visible are written
                  global int *to_clip,             // F, the first counters->to_clip are written: faces
                  global Counters *counters,       // 1
                  int index_bits,                  // of the keys
                  int count)                       // F
{
    int first = get_global_id(0) * SETUP_RUN;
    int end = min(first + SETUP_RUN, count);
    ulong own_keys[SETUP_RUN];
    int own_count = 0;
    Culled culled = {(fixeds)(0)};
    for (int group = first; group < end; group += LANES) {
        int face[LANES];
        for (int lane = 0; lane < LANES; ++lane)
            face[lane] = min(group + lane, end - 1);
        fixeds behind[3], cut;
        Corners t = corners_of_faces(faces, vertices, face, behind);
        fixeds asked = group + LANE_INDEX < end;
        fixeds seen = see_faces(&t, asked, behind, face, face_materials, materials, image, &culled, &cut);
        list_to_clip(cut, face, to_clip, counters);
        if (!any_lane(TO_INTS(seen)))
            continue;
        write_triangles(&t, seen, face, face, WHOLE_FACE, triangles, bounds);
        int visible[LANES];
        STORE_LANES(seen, visible);
        for (int lane = 0; lane < LANES; ++lane) {
            if (!visible[lane])
                continue;
#if FP64 || DEPTH_TEST
            global const int *v = faces + 3 * face[lane];
            ulong order = ORDER_OF(depth_of_face(vertices + v[0], vertices + v[1], vertices + v[2]));
#else
            ulong order = depth_order(mean_depths[face[lane]]);
#endif
            own_keys[own_count++] = sort_key(order, face[lane], index_bits);
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
                         int index_bits,               // of the keys
                         int count)                    // C
{
    int first = get_global_id(0) * LANES;
    if (first >= count)
        return;
    int face[LANES], index[LANES], x[3][LANES], y[3][LANES];
    real w[3][LANES];
    for (int lane = 0; lane < LANES; ++lane) {
        int i = min(first + lane, count - 1);
        global const Piece *piece = pieces + i;
        face[lane] = piece->face;
        index[lane] = face_count + i;
        for (int k = 0; k < 3; ++k) {
            x[k][lane] = piece->x[k];
            y[k][lane] = piece->y[k];
            w[k][lane] = piece->w[k];
        }
    }
    Corners t;
    for (int k = 0; k < 3; ++k) {
        t.x[k] = LOAD_LANES(x[k]);
        t.y[k] = LOAD_LANES(y[k]);
        t.w[k] = LOAD_LANES(w[k]);
    }
    Culled culled = {(fixeds)(0)};
    fixeds front_only = front_only_lanes(face, face_materials, materials, image);
    fixeds seen = complete(&t, first + LANE_INDEX < count, front_only, image, &culled);
    write_triangles(&t, seen, index, face, first, triangles, bounds);
    int visible[LANES];
    STORE_LANES(seen, visible);
    for (int lane = 0; lane < LANES; ++lane)
        if (visible[lane])
            keys[atomic_inc(&counters->visible)] =
                sort_key(ORDER_OF(DEPTH_OF(pieces[first + lane].key_depth)), index[lane], index_bits);
    add_culled(counters, &culled);
}

#if HAS_ROWS
// Stores the triangles of the lanes in `seen` from slot `first` on, and counts their tiles. Returns how many there are.
INLINE int store_and_count(const Corners *t, fixeds seen, const int *face, int first, global Triangle *triangles,
                           global Bounds *bounds, global uint *counts, global const Image *image)
{
    StoredRows box, row[3];
    int visible[LANES], made = 0;
    store_rows(&box, AS_REALS(t->left | t->bottom << 16), AS_REALS(t->right | t->top << 16), MOST(t->w), t->only);
    store_rows(row, AS_REALS(t->x[0]), AS_REALS(t->x[1]), AS_REALS(t->x[2]), AS_REALS(t->y[0]));
    store_rows(row + 1, AS_REALS(t->y[1]), AS_REALS(t->y[2]), t->w[0], t->w[1]);
    fixeds piece_and_turn = (fixeds)(2 * WHOLE_FACE) + (t->turn < 0 ? (fixeds)(1) : (fixeds)(0));
    store_rows(row + 2, t->w[2], AS_REALS(piece_and_turn), AS_REALS(LOAD_LANES(face)), t->inverse_area);
    STORE_LANES(seen & 1, visible);
#if HAS_NEAR_TILES
    int slot_of[LANES];
    NearTiles near = near_tiles(t->left, t->bottom, t->right, t->top, seen, image);
#endif
    for (int lane = 0; lane < LANES; ++lane) {
        int slot = first + made;  // what a lane that is not seen writes, the next one overwrites, or nobody reads
        global float4 *to = (global float4 *)(triangles + slot);
        to[0] = stored_row(row, lane);
        to[1] = stored_row(row + 1, lane);
        to[2] = stored_row(row + 2, lane);
        ((global float4 *)bounds)[slot] = stored_row(&box, lane);
#if HAS_NEAR_TILES
        slot_of[lane] = slot;
        counts[near.tile[0][lane]] += 1;
#else
        if (visible[lane])
            count_tiles(counts, bounds[slot], triangles + slot, image);
#endif
        made += visible[lane];
    }
#if HAS_NEAR_TILES
    for (ulong todo = (near.touched & ~FIRST_TILES) | spread_bits(near.wide); todo; todo &= todo - 1) {
        int i = LOWEST_BIT(todo), lane = i >> 2, slot = slot_of[lane];
        if (near.wide >> lane & 1)
            count_tiles(counts, bounds[slot], triangles + slot, image);
        else
            counts[near.tile[i & 3][lane]] += 1;
    }
#endif
    return made;
}

// As setup, for chunks of faces, a multiple of LANES each: a chunk's triangles lie one behind the other from its first face's
// slot on, in the order of faces, and are counted into the tiles. There are no keys: the depth test decides. Buffers of
// triangles have room for LANES more.
ITEM_BY_ITEM
kernel void setup_count(global const int *faces,         // F x 3, vertices
                        global const Vertex *vertices,   // V, from project
                        global const int *face_materials,    // F, with SIDES
                        global const Material *materials,    // with SIDES
                        global const Image *image,       // 1
                        global Triangle *triangles,      // F + LANES
                        global Bounds *bounds,           // F + LANES
                        global uint *made,               // chunks: the triangles of each
                        global uint *counts,             // chunks x (tiles + 1): the entries of each tile
                        global int *to_clip,             // F, the first counters->to_clip are written: faces
                        global Counters *counters,       // 1
                        int chunk_size, int count)       // F
{
    int chunk = get_global_id(0), first = chunk * chunk_size, end = min(first + chunk_size, count), own_count = 0;
    global uint *own = counts + (long)chunk * TILE_COUNTS(image);
    for (int tile = 0; tile < TILE_COUNTS(image); ++tile)
        own[tile] = 0;
    Culled culled = {(fixeds)(0)};
    for (int group = first; group < end; group += LANES) {
        int face[LANES];
        for (int lane = 0; lane < LANES; ++lane)
            face[lane] = min(group + lane, end - 1);
        fixeds behind[3], cut;
        Corners t = corners_of_faces(faces, vertices, face, behind);
        fixeds asked = group + LANE_INDEX < end;
        fixeds seen = see_faces(&t, asked, behind, face, face_materials, materials, image, &culled, &cut);
        list_to_clip(cut, face, to_clip, counters);
        if (!any_lane(TO_INTS(seen)))
            continue;
        own_count += store_and_count(&t, seen, face, first + own_count, triangles, bounds, own, image);
    }
    made[chunk] = own_count;
    if (own_count)
        atomic_add(&counters->visible, own_count);
    add_culled(counters, &culled);
}
#endif
